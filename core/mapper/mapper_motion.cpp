// SPDX-License-Identifier: Apache-2.0
// Mapper: estimates the motion of the camera during stacks together with poses, and propagates its uncertainty to them
// (docs/method.md, section 9).
#include <algorithm>
#include <opencv2/core.hpp>
#include <utility>

#include "core/base/stage_clock.h"
#include "core/mapper/mapper.h"
#include "core/registration/motion_registration.h"
#include "core/types/linear_algebra.h"

namespace fringeslam {

// Largest displacement of surfaces from their predicted positions.
double Mapper::largest_error_m(const Prediction& predicted) const {
  // Noise of dark or distant surfaces must not make them look contradictory.
  constexpr double kSigmas = 6, kLeast_m = 5e-3;
  const Vector6d sigmas = predicted.covariance.diagonal().cwiseSqrt();
  return std::max(kLeast_m,
                  kSigmas * (sigmas.head<3>().maxCoeff() * rig_.middle_range_m() + sigmas.tail<3>().maxCoeff()));
}

// Corrects a prediction that the motion during the stack contradicts: the robot has accelerated since the last view.
Mapper::Prediction Mapper::corrected(Prediction predicted, const FrameResult& result) const {
  if (!in_motion_ || !result.in_motion() || result.motion_unknown() || result.motion->residuals == 0) return predicted;
  const StackMotion& own = *result.motion;
  const double since_last_s = result.frame.timestamp_s - track_.back().timestamp_s;
  // Share of the change that affects the displacement: one half for a constant acceleration, otherwise 0 to 1.
  constexpr double kShare = 0.5, kShareSigma = 0.3;
  if (agrees(own, predicted.motion)) return predicted;
  const Vector6d change = (to_vector(own.motion) - to_vector(predicted.motion.motion)).head<6>();
  CameraMotion steady;
  steady.angular_rad_s = change.head<3>();
  steady.velocity_m_s = change.tail<3>();
  predicted.world_from_camera = predicted.world_from_camera * steady.at(kShare * since_last_s);
  Vector6d sigmas;
  sigmas << Eigen::Vector3d::Constant(change.head<3>().norm()), Eigen::Vector3d::Constant(change.tail<3>().norm());
  sigmas *= kShareSigma * since_last_s;
  predicted.covariance.diagonal() += sigmas.cwiseAbs2();
  return predicted;
}

// Follows a complete view whose stack was exposed in motion.
bool Mapper::follow_in_motion(FrameResult& result, const MapperInput& input, const Prediction& predicted,
                              MotionEffect& effect) {
  const StackMotion& own = *result.motion;
  const MotionPrior prior = own.residuals > 0 ? MotionPrior{own.motion, own.covariance} : predicted.motion;
  if (!follow(result, estimate_motion(result, input, predicted, nullptr, prior, effect))) return false;
  fill_fringe_orders(result, input);
  return true;
}

namespace {

// True if fewer than this share of the pixels with fringes have a fringe order.
bool lacks_fringe_orders(const FrameResult& result, double share) {
  const cv::Mat1f &phase = result.decoded.wrapped_phase, &coordinate = result.decoded.coordinate_px;
  if (phase.empty() || coordinate.empty()) return false;  // a front end that does not decode fringes
  return cv::countNonZero(coordinate == coordinate) < share * cv::countNonZero(phase == phase);
}

}  // namespace

// The registered pose of a view in the world, with the uncertainty of its motion during the stack.
Mapper::Prediction Mapper::registered(const FrameResult& result, const MapperInput& input) {
  const Pose world_from_reference = map_.keyframes()[static_cast<size_t>(result.reference)].world_from_camera;
  const Pose& pose = result.registration.earlier_from_current;
  const FrameMotion own = frame_motion(result, input, keyframe_image(result.reference), pose);
  return {world_from_reference * pose,
          rotated_covariance(world_from_reference.rotation, result.covariance + own.spread()),
          {result.motion->motion, result.motion->covariance}};
}

// Vibration leaves fewer fringe orders to a whole sequence than to the map, once the pose is known.
void Mapper::fill_fringe_orders(FrameResult& result, const MapperInput& input) {
  constexpr double kFew = 0.9;
  if (!result.in_motion() || !input.reconstruct || !lacks_fringe_orders(result, kFew)) return;
  const Prediction found = registered(result, input);
  const ExpectedView expected = expected_view(found.world_from_camera, found.covariance, true);
  const ReconstructedView rough = result;  // shares its images
  reconstruct(result, input, {&expected, found.motion, true, &rough});
  result.motion = rough.motion;
}

// Decodes and registers a view again whose prediction, less accurate than its registration, left few fringe orders, for
// instance because the robot accelerated. Keeps the first registration if the second fails.
void Mapper::follow_again(FrameResult& result, const MapperInput& input, const MotionPrior& prior,
                          MotionEffect& effect) {
  if (!result.in_motion() || !input.reconstruct ||
      !lacks_fringe_orders(result, options_.registration.tracking.min_predicted))
    return;
  const FrameResult first = result;  // shares its images
  const MotionEffect first_effect = effect;
  const Prediction found = registered(result, input);
  if (follow_from(result, input, found, prior, true, Matrix6d::Zero(), effect)) return;
  result = first;
  effect = first_effect;
}

// Rejects a relocalized view whose pose changes by more than its uncertainty, or is lost, when it is estimated together
// with the motion: depth that its stack's own estimate distorted matches the map at a wrong pose. Relative to another keyframe,
// the errors of the two registrations, and of the map between the keyframes, are independent.
void Mapper::confirm_in_motion(FrameResult& result, const MapperInput& input) {
  if (!result.registration.refined || result.motion->residuals == 0) return;
  const Pose& pose = result.registration.earlier_from_current;
  const FrameMotion own = frame_motion(result, input, keyframe_image(result.reference), pose);
  const Matrix6d covariance = result.covariance + own.spread();
  const Pose world_from_reference = map_.keyframes()[static_cast<size_t>(result.reference)].world_from_camera;
  prediction_checked_ = false;  // the pose contradicts the prediction
  FrameResult joint = result;   // shares its images
  MotionEffect effect;
  // Without a joint estimate, the registration would only be repeated.
  bool confirmed =
      follow_in_motion(joint, input, {world_from_reference * pose, covariance, {}}, effect) && effect.reference >= 0;
  if (confirmed) {
    const Pose& joint_pose = joint.registration.earlier_from_current;
    const Pose world_from_other = map_.keyframes()[static_cast<size_t>(joint.reference)].world_from_camera,
               world_from_joint = world_from_other * joint_pose;
    Matrix6d expected = covariance;
    if (joint.reference != result.reference) {
      // Zero if it is unknown, which makes the test stricter.
      Matrix6d between = map_.covariance_between(result.reference, joint.reference);
      between.bottomRightCorner<3, 3>().diagonal().array() +=
          between.topLeftCorner<3, 3>().trace() * joint_pose.translation.squaredNorm();
      const Eigen::Matrix3d axes = world_from_reference.rotation.transpose() * world_from_other.rotation;
      expected = with_parallax(covariance + rotated_covariance(axes, joint.covariance) + between, result, pose);
    }
    confirmed = agree(world_from_reference.inverse() * world_from_joint, pose, expected);
  }
  if (confirmed) return;
  result.tracking = Tracking::lost;
  result.registration.found = false;
}

namespace {

// Covariance of the error of the motion that a view is compensated for; empty if the camera was at rest.
std::optional<Matrix12d> motion_covariance(const ReconstructedView& view) {
  constexpr double kUnlikely = 1e-3;
  if (view.in_motion()) return view.motion->covariance;
  if (!view.undecided_motion) return std::nullopt;
  const StackMotion& motion = *view.undecided_motion;
  if (view.motion_untested) return mean_square(motion);
  // Residuals that neither rest nor a constant motion explains come from vibration, whose mean motion may be small.
  constexpr double kUnexplained_rms = 1.2;
  const double probability = motion.rms_sigma > kUnexplained_rms ? 1 : probability_of_motion(motion);
  if (probability < kUnlikely) return std::nullopt;
  return probability * mean_square(motion);
}

}  // namespace

// Returns how the uncertain motion during the stack changes the pose of its frame relative to `target`.
Mapper::FrameMotion Mapper::frame_motion(const ReconstructedView& view, const MapperInput& input, const Frame& target,
                                         const Pose& target_from_source) const {
  constexpr int kCoarsest = 8;
  const std::optional<Matrix12d> covariance = motion_covariance(view);
  if (!covariance || !input.depth_slopes) return {};
  FrameMotion motion{Matrix6x12d::Zero(), *covariance};
  // Views with few pixels need all of them.
  for (int stride = kCoarsest; stride >= 1 && motion.pose_by_motion.isZero(0); stride /= 2) {
    const std::vector<DepthSlope> slopes = input.depth_slopes(view, stride);
    enter_stage("motion");
    motion.pose_by_motion = pose_by_motion(target, view.frame, rig_.camera, target_from_source, slopes);
  }
  return motion;
}

// Returns how the uncertain motion during the stack of a registered view changes its pose.
Mapper::FrameMotion Mapper::own_motion(const FrameResult& result, const MapperInput& input,
                                       const MotionEffect& effect) {
  if (effect.reference == result.reference && result.in_motion())
    return {effect.pose_by_motion, result.motion->covariance};
  return frame_motion(result, input, keyframe_image(result.reference), result.registration.earlier_from_current);
}

// Returns the covariance of a registered view's pose that the uncertain motion during its keyframe's stack causes.
Matrix6d Mapper::by_motion_of_reference(const FrameResult& result) const {
  return covariance_by_motion(map_.keyframes()[static_cast<size_t>(result.reference)],
                              result.registration.earlier_from_current);
}

// Later views reveal vibration that the first keyframe was exposed to, as long as the robot neither stops nor gets lost.
void Mapper::widen_first_motion() {
  constexpr double kChange = 0.05;
  constexpr size_t kMostViews = 32;  // as many as vibration is estimated from
  if (continuous_from_ > 0 || track_.size() > kMostViews) first_motion_.reset();
  if (!first_motion_) return;
  FrameMotion motion = *first_motion_;
  vibration_.widen(motion.covariance);
  vibration_.widen_estimate(motion.covariance);
  const Matrix6d covariance = motion.spread(), before = map_.keyframes()[0].motion.covariance;
  if ((covariance - before).norm() > kChange * before.norm()) map_.set_motion(0, {covariance, true});
}

namespace {

// A motion whose mean is known from the poses of two views, but which is as uneven as it is fast.
StackMotion uneven(const Vector6d& velocity, const Matrix6d& covariance) {
  StackMotion motion;
  motion.motion.angular_rad_s = velocity.head<3>();
  motion.motion.velocity_m_s = velocity.tail<3>();
  motion.covariance.topLeftCorner<6, 6>() = covariance;
  motion.covariance.diagonal().head<3>().array() += velocity.head<3>().squaredNorm();
  motion.covariance.diagonal().segment<3>(3).array() += velocity.tail<3>().squaredNorm();
  motion.converged = true;
  return motion;
}

}  // namespace

// The motion from the last view to this one, in axes that are turned like these to the world's. Empty without a view before.
std::optional<StackMotion> Mapper::motion_since_last(const FrameResult& result, const Eigen::Matrix3d& axes) const {
  if (result.tracking == Tracking::first || track_.size() <= continuous_from_) return std::nullopt;
  const double time_s = result.frame.timestamp_s - track_.back().timestamp_s;
  if (!(time_s > 0)) return std::nullopt;
  const Pose world_from_reference = map_.keyframes()[static_cast<size_t>(result.reference)].world_from_camera;
  const Pose world_from_current = world_from_reference * result.registration.earlier_from_current;
  const Vector6d change = difference(world_from_current, world_from_camera(track_.back()));
  const Matrix6d covariance = rotated_covariance(axes * world_from_reference.rotation, result.covariance);
  return uneven(rotated_tangent(axes) * change / time_s, covariance / (time_s * time_s));
}

// A stack that cannot show motion does not reveal whether the robot stopped for it. If it did not, it moved as between this view
// and the last one; without a view before, all motions are possible.
void Mapper::assume_motion(FrameResult& result) const {
  result.undecided_motion = StackMotion{{}, unknown_motion(options_.registration.motion_prior).covariance, 0, 0, true};
  if (result.tracking == Tracking::first) return;
  const Pose world_from_current = map_.keyframes()[static_cast<size_t>(result.reference)].world_from_camera *
                                  result.registration.earlier_from_current;
  if (const auto moved = motion_since_last(result, world_from_current.rotation.transpose()))
    result.undecided_motion = moved;
}

// The view after the first one bounds the motion during the first stack, if that cannot show it.
void Mapper::assume_first_motion(const FrameResult& result) {
  if (!first_is_untested_) return;
  first_is_untested_ = false;
  const auto moved = motion_since_last(result, map_.keyframes()[0].world_from_camera.rotation.transpose());
  if (!moved || !first_motion_ || track_.size() != 1) return;
  first_motion_->covariance = mean_square(*moved);
  map_.set_motion(0, {first_motion_->spread(), true});
}

// Adds the uncertainty of the motion during the stack, and during that of the keyframe, to the covariance of the pose, and
// accounts for parallax. Returns the motion during the stack in the axes of the view.
Mapper::FrameMotion Mapper::add_motion_uncertainty(FrameResult& result, const MapperInput& input,
                                                   const MotionEffect& effect) {
  variance_ = pose_variance(result.covariance);
  shared_variance_ = {};
  if (!has_pose(result.tracking)) return {};
  assume_first_motion(result);
  if (result.motion_untested) assume_motion(result);
  if (result.tracking == Tracking::first) {
    first_is_untested_ = result.motion_untested;
    return frame_motion(result, input, result.frame, {});
  }
  const Pose& pose = result.registration.earlier_from_current;
  FrameMotion own = own_motion(result, input, effect);
  variance_ = pose_variance(result.covariance + own.spread());
  shared_variance_ = pose_variance(by_motion_of_reference(result));
  if (!result.motion_untested && (result.in_motion() || !own.covariance.isZero(0))) {
    std::vector<PoseSample> samples = last_samples(result.reference, shared_variance_);
    const Pose world_from_reference = map_.keyframes()[static_cast<size_t>(result.reference)].world_from_camera;
    samples.push_back({result.frame.timestamp_s, world_from_reference * pose, variance_});
    vibration_.note(estimate_vibration(samples, options_.registration.motion_prior, vibration_.camera_rate_hz()));
    vibration_.widen_estimate(own.covariance);
    widen_first_motion();
  } else {
    first_motion_.reset();
  }
  result.covariance = with_parallax(result.covariance + own.spread() + by_motion_of_reference(result), result, pose);
  own.pose_by_motion = rotated_tangent(pose.rotation.transpose()) * own.pose_by_motion;
  return own;
}

// A robot that moves slowly without stopping and one that stops for each capture differ in whether the motion during the
// stacks agrees with the poses between them. A single slow stack hardly shows its motion, so the evidence of several adds
// up. If it suffices, the view is reconstructed with the motion, and true is returned.
bool Mapper::moves_on(FrameResult& result, const MapperInput& input) {
  constexpr double kSure = 3, kMost = 6;  // log-likelihood ratios
  if (in_motion_ || !result.complete || result.motion_unknown() || !result.undecided_motion) {
    if (!in_motion_ && result.complete && result.motion && !result.in_motion()) evidence_of_motion_ = 0;
    return false;
  }
  if (lost_ || track_.size() < continuous_from_ + 2) return false;
  const std::optional<MotionPrediction> moving =
      predict_motion(last_samples(), input.timestamp_s, options_.registration.motion_prior);
  if (!moving) return false;
  const StackMotion& own = *result.undecided_motion;
  const MotionPrior& expected = moving->motion;
  const Vector12d found = to_vector(own.motion);
  evidence_of_motion_ += log_normal(found - to_vector(expected.motion), own.covariance + expected.covariance) -
                         log_normal(found, own.covariance);
  evidence_of_motion_ = std::clamp(evidence_of_motion_, -kMost, kMost);
  if (evidence_of_motion_ < kSure) return false;
  const ReconstructedView rough = result;  // shares its images
  reconstruct(result, input, {nullptr, fused({own.motion, own.covariance}, expected), true, &rough});
  return result.in_motion();
}

// Predicts the motion during a stack from that of the last one, with accelerations in between.
MotionPrior Mapper::motion_like_last(double timestamp_s) const {
  const MotionLimits& limits = options_.registration.motion_prior;
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

// Estimates the motion during a stack by registration with the map, and decodes the stack with it. Returns the camera
// pose that was estimated with it; the predicted one, without an `effect`, if there are too few pixels.
Pose Mapper::estimate_motion(FrameResult& result, const MapperInput& input, const Prediction& predicted,
                             const ExpectedView* expected, const MotionPrior& prior, MotionEffect& effect) {
  constexpr int kRounds = 6;
  constexpr double kNegligible = 0.15;  // change of the depths, sigmas
  if (!input.depth_slopes || !result.motion) return predicted.world_from_camera;
  const bool by_own_stack = result.motion->residuals > 0;
  MotionPrior widened = prior;
  vibration_.widen(widened.covariance);
  Pose world_from_camera = predicted.world_from_camera;
  const auto without_estimate = [&] {
    effect = {};
    vibration_.widen(result.motion->covariance);
    return predicted.world_from_camera;
  };
  for (int round = 0; round < kRounds; ++round) {
    const int reference = best_reference(result.frame, world_from_camera);
    // Detecting motion requires fewer pixels than estimating it.
    const int coarsest = result.motion->motion.is_still() ? 12 : 6;
    if (reference < 0) return without_estimate();
    const Pose world_from_reference = map_.keyframes()[static_cast<size_t>(reference)].world_from_camera;
    MotionRegistration found;
    // A view with few pixels needs more of them. If few of many correspond with the map, more would not help.
    constexpr size_t kMany = 1500;
    for (int stride = coarsest; stride >= 1; stride /= 2) {
      const std::vector<DepthSlope> slopes = input.depth_slopes(result, stride);
      enter_stage("motion");
      found =
          register_motion(keyframe_image(reference), result.frame, rig_.camera,
                          world_from_reference.inverse() * world_from_camera, slopes, result.motion->motion, widened);
      if (found.valid || slopes.size() >= kMany) break;
    }
    if (!found.valid) return without_estimate();
    const Vector12d change = to_vector(result.motion->motion) + found.step - to_vector(prior.motion);
    if (!by_own_stack && vibration_.note(change, prior.covariance, found.motion_covariance)) {
      widened = prior;
      vibration_.widen(widened.covariance);
      world_from_camera = world_from_reference * found.target_from_source;
      continue;
    }
    world_from_camera = world_from_reference * found.target_from_source;
    effect = {reference, found.pose_by_motion};
    StackMotion motion = *result.motion;
    motion.motion = changed(result.motion->motion, found.step);
    motion.covariance = found.motion_covariance;
    motion.converged = true;
    if (result.motion->motion.is_still() && !is_moving(motion)) {
      result.undecided_motion = motion;
      result.motion->covariance = found.motion_covariance;
      return predicted.world_from_camera;
    }
    if (found.ripple_sigma < kNegligible) {
      // The frame is compensated for the motion before the step.
      result.motion->covariance = found.motion_covariance + found.step * found.step.transpose();
      break;
    }
    reconstruct(result, input, {expected, MotionPrior{motion.motion, motion.covariance}, true});
    result.complete = expected == nullptr;
  }
  // The ripples of the keyframe's own stack resemble those of this one: with errors as large as a vibration, they do not
  // average out.
  vibration_.widen(result.motion->covariance);
  return world_from_camera;
}

}  // namespace fringeslam
