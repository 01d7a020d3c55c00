// SPDX-License-Identifier: Apache-2.0
#include "tools/rgbd.h"

#include <cmath>

#include "core/io/tum_file.h"
#include "core/rig/dataset.h"
#include "core/score/truth_files.h"
#include "tools/progress.h"

namespace fringeslam::tools {

namespace fs = std::filesystem;

DepthSensor::DepthSensor(const RigModel& model, const PatternSequence& sequence, const Settings& settings,
                         const std::string& name)
    : unknown_motion_(unknown_motion(settings.pipeline.motion_prior)),
      front_end_(model, sequence, settings.pipeline.front_end()) {
  if (!model.calibrated)
    throw Error(name + ": its rig is not calibrated, so there is no depth; run fringeslam calibrate rig");
  resolve_unwrapping(sequence, model, settings.pipeline.decode);
}

RgbdView DepthSensor::see(FringeStack stack) const {
  ReconstructedView view = front_end_.reconstruct(stack, {});
  if (view.motion_unknown()) {
    ReconstructedView compensated = front_end_.reconstruct(stack, {nullptr, unknown_motion_, false, &view});
    if (!compensated.motion_unknown()) view = std::move(compensated);
  }
  cv::Mat1f depth_m;
  cv::extractChannel(view.frame.points_m, depth_m, 2);
  return {std::move(stack), std::move(view.frame), std::move(depth_m)};
}

void prepare(Source& source, const RgbdOptions& options, const std::string& out) {
  if (options.depth == "truth" && !source.has_truth()) throw Error(out + ": the source has no true depth");
  if (!options.distorted) source.undistort();
}

Trajectory for_each_view(Source& source, const Settings& settings, const RgbdOptions& options, const fs::path& scratch,
                         const std::string& out, const Common& common,
                         const std::function<void(const RgbdView&)>& take) {
  const bool true_depth = options.depth == "truth";
  Settings of_sensor = settings;
  if (!source.may_move() || !source.has_image_times()) of_sensor.pipeline.tracking.at_rest = true;
  const DepthSensor sensor(source.model(), source.sequence(), of_sensor, source.name());
  const auto rig = source.open(scratch);
  const fs::path truth = scratch / "truth";
  int views = 0;
  {
    Progress progress("rendering", source.stacks(), common.quiet || common.json);
    while (auto stack = rig->capture(source.sequence())) {
      const fs::path truth_file = truth / (stack_name(stack->index) + ".exr");
      RgbdView view = sensor.see(std::move(*stack));
      if (true_depth) view.depth_m = read_truth_frame(truth_file).depth_m;
      take(view);
      fs::remove(truth_file);
      progress.step();
      ++views;
    }
  }
  if (views == 0) throw Error(out + ": the source contains no views");
  Trajectory robot;
  if (source.has_truth()) robot = read_tum(truth / "truth.tum");
  std::error_code ignored;
  fs::remove_all(truth, ignored);
  return robot;
}

Trajectory camera_trajectory(Trajectory robot, const RigModel& model) {
  for (TimedPose& pose : robot) pose.world_from_robot = pose.world_from_robot * model.robot_from_camera;
  return robot;
}

cv::Mat1w depth_units(const cv::Mat1f& depth_m, double units_per_m) {
  cv::Mat1w units(depth_m.size(), uint16_t{0});
  for (int row = 0; row < depth_m.rows; ++row) {
    for (int col = 0; col < depth_m.cols; ++col) {
      const double value = std::round(static_cast<double>(depth_m(row, col)) * units_per_m);
      if (value > 0 && value <= UINT16_MAX) units(row, col) = static_cast<uint16_t>(value);
    }
  }
  return units;
}

}  // namespace fringeslam::tools
