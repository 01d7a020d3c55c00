// SPDX-License-Identifier: Apache-2.0
// Rows on real captures of other rigs: agreement of two codings, honesty of the sigmas with measured noise, boards measured
// with a calibration from the others, and mistakes in the description that are not detected.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <numeric>
#include <optional>
#include <random>
#include <regex>

#include "bench/row.h"
#include "bench/twin/twin.h"
#include "core/calibrate/camera_noise.h"
#include "core/calibrate/rig_calibration.h"
#include "core/check/conventions.h"
#include "core/decode/decode.h"
#include "core/depth/depth.h"
#include "core/import/import.h"
#include "core/io/files.h"
#include "core/score/local_scatter.h"
#include "core/types/grey_value.h"
#include "core/types/linear_algebra.h"

namespace fringeslam::bench {

namespace fs = std::filesystem;

namespace {

fs::path captures_folder() {
  const char* captures = std::getenv("FRINGESLAM_CAPTURES");
  return captures ? fs::path(captures) : fs::path(FRINGESLAM_SOURCE) / ".." / "shared" / "captures";
}

bool has_captures() {
  if (fs::is_directory(captures_folder() / "skull") && fs::is_directory(captures_folder() / "relief")) return true;
  std::fprintf(stderr, "  skipped: set FRINGESLAM_CAPTURES to the folder that contains skull/ and relief/\n");
  return false;
}

struct Capture {
  std::string description;  // bench/accuracy/captures/NAME.yaml
  fs::path images;          // below the captures
};
const Capture kSkull{"skull_2x3", "skull/skull_2x3"}, kSkullGray{"skull_gray", "skull/skull_gray"},
    kRelief{"relief", "relief"}, kBoards{"boards", "skull/boards"},
    kBoardsCalibrated{"boards_calibrated", "skull/boards"};

fs::path description_file(const Capture& capture) {
  return fs::path(FRINGESLAM_SOURCE) / "bench/accuracy/captures" / (capture.description + ".yaml");
}

std::vector<FringeStack> stacks_of(ImportedRig& rig) {
  std::vector<FringeStack> stacks;
  while (auto stack = rig.capture(rig.sequence())) stacks.push_back(std::move(*stack));
  return stacks;
}

SensorModel measured_noise(const SensorModel& prior, const std::vector<FringeStack>& stacks) {
  NoiseEstimator estimator(prior, {});
  for (const FringeStack& stack : stacks) estimator.add(stack);
  return estimator.estimate().sensor;
}

struct Measurement {
  RigModel rig;
  std::vector<FringeStack> stacks;
};

// Imports a capture with noise that is measured, or that of another capture.
Measurement measured(const Capture& capture, const std::optional<SensorModel>& sensor = std::nullopt) {
  ImportedRig rig(read_import(description_file(capture), captures_folder() / capture.images));
  Measurement result{rig.model(), stacks_of(rig)};
  result.rig.sensor = sensor ? *sensor : measured_noise(rig.model().sensor, result.stacks);
  return result;
}

Frame frame_of(const DecodedStack& decoded, const RigModel& rig) {
  DepthOptions options;
  options.near_m = rig.near_m;
  options.far_m = rig.far_m;
  return reconstruct(decoded, rig, pixel_rays(rig.camera), options);
}

double median_of(std::vector<double> values) {
  if (values.empty()) return std::nan("");
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

// --- wax bowl by micro phase shifting ---

// Projector columns that the authors of the capture published; they count from 1. -1: none.
cv::Mat1f published_columns() {
  cv::Mat1f columns;
  read_grey(captures_folder() / "waxbowl/column_x16.png").convertTo(columns, CV_32F, 1 / 16.0, -1);
  return columns;
}

// They applied a median over 5 x 5 pixels; so does the comparison, where all of these have a column.
std::vector<Row> waxbowl_rows(const Context&) {
  constexpr int kRadius = 2;
  constexpr float kNear_px = 0.5f;
  const fs::path images = captures_folder() / "waxbowl";
  if (!fs::is_directory(images)) {
    std::fprintf(stderr, "  skipped: set FRINGESLAM_CAPTURES to the folder that contains waxbowl/\n");
    return {};
  }
  ImportedRig rig(read_import(description_file({"waxbowl", "waxbowl"}), images));
  const FringeStack stack = *rig.capture(rig.sequence());
  DecodeOptions options;
  options.unwrapping = Unwrapping::micro;
  const cv::Mat1f ours = decode(stack, rig.model(), options).coordinate_px, theirs = published_columns();
  int compared = 0, near = 0, orders = 0, valid = 0, published = 0;
  for (int row = kRadius; row + kRadius < ours.rows; ++row) {
    for (int col = kRadius; col + kRadius < ours.cols; ++col) {
      published += theirs(row, col) >= 0;
      if (theirs(row, col) < 0 || std::isnan(ours(row, col))) continue;
      ++valid;
      orders += std::abs(ours(row, col) - theirs(row, col)) > 10;
      std::vector<double> window;
      for (int y = -kRadius; y <= kRadius; ++y) {
        for (int x = -kRadius; x <= kRadius; ++x) {
          const float column = ours(row + y, col + x);
          if (!std::isnan(column)) window.push_back(static_cast<double>(column));
        }
      }
      if (window.size() < 25) continue;
      ++compared;
      near += std::abs(static_cast<float>(median_of(std::move(window))) - theirs(row, col)) <= kNear_px;
    }
  }
  std::fprintf(stderr, "  %d of their %d pixels have a column; %.1e of them differ by a fringe order\n", valid,
               published, static_cast<double>(orders) / std::max(1, valid));
  return {bound_row("captures.waxbowl", static_cast<double>(near) / std::max(1, compared), compared, "", 0.99,
                    Limit::least)};
}

// --- skull in two codings ---

// The Gray code's cells of 2 px scatter single depths by 0.3 mm; their median does not.

std::vector<Row> skull_rows(const Context&) {
  if (!has_captures()) return {};
  const Measurement fringes = measured(kSkull), gray = measured(kSkullGray, fringes.rig.sensor);
  const DecodedStack by_fringes = decode(fringes.stacks[0], fringes.rig, {}),
                     by_gray = decode(gray.stacks[0], gray.rig, {});
  const Frame a = frame_of(by_fringes, fringes.rig), b = frame_of(by_gray, gray.rig);
  std::vector<double> differences;
  int compared = 0, differing = 0, lit = 0, valid = 0;
  constexpr float kLit = 20;  // brighter under white than under black by more than this, DN
  const double half_period_px = 0.5 * by_fringes.finest_period_px;
  const cv::Mat &white = gray.stacks[0].images[0], &black = gray.stacks[0].images[1];
  for (int row = 0; row < a.height(); ++row) {
    for (int col = 0; col < a.width(); ++col) {
      if (grey_value(white, row, col) - grey_value(black, row, col) > kLit) {
        ++lit;
        valid += a.valid(row, col);
      }
      if (!a.valid(row, col) || !b.valid(row, col)) continue;
      ++compared;
      differing += static_cast<double>(std::abs(by_fringes.coordinate_px(row, col) - by_gray.coordinate_px(row, col))) >
                   half_period_px;
      differences.push_back(1e3 * static_cast<double>(a.points_m(row, col)[2] - b.points_m(row, col)[2]));
    }
  }
  const int n = static_cast<int>(differences.size());
  return {
      bound_row("captures.skull.agree.depth", std::abs(median_of(std::move(differences))), n, "mm", 0.12, Limit::most),
      bound_row("captures.skull.agree.orders", static_cast<double>(differing) / compared, compared, "", 1e-4,
                Limit::most),
      bound_row("captures.skull.valid", static_cast<double>(valid) / lit, lit, "", 0.84, Limit::least)};
}

// --- local scatter over predicted sigma ---

double scatter_ratio(const Frame& frame) {
  cv::Mat1f depth(frame.points_m.size());
  cv::extractChannel(frame.points_m, depth, 2);
  return local_scatter(depth, frame.sigma_m).over_sigma;
}

std::vector<Row> sigma_rows(const Context&) {
  if (!has_captures()) return {};
  std::vector<double> ratios;
  const auto add = [&](const char* name, const Measurement& m, size_t stack) {
    ratios.push_back(scatter_ratio(frame_of(decode(m.stacks[stack], m.rig, {}), m.rig)));
    std::fprintf(stderr, "  %s: scatter / sigma %.3f\n", name, ratios.back());
  };
  const Measurement skull = measured(kSkull);
  add("skull_2x3", skull, 0);
  add("skull_gray", measured(kSkullGray, skull.rig.sensor), 0);
  add("relief", measured(kRelief), 0);
  const Measurement boards = measured(kBoardsCalibrated);
  for (size_t i = 0; i < boards.stacks.size(); ++i) add(("board " + std::to_string(i + 1)).c_str(), boards, i);
  const int n = static_cast<int>(ratios.size());
  return {bound_row("captures.sigma.least", least_of(ratios), n, "x", 0.9, Limit::least),
          bound_row("captures.sigma.greatest", greatest_of(ratios), n, "x", 1.1, Limit::most)};
}

// --- boards left out of the calibration ---

// RMS distance of a board's points from their plane. Points more than 4 robust sigmas away, such as those beside the
// board, do not count.
double plane_rms_m(const Frame& frame, const std::vector<cv::Point2f>& corners) {
  // The plane spanned by the corners' outline.
  float left = 1e9f, right = 0, top = 1e9f, bottom = 0;
  for (const cv::Point2f& c : corners) {
    left = std::min(left, c.x), right = std::max(right, c.x);
    top = std::min(top, c.y), bottom = std::max(bottom, c.y);
  }
  std::vector<Eigen::Vector3d> points;
  for (int row = static_cast<int>(top); row <= static_cast<int>(bottom); row += 2) {
    for (int col = static_cast<int>(left); col <= static_cast<int>(right); col += 2) {
      if (!frame.valid(row, col)) continue;
      const cv::Vec3f& p = frame.points_m(row, col);
      points.emplace_back(p[0], p[1], p[2]);
    }
  }
  double rms = 0, limit = 1e9;
  Eigen::Vector3d center, normal;
  for (int iteration = 0; iteration < 10; ++iteration) {
    std::vector<Eigen::Vector3d> inside;
    for (const Eigen::Vector3d& p : points) {
      if (iteration == 0 || std::abs(normal.dot(p - center)) < limit) inside.push_back(p);
    }
    center.setZero();
    for (const Eigen::Vector3d& p : inside) center += p / static_cast<double>(inside.size());
    Eigen::Matrix3d spread = Eigen::Matrix3d::Zero();
    for (const Eigen::Vector3d& p : inside)
      spread += (p - center) * (p - center).transpose() / static_cast<double>(inside.size());
    const SymmetricEigen<3> eigen = symmetric_eigen(spread);
    normal = eigen.vectors.col(0);
    rms = std::sqrt(std::max(0.0, eigen.values[0]));
    std::vector<double> distances;
    for (const Eigen::Vector3d& p : inside) distances.push_back(std::abs(normal.dot(p - center)));
    limit = 4 * 1.4826 * median_of(std::move(distances));
  }
  return rms;
}

std::vector<Row> board_rows(const Context&) {
  if (!has_captures()) return {};
  const Measurement boards = measured(kBoards);
  const Board board{BoardKind::checkerboard, 9, 13, 0.01, 0};
  std::vector<BoardView> views;
  std::vector<DecodedStack> columns;
  for (const FringeStack& stack : boards.stacks) {
    columns.push_back(decode(stack, boards.rig, {}, {Axis::columns}));
    const DecodedStack rows = decode(stack, boards.rig, {}, {Axis::rows});
    cv::Mat1f texture;
    cv::addWeighted(columns.back().mean, 0.5, rows.mean, 0.5, 0, texture);
    views.push_back(observe_board(
        "board " + std::to_string(stack.index + 1), texture,
        {columns.back().coordinate_px, rows.coordinate_px, columns.back().sigma_px, rows.sigma_px}, board, {}));
  }
  std::vector<double> rms;
  for (size_t i = 0; i < views.size(); ++i) {
    std::vector<BoardView> others = views;
    others.erase(others.begin() + static_cast<std::ptrdiff_t>(i));
    const RigModel rig = calibrate_rig(others, board, boards.rig, {}).rig;
    rms.push_back(1e3 * plane_rms_m(frame_of(columns[i], rig), views[i].corners_px));
    std::fprintf(stderr, "  %s: plane RMS %.3f mm\n", views[i].name.c_str(), rms.back());
  }
  const double mean = std::accumulate(rms.begin(), rms.end(), 0.0) / static_cast<double>(rms.size());
  return {bound_row("captures.boards", mean, static_cast<int>(rms.size()), "mm", 0.22, Limit::most)};
}

// --- digital twins ---

std::vector<Row> twin_rows(const Context&) {
  if (!has_captures()) return {};
  const Measurement skull = measured(kSkull);
  const std::vector<std::pair<std::string, Measurement>> captures = {
      {"skull_2x3", skull}, {"skull_gray", measured(kSkullGray, skull.rig.sensor)}, {"relief", measured(kRelief)}};
  const fs::path folder = fs::temp_directory_path() / ("fringeslam-twin-" + std::to_string(std::random_device{}()));
  std::vector<double> ratios;
  for (const auto& [name, capture] : captures) {
    fs::create_directories(folder);
    const twin::Twin made = twin::make_twin(capture.stacks[0], capture.rig, name, folder, [] {});
    std::fprintf(stderr, "  %s: blur %.2f px\n", name.c_str(), made.rig.projector_lens.blur_px);
    for (const twin::Comparison& c : made.comparisons) {
      std::fprintf(stderr, "  %s, %s: real %.4g, simulated %.4g %s\n", name.c_str(), c.name.c_str(), c.real,
                   c.simulated, c.unit.c_str());
      if (c.name != "phase noise" && c.name != "depth scatter") continue;
      ratios.push_back(c.simulated / c.real);
    }
    fs::remove_all(folder);
  }
  const int n = static_cast<int>(ratios.size());
  return {bound_row("captures.twin.least", least_of(ratios), n, "x", 0.9, Limit::least),
          bound_row("captures.twin.greatest", greatest_of(ratios), n, "x", 1.1, Limit::most)};
}

// --- mistakes ---

struct Mistake {
  const Capture* capture;
  std::string pattern, replacement;  // regular expression on the description's text
};

const std::vector<Mistake>& mistakes() {
  static const std::vector<Mistake> all = {
      {&kSkull, "width_px: 1824", "width_px: 912"},
      {&kSkull, ", shift_sign: -1", ""},
      {&kSkull, "shift_sign: -1", "shift_sign: -1, phase_offset_deg: 30"},
      {&kSkull, "shift_sign: -1", "shift_sign: -1, phase_offset_deg: -45"},
      {&kSkull, "shift_sign: -1", "shift_sign: -1, wave: sin"},
      {&kSkull, ", shift_sign: -1", ", phase_offset_deg: 90"},
      {&kSkull, "number_of_periods: 16", "number_of_periods: 15"},
      {&kSkull, "number_of_periods: 16", "number_of_periods: 17"},
      {&kSkull, "number_of_periods: 16", "number_of_periods: 32"},
      {&kSkull, "number_of_periods: 16", "number_of_periods: 8"},
      {&kSkull, "number_of_periods: 1,", "number_of_periods: 2,"},
      {&kSkull, "projector_from_camera", "camera_from_projector"},
      {&kSkull, "unit_m: 0.001", "unit_m: 0.01"},
      {&kSkull, "axis: columns", "axis: rows"},
      {&kSkull, "1824, height_px: 1140", "1140, height_px: 1824"},
      {&kSkull, "near_m: 0.25\nfar_m: 0.6", "near_m: 0.7\nfar_m: 3"},
      {&kSkull, "camera_matrix: Kc, camera_distortion: kc, projector_matrix: Kp, projector_distortion: kp",
       "camera_matrix: Kp, camera_distortion: kp, projector_matrix: Kc, projector_distortion: kc"},
      {&kRelief, ", phase_offset_deg: 180", ""},
      {&kRelief, "phase_offset_deg: 180", "phase_offset_deg: 150"},
      {&kRelief, "phase_offset_deg: 180", "phase_offset_deg: 180, shift_sign: -1"},
      {&kRelief, "period_px: 60, steps", "period_px: 64, steps"},
      {&kRelief, "bits: 5", "bits: 5, order: lsb_first"},
      {&kRelief, "bits: 5", "bits: 5, bright_is_one: false"},
      {&kRelief, "projector_from_camera", "camera_from_projector"},
      {&kRelief, "unit_m: 0.001", "unit_m: 0.01"},
      {&kRelief, "columns", "rows"},
      {&kRelief, "1920, height_px: 1080", "1280, height_px: 720"},
      {&kRelief, "M1, camera_distortion: D1([^]*)M4([^]*)D4", "M4, camera_distortion: D4$1M1$2D1"},
      {&kSkullGray, "bits: 10", "bits: 10, order: lsb_first"},
      {&kSkullGray, "bits: 10", "bits: 10, bright_is_one: false"},
      {&kSkullGray, "period_px: 2,", "period_px: 4,"},
      {&kSkullGray, "white: true([^]*)black: true", "black: true$1white: true"},
      {&kSkullGray, "axis: columns", "axis: rows"},
      {&kBoards, "(columns[^}]*), shift_sign: -1", "$1"},
      {&kBoards, "(rows[^}]*), shift_sign: -1", "$1"},
      {&kBoards, "number_of_periods: 16", "number_of_periods: 15"},
      {&kBoards, "16, steps: 3, shift_sign: -1", "16, steps: 3, shift_sign: -1, phase_offset_deg: 30"},
      {&kBoardsCalibrated, "width_px: 1824", "width_px: 912"},
      {&kBoardsCalibrated, "projector_from_camera", "camera_from_projector"},
      {&kBoardsCalibrated, "(columns[^}]*), shift_sign: -1", "$1"}};
  return all;
}

// Returns what an import reports, empty if nothing.
std::string report_on(const fs::path& config, const Capture& capture) {
  try {
    const ImportPlan plan = read_import(config, captures_folder() / capture.images);
    ImportedRig rig(plan);
    const auto stack = rig.capture(rig.sequence());
    RigModel model = rig.model();
    try {
      model.sensor = measured_noise(model.sensor, {*stack});
    } catch (const Error&) {
    }
    return check_conventions(*stack, model, plan.offset_rad).message;
  } catch (const Error& e) {
    return e.what();
  }
}

std::vector<Row> wrong_rows(const Context&) {
  if (!has_captures()) return {};
  int false_alarms = 0, unnoticed = 0;
  const Capture* const all[] = {&kSkull, &kSkullGray, &kRelief, &kBoards, &kBoardsCalibrated};
  for (const Capture* capture : all) {
    const std::string report = report_on(description_file(*capture), *capture);
    if (report.empty()) continue;
    ++false_alarms;
    std::fprintf(stderr, "  false alarm on %s: %s\n", capture->description.c_str(), report.c_str());
  }
  const fs::path config =
      fs::temp_directory_path() / ("fringeslam-captures-" + std::to_string(std::random_device{}()) + ".yaml");
  for (const Mistake& mistake : mistakes()) {
    std::ifstream in(description_file(*mistake.capture));
    const std::string text((std::istreambuf_iterator<char>(in)), {});
    const std::string changed = std::regex_replace(text, std::regex(mistake.pattern), mistake.replacement);
    if (changed == text) throw Error("captures.wrong: '" + mistake.pattern + "' does not occur");
    std::ofstream(config) << changed;
    const std::string report = report_on(config, *mistake.capture);
    if (!report.empty()) continue;
    ++unnoticed;
    std::fprintf(stderr, "  unnoticed in %s: %s\n", mistake.capture->description.c_str(), mistake.replacement.c_str());
  }
  fs::remove(config);
  const int n = static_cast<int>(mistakes().size());
  return {bound_row("captures.wrong.unnoticed", unnoticed, n, "", 0, Limit::most),
          bound_row("captures.wrong.false_alarms", false_alarms, static_cast<int>(std::size(all)), "", 0, Limit::most)};
}

}  // namespace

std::vector<Item> real_capture_items() {
  return {{{"captures.skull.agree.depth", "captures.skull.agree.orders", "captures.skull.valid"},
           "a real object in two codings: fringes of two periods, and a Gray code",
           skull_rows},
          {{"captures.waxbowl"},
           "micro phase shifting of a wax bowl: columns within half a column of the authors' result",
           waxbowl_rows},
          {{"captures.sigma.least", "captures.sigma.greatest"},
           "local scatter of real captures over predicted sigmas, with measured noise",
           sigma_rows},
          {{"captures.boards"}, "real boards, each measured with a calibration from the other four", board_rows},
          {{"captures.twin.least", "captures.twin.greatest"},
           "simulated over real phase noise and depth scatter of three captures",
           twin_rows},
          {{"captures.wrong.unnoticed", "captures.wrong.false_alarms"},
           "mistakes in the descriptions of real captures",
           wrong_rows}};
}

}  // namespace fringeslam::bench
