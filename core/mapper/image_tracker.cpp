// SPDX-License-Identifier: Apache-2.0
#include "core/mapper/image_tracker.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "core/types/error.h"
#include "core/types/linear_algebra.h"

namespace fringeslam {

namespace {

Matrix6d symmetric(const Matrix6d& matrix) { return 0.5 * (matrix + matrix.transpose()); }

// The part of a pose's covariance that differs from image to image. The part that they have in common is only an estimate;
// some of it may vary.
Matrix6d own_part(const ImagePose& pose) {
  constexpr double kLeastOwnShare = 0.1;
  return symmetric((1 + kLeastOwnShare) * (pose.covariance - pose.motion_covariance) - pose.reference_covariance);
}

}  // namespace

ImageReference image_reference(const ReconstructedView& view, const FringeStack& stack) {
  if (view.decoded.mean.empty() || !(view.decoded.finest_period_px > 0))
    throw Error("image pose: view " + std::to_string(stack.index) + " was not decoded from fringes");
  ImageReference reference{view.frame, view.decoded.mean, view.decoded.modulation, view.decoded.finest_period_px};
  for (size_t k = 0; k < stack.images.size(); ++k) {
    const Pattern& pattern = stack.patterns.patterns[k];
    if (pattern.coding != Coding::fringe || pattern.axis != Axis::columns ||
        pattern.period_px != view.decoded.finest_period_px)
      continue;
    reference.shifts_rad.push_back(pattern.shift_rad);
    reference.times_s.push_back(stack.exposure_time_s[k] - stack.timestamp_s);
  }
  reference.coordinate_px = view.decoded.coordinate_px;
  if (view.motion && view.motion->converged) {
    reference.motion = view.motion->motion;
    reference.motion_covariance = view.motion->covariance;
  }
  if (view.motion_untested && view.undecided_motion) reference.motion_covariance = mean_square(*view.undecided_motion);
  return reference;
}

ImageTracker::ImageTracker(const RigModel& rig, const PatternSequence& sequence, const ImageTrackerOptions& options)
    : rig_(rig), sequence_(sequence), options_(options) {
  check_options(options, "image tracker");
}

void ImageTracker::set_reference(const ImageReference& reference, const Pose& world_from_camera,
                                 const Matrix6d& covariance, double timestamp_s,
                                 const std::optional<MotionPrior>& motion) {
  estimator_ = std::make_shared<const ImagePoseEstimator>(rig_, reference, options_.stride);
  world_from_reference_ = world_from_camera;
  last_ = {};
  last_.valid = true;
  reference_covariance_ = covariance;
  reference_speed_variance_ = speed_variance(reference);
  motion_error_.setZero();
  motion_error_covariance_ = reference.motion_covariance;
  if (state_ && std::abs(timestamp_s - state_->time_s) <= options_.max_gap_s) {
    // The filter's pose has the errors of the old reference; the new reference has different ones.
    state_->covariance.topLeftCorner<6, 6>() += common_ + covariance;
    return;
  }
  common_ = covariance;
  const MotionPrior known = motion ? *motion : unknown_motion({});
  State start{timestamp_s, world_from_camera, {}, Matrix12d::Zero()};
  const Matrix6d turn = rotated_tangent(world_from_camera.rotation);
  start.rate = turn * to_vector(known.motion).head<6>();
  start.covariance.bottomRightCorner<6, 6>() =
      rotated_covariance(world_from_camera.rotation, known.covariance.topLeftCorner<6, 6>());
  state_ = start;
}

void ImageTracker::move(const Pose& new_from_old) {
  const Matrix6d turn = rotated_tangent(new_from_old.rotation);
  const auto moved = [&](const Matrix6d& covariance) {
    return symmetric(rotated_covariance(new_from_old.rotation, covariance));
  };
  world_from_reference_ = orthonormalised(new_from_old * world_from_reference_);
  reference_covariance_ = moved(reference_covariance_);
  common_ = moved(common_);
  if (!state_) return;
  state_->world_from_camera = orthonormalised(new_from_old * state_->world_from_camera);
  state_->rate = turn * state_->rate;
  Matrix12d both = Matrix12d::Zero();
  both.topLeftCorner<6, 6>() = both.bottomRightCorner<6, 6>() = turn;
  state_->covariance = both * state_->covariance * both.transpose();
}

bool ImageTracker::needs_reference() const {
  return !estimator_ || !last_.valid || last_.rms_sigma > options_.max_rms_sigma ||
         translation_m(last_.reference_from_camera) > options_.max_distance * rig_.middle_range_m();
}

double ImageTracker::speed_variance(const ImageReference& reference) const {
  const double range_m = rig_.middle_range_m();
  const Matrix12d& covariance = reference.motion_covariance;
  return range_m * range_m * covariance.diagonal().head<3>().sum() + covariance.diagonal().segment<3>(3).sum();
}

bool ImageTracker::should_replace_reference(const ImageReference& view) const {
  constexpr double kGain = 2;
  return needs_reference() || kGain * kGain * speed_variance(view) < reference_speed_variance_;
}

ImageTracker::State ImageTracker::at(double time_s) const {
  State state = *state_;
  const double after_s = time_s - state.time_s;
  state.time_s = time_s;
  state.world_from_camera = orthonormalised(retract(state.world_from_camera, after_s * state.rate));
  Matrix12d transition = Matrix12d::Identity();
  transition.topRightCorner<6, 6>() = after_s * Matrix6d::Identity();
  Vector6d variances;
  variances << Eigen::Vector3d::Constant(options_.turn_rad_s2 * options_.turn_rad_s2),
      Eigen::Vector3d::Constant(options_.acceleration_m_s2 * options_.acceleration_m_s2);
  Eigen::Matrix<double, 12, 6> by_acceleration;
  by_acceleration << 0.5 * after_s * after_s * Matrix6d::Identity(), after_s * Matrix6d::Identity();
  state.covariance = transition * state.covariance * transition.transpose() +
                     by_acceleration * variances.asDiagonal() * by_acceleration.transpose();
  return state;
}

std::optional<CameraPrediction> ImageTracker::predict(double time_s) const {
  if (!state_ || std::abs(time_s - state_->time_s) > options_.max_gap_s) return std::nullopt;
  const State state = at(time_s);
  CameraPrediction prediction{state.world_from_camera, state.covariance.topLeftCorner<6, 6>() + common_,
                              unknown_motion({})};
  const Matrix6d turn = rotated_tangent(state.world_from_camera.rotation.transpose());
  const Vector6d rate = turn * state.rate;
  prediction.motion.motion.angular_rad_s = rate.head<3>();
  prediction.motion.motion.velocity_m_s = rate.tail<3>();
  prediction.motion.covariance.topLeftCorner<6, 6>() =
      rotated_covariance(state.world_from_camera.rotation.transpose(), state.covariance.bottomRightCorner<6, 6>());
  return prediction;
}

TrackedImage ImageTracker::track(const cv::Mat& image, const Pattern& expected, double time_s,
                                 const std::vector<Pattern>& requested) {
  TrackedImage result;
  result.timestamp_s = time_s;
  if (!estimator_ || !state_ || std::abs(time_s - state_->time_s) > options_.max_gap_s) return result;
  if (!has_image_model(expected)) {  // nothing contradicts it
    result.as_expected = true;
    return result;
  }
  const State state = at(time_s);
  const Matrix6d turn = rotated_tangent(world_from_reference_.rotation);
  const Pose predicted = world_from_reference_.inverse() * state.world_from_camera;
  // The prediction is hardly part of the estimate, which is to be a measurement for the filter; it only holds directions
  // that the image leaves undetermined.
  constexpr double kWeak = 0.01, kLeastVariance = 1e-12;
  const Matrix6d prior = turn.transpose() * state.covariance.topLeftCorner<6, 6>() * turn;
  const Matrix6d information = kWeak * symmetric(inverse(prior + kLeastVariance * Matrix6d::Identity()));
  result.relative = estimator_->estimate(image, expected, predicted, information);
  if (result.relative.valid) {
    result.shown = expected;
    result.as_expected = true;
  } else {
    std::vector<Pattern> candidates = {expected};
    const auto add = [&](const std::vector<Pattern>& patterns) {
      for (const Pattern& pattern : patterns) {
        if (!has_image_model(pattern)) continue;
        if (std::find(candidates.begin(), candidates.end(), pattern) == candidates.end()) candidates.push_back(pattern);
      }
    };
    add(requested);
    add(sequence_.patterns);
    const ShownPattern shown = estimator_->shown_pattern(image, candidates, predicted, information);
    result.as_expected = shown.agrees_with(0);
    if (shown.explained) result.shown = candidates[shown.pattern];
    if (shown.explained && shown.pattern != 0)
      result.relative = estimator_->estimate(image, candidates[shown.pattern], predicted, information);
  }
  last_ = result.relative;
  if (!result.relative.valid) return result;
  correct(state, result.relative);
  result.tracked = true;
  result.world_from_camera = state_->world_from_camera;
  result.covariance = state_->covariance.topLeftCorner<6, 6>() + common_;
  return result;
}

void ImageTracker::compare(const TrackedImage& image, const Pose& world_from_camera, const Matrix6d& covariance) {
  if (!image.tracked) return;
  const Eigen::Matrix<double, 6, 12>& by_motion = image.relative.by_reference_motion;
  const Matrix6d turn = rotated_tangent(world_from_reference_.rotation);
  const Vector6d seen =
      difference(image.relative.reference_from_camera, world_from_reference_.inverse() * world_from_camera);
  // A rotation of the reference moves the camera with it.
  const Matrix6d moved =
      tangent_of_product(world_from_reference_.rotation * image.relative.reference_from_camera.translation);
  const Matrix6d noise = image.relative.covariance - image.relative.motion_covariance +
                         turn.transpose() * (covariance + moved * reference_covariance_ * moved.transpose()) * turn;
  const Matrix6d innovation = by_motion * motion_error_covariance_ * by_motion.transpose() + noise;
  const Eigen::Matrix<double, 12, 6> gain =
      motion_error_covariance_ * by_motion.transpose() * inverse(symmetric(innovation));
  motion_error_ += gain * (seen - by_motion * motion_error_);
  const Matrix12d left = Matrix12d::Identity() - gain * by_motion;
  motion_error_covariance_ = left * motion_error_covariance_ * left.transpose() + gain * noise * gain.transpose();
}

void ImageTracker::correct(State state, const ImagePose& found) {
  const Matrix6d turn = rotated_tangent(world_from_reference_.rotation);
  const Eigen::Matrix<double, 6, 12>& by_motion = found.by_reference_motion;
  const Pose relative = retract(found.reference_from_camera, -by_motion * motion_error_);
  const Matrix6d of_motion = symmetric(by_motion * motion_error_covariance_ * by_motion.transpose());
  const Vector6d step = difference(world_from_reference_ * relative, state.world_from_camera);
  // The error of the motion affects images with different phase shifts differently.
  const Matrix6d noise = turn * (own_part(found) + of_motion) * turn.transpose();
  const Matrix6d before = state.covariance.topLeftCorner<6, 6>();
  const Eigen::Matrix<double, 12, 6> gain = state.covariance.leftCols<6>() * inverse(symmetric(before + noise));
  const Vector12d change = gain * step;
  state.world_from_camera = orthonormalised(retract(state.world_from_camera, change.head<6>()));
  state.rate += change.tail<6>();
  // Joseph's form stays positive definite.
  Matrix12d left = Matrix12d::Identity();
  left.leftCols<6>() -= gain;
  state.covariance = left * state.covariance * left.transpose() + gain * noise * gain.transpose();
  // An error of the reference's pose moves the camera with it.
  const Matrix6d moved = tangent_of_product(world_from_reference_.rotation * found.reference_from_camera.translation);
  common_ = symmetric(moved * reference_covariance_ * moved.transpose() +
                      turn * (found.reference_covariance + of_motion) * turn.transpose());
  state_ = std::move(state);
}

std::optional<size_t> first_inconsistent_image(ImageTracker tracker, const FringeStack& stack) {
  check_stack(stack);
  for (size_t i = 0; i < stack.images.size(); ++i) {
    if (!tracker.predict(stack.exposure_time_s[i])) return std::nullopt;
    const TrackedImage image =
        tracker.track(stack.images[i], stack.patterns.patterns[i], stack.exposure_time_s[i], stack.patterns.patterns);
    if (!image.as_expected) return i;
  }
  return std::nullopt;
}

}  // namespace fringeslam
