// SPDX-License-Identifier: Apache-2.0
// Sensor rows: noise, sigmas, fringe orders and the projector's response, on scenes with known ground truth.
#include <array>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <optional>

#include "bench/row.h"
#include "core/calibrate/response.h"
#include "core/decode/decode.h"
#include "core/depth/depth.h"
#include "core/patterns/design.h"
#include "core/score/score.h"
#include "core/types/linear_algebra.h"
#include "sim/virtual_rig.h"

namespace fringeslam::bench {

namespace {

sim::Scene scene_of(const std::string& name, uint64_t seed) {
  return sim::load_scene(std::string(FRINGESLAM_SCENES) + "/" + name + "/scene.yaml", {seed});
}

PatternSequence sequence_of(const RigModel& rig, std::vector<double> periods, GrayCode gray = GrayCode::none,
                            int steps = 3) {
  SequenceDesign design;
  design.width = rig.projector.width;
  design.height = rig.projector.height;
  design.periods_px = std::move(periods);
  design.gray = gray;
  design.steps = steps;
  return design_sequence(design);
}

// --- range noise ---

// RMS distance of the points from their best-fit plane.
double rms_from_plane(const Frame& frame) {
  std::vector<Eigen::Vector3d> points;
  for (const cv::Vec3f& p : frame.points_m) {
    if (!std::isnan(p[2])) points.emplace_back(p[0], p[1], p[2]);
  }
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d& p : points) mean += p / static_cast<double>(points.size());
  Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
  for (const Eigen::Vector3d& p : points) scatter += (p - mean) * (p - mean).transpose();
  const double least = symmetric_eigen(scatter).values(0);
  return std::sqrt(least / static_cast<double>(points.size()));
}

// Three images of the finest fringes; the fringe order comes from the board's approximate distance of 1 m.
std::vector<Row> range_noise_rows(const Context& context) {
  std::vector<double> values;
  for (int seed = 1; seed <= (context.quick ? 3 : 20); ++seed) {
    const sim::Scene scene = scene_of("flat_board", static_cast<uint64_t>(seed));
    const PatternSequence sequence = sequence_of(scene.rig, {16.5});
    const auto stack = sim::VirtualRig(scene, {}).capture(sequence);
    const PixelRays rays = pixel_rays(scene.rig.camera);
    const auto expected =
        predict_coordinate(scene.rig, rays, cv::Mat1f(rays.size(), 1.0f), cv::Mat1f(rays.size(), 0.002f));
    DecodeOptions options;
    options.unwrapping = Unwrapping::predicted;
    const DecodedStack decoded = decode(*stack, scene.rig, options, {Axis::columns, &expected});
    Frame frame;
    triangulate(frame, decoded, Triangulation(scene.rig, rays, 0.4, 2.5), {});
    values.push_back(1e3 * rms_from_plane(frame));
  }
  return {median_row("range_noise", values, "mm", 0.05)};
}

// --- consistency of sigmas ---

struct Board {
  double range_m, slope_deg, albedo;
};

// A board in front of the centre of the camera's view, with just enough pixels for statistics.
sim::Scene board_scene(const Board& board, uint64_t seed) {
  sim::Scene scene = scene_of("flat_board", seed);
  constexpr int kSize = 40;
  Pinhole& camera = scene.rig.camera;
  camera.cx -= 0.5 * (camera.width - kSize);
  camera.cy -= 0.5 * (camera.height - kSize);
  camera.width = camera.height = kSize;
  scene.objects[0].material.albedo = board.albedo;
  SixDof pose;
  pose.translation_mm = {0, 0, 1e3 * board.range_m};
  pose.angles_deg = {0.6 * board.slope_deg, board.slope_deg, 0};
  scene.objects[0].world_from_object = pose_from(pose);
  return scene;
}

// Standard deviation over the seeds at each pixel relative to the predicted sigma; RMS over the pixels.
double scatter_over_sigma(const Board& board, int seeds) {
  cv::Mat1d sum, squares, variance, count;
  for (int seed = 1; seed <= seeds; ++seed) {
    const sim::Scene scene = board_scene(board, static_cast<uint64_t>(seed));
    const auto stack = sim::VirtualRig(scene, {}).capture(scene.patterns);
    Frame frame;
    triangulate(frame, decode(*stack, scene.rig, {}), Triangulation(scene.rig, pixel_rays(scene.rig.camera), 0.4, 2.5),
                {});
    if (sum.empty()) {
      for (cv::Mat1d* image : {&sum, &squares, &variance, &count}) *image = cv::Mat1d::zeros(frame.points_m.size());
    }
    for (int row = 0; row < frame.height(); ++row) {
      for (int col = 0; col < frame.width(); ++col) {
        if (!frame.valid(row, col)) continue;
        const double z = static_cast<double>(frame.points_m(row, col)[2]) - board.range_m;
        sum(row, col) += z;
        squares(row, col) += z * z;
        variance(row, col) += std::pow(static_cast<double>(frame.sigma_m(row, col)), 2);
        ++count(row, col);
      }
    }
  }
  double ratios = 0;
  int pixels = 0;
  for (int i = 0; i < static_cast<int>(sum.total()); ++i) {
    const int row = i / sum.cols, col = i % sum.cols;
    const double n = count(row, col);
    if (n < 0.9 * seeds) continue;
    const double scatter = (squares(row, col) - sum(row, col) * sum(row, col) / n) / (n - 1);
    ratios += scatter / (variance(row, col) / n);
    ++pixels;
  }
  return pixels > 0 ? std::sqrt(ratios / pixels) : NAN;
}

std::vector<Row> sigma_rows(const Context& context) {
  std::vector<double> ratios;
  for (const double range : {0.75, 1.0, 1.35}) {
    for (const double slope : {0.0, 30.0, 55.0}) {
      for (const double albedo : {0.6, 0.35, 0.2}) {
        const double ratio = scatter_over_sigma({range, slope, albedo}, context.quick ? 12 : 50);
        std::fprintf(stderr, "  %.2f m, %.0f degrees, albedo %.2f: scatter / sigma %.3f\n", range, slope, albedo,
                     ratio);
        ratios.push_back(ratio);
      }
    }
  }
  return {
      bound_row("sigma_honest.least", least_of(ratios), static_cast<int>(ratios.size()), "x", 0.9, Limit::least),
      bound_row("sigma_honest.greatest", greatest_of(ratios), static_cast<int>(ratios.size()), "x", 1.1, Limit::most)};
}

// --- fringe orders ---

struct Method {
  std::string id;
  Unwrapping unwrapping;
  SpatialOrdering spatial_order;
  std::vector<double> periods;
  GrayCode gray;
  double limit;
};

const std::vector<Method>& methods() {
  using enum SpatialOrdering;
  static const std::vector<Method> all = {
      {"multifrequency", Unwrapping::multifrequency, quality, {1040, 131, 16.5}, GrayCode::none, 1e-4},
      {"heterodyne", Unwrapping::heterodyne, quality, {21.66, 18.9, 16.5}, GrayCode::none, 1e-4},
      {"gray", Unwrapping::gray, quality, {16.5}, GrayCode::complementary, 1e-4},
      {"geometric", Unwrapping::geometric, quality, {480}, GrayCode::none, 1e-4},
      {"spatial_quality", Unwrapping::spatial, quality, {1040, 131, 16.5}, GrayCode::none, 1e-4},
      {"spatial_reliability", Unwrapping::spatial, reliability, {1040, 131, 16.5}, GrayCode::none, 1e-4}};
  return all;
}

DepthScore orders_of(const Method& method, uint64_t seed) {
  const sim::Scene scene = scene_of("steps_and_holes", seed);
  const PatternSequence sequence = sequence_of(scene.rig, method.periods, method.gray);
  const auto view = sim::VirtualRig(scene, {}).simulate(sequence);
  DecodeOptions options;
  options.unwrapping = method.unwrapping;
  options.spatial_order = method.spatial_order;
  const DecodedStack decoded = decode(view->stack, scene.rig, options);
  Frame frame;
  triangulate(frame, decoded, Triangulation(scene.rig, pixel_rays(scene.rig.camera), 0.4, 2.5), {});
  cv::Mat1f depth;
  cv::extractChannel(frame.points_m, depth, 2);
  return score_depth({depth, frame.sigma_m, decoded.coordinate_px}, view->truth, decoded.finest_period_px);
}

std::vector<Row> wrong_order_rows(const Method& method, const Context& context) {
  std::vector<double> shares, valid;
  double wrong = 0;
  int compared = 0;
  for (int seed = 1; seed <= (context.quick ? 3 : 20); ++seed) {
    const DepthScore score = orders_of(method, static_cast<uint64_t>(seed));
    valid.push_back(score.valid_fraction);
    if (score.compared == 0) continue;
    shares.push_back(score.wrong_order);
    wrong += score.wrong_order * score.compared;
    compared += score.compared;
  }
  std::fprintf(stderr, "  %s: %.2f %% of the lit pixels have depth; worst seed %.1e\n", method.id.c_str(),
               100 * median_of(valid), greatest_of(shares));
  return {bound_row("wrong_order." + method.id, wrong / compared, compared, "share", method.limit, Limit::most)};
}

// --- response ---

// Systematic part of the phase error of three steps on a flat board: mean over pixels of equal phase, RMS over all
// phases.
double systematic_phase_error(const sim::Scene& scene, const RigModel& model, const std::vector<double>& inverse) {
  PatternSequence sequence = sequence_of(scene.rig, {16.5});
  sequence.inverse_response = inverse;
  constexpr int kBins = 90;
  std::array<double, kBins> sum{}, count{};
  for (uint64_t seed = 1; seed <= 4; ++seed) {
    sim::Scene noisy = scene;
    noisy.seed = seed;
    const auto view = sim::VirtualRig(noisy, {}).simulate(sequence);
    const TruthFrame& truth = view->truth;
    DecodeOptions options;
    options.unwrapping = Unwrapping::spatial;
    options.spatial_reference = SpatialReference::none;
    const DecodedStack decoded = decode(view->stack, model, options);
    for (int row = 0; row < truth.depth_m.rows; ++row) {
      for (int col = 0; col < truth.depth_m.cols; ++col) {
        const double phase = absolute_phase(static_cast<double>(truth.projector_column(row, col)), 16.5);
        const double off =
            std::remainder(static_cast<double>(decoded.wrapped_phase(row, col)) - phase, 2 * std::numbers::pi);
        if (std::isnan(off)) continue;
        const double turns = phase / (2 * std::numbers::pi);
        const auto bin = static_cast<size_t>((turns - std::floor(turns)) * kBins);
        sum[bin] += off;
        ++count[bin];
      }
    }
  }
  double squares = 0;
  for (size_t b = 0; b < kBins; ++b) squares += std::pow(sum[b] / count[b], 2) / kBins;
  return std::sqrt(squares);
}

std::vector<cv::Mat1f> as_floats(const FringeStack& stack, size_t first, size_t last) {
  std::vector<cv::Mat1f> images(last - first);
  for (size_t i = first; i < last; ++i) stack.images[i].convertTo(images[i - first], CV_32F);
  return images;
}

// Everything is measured from noisy 8-bit images of a ramp and of 12 steps; nothing comes from the rig file.
std::vector<Row> response_rows(const Context& context) {
  std::vector<double> by_inverse, by_table;
  for (int seed = 1; seed <= (context.quick ? 1 : 5); ++seed) {
    const sim::Scene scene = scene_of("response_ramp", static_cast<uint64_t>(seed));
    const auto stack = sim::VirtualRig(scene, {}).capture(scene.patterns);
    const FringeGroup steps = fringe_groups(scene.patterns, Axis::columns).front();
    const size_t fringes = steps.images.size(), all = scene.patterns.patterns.size();
    std::vector<double> levels;
    for (size_t i = fringes; i < all; ++i) levels.push_back(scene.patterns.patterns[i].level);
    const Response response = response_from_ramp(as_floats(*stack, fringes, all), levels, scene.rig.sensor, {});
    RigModel plain = scene.rig;
    plain.projector_response.clear();
    RigModel corrected = plain;
    corrected.phase_correction =
        phase_correction_from_fringes(as_floats(*stack, 0, fringes), steps.shifts_rad, 3, scene.rig.sensor, {});
    const double before = systematic_phase_error(scene, plain, {});
    const double inverse = systematic_phase_error(scene, plain, invert_table(response.table, 1025));
    const double table = systematic_phase_error(scene, corrected, {});
    std::fprintf(stderr, "  gamma %.3f; phase error %.4f rad, inverse response %.4f, phase table %.4f\n",
                 response.gamma, before, inverse, table);
    by_inverse.push_back(before / inverse);
    by_table.push_back(before / table);
  }
  return {median_row("response.inverse_table", by_inverse, "x", 13, Limit::least),
          median_row("response.phase_table", by_table, "x", 13, Limit::least)};
}

}  // namespace

std::vector<Item> sensor_items() {
  std::vector<Item> items = {{{"range_noise"}, "flat board at 1 m: RMS distance from its plane", range_noise_rows},
                             {{"sigma_honest.least", "sigma_honest.greatest"},
                              "scatter relative to predicted sigma: 3 ranges, 3 slopes, 3 albedos",
                              sigma_rows},
                             {{"response.inverse_table", "response.phase_table"},
                              "gamma 2.2: systematic phase error without correction, relative to that with it",
                              response_rows}};
  for (const Method& method : methods())
    items.push_back({{"wrong_order." + method.id},
                     "wrong fringe orders by " + method.id + ", steps and holes",
                     [method](const Context& context) { return wrong_order_rows(method, context); }});
  return items;
}

}  // namespace fringeslam::bench
