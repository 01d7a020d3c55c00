// SPDX-License-Identifier: Apache-2.0
// Residuals between a fringe image and its prediction from a reference view, and their normal equations; see
// image_pose.h. Sixteen points are processed at a time in single precision.
#pragma once

#include <memory>
#include <opencv2/core.hpp>
#include <vector>

#include "core/types/camera_motion.h"
#include "core/types/frame.h"
#include "core/types/pattern_sequence.h"
#include "core/types/rig_model.h"

namespace fringeslam {

// Frame and image model of a view; all images are H x W in the camera's pixel grid.
struct ImageReference {
  Frame frame;              // points, their sigmas and normals
  cv::Mat1f mean_dn;        // I'
  cv::Mat1f modulation_dn;  // I'' of fringes with this period
  double period_px = 0;
  // The images that I' and I'' come from: phase shifts and times after the frame's reference time. Empty: three equal
  // steps at rest.
  std::vector<double> shifts_rad = {}, times_s = {};
  // The motion that the view was decoded with, and its covariance.
  CameraMotion motion = {};
  Matrix12d motion_covariance = Matrix12d::Zero();
  // The coordinate that the view was decoded to, from which the points have been corrected for texture (docs/method.md, section
  // 4.1); images show the same bias. Empty: that of the points.
  cv::Mat1f coordinate_px = {};
};

// Parameters of an image: its pose, in the order of retract(), and the changes of gain and contrast.
inline constexpr int kImageParameters = 8;
using ImageVector = Eigen::Matrix<double, kImageParameters, 1>;
using ImageMatrix = Eigen::Matrix<double, kImageParameters, kImageParameters>;
struct ImageParameters {
  Pose camera_from_reference;
  double gain = 0, contrast = 0;
};

// Normal equations over all points, and statistics of the fit.
struct ImageSums {
  ImageMatrix information = ImageMatrix::Zero();
  ImageVector gradient = ImageVector::Zero();
  double squares = 0;  // of the residuals in sigmas, each clipped at the square of the cut-off
  double cost = 0;     // sum of Tukey's cost, in the unit of half squares
  int points = 0;      // that the image shows
  int inliers = 0;     // within the cut-off
};

// Quantity that ImageSums::information sums up.
enum class ImageInformation {
  residuals,       // weights
  reference_noise  // the part of the residuals' variance that is due to the reference, times the squared weights
};

// True if the intensity of a pattern is a single wave, whose phase an image can be compared with: not for products of
// cosines and Gray bits combined by XOR.
bool has_image_model(const Pattern& pattern);

// Returns the coefficients of the cubic B-spline through the pixels of a grey image (core/base/cubic_spline.h).
cv::Mat1f spline_coefficients(const cv::Mat& image);

class ImageResiduals {
 public:
  // Uses every `stride`-th pixel with a normal in every `stride`-th row. Throws Error if the reference's images differ in
  // size.
  ImageResiduals(const RigModel& rig, const ImageReference& reference, int stride);

  // Numbers of all points, and of the coarse subset of one in sixteen.
  int points() const { return points_; }
  int coarse_points() const { return coarse_; }

  // Computes the normal equations over the first `points` points. `coefficients` are those of an image in DN of the
  // camera's size. Residuals beyond `outlier_sigma` get no weight (Tukey).
  ImageSums linearise(const cv::Mat1f& coefficients, const Pattern& pattern, const ImageParameters& at,
                      double outlier_sigma, int points,
                      ImageInformation information = ImageInformation::residuals) const;

  // Returns the sum over all points of their weights, derivatives and the derivatives of their residuals with respect to
  // the motion that the reference was decoded with: how an error of that motion changes the gradient. An estimate from a
  // part of the coarse points.
  Eigen::Matrix<double, kImageParameters, 12> motion_coupling(const Pattern& pattern, const ImageParameters& at) const;

 private:
  struct Estimator;
  Estimator estimator_of(const Eigen::Vector3d& point) const;
  const float* array(int quantity) const { return values_.get() + quantity * padded_; }

  Pinhole camera_, projector_;
  Pose projector_from_camera_;
  SensorModel sensor_;
  double period_px_;
  std::vector<double> shifts_rad_, times_s_;
  CameraMotion motion_;
  int points_ = 0, coarse_ = 0, padded_ = 0;
  std::unique_ptr<float[]> values_;
};

}  // namespace fringeslam
