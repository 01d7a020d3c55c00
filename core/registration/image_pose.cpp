// SPDX-License-Identifier: Apache-2.0
#include "core/registration/image_pose.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/types/error.h"
#include "core/types/linear_algebra.h"

namespace fringeslam {

namespace {

constexpr double kWideSigma = 15, kOutlierSigma = 6, kSettledSigmas = 0.5;

std::string text_of(const cv::Size& size) { return std::to_string(size.width) + "x" + std::to_string(size.height); }

// Errors that do not average out over the pixels: aliased texture, harmonics of the projector, normals that are smoother
// than the surface. Found in simulated images. The contrast of other patterns than the reference's is less well known.
Matrix6d image_systematics(const Pinhole& camera, double range_m, bool same_period) {
  const double error_px = same_period ? 0.008 : 0.04;
  const double turn = error_px / std::max(camera.fx, camera.fy), shift = turn * range_m;
  Vector6d variances;
  variances << Eigen::Vector3d::Constant(turn * turn), Eigen::Vector3d::Constant(shift * shift);
  return variances.asDiagonal();
}

}  // namespace

// Expectation of the parameters: their mean and information in the tangent of camera_from_reference.
struct ImagePoseEstimator::Prior {
  ImageParameters mean;
  ImageMatrix information;
};

struct ImagePoseEstimator::Fit {
  ImageParameters at;
  ImageSums sums;           // at the parameters before the last step
  ImageMatrix information;  // with the prior
  double prior_square = 0;
};

bool ShownPattern::agrees_with(size_t expected) const {
  // Residuals are correlated and not quite normal, so their likelihoods count less than those of independent ones: a
  // hundredth of them.
  constexpr double kDecisive = 500;
  return explained && (pattern == expected || log_ratio < kDecisive);
}

ImagePoseEstimator::ImagePoseEstimator(const RigModel& rig, const ImageReference& reference, int stride)
    : residuals_(rig, reference, stride),
      motion_covariance_(reference.motion_covariance),
      systematic_(image_systematics(rig.camera, rig.middle_range_m(), true)),
      other_systematic_(image_systematics(rig.camera, rig.middle_range_m(), false)),
      size_(reference.frame.points_m.size()),
      period_px_(reference.period_px) {}

cv::Mat1f ImagePoseEstimator::coefficients_of(const cv::Mat& image) const {
  if (image.size() != size_ || image.channels() != 1)
    throw Error("image pose: the image has " + text_of(image.size()) + " px and " + std::to_string(image.channels()) +
                " channels; the reference needs grey images of " + text_of(size_) + " px");
  return spline_coefficients(image);
}

bool ImagePoseEstimator::shows_reference_period(const Pattern& pattern) const {
  return pattern.coding == Coding::fringe && std::abs(pattern.period_px - period_px_) < 1e-6;
}

ImagePoseEstimator::Prior ImagePoseEstimator::prior_of(const Pattern& pattern, const Pose& initial,
                                                       const Matrix6d& information) const {
  // The contrast of other periods differs from that of the reference, because the projector and the lens blur fine
  // fringes; the rest changes with the distance from the focus.
  constexpr double kGainSigma = 0.01, kContrastSigma = 0.02, kOtherContrastSigma = 0.2;
  const double contrast_sigma = shows_reference_period(pattern) ? kContrastSigma : kOtherContrastSigma;
  Prior prior{{initial.inverse(), 0, 0}, ImageMatrix::Zero()};
  // With the tangents x of `initial` and x' = J x of its inverse, the information is J^-T information J^-1; J is the
  // derivative in covariance_of_inverse(), and that of the inverse's inverse is J^-1.
  const Matrix6d back = tangent_of_inverse(prior.mean.camera_from_reference);
  prior.information.topLeftCorner<6, 6>() = back.transpose() * information * back;
  prior.information(6, 6) = 1 / (kGainSigma * kGainSigma);
  prior.information(7, 7) = 1 / (contrast_sigma * contrast_sigma);
  return prior;
}

bool ImagePoseEstimator::fit(const cv::Mat1f& image, const Pattern& pattern, const Prior& prior, int points,
                             int iterations, double outlier_sigma, Fit& fit) const {
  constexpr int kLeastInliers = 100;
  for (int iteration = 0; iteration < iterations; ++iteration) {
    fit.sums = residuals_.linearise(image, pattern, fit.at, outlier_sigma, points);
    if (fit.sums.inliers < kLeastInliers) return false;
    ImageVector from_prior;
    from_prior << difference(fit.at.camera_from_reference, prior.mean.camera_from_reference),
        fit.at.gain - prior.mean.gain, fit.at.contrast - prior.mean.contrast;
    // Unmodelled residuals weaken the evidence.
    const double excess = std::max(1.0, fit.sums.squares / fit.sums.points);
    fit.information = fit.sums.information / excess + prior.information;
    fit.prior_square = from_prior.dot(prior.information * from_prior);
    const ImageVector step =
        solve_positive_definite(Eigen::MatrixXd(fit.information),
                                Eigen::VectorXd(-(fit.sums.gradient / excess + prior.information * from_prior)));
    if (!step.allFinite()) return false;
    fit.at.camera_from_reference = retract(fit.at.camera_from_reference, step.head<6>());
    fit.at.gain += step[6];
    fit.at.contrast += step[7];
    if (std::sqrt(step.dot(fit.information * step)) < kSettledSigmas) return true;
  }
  return false;
}

ImagePose ImagePoseEstimator::estimate(const cv::Mat& image, const Pattern& pattern, const Pose& initial,
                                       const Matrix6d& information) const {
  constexpr int kCoarseIterations = 8, kIterations = 100;  // few images need more than eight
  constexpr double kMaxRms = 2.5, kLeastShare = 0.5;       // most points are explained
  const cv::Mat1f grey = coefficients_of(image);
  const Prior prior = prior_of(pattern, initial, information);
  ImagePose result;
  result.reference_from_camera = initial;
  Fit found{prior.mean, {}, prior.information, 0};
  fit(grey, pattern, prior, residuals_.coarse_points(), kCoarseIterations, kWideSigma, found);
  const bool settled = fit(grey, pattern, prior, residuals_.points(), kIterations, kOutlierSigma, found);
  result.points = found.sums.points;
  result.inliers = found.sums.inliers;
  result.gain = found.at.gain;
  result.contrast = found.at.contrast;
  result.rms_sigma = std::sqrt(found.sums.squares / std::max(1, found.sums.points));
  result.valid = settled && result.inliers >= kLeastShare * result.points && result.rms_sigma <= kMaxRms;
  if (!found.at.camera_from_reference.is_finite()) return result;
  const Pose& pose = found.at.camera_from_reference;
  result.reference_from_camera = pose.inverse();
  const Matrix6d& systematic = shows_reference_period(pattern) ? systematic_ : other_systematic_;
  const ImageMatrix covariance = inverse_positive_definite(Eigen::MatrixXd(found.information));
  result.covariance = covariance_of_inverse(pose, covariance.topLeftCorner<6, 6>()) + systematic;
  // An error of the reference's motion shifts the minimum.
  const double excess = std::max(1.0, found.sums.squares / std::max(1, found.sums.points));
  const Eigen::Matrix<double, kImageParameters, 12> by_motion =
      covariance * residuals_.motion_coupling(pattern, found.at) / excess;
  result.by_reference_motion = tangent_of_inverse(pose) * by_motion.topRows<6>();
  result.motion_covariance = result.by_reference_motion * motion_covariance_ * result.by_reference_motion.transpose();
  result.covariance += result.motion_covariance;
  // The coarse subset represents all points.
  const ImageSums of_reference = residuals_.linearise(grey, pattern, found.at, kOutlierSigma,
                                                      residuals_.coarse_points(), ImageInformation::reference_noise);
  const double share = static_cast<double>(residuals_.points()) / std::max(1, residuals_.coarse_points());
  const ImageMatrix caused = covariance * of_reference.information * covariance * (share / (excess * excess));
  result.reference_covariance = covariance_of_inverse(pose, caused.topLeftCorner<6, 6>()) + systematic_;
  return result;
}

ShownPattern ImagePoseEstimator::shown_pattern(const cv::Mat& image, const std::vector<Pattern>& candidates,
                                               const Pose& initial, const Matrix6d& information) const {
  constexpr int kIterations = 4;
  constexpr double kExplained = 0.25;  // of the mean clipped square if nothing fits
  if (candidates.empty()) throw Error("image pose: no candidate patterns");
  const cv::Mat1f grey = coefficients_of(image);
  ShownPattern shown;
  double best = -std::numeric_limits<double>::infinity(), second = best;
  for (size_t i = 0; i < candidates.size(); ++i) {
    const Prior prior = prior_of(candidates[i], initial, information);
    Fit found{prior.mean, {}, prior.information, 0};
    fit(grey, candidates[i], prior, residuals_.coarse_points(), kIterations, kOutlierSigma, found);
    found.sums = residuals_.linearise(grey, candidates[i], found.at, kOutlierSigma, residuals_.coarse_points());
    PatternFit quality{-found.sums.cost - 0.5 * found.prior_square,
                       found.sums.squares / std::max(1, found.sums.points)};
    if (quality.log_likelihood > best) {
      second = best;
      best = quality.log_likelihood;
      shown.pattern = i;
    } else {
      second = std::max(second, quality.log_likelihood);
    }
    shown.fits.push_back(quality);
  }
  shown.log_ratio = best - second;
  shown.explained = shown.fits[shown.pattern].mean_square < kExplained * kOutlierSigma * kOutlierSigma;
  return shown;
}

}  // namespace fringeslam
