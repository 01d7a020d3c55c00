// SPDX-License-Identifier: Apache-2.0
// The pose of a single fringe image relative to a reference view, and the pattern that it shows (docs/method.md, section
// 9.5).
//
// The reference view gives depth z, mean I' and modulation I'' of its pixels. At the pose T, camera_from_reference, the
// image shows the point P = z d at x = pi_c(T P), lit by the projector coordinate u = pi_p(T P), with
//
//   I(x) = y0 + (1 + g) a (I' - y0 + (1 + m) I'' cos(2 pi (u + 1/2) / p + delta)),
//
// y0 the black level, a the change of irradiance with distance and incidence, g and m small unknown changes of gain and
// contrast. Gauss-Newton over T, g and m. Fringes constrain motion that changes depth, texture the rest.
#pragma once

#include <cstddef>
#include <vector>

#include "core/registration/image_residuals.h"

namespace fringeslam {

struct ImagePose {
  Pose reference_from_camera;
  // Given the image and the prior, with the uncertainty of the reference's motion; tangent of retract().
  Matrix6d covariance = Matrix6d::Zero();
  // The parts of it that are common to all images that are compared with this reference and do not average out over them:
  // the noise of the reference and systematic errors; and the error of its motion. `by_reference_motion` is the derivative
  // of the pose with respect to to_vector() of the motion that the reference was decoded with, for the same images.
  Matrix6d reference_covariance = Matrix6d::Zero(), motion_covariance = Matrix6d::Zero();
  Eigen::Matrix<double, 6, 12> by_reference_motion = Eigen::Matrix<double, 6, 12>::Zero();
  double gain = 0, contrast = 0;  // g and m
  double rms_sigma = 0;           // of the residuals, clipped at the cut-off; about 1 if the sigmas are correct
  int points = 0;                 // that the image shows
  int inliers = 0;                // within the cut-off
  bool valid = false;             // false: the pose is unknown
};

// How well an image agrees with a pattern, at the pose that fits best.
struct PatternFit {
  double log_likelihood = 0;  // up to a constant
  double mean_square = 0;     // of the clipped residuals, sigmas squared
};

struct ShownPattern {
  size_t pattern = 0;    // index of the most likely candidate
  double log_ratio = 0;  // log-likelihood of that candidate minus that of the next one; infinite if it is the only one
  bool explained = false;        // most points agree with that candidate
  std::vector<PatternFit> fits;  // one per candidate
  // True if the image shows candidate `expected`, or if there is no evidence against it.
  bool agrees_with(size_t expected) const;
};

class ImagePoseEstimator {
 public:
  // Uses every `stride`-th pixel with a normal in every `stride`-th row of the reference. Throws Error if sizes differ.
  explicit ImagePoseEstimator(const RigModel& rig, const ImageReference& reference, int stride = 3);

  // Estimates the pose of an image (DN, of the camera's size) that was exposed as long as the reference's images. The
  // texture has to be within about two pixels of where `initial`, reference_from_camera, predicts it. `information` is
  // the inverse covariance of this prediction in the tangent of retract(); zero: none. Not valid if few points agree or
  // if the iteration does not settle. Throws Error if the image's size is wrong or the pattern has no model (has_image_model()).
  ImagePose estimate(const cv::Mat& image, const Pattern& pattern, const Pose& initial,
                     const Matrix6d& information) const;

  // Compares an image with several patterns. Each is fitted with the prediction `initial` and its `information` as in
  // estimate(), so an uncertain prediction makes the comparison less decisive.
  ShownPattern shown_pattern(const cv::Mat& image, const std::vector<Pattern>& candidates, const Pose& initial,
                             const Matrix6d& information) const;

 private:
  struct Fit;
  struct Prior;
  bool shows_reference_period(const Pattern& pattern) const;
  Prior prior_of(const Pattern& pattern, const Pose& initial, const Matrix6d& information) const;
  // Returns false if it does not settle.
  bool fit(const cv::Mat1f& image, const Pattern& pattern, const Prior& prior, int points, int iterations,
           double outlier_sigma, Fit& at) const;
  cv::Mat1f coefficients_of(const cv::Mat& image) const;

  ImageResiduals residuals_;
  Matrix12d motion_covariance_;
  Matrix6d systematic_, other_systematic_;  // of images with the reference's period, and of others
  cv::Size size_;
  double period_px_;
};

}  // namespace fringeslam
