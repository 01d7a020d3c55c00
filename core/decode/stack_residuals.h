// SPDX-License-Identifier: Apache-2.0
// Residuals of a stack of several periods with respect to the motion of the camera while it was exposed
// (docs/method.md, section 9.1): means of different periods agree, and so do multiples of their phases.
#pragma once

#include <memory>

#include "core/decode/decode.h"
#include "core/types/camera_motion.h"

namespace fringeslam {

// Parameters of a motion to third order: to_vector(motion), angular_rad_s3, jerk_m_s3.
constexpr int kMotionUnknowns = 18;
using MotionVector = Eigen::Matrix<double, kMotionUnknowns, 1>;
using MotionMatrix = Eigen::Matrix<double, kMotionUnknowns, kMotionUnknowns>;

// Sum of squared, whitened residuals and its derivatives at one motion.
struct MotionSums {
  MotionMatrix information = MotionMatrix::Zero();
  MotionVector gradient = MotionVector::Zero();
  double squares = 0, cost = 0;  // clipped, and of the robust kernel
  int residuals = 0;
};

class StackResiduals {
 public:
  // Grey values from `clip_dn` on are saturated, and are left out. `steps`: as in DecodeOptions.
  StackResiduals(const FringeStack& stack, const RigModel& rig, const PixelRays& rays, double clip_dn, Axis axis,
                 int steps = 0);
  ~StackResiduals();

  size_t periods() const;

  // Residuals then are those of images blurred by `sigma_px`, with the noise left.
  void blur(double sigma_px);

  // Sets the rough depth of the surfaces. Without normals, their brightness does not depend on the pose.
  void set_depth(const cv::Mat1f& depth_m, bool with_normals);

  // Sums over every `stride`-th pixel in both directions. Residuals beyond `outlier_sigma` have no weight.
  MotionSums linearise(const CameraMotion& motion, int stride, double outlier_sigma);

  // Depth slopes of the fringes of this period where `known_m` is a depth; see depth_slopes(). Empty if there are none.
  std::vector<DepthSlope> slopes(const cv::Mat1f& known_m, const CameraMotion& motion, double period_px, int stride);

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace fringeslam
