// SPDX-License-Identifier: Apache-2.0
#include "core/mapper/mapper.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <utility>

#include "core/base/stage_clock.h"
#include "core/types/linear_algebra.h"

namespace fringeslam {

namespace {

double middle_m(const RigModel& rig) { return 0.5 * (rig.near_m + rig.far_m); }

// Extrapolates a motion to `share` of its duration at constant velocity.
Pose continued(const Pose& motion, double share) {
  return {rotation_exp(share * rotation_log(motion.rotation)), share * motion.translation};
}

}  // namespace

std::string to_string(Tracking tracking) {
  switch (tracking) {
    case Tracking::first:
      return "first";
    case Tracking::followed:
      return "followed";
    case Tracking::refined:
      return "refined";
    case Tracking::landmarks:
      return "landmarks";
    case Tracking::lost:
      return "lost";
  }
  return "unknown";
}

Mapper::Mapper(const RigModel& rig, const MapperOptions& options, const Pose& world_from_robot)
    : Mapper(KeyframeMap(rig, options.mapping), options) {
  start_ = world_from_robot;
}

Mapper::Mapper(KeyframeMap map, const MapperOptions& options)
    : rig_(map.rig()), options_(options), finder_(rig_, options.finder), map_(std::move(map)) {
  check_options(options.registration.matching, "matching");
  check_options(options.registration.motion, "motion");
  check_options(options.registration.icp, "icp");
  check_options(options.registration.tracking, "tracking");
  check_options(options.mapping, "mapping");
  check_options(options.pose_graph, "pose_graph");
  for (size_t i = 0; i < map_.keyframes().size(); ++i)
    finder_.add_keyframe(static_cast<int>(i), map_.keyframes()[i].landmarks);
}

FrameResult Mapper::process(MapperInput input) {
  FrameResult result;
  const std::optional<Pose> predicted = predicted_camera(input.timestamp_s);
  if (input.view)
    static_cast<ReconstructedView&>(result) = std::move(*input.view);
  else if (!input.needs_prior)
    reconstruct(result, input, {nullptr, twist()});
  result.complete = !input.needs_prior;
  if (result.complete && options_.registration.tracking.landmarks == LandmarkViews::every_frame) find_landmarks(result);

  if (map_.keyframes().empty())
    result.tracking = result.complete ? Tracking::first : Tracking::lost;
  else if (input.needs_prior)
    predicted&& follow_by_prediction(result, input, *predicted);
  else
    (predicted && follow(result, *predicted)) || relocalize(result);

  if (result.tracking == Tracking::lost) {
    lost_ = !map_.keyframes().empty();
    return result;
  }
  result.relocalized = std::exchange(lost_, false);
  extend_map(result);
  note_pose(result, predicted);
  return result;
}

Trajectory Mapper::trajectory() const {
  Trajectory trajectory;
  for (const TrackedView& view : track_)
    trajectory.push_back(
        {view.timestamp_s, orthonormalised(world_from_camera(view) * rig_.robot_from_camera.inverse())});
  return trajectory;
}

Pose Mapper::world_from_camera(const TrackedView& view) const {
  return map_.world_from_camera(view.keyframe, view.keyframe_from_camera);
}

// Constant velocity between the last two tracked views; empty if they are too far in the past.
std::optional<Pose> Mapper::predicted_camera(double timestamp_s) const {
  constexpr double kFarthest = 3;  // intervals between those views
  if (!options_.registration.tracking.predict || lost_ || track_.size() < 2) return std::nullopt;
  const TrackedView &before = track_[track_.size() - 2], &last = track_.back();
  const double share = (timestamp_s - last.timestamp_s) / (last.timestamp_s - before.timestamp_s);
  if (!(share >= 0 && share <= kFarthest)) return std::nullopt;
  const Pose from = world_from_camera(last);
  // Extrapolation would double the rounding error of the rotations each time.
  return orthonormalised(from * continued(orthonormalised(world_from_camera(before).inverse() * from), share));
}

std::optional<CameraTwist> Mapper::twist() const {
  if (!options_.registration.tracking.moving || lost_ || track_.size() < 2) return std::nullopt;
  const TrackedView &before = track_[track_.size() - 2], &last = track_.back();
  const double duration_s = last.timestamp_s - before.timestamp_s;
  const Pose motion = world_from_camera(before).inverse() * world_from_camera(last);
  return CameraTwist{rotation_log(motion.rotation) / duration_s, motion.translation / duration_s};
}

const Frame& Mapper::keyframe_image(int keyframe) {
  if (image_keyframe_ != keyframe) keyframe_image_ = map_.keyframe_image(keyframe);
  image_keyframe_ = keyframe;
  return keyframe_image_;
}

void Mapper::reconstruct(FrameResult& result, const MapperInput& input, const ReconstructionPrior& prior) const {
  static_cast<ReconstructedView&>(result) = input.reconstruct(prior);
}

void Mapper::find_landmarks(FrameResult& result) const {
  FoundLandmarks found = finder_.find(result.frame);
  result.keypoints = std::move(found.keypoints);
  result.landmarks = std::move(found.landmarks);
  result.recognitions = std::move(found.recognitions);
}

// Registers with the keyframe that shows most of the view; the previous one is kept unless another shows clearly more.
bool Mapper::follow(FrameResult& result, const Pose& predicted, const Matrix6d& prior) {
  constexpr double kClearly = 0.1;
  enter_stage("follow");
  const std::vector<int> candidates = map_.overlapping(result.frame, predicted);
  if (candidates.empty()) return false;
  const int last = track_.back().keyframe, most = candidates.front();
  const bool change = map_.expected_overlap(result.frame, predicted, most) >
                      map_.expected_overlap(result.frame, predicted, last) + kClearly;
  result.reference = change ? most : last;
  const Pose world_from_reference = map_.keyframes()[static_cast<size_t>(result.reference)].world_from_camera;
  const auto registered = [&](const Pose& expected, int stride) {
    RegistrationOptions options = options_.registration;
    options.icp.stride = std::max(options.icp.stride, stride);
    return follow_view(keyframe_image(result.reference), result.frame, expected, rig_.camera, middle_m(rig_), options,
                       prior);
  };
  result.registration = registered(world_from_reference.inverse() * predicted, options_.registration.tracking.stride);
  const Pose found = result.registration.earlier_from_current;
  result.leaves_keyframe =
      result.registration.found && leaves_keyframe(result, world_from_reference * found, result.reference);
  // Keyframes are registered with all points.
  if (result.leaves_keyframe) result.registration = registered(found, 1);
  result.covariance = result.registration.covariance;
  if (result.registration.found) result.tracking = Tracking::followed;
  return result.registration.found;
}

// Unwraps by the depth that the map predicts (docs/method.md, section 3.2, `predicted`). The first registration improves
// the predicted pose, which determines more fringe orders.
bool Mapper::follow_by_prediction(FrameResult& result, const MapperInput& input, const Pose& predicted) {
  const ExpectedView first = expected_view(predicted, prediction_covariance_, false);
  reconstruct(result, input, {&first, {}});
  // The fringe orders at depth steps are still missing, and the remaining walls may not constrain all directions: the
  // prediction is a prior of the registration.
  if (!follow(result, predicted, inverse(prediction_covariance_))) return false;
  const Pose world_from_reference = map_.keyframes()[static_cast<size_t>(result.reference)].world_from_camera;
  const Pose found = world_from_reference * result.registration.earlier_from_current;
  const ExpectedView second = expected_view(found, result.covariance, true);
  reconstruct(result, input, {&second, {}});
  return follow(result, found);
}

// Depth expected from the last view, and from its keyframe where the last view shows nothing. `covariance` is that of the
// camera pose relative to them.
ExpectedView Mapper::expected_view(const Pose& world_from_current, const Matrix6d& covariance,
                                   bool by_reference) const {
  enter_stage("expected view");
  const Pose current_from_world = world_from_current.inverse();
  const auto known = [&](const Frame& frame, const Pose& world_from_known) {
    const Pose current_from_known = current_from_world * world_from_known;
    return KnownView{&frame, current_from_known, covariance_of_inverse(current_from_known.inverse(), covariance)};
  };
  std::vector<KnownView> views = {known(last_frame_, world_from_camera(track_.back()))};
  if (by_reference && last_keyframe_ != image_keyframe_)
    views.push_back(known(keyframe_image_, map_.keyframes()[static_cast<size_t>(image_keyframe_)].world_from_camera));
  return fringeslam::expected_view(views, rig_.camera, map_.rays());
}

// Relocalizes by landmarks, wherever in the map they were seen, or else by all keypoints of the last keyframe.
bool Mapper::relocalize(FrameResult& result) {
  if (result.keypoints.detected == 0) find_landmarks(result);
  enter_stage("locate");
  const int last = track_.empty() ? static_cast<int>(map_.keyframes().size()) - 1 : track_.back().keyframe;
  const auto known = [&](int keyframe) -> SeenView {
    return {keyframe_image(keyframe), map_.keyframes()[static_cast<size_t>(keyframe)].landmarks.keypoints};
  };
  LocatedView located = locate_view(known, last, {result.frame, result.keypoints}, result.recognitions, rig_.camera,
                                    middle_m(rig_), options_.registration);
  result.reference = located.with.earlier;
  result.matches = std::move(located.with.matches);
  result.registration = std::move(located.registration);
  result.leaves_keyframe = false;
  if (!result.registration.found) return false;
  result.covariance = result.registration.covariance;
  result.tracking = result.registration.refined ? Tracking::refined : Tracking::landmarks;
  const Pose world_from_reference = map_.keyframes()[static_cast<size_t>(result.reference)].world_from_camera;
  result.leaves_keyframe =
      result.registration.refined &&
      leaves_keyframe(result, world_from_reference * result.registration.earlier_from_current, result.reference);
  return true;
}

// Views reconstructed by prediction show nothing new, so they never start a keyframe.
bool Mapper::leaves_keyframe(const FrameResult& result, const Pose& world_from_camera, int keyframe) const {
  if (options_.mapping.every_view) return true;
  return result.complete &&
         map_.expected_overlap(result.frame, world_from_camera, keyframe) < options_.mapping.keyframe_overlap;
}

// Adds the view to the track, and to the map if registration by depth confirmed its pose.
void Mapper::extend_map(FrameResult& result) {
  enter_stage("map");
  TrackedView here{result.frame.timestamp_s, result.reference, result.registration.earlier_from_current};
  if (result.tracking == Tracking::first || result.leaves_keyframe)
    add_keyframe(result, here);
  else if (result.registration.refined)
    result.in_map = map_.add_frame(result.frame, here.keyframe, here.keyframe_from_camera);
  result.view = static_cast<int>(track_.size());
  track_.push_back(here);
}

void Mapper::add_keyframe(FrameResult& result, TrackedView& here) {
  const bool first = result.tracking == Tracking::first;
  const Pose current = first ? start_ * rig_.robot_from_camera : world_from_camera(here);
  if (result.keypoints.detected == 0) find_landmarks(result);
  enter_stage("map");
  result.keyframe = map_.add_keyframe(result.frame, result.landmarks, current);
  result.in_map = true;
  finder_.add_keyframe(result.keyframe, result.landmarks);
  here = {here.timestamp_s, result.keyframe, {}};
  if (first) return;
  map_.link(
      {result.reference, result.keyframe, result.registration.earlier_from_current, inverse(result.covariance), false});
  result.loops = close_loops(result);
  if (result.loops > 0) result.corrected = map_.correct(options_.pose_graph, options_.mapping.significant_m);
}

// Links the new keyframe with earlier ones besides its reference: those that overlap it, and those whose landmarks were
// re-identified. Returns the number of links.
int Mapper::close_loops(const FrameResult& result) {
  enter_stage("loops");
  const Pose current = map_.keyframes().back().world_from_camera;
  std::vector<int> near = map_.overlapping(result.frame, current);
  std::map<int, std::vector<KeypointMatch>> recognised;
  for (auto& [keyframe, matches] : matches_by_view(result.recognitions)) {
    recognised[keyframe] = std::move(matches);
    if (std::find(near.begin(), near.end(), keyframe) == near.end()) near.push_back(keyframe);
  }
  int links = 0;
  for (const int keyframe : near) {
    if (links >= options_.mapping.max_links) break;
    if (keyframe == result.keyframe || keyframe == result.reference) continue;
    const Keyframe& earlier = map_.keyframes()[static_cast<size_t>(keyframe)];
    const Frame image = map_.keyframe_image(keyframe);
    ViewRegistration registration = follow_view(image, result.frame, earlier.world_from_camera.inverse() * current,
                                                rig_.camera, middle_m(rig_), options_.registration);
    if (!registration.refined && recognised.contains(keyframe))
      registration = register_views(image, result.frame,
                                    point_pairs(earlier.landmarks.keypoints, result.keypoints, recognised[keyframe]),
                                    rig_.camera, middle_m(rig_), options_.registration);
    if (!registration.refined) continue;
    map_.link({keyframe, result.keyframe, registration.earlier_from_current, inverse(registration.covariance), true});
    ++links;
  }
  return links;
}

// Fills in the poses, and keeps what predicts the next view. The error of constant velocity is assumed to be at most
// twice the present one, and not less than the jerks of a slow robot.
void Mapper::note_pose(FrameResult& result, const std::optional<Pose>& predicted) {
  enter_stage("other");
  const Pose world_from_current = world_from_camera(track_.back());
  result.world_from_robot = orthonormalised(world_from_current * rig_.robot_from_camera.inverse());
  if (track_.size() > 1)
    result.previous_from_current = world_from_camera(track_[track_.size() - 2]).inverse() * world_from_current;
  last_frame_ = result.frame;
  last_keyframe_ = result.keyframe;
  if (result.tracking != Tracking::followed) return;
  constexpr double kTurn_rad = 0.03 * std::numbers::pi / 180, kShift_m = 0.3e-3;
  const Vector6d error = difference(world_from_current, *predicted);
  Vector6d sigmas;
  sigmas << Eigen::Vector3d::Constant(std::max(kTurn_rad, 2 * error.head<3>().norm())),
      Eigen::Vector3d::Constant(std::max(kShift_m, 2 * error.tail<3>().norm()));
  prediction_covariance_ = sigmas.cwiseAbs2().asDiagonal();
}

}  // namespace fringeslam
