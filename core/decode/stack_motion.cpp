// SPDX-License-Identifier: Apache-2.0
#include "core/decode/stack_motion.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/decode/stack_residuals.h"
#include "core/types/error.h"
#include "core/types/linear_algebra.h"

namespace fringeslam {

std::vector<DepthSlope> depth_slopes(const FringeStack& stack, const RigModel& rig, const PixelRays& rays,
                                     const cv::Mat1f& depth_m, double clip_dn, const CameraMotion& motion,
                                     double period_px, int stride, Axis axis, int steps) {
  check_stack(stack);
  StackResiduals problem(stack, rig, rays, clip_dn, axis, steps);
  if (problem.periods() == 0) return {};
  problem.set_depth(depth_m, false);
  return problem.slopes(depth_m, motion, period_px, stride);
}

namespace {

using Eigen::Vector3d;

constexpr int kLeastResiduals = 100;

struct Level {
  double blur_px;
  int stride, iterations;
  double outlier_sigma;
};

// Errors that do not average out over the pixels: aliased texture, interpolation, and brightness that changes with the
// pose. Found in simulated stacks.
Matrix12d systematic_covariance() {
  constexpr double kTurn_rad_s = 8e-3, kVelocity_m_s = 8e-3, kTurn_rad_s2 = 0.2, kAcceleration_m_s2 = 0.2;
  Vector12d sigmas;
  sigmas << Vector3d::Constant(kTurn_rad_s), Vector3d::Constant(kVelocity_m_s), Vector3d::Constant(kTurn_rad_s2),
      Vector3d::Constant(kAcceleration_m_s2);
  return sigmas.cwiseAbs2().asDiagonal();
}

constexpr double kSharing_px2 = 1600;  // area within which residuals share their errors

// `sums`: with the prior. The third order is marginalised.
Matrix12d motion_covariance(const MotionSums& sums) {
  return inverse_positive_definite(Eigen::MatrixXd(sums.information)).topLeftCorner<12, 12>() + systematic_covariance();
}

MotionVector vector_of(const CameraMotion& motion) {
  MotionVector parameters;
  parameters << to_vector(motion), motion.angular_rad_s3, motion.jerk_m_s3;
  return parameters;
}

CameraMotion motion_of(const MotionVector& parameters) {
  CameraMotion motion = to_motion(parameters.head<12>());
  motion.angular_rad_s3 = parameters.segment<3>(12);
  motion.jerk_m_s3 = parameters.segment<3>(15);
  return motion;
}

// How fast accelerations change during a stack, standard deviations of each component.
struct ThirdOrder {
  double turn_rad_s3 = 20, jerk_m_s3 = 10;
};

// Accelerations as large as those of `motion` may be absent at the stack's other end.
ThirdOrder third_order_of(const CameraMotion& motion, double duration_s) {
  const ThirdOrder least;
  const double per_component = 2 / (std::sqrt(3.0) * duration_s);
  return {std::max(least.turn_rad_s3, per_component * motion.angular_rad_s2.norm()),
          std::max(least.jerk_m_s3, per_component * motion.acceleration_m_s2.norm())};
}

// Information about the motion before its stack is looked at.
MotionMatrix information_of(const MotionPrior& prior, const ThirdOrder& third = {}) {
  // Errors that residuals share, such as aliased texture, look like accelerations. Held too tightly, those would turn into
  // errors of the velocity.
  constexpr double kWider = 10;
  MotionMatrix information = MotionMatrix::Zero();
  Matrix12d covariance = prior.covariance;
  covariance.topRightCorner<6, 6>() *= kWider;
  covariance.bottomLeftCorner<6, 6>() *= kWider;
  covariance.bottomRightCorner<6, 6>() *= kWider * kWider;
  information.topLeftCorner<12, 12>() = inverse_positive_definite(Eigen::MatrixXd(covariance));
  information.diagonal().segment<3>(12).setConstant(1 / (third.turn_rad_s3 * third.turn_rad_s3));
  information.diagonal().segment<3>(15).setConstant(1 / (third.jerk_m_s3 * third.jerk_m_s3));
  return information;
}

// The same with accelerations and their changes held near zero.
MotionMatrix information_of_velocity(const MotionPrior& prior) {
  constexpr double kHeld = 1e4;
  MotionPrior steady = prior;
  steady.covariance.bottomRightCorner<6, 6>() /= kHeld;
  steady.covariance.topRightCorner<6, 6>().setZero();
  steady.covariance.bottomLeftCorner<6, 6>().setZero();
  MotionMatrix information = information_of(steady);
  information.bottomRightCorner<6, 6>() *= kHeld;
  return information;
}

// Evidence per residual: unmodelled residuals, such as depth errors, weaken it, and so do errors that neighbours share.
// `stride`: between the pixels of the sums.
double evidence_of(const MotionSums& sums, int stride) {
  return 1 / (std::max(1.0, sums.squares / sums.residuals) * std::max(1.0, kSharing_px2 / (stride * stride)));
}

// Prior whose covariance is multiplied by `scale`, the factor of greatest likelihood.
struct ScaledPrior {
  MotionMatrix information;
  MotionVector mean;
  double scale = 1;

  double cost(const MotionVector& motion) const {
    return 0.5 / scale * (motion - mean).dot(information * (motion - mean));
  }
};

// Adds the prior to the sums at `motion`, and finds the prior's scale by expectation maximisation: accelerations that the
// images show in some directions make the prior doubtful in the others, too.
MotionSums with_prior(MotionSums sums, int stride, const MotionVector& motion, ScaledPrior& prior) {
  constexpr int kIterations = 20;
  constexpr double kSettled = 1.1;
  const double evidence = evidence_of(sums, stride);
  const MotionMatrix measured = evidence * sums.information;
  const MotionVector pull = evidence * sums.gradient, from_prior = motion - prior.mean;
  for (int i = 0; i < kIterations; ++i) {
    sums.information = measured + prior.information / prior.scale;
    sums.gradient = pull + prior.information * from_prior / prior.scale;
    const MotionVector step =
        solve_positive_definite(Eigen::MatrixXd(sums.information), Eigen::VectorXd(-sums.gradient));
    const MotionMatrix left = inverse_positive_definite(Eigen::MatrixXd(sums.information));
    const MotionVector off = from_prior + step;
    const double scale =
        std::max(1.0, (off.dot(prior.information * off) + (prior.information * left).trace()) / kMotionUnknowns);
    if (!(scale > kSettled * prior.scale || kSettled * scale < prior.scale)) break;
    prior.scale = scale;
  }
  return sums;
}

// Minimises the robust cost of one level by Levenberg-Marquardt: where texture is fine, full steps overshoot. Returns true
// if the last step is small relative to the sigmas that motion_covariance() reports.
bool minimise(StackResiduals& problem, const Level& level, ScaledPrior prior, MotionVector& motion, MotionSums& sums) {
  constexpr double kSettledSigmas = 0.1, kStuck = 1e6;
  // The cost is not smooth: pixels enter and leave the images. Where it is flat, small steps are no worse than smaller.
  constexpr double kFlat = 1e-3, kFlatSigmas = 0.5;
  // The kernel's weights change with the motion, so that Gauss-Newton steps are too short: successful ones get longer.
  constexpr double kLonger = 1.5, kLongest = 5;
  problem.blur(level.blur_px);
  double damping = 1e-3, factor = 1, cost = std::numeric_limits<double>::infinity(), evidence = 1;
  MotionVector tried = motion;
  for (int iteration = 0; iteration < level.iterations; ++iteration) {
    const MotionSums here = problem.linearise(motion_of(tried), level.stride, level.outlier_sigma);
    if (here.residuals < kLeastResiduals) return false;
    if (iteration == 0) evidence = evidence_of(here, level.stride);
    const auto cost_at = [&](const MotionVector& at, const MotionSums& of) {
      return (of.cost + prior.cost(at) / evidence) / of.residuals;
    };
    const double here_cost = cost_at(tried, here);
    const bool flat = std::abs(here_cost - cost) < kFlat * cost;
    if (here_cost <= cost) {
      motion = tried;
      sums = with_prior(here, level.stride, motion, prior);
      evidence = evidence_of(here, level.stride);
      cost = cost_at(motion, here);
      damping = std::max(1e-6, 0.2 * damping);
      factor = std::min(kLongest, iteration > 0 ? kLonger * factor : 1);
    } else {
      if (factor == 1) damping = std::max(1e-3, 10 * damping);
      factor = 1;
      if (damping > kStuck) return false;
    }
    MotionMatrix damped = sums.information;
    damped.diagonal() *= 1 + damping;
    const MotionVector step = solve_positive_definite(Eigen::MatrixXd(damped), Eigen::VectorXd(-sums.gradient));
    if (!step.allFinite()) return false;
    tried = motion + factor * step;
    const double sigmas = std::sqrt(step.dot(sums.information * step));
    if (sigmas < kSettledSigmas || (flat && sigmas < kFlatSigmas)) return true;
  }
  return false;
}

}  // namespace

StackMotion estimate_stack_motion(const FringeStack& stack, const RigModel& rig, const PixelRays& rays,
                                  const cv::Mat1f& depth_m, double clip_dn, const MotionPrior& prior,
                                  MotionSearch search, Axis axis) {
  check_stack(stack);
  StackMotion result;
  result.motion = prior.motion;
  result.covariance = prior.covariance;
  StackResiduals problem(stack, rig, rays, clip_dn, axis);
  if (problem.periods() < 2) return result;
  problem.set_depth(depth_m, true);
  // The texture between pixels aliases; more pixels average its errors.
  constexpr int kRoughStride = 8, kFineStride = 4;
  const bool wide = search != MotionSearch::close;
  const Level fine{0, kRoughStride, 20, 8}, last{0, wide ? kRoughStride : kFineStride, 20, 8};
  std::vector<Level> levels = {fine};
  if (wide) levels = {{12, 8, 15, 200}, {6, 8, 15, 60}, {3, 8, 15, 30}, {1.5, 8, 12, 20}, fine};
  const MotionVector start = vector_of(prior.motion);
  MotionVector motion = start;
  const ScaledPrior held{information_of_velocity(prior), start}, free{information_of(prior), start};
  MotionSums sums;
  bool settled = false;
  // Blurred images do not determine accelerations far from the motion.
  const ScaledPrior& first = search == MotionSearch::accelerated ? free : held;
  for (const Level& level : levels) settled = minimise(problem, level, first, motion, sums);
  if (sums.residuals < kLeastResiduals) return result;
  settled = minimise(problem, last, free, motion, sums) || settled;
  // Where accelerations turn out to be large, so may be their changes.
  const auto [earliest, latest] = std::minmax_element(stack.exposure_time_s.begin(), stack.exposure_time_s.end());
  const ThirdOrder third = third_order_of(motion_of(motion), *latest - *earliest);
  constexpr double kLarger = 1.5;
  if (third.turn_rad_s3 > kLarger * ThirdOrder().turn_rad_s3 || third.jerk_m_s3 > kLarger * ThirdOrder().jerk_m_s3)
    settled = minimise(problem, last, {information_of(prior, third), start}, motion, sums);
  // Residuals are clipped at 8 sigmas. Wrong motions of fast stacks leave an RMS of 3.6 and more.
  constexpr double kMaxRms = 3.3;
  result.motion = motion_of(motion);
  result.covariance = motion_covariance(sums);
  result.rms_sigma = std::sqrt(sums.squares / sums.residuals);
  result.residuals = sums.residuals;
  result.converged = settled && result.rms_sigma <= kMaxRms;
  return result;
}

std::optional<bool> shows_motion(const FringeStack& stack, const RigModel& rig, const PixelRays& rays,
                                 const cv::Mat1f& depth_m, double clip_dn, Axis axis) {
  // Far from the minimum, the linearised motion is too small; large residuals give it away.
  constexpr double kMaxRms = 1.3, kOutlierSigma = 8;
  constexpr int kStride = 5;
  StackResiduals problem(stack, rig, rays, clip_dn, axis);
  if (problem.periods() < 2) return std::nullopt;
  problem.set_depth(depth_m, false);
  MotionSums sums = problem.linearise({}, kStride, kOutlierSigma);
  if (sums.residuals < kLeastResiduals) return std::nullopt;
  if (sums.squares > kMaxRms * kMaxRms * sums.residuals) return true;
  ScaledPrior prior{information_of(unknown_motion({})), MotionVector::Zero()};
  sums = with_prior(sums, kStride, MotionVector::Zero(), prior);
  const MotionVector step = solve_positive_definite(Eigen::MatrixXd(sums.information), Eigen::VectorXd(-sums.gradient));
  StackMotion linear;
  linear.motion = motion_of(step);
  linear.covariance = motion_covariance(sums);
  return is_moving(linear);
}

}  // namespace fringeslam
