// SPDX-License-Identifier: Apache-2.0
#include "sim/virtual_rig.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "core/io/files.h"
#include "core/rig/dataset.h"
#include "sim/light/beam.h"
#include "sim/light/thermal.h"

namespace fringeslam::sim {

namespace {

// Blur is tabulated between these multiples of near_m and far_m from the projector; beyond them it is clamped.
constexpr double kNearest = 0.3, kFarthest = 3;

std::vector<TruthOrder> fringe_orders(const PatternSequence& sequence, const TruthFrame& truth) {
  std::vector<TruthOrder> orders;
  for (const Axis axis : {Axis::columns, Axis::rows}) {
    for (const Pattern& pattern : sequence.patterns) {
      if (pattern.coding != Coding::fringe || pattern.axis != axis) continue;
      const bool columns = axis == Axis::columns;
      const bool known = std::any_of(orders.begin(), orders.end(), [&](const TruthOrder& order) {
        return order.columns == columns && order.period_px == pattern.period_px;
      });
      if (known) continue;
      const cv::Mat1f& coordinate = columns ? truth.projector_column : truth.projector_row;
      TruthOrder order{columns, pattern.period_px, cv::Mat1f(coordinate.size())};
      std::transform(coordinate.begin(), coordinate.end(), order.order.begin(), [&](float u) {
        return static_cast<float>(std::floor((static_cast<double>(u) + 0.5) / pattern.period_px));
      });
      orders.push_back(std::move(order));
    }
  }
  return orders;
}

void label(TruthFrame& truth, int index, const TimedPose& pose) {
  truth.index = index;
  truth.timestamp_s = pose.timestamp_s;
  truth.world_from_robot = pose.world_from_robot;
}

double shortest_interval_s(const Trajectory& trajectory) {
  double shortest_s = INFINITY;
  for (size_t i = 1; i < trajectory.size(); ++i)
    shortest_s = std::min(shortest_s, trajectory[i].timestamp_s - trajectory[i - 1].timestamp_s);
  return shortest_s;
}

}  // namespace

void RenderOptions::check() const {
  check_options(*this, "render");
  const int side = static_cast<int>(std::lround(std::sqrt(samples_per_pixel)));
  if (side * side != samples_per_pixel)
    throw Error("render.samples_per_pixel is " + std::to_string(samples_per_pixel) + "; must be a square number");
}

VirtualRig::VirtualRig(const Scene& scene, const RenderOptions& options)
    : scene_(scene),
      calibration_(calibration_of(scene)),
      options_((options.check(), options)),
      renderer_(scene, options.effects, options.samples_per_pixel),
      camera_(scene.rig, options.effects, scene.seed, renderer_.rays().blur_px) {
  if (scene.rig.thermal) thermal_rays_ = thermal_rays(scene.rig, options.effects);
}

BlurRange blur_range(const RigModel& rig, const Effects& effects) {
  return Beam::blur_range(rig, effects, kNearest * rig.near_m, kFarthest * rig.far_m);
}

const std::vector<ProjectedPatterns>& VirtualRig::shown(const PatternSequence& sequence) {
  if (!shown_.empty() && shown_sequence_ == sequence) return shown_;
  const RigModel& rig = scene_.rig;
  const BlurRange blur = blur_range(rig, options_.effects);
  shown_.clear();
  shown_sequence_ = sequence;
  if (!moving()) {
    shown_.emplace_back(sequence, rig, blur);
    return shown_;
  }
  for (const Pattern& pattern : sequence.patterns) {
    PatternSequence one = sequence;
    one.patterns = {pattern};
    shown_.emplace_back(one, rig, blur);
  }
  return shown_;
}

std::optional<VirtualRig::Schedule> VirtualRig::schedule(const PatternSequence& sequence) const {
  const Timing& timing = scene_.rig.timing;
  if (!scene_.path) {
    if (next_ >= scene_.trajectory.size()) return std::nullopt;
    const TimedPose& reference = scene_.trajectory[next_];
    return Schedule{reference, exposure_times_s(reference.timestamp_s, sequence, timing)};
  }
  Schedule result;
  for (size_t i = 0; i < sequence.patterns.size(); ++i)
    result.exposure_time_s.push_back(clock_s_ + (static_cast<double>(i) + 0.5) / timing.camera_rate_hz);
  if (result.exposure_time_s.back() > scene_.path->duration_s()) return std::nullopt;
  const double reference_s = reference_time_s(sequence, result.exposure_time_s);
  result.reference = {reference_s, scene_.path->at(reference_s)};
  return result;
}

Pose VirtualRig::robot_at(const TimedPose& reference, double time_s) const {
  if (scene_.path) return scene_.path->at(time_s);
  const double after_s = time_s - reference.timestamp_s;
  return reference.world_from_robot *
         Pose{rotation_exp(after_s * scene_.motion.angular_rad_s), after_s * scene_.motion.velocity_m_s};
}

std::vector<Pose> VirtualRig::camera_poses(const TimedPose& reference, double middle_s, double exposure_s) const {
  // The rays of a pixel are shared evenly among the steps; otherwise the mean time would not be the middle.
  int steps = std::min(options_.effects.exposure_steps, options_.samples_per_pixel);
  while (options_.samples_per_pixel % steps != 0) ++steps;
  std::vector<Pose> poses;
  for (int step = 0; step < steps; ++step) {
    const double time_s = middle_s + ((step + 0.5) / steps - 0.5) * exposure_s;
    poses.push_back(robot_at(reference, time_s) * scene_.rig.robot_from_camera);
  }
  return poses;
}

std::vector<cv::Mat1f> VirtualRig::light(const PatternSequence& sequence, const Schedule& when, double exposure_s,
                                         TruthFrame* truth) {
  const std::vector<ProjectedPatterns>& shown_patterns = shown(sequence);
  const int stack = static_cast<int>(next_);
  const Pose still = when.reference.world_from_robot * scene_.rig.robot_from_camera;
  std::vector<cv::Mat1f> images;
  if (moving()) {
    if (truth) *truth = truth_at(when.reference, stack);
    for (size_t i = 0; i < sequence.patterns.size(); ++i)
      images.push_back(renderer_.render(
          shown_patterns[i],
          camera_poses(when.reference, when.exposure_time_s[i], sequence.patterns[i].exposure * exposure_s), stack)[0]);
  } else {
    images = renderer_.render(shown_patterns.front(), {still}, stack, truth);
  }
  for (cv::Mat1f& image : images) image = camera_.electrons_per_s(image);
  return images;
}

std::optional<FringeStack> VirtualRig::capture(const PatternSequence& sequence) {
  return next_stack(sequence, nullptr);
}

std::optional<SimulatedView> VirtualRig::simulate(const PatternSequence& sequence) {
  SimulatedView view;
  std::optional<FringeStack> stack = next_stack(sequence, &view.truth);
  if (!stack) return std::nullopt;
  view.stack = std::move(*stack);
  return view;
}

std::optional<FringeStack> VirtualRig::next_stack(const PatternSequence& sequence, TruthFrame* truth) {
  const Timing& timing = scene_.rig.timing;
  const double duration_s = static_cast<double>(sequence.patterns.size()) / timing.camera_rate_hz;
  if (scene_.path && scene_.view_rate_hz > 0 && duration_s * scene_.view_rate_hz > 1 + 1e-9)
    throw Error("trajectory.continuous.view_rate_hz: " + std::to_string(sequence.patterns.size()) +
                " images per view at " + to_text(timing.camera_rate_hz) + " images/s take " + to_text(duration_s) +
                " s, so the camera cannot take " + to_text(scene_.view_rate_hz) +
                " views/s; use a lower view rate or fewer patterns");
  if (moving() && !scene_.path && duration_s > shortest_interval_s(scene_.trajectory) + 1e-9)
    throw Error("trajectory.interval_s: " + std::to_string(sequence.patterns.size()) + " images per view at " +
                to_text(timing.camera_rate_hz) + " images/s take " + to_text(duration_s) +
                " s, so a view would begin before the one before it ends; use a longer interval or fewer patterns");
  const std::optional<Schedule> when = schedule(sequence);
  if (!when) return std::nullopt;
  const TimedPose& pose = when->reference;
  double longest = 1;
  for (const Pattern& pattern : sequence.patterns) longest = std::max(longest, pattern.exposure);
  const double longest_s = 1 / (longest * timing.pattern_rate_hz);
  double exposure_s = timing.exposure_s;
  if (!scene_.auto_exposure && longest > 1 && exposure_s > (1 + 1e-9) * longest_s)
    throw Error(
        "patterns.exposures: an exposure of " + to_text(longest) + " times " + to_text(exposure_s) +
        " s exceeds the display time of a pattern, 1 / pattern_rate_hz = " + to_text(1 / timing.pattern_rate_hz) +
        " s; set light.exposure_s to at most " + to_text(longest_s) + " s, or a lower pattern rate");
  std::vector<cv::Mat1f> images;
  if (scene_.auto_exposure) {
    // In motion, the images are then rendered again: their blur depends on the exposure.
    images = light(sequence, *when, 0, moving() ? nullptr : truth);
    cv::Mat1f brightest = images.front().clone();
    for (const cv::Mat1f& image : images) brightest = cv::max(brightest, image);
    exposure_s = camera_.auto_exposure_s(brightest, longest_s);
  }
  if (!scene_.auto_exposure || moving()) images = light(sequence, *when, exposure_s, truth);
  FringeStack stack;
  stack.index = static_cast<int>(next_);
  stack.timestamp_s = pose.timestamp_s;
  stack.patterns = sequence;
  stack.exposure_time_s = when->exposure_time_s;
  for (size_t i = 0; i < images.size(); ++i) {
    const double image_exposure_s = sequence.patterns[i].exposure * exposure_s;
    stack.images.push_back(
        camera_.expose(images[i], image_exposure_s,
                       {options_.noise, options_.quantise, scene_.seed, stack.index, static_cast<int>(i)}));
    stack.exposure_s.push_back(image_exposure_s);
  }
  if (scene_.rig.thermal)
    stack.thermal_c = thermal_image(scene_, *thermal_rays_, renderer_.world(), renderer_.surfaces(), options_.effects,
                                    pose.world_from_robot * scene_.rig.robot_from_camera, stack.index,
                                    {options_.noise, options_.quantise});
  if (truth) {
    label(*truth, stack.index, pose);
    for (const double time_s : when->exposure_time_s)
      truth->exposures.push_back({time_s, moving() ? robot_at(pose, time_s) : pose.world_from_robot});
    note_thermal(*truth);
    truth->fringe_orders = fringe_orders(sequence, *truth);
  }
  ++next_;
  clock_s_ += duration_s;
  if (scene_.view_rate_hz > 0) clock_s_ = static_cast<double>(next_) / scene_.view_rate_hz;
  return stack;
}

TruthFrame VirtualRig::truth_of(size_t pose) const {
  return truth_at(scene_.trajectory.at(pose), static_cast<int>(pose));
}

TruthFrame VirtualRig::truth_at(const TimedPose& pose, int index) const {
  PatternSequence nothing = scene_.patterns;
  nothing.patterns.clear();
  TruthFrame truth;
  renderer_.render(ProjectedPatterns(nothing, scene_.rig, {}), {pose.world_from_robot * scene_.rig.robot_from_camera},
                   index, &truth);
  label(truth, index, pose);
  note_thermal(truth);
  return truth;
}

void VirtualRig::note_thermal(TruthFrame& truth) const {
  if (!scene_.rig.thermal) return;
  mark_thermal_visibility(truth, scene_, renderer_.world(), truth.world_from_robot * scene_.rig.robot_from_camera);
}

cv::Mat VirtualRig::look(const cv::Mat1b& screen, size_t pose, double exposure_s, int number) {
  const RigModel& rig = scene_.rig;
  if (screen.size() != cv::Size(rig.projector.width, rig.projector.height))
    throw Error("look: the screen image is " + std::to_string(screen.cols) + "x" + std::to_string(screen.rows) +
                ", but the projector's resolution is " + std::to_string(rig.projector.width) + "x" +
                std::to_string(rig.projector.height));
  cv::Mat1f levels;
  screen.convertTo(levels, CV_32F, 1.0 / 255);
  const Pose world_from_camera = scene_.trajectory.at(pose).world_from_robot * rig.robot_from_camera;
  const auto stack = static_cast<int>(pose);
  const cv::Mat1f light =
      renderer_.render(ProjectedPatterns(std::vector<cv::Mat1f>{levels}, rig, blur_range(rig, options_.effects)),
                       {world_from_camera}, stack)[0];
  return camera_.expose(camera_.electrons_per_s(light), exposure_s,
                        {options_.noise, options_.quantise, scene_.seed, stack, number});
}

void write_truth(const TruthFrame& truth, const std::filesystem::path& folder) {
  std::vector<cv::Mat> normal(3), position(3);
  cv::split(truth.normals, normal);
  cv::split(truth.position_m, position);
  std::vector<ExrChannel> channels = {{"depth_m", truth.depth_m},
                                      {"position.x", position[0]},
                                      {"position.y", position[1]},
                                      {"position.z", position[2]},
                                      {"normal.x", normal[0]},
                                      {"normal.y", normal[1]},
                                      {"normal.z", normal[2]},
                                      {"object_id", truth.object_id},
                                      {"projector_column", truth.projector_column},
                                      {"projector_row", truth.projector_row},
                                      {"temperature_c", truth.temperature_c},
                                      {"mask", truth.mask}};
  if (!truth.indirect_share.empty()) channels.push_back({"indirect_share", truth.indirect_share});
  for (const TruthOrder& order : truth.fringe_orders)
    channels.push_back(
        {std::string("fringe_order.") + (order.columns ? "columns." : "rows.") + to_text(order.period_px),
         order.order});
  write_exr(folder / (stack_name(truth.index) + ".exr"), channels);
}

}  // namespace fringeslam::sim
