// SPDX-License-Identifier: Apache-2.0
#include "core/mapper/mapper.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <utility>

#include "core/base/stage_clock.h"
#include "core/registration/motion_registration.h"
#include "core/types/linear_algebra.h"

namespace fringeslam {

namespace {

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
    reconstruct(result, input, {});
  result.complete = !input.needs_prior;
  if (result.complete && options_.registration.tracking.landmarks == LandmarkViews::every_frame) find_landmarks(result);

  const bool motion_unknown = result.motion && !result.motion->converged;
  if (motion_unknown)
    result.tracking = Tracking::lost;
  else if (map_.keyframes().empty())
    result.tracking = result.complete ? Tracking::first : Tracking::lost;
  else if (input.needs_prior)
    predicted&& follow_by_prediction(result, input, *predicted);
  else
    (predicted && follow(result, *predicted)) || relocalize(result);
  add_motion_uncertainty(result, input);

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
int Mapper::best_reference(const Frame& frame, const Pose& predicted) const {
  constexpr double kClearly = 0.1;
  const std::vector<int> candidates = map_.overlapping(frame, predicted);
  if (candidates.empty()) return -1;
  const int last = track_.back().keyframe, most = candidates.front();
  const bool change =
      map_.expected_overlap(frame, predicted, most) > map_.expected_overlap(frame, predicted, last) + kClearly;
  return change ? most : last;
}

bool Mapper::follow(FrameResult& result, const Pose& predicted, const Matrix6d& prior) {
  enter_stage("follow");
  const int reference = best_reference(result.frame, predicted);
  if (reference < 0) return false;
  result.reference = reference;
  const Pose world_from_reference = map_.keyframes()[static_cast<size_t>(result.reference)].world_from_camera;
  const auto registered = [&](const Pose& expected, int stride) {
    RegistrationOptions options = options_.registration;
    options.icp.stride = std::max(options.icp.stride, stride);
    return follow_view(keyframe_image(result.reference), result.frame, expected, rig_.camera, rig_.middle_range_m(),
                       options, prior);
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
  const MotionPrior prior = predicted_motion(input.timestamp_s);
  reconstruct(result, input, {&first, prior});
  const Pose start = estimate_motion(result, input, predicted, first, prior);
  // The fringe orders at depth steps are still missing, and the remaining walls may not constrain all directions: the
  // prediction is a prior of the registration.
  if (!follow(result, start, inverse(prediction_covariance_))) return false;
  const Pose world_from_reference = map_.keyframes()[static_cast<size_t>(result.reference)].world_from_camera;
  const Pose found = world_from_reference * result.registration.earlier_from_current;
  const ExpectedView second = expected_view(found, result.covariance, true);
  const std::optional<StackMotion> motion = result.motion;
  reconstruct(result, input, {&second, motion ? MotionPrior{motion->motion, motion->covariance} : prior});
  return follow(result, found);
}

// Adds the uncertainty of the motion during the stack to the covariance of the pose. The motion of a complete stack is
// known from the stack itself; that of others is estimated together with the pose.
void Mapper::add_motion_uncertainty(FrameResult& result, const MapperInput& input) {
  constexpr int kStride = 8;
  if (!result.motion || result.motion->motion.is_still() || !input.depth_slopes || !result.registration.refined) return;
  const std::vector<DepthSlope> slopes = input.depth_slopes(result, kStride);
  enter_stage("motion");
  const MotionRegistration joint =
      register_motion(keyframe_image(result.reference), result.frame, rig_.camera,
                      result.registration.earlier_from_current, slopes, result.motion->motion,
                      result.complete ? MotionPrior{result.motion->motion, result.motion->covariance}
                                      : predicted_motion(input.timestamp_s));
  if (joint.valid) result.covariance += joint.pose_covariance - joint.fixed_covariance;
}

// Predicts the motion during a stack from that of the last view, with accelerations in between.
MotionPrior Mapper::predicted_motion(double timestamp_s) const {
  const MotionLimits limits;
  MotionPrior prior = unknown_motion(limits);
  if (!last_motion_ || lost_) return prior;
  const double duration_s = std::abs(timestamp_s - track_.back().timestamp_s);
  prior.motion.angular_rad_s = last_motion_->motion.angular_rad_s;
  prior.motion.velocity_m_s = last_motion_->motion.velocity_m_s;
  const double turn = limits.turn_rad_s2 * duration_s, speed = limits.acceleration_m_s2 * duration_s;
  Vector6d change;
  change << Eigen::Vector3d::Constant(turn * turn), Eigen::Vector3d::Constant(speed * speed);
  prior.covariance.topLeftCorner<6, 6>() = last_motion_->covariance.topLeftCorner<6, 6>();
  prior.covariance.topLeftCorner<6, 6>().diagonal() += change;
  return prior;
}

// Estimates the motion during a stack of one period by registration with the map, and decodes the stack with it.
// Returns the camera pose found on the way.
Pose Mapper::estimate_motion(FrameResult& result, const MapperInput& input, const Pose& predicted,
                             const ExpectedView& expected, const MotionPrior& prior) {
  constexpr int kStride = 6, kRounds = 4;
  constexpr double kNegligible = 0.05;  // change of the depths, sigmas
  if (!input.depth_slopes || !result.motion) return predicted;
  Pose world_from_camera = predicted;
  for (int round = 0; round < kRounds; ++round) {
    const int reference = best_reference(result.frame, world_from_camera);
    const std::vector<DepthSlope> slopes = input.depth_slopes(result, kStride);
    if (reference < 0 || slopes.empty()) return predicted;
    enter_stage("motion");
    const Pose world_from_reference = map_.keyframes()[static_cast<size_t>(reference)].world_from_camera;
    const MotionRegistration found =
        register_motion(keyframe_image(reference), result.frame, rig_.camera,
                        world_from_reference.inverse() * world_from_camera, slopes, result.motion->motion, prior);
    if (!found.valid) return predicted;
    world_from_camera = world_from_reference * found.target_from_source;
    StackMotion motion = *result.motion;
    motion.motion = to_motion(to_vector(result.motion->motion) + found.step);
    motion.covariance = found.motion_covariance;
    motion.converged = true;
    if (result.motion->motion.is_still() && !is_moving(motion)) {
      result.motion->covariance = found.motion_covariance;
      return predicted;
    }
    if (found.ripple_sigma < kNegligible) {
      result.motion->covariance = found.motion_covariance;
      break;
    }
    reconstruct(result, input, {&expected, MotionPrior{motion.motion, motion.covariance}});
  }
  return world_from_camera;
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
                                    rig_.middle_range_m(), options_.registration);
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
                                                rig_.camera, rig_.middle_range_m(), options_.registration);
    if (!registration.refined && recognised.contains(keyframe))
      registration = register_views(image, result.frame,
                                    point_pairs(earlier.landmarks.keypoints, result.keypoints, recognised[keyframe]),
                                    rig_.camera, rig_.middle_range_m(), options_.registration);
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
  last_motion_ = result.motion;
  if (result.tracking != Tracking::followed) return;
  constexpr double kTurn_rad = 0.03 * std::numbers::pi / 180, kShift_m = 0.3e-3;
  const Vector6d error = difference(world_from_current, *predicted);
  Vector6d sigmas;
  sigmas << Eigen::Vector3d::Constant(std::max(kTurn_rad, 2 * error.head<3>().norm())),
      Eigen::Vector3d::Constant(std::max(kShift_m, 2 * error.tail<3>().norm()));
  prediction_covariance_ = sigmas.cwiseAbs2().asDiagonal();
}

}  // namespace fringeslam
