// SPDX-License-Identifier: Apache-2.0
#include "bench/datasets/sample_files.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <numbers>

#include "core/base/constants.h"
#include "core/decode/coordinate_of_depth.h"
#include "core/io/files.h"
#include "core/rig/rig_file.h"
#include "core/types/centikelvin.h"

namespace fringeslam::datasets {

namespace {

using Json = nlohmann::ordered_json;

bool has_fringes(const PatternSequence& sequence, Axis axis) {
  const auto shifts = std::count_if(sequence.patterns.begin(), sequence.patterns.end(), [&](const Pattern& pattern) {
    return pattern.coding == Coding::fringe && pattern.axis == axis;
  });
  return shifts >= 3;
}

cv::Mat1f coordinate_sigma(const sim::SimulatedView& view, const RigModel& rig, DecodeOptions options, Axis axis) {
  if (!has_fringes(view.stack.patterns, axis)) return {};
  // The true coordinate selects the fringe order, so that the sigma exists wherever there are fringes.
  const cv::Mat1f& coordinate = axis == Axis::columns ? view.truth.projector_column : view.truth.projector_row;
  const cv::Mat1f exact(coordinate.size(), 0.0f);
  const CoordinatePrior expected{coordinate, exact, exact};
  options.unwrapping = Unwrapping::predicted;
  options.min_modulation_dn = options.min_data_modulation = 0;
  options.max_phase_sigma_rad = 3;
  options.max_order_failure = 1;
  options.max_order_residual_sigma = 1e6;
  DecodeContext context;
  context.axis = axis;
  context.expected = &expected;
  cv::Mat1f sigma = decode(view.stack, rig, options, context).sigma_px;
  std::transform(sigma.begin(), sigma.end(), coordinate.begin(), sigma.begin(),
                 [](float s, float u) { return std::isnan(u) ? kNaN : s; });
  return sigma;
}

Json rows_of(const Pose& pose) {
  Json rows = Json::array();
  for (int row = 0; row < 3; ++row) {
    Json values = Json::array();
    for (int col = 0; col < 3; ++col) values.push_back(pose.rotation(row, col));
    values.push_back(pose.translation[row]);
    rows.push_back(values);
  }
  rows.push_back({0.0, 0.0, 0.0, 1.0});
  return rows;
}

// A drawn value as a number if it is one.
Json value_json(const std::string& text) {
  Json value = Json::parse(text, nullptr, false);
  return value.is_number() || value.is_boolean() ? value : Json(text);
}

std::string description(const TrialContext& context, const sim::SimulatedView& view, int view_number) {
  const Spec& spec = context.spec;
  const FringeStack& stack = view.stack;
  const Pose robot_from_camera = context.scene.rig.robot_from_camera;
  const int world = studies::world_of(spec, context.trial.index);
  Json json = {{"sample", context.trial.index * spec.views + view_number},
               {"split", kSplits[static_cast<size_t>(split_of(spec, world))]},
               {"world", world},
               {"trial", context.trial.index},
               {"view", view_number},
               {"scene", context.scene.name},
               {"seed", context.trial.world_seed},
               {"rig", context.calibration.name}};
  Json values = Json::object();
  for (size_t p = 0; p < spec.parameters.size(); ++p)
    values[spec.parameters[p].name] = value_json(context.trial.values[p]);
  json["parameters"] = values;
  json["timestamp_s"] = stack.timestamp_s;
  json["exposure_s"] = stack.exposure_s;
  json["exposure_time_s"] = stack.exposure_time_s;
  json["world_from_camera"] = rows_of(view.truth.world_from_robot * robot_from_camera);
  json["world_from_robot"] = rows_of(view.truth.world_from_robot);
  // Only the views of a moving robot have a pose for each image.
  const auto moved = [&](const TimedPose& pose) {
    return pose.world_from_robot.translation != view.truth.world_from_robot.translation ||
           pose.world_from_robot.rotation != view.truth.world_from_robot.rotation;
  };
  if (std::any_of(view.truth.exposures.begin(), view.truth.exposures.end(), moved)) {
    json["exposure_world_from_camera"] = Json::array();
    for (const TimedPose& pose : view.truth.exposures)
      json["exposure_world_from_camera"].push_back(rows_of(pose.world_from_robot * robot_from_camera));
  }
  return json.dump() + "\n";
}

// Floats whose last bits vary from pixel to pixel do not shrink; normals are constant on flat surfaces.
constexpr ExrCompression kVaried = ExrCompression::none, kFlat = ExrCompression::zip;

class Files {
 public:
  void add(const std::string& extension, std::string bytes) { files_.push_back({extension, std::move(bytes)}); }
  void add_exr(const std::string& name, const std::vector<ExrChannel>& channels, ExrCompression compression) {
    if (!channels.empty()) add(name + ".exr", exr_bytes(channels, compression));
  }
  void add_grey(const std::string& name, const cv::Mat& image) {
    if (image.type() == CV_32FC1)
      add_exr(name, {{"Y", image}}, kVaried);
    else
      add(name + ".png", png_bytes(image));
  }
  // Whole numbers as 16-bit PNG, NaN as the highest value; EXR if they do not fit.
  void add_whole(const std::string& name, const std::string& channel, const cv::Mat1f& numbers) {
    constexpr float kNone = 65535;
    double highest = 0;
    cv::minMaxLoc(numbers, nullptr, &highest, nullptr, nullptr, numbers == numbers);
    if (highest >= kNone) return add_exr(name, {{channel, numbers}}, kFlat);
    cv::Mat1w image(numbers.size());
    std::transform(numbers.begin(), numbers.end(), image.begin(),
                   [](float n) { return static_cast<uint16_t>(std::isnan(n) ? kNone : n); });
    add(name + ".png", png_bytes(image));
  }
  std::vector<SampleFile> sorted() {
    std::sort(files_.begin(), files_.end(),
              [](const SampleFile& a, const SampleFile& b) { return a.extension < b.extension; });
    return std::move(files_);
  }

 private:
  std::vector<SampleFile> files_;
};

std::string order_name(const std::string& quantity, const TruthOrder& order) {
  return quantity + (order.columns ? ".columns." : ".rows.") + to_text(order.period_px);
}

void add_orders(Files& files, const Spec& spec, const TruthFrame& truth) {
  std::vector<ExrChannel> phases;
  for (const bool columns : {true, false}) {
    const TruthOrder* finest = nullptr;
    for (const TruthOrder& order : truth.fringe_orders) {
      if (order.columns != columns) continue;
      if (spec.writes(Part::order)) files.add_whole(order_name("order", order), "order", order.order);
      if (!finest || order.period_px < finest->period_px) finest = &order;
    }
    if (!finest) continue;
    const cv::Mat1f& coordinate = columns ? truth.projector_column : truth.projector_row;
    cv::Mat1f phase(coordinate.size());
    std::transform(coordinate.begin(), coordinate.end(), phase.begin(), [&](float u) {
      return static_cast<float>(2 * std::numbers::pi * (static_cast<double>(u) + 0.5) / finest->period_px);
    });
    phases.push_back({order_name("phase", *finest), phase});
  }
  if (spec.writes(Part::phase)) files.add_exr("phase", phases, kVaried);
}

void add_sigma(Files& files, const PredictedSigma& sigma) {
  std::vector<ExrChannel> channels;
  if (!sigma.column_px.empty()) channels.push_back({"column_sigma_px", sigma.column_px});
  if (!sigma.row_px.empty()) channels.push_back({"row_sigma_px", sigma.row_px});
  if (!sigma.depth_m.empty()) channels.push_back({"depth_sigma_m", sigma.depth_m});
  files.add_exr("sigma", channels, kVaried);
}

void add_thermal(Files& files, const cv::Mat1f& temperature_c) {
  const bool recordable = std::all_of(temperature_c.begin(), temperature_c.end(),
                                      [](float t) { return t == celsius(centikelvin(static_cast<double>(t))); });
  if (!recordable) return files.add_exr("thermal", {{"Y", temperature_c}}, kVaried);
  cv::Mat1w image(temperature_c.size());
  std::transform(temperature_c.begin(), temperature_c.end(), image.begin(),
                 [](float t) { return centikelvin(static_cast<double>(t)); });
  files.add("thermal.png", png_bytes(image));
}

}  // namespace

PredictedSigma predicted_sigma(const sim::SimulatedView& view, const RigModel& rig, const PixelRays& rays,
                               const DecodeOptions& options) {
  PredictedSigma sigma{
      coordinate_sigma(view, rig, options, Axis::columns), coordinate_sigma(view, rig, options, Axis::rows), {}};
  const bool columns = !sigma.column_px.empty();
  const cv::Mat1f& coordinate_px = columns ? sigma.column_px : sigma.row_px;
  if (coordinate_px.empty()) return sigma;
  const DepthCoordinate slope =
      coordinate_of_depth(rig, rays, view.truth.depth_m, columns ? Axis::columns : Axis::rows);
  sigma.depth_m.create(coordinate_px.size());
  std::transform(coordinate_px.begin(), coordinate_px.end(), slope.per_m.begin(), sigma.depth_m.begin(),
                 [](float px, float px_per_m) { return px / std::abs(px_per_m); });
  return sigma;
}

std::string sample_name(int sample) {
  char name[16];
  std::snprintf(name, sizeof name, "%09d", sample);
  return name;
}

std::vector<SampleFile> sample_files(const TrialContext& context, const sim::SimulatedView& view, int view_number) {
  const Spec& spec = context.spec;
  const TruthFrame& truth = view.truth;
  Files files;
  files.add("json", description(context, view, view_number));
  files.add("rig.yaml", to_yaml(context.calibration));
  files.add("patterns.yaml", to_yaml(view.stack.patterns));
  for (size_t i = 0; spec.writes(Part::images) && i < view.stack.images.size(); ++i) {
    char name[32];
    std::snprintf(name, sizeof name, "image.%03zu", i);
    files.add_grey(name, view.stack.images[i]);
  }
  if (spec.writes(Part::thermal) && !view.stack.thermal_c.empty()) add_thermal(files, view.stack.thermal_c);
  if (spec.writes(Part::depth)) files.add_exr("depth", {{"depth_m", truth.depth_m}}, kVaried);
  if (spec.writes(Part::normals)) {
    std::vector<cv::Mat> normal(3);
    cv::split(truth.normals, normal);
    files.add_exr("normals", {{"normal.x", normal[0]}, {"normal.y", normal[1]}, {"normal.z", normal[2]}}, kFlat);
  }
  if (spec.writes(Part::coordinate))
    files.add_exr("coordinate", {{"projector_column", truth.projector_column}, {"projector_row", truth.projector_row}},
                  kVaried);
  add_orders(files, spec, truth);
  if (spec.writes(Part::sigma))
    add_sigma(files, predicted_sigma(view, context.scene.rig, context.rays, context.decode));
  if (spec.writes(Part::objects)) files.add_whole("objects", "object_id", truth.object_id);
  if (spec.writes(Part::mask)) {
    cv::Mat1b mask;
    truth.mask.convertTo(mask, CV_8U);
    files.add("mask.png", png_bytes(mask));
  }
  if (spec.writes(Part::temperature) && context.scene.rig.thermal)
    files.add_exr("temperature", {{"temperature_c", truth.temperature_c}}, kFlat);
  return files.sorted();
}

}  // namespace fringeslam::datasets
