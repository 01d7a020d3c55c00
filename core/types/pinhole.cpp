// SPDX-License-Identifier: Apache-2.0
#include "core/types/pinhole.h"

#include <Eigen/LU>
#include <limits>

namespace fringeslam {

namespace {

// Jacobian of Pinhole::distort with respect to the undistorted coordinates.
Eigen::Matrix2d distortion_jacobian(const Distortion& d, double x, double y) {
  const double r2 = x * x + y * y;
  const double radial = 1 + r2 * (d.k1 + r2 * (d.k2 + r2 * d.k3));
  const double slope = d.k1 + r2 * (2 * d.k2 + r2 * 3 * d.k3);  // d radial / d r2
  const double cross = 2 * x * y * slope + 2 * d.p1 * x + 2 * d.p2 * y;
  Eigen::Matrix2d j;
  j << radial + 2 * x * x * slope + 2 * d.p1 * y + 6 * d.p2 * x, cross,  //
      cross, radial + 2 * y * y * slope + 6 * d.p1 * y + 2 * d.p2 * x;
  return j;
}

}  // namespace

Eigen::Vector2d Pinhole::distort(const Eigen::Vector2d& normalised) const {
  const double x = normalised.x(), y = normalised.y();
  const Distortion& d = distortion;
  const double r2 = x * x + y * y;
  const double radial = 1 + r2 * (d.k1 + r2 * (d.k2 + r2 * d.k3));
  return {x * radial + 2 * d.p1 * x * y + d.p2 * (r2 + 2 * x * x),
          y * radial + d.p1 * (r2 + 2 * y * y) + 2 * d.p2 * x * y};
}

Eigen::Vector2d Pinhole::project(const Eigen::Vector3d& point) const {
  const Eigen::Vector2d distorted = distort(point.head<2>() / point.z());
  return {fx * distorted.x() + cx, fy * distorted.y() + cy};
}

double Pinhole::largest_r2() const {
  constexpr int kSteps = 16;              // per border
  constexpr double kBetweenSteps = 1.01;  // the border may bulge between them
  double largest = 0;
  const auto add = [&](double u, double v) {
    const double r2 = undistort({u, v}).squaredNorm();
    if (r2 > largest) largest = r2;  // not if there is no ray
  };
  for (int i = 0; i <= kSteps; ++i) {
    const double u = width * i / double{kSteps} - 0.5, v = height * i / double{kSteps} - 0.5;
    for (const double end : {-0.5, height - 0.5}) add(u, end);
    for (const double end : {-0.5, width - 0.5}) add(end, v);
  }
  return largest > 0 ? kBetweenSteps * largest : std::numeric_limits<double>::infinity();
}

Eigen::Vector2d Pinhole::undistort(const Eigen::Vector2d& pixel) const {
  const Eigen::Vector2d target((pixel.x() - cx) / fx, (pixel.y() - cy) / fy);
  if (distortion.is_zero()) return target;
  Eigen::Vector2d estimate = target;
  for (int iteration = 0; iteration < 20; ++iteration) {
    const Eigen::Vector2d error = distort(estimate) - target;
    const Eigen::Matrix2d jacobian = distortion_jacobian(distortion, estimate.x(), estimate.y());
    if (error.squaredNorm() < 1e-24) {
      // Beyond a fold of the distortion polynomial there are spurious roots at which the image is mirrored.
      const bool mirrored = jacobian.determinant() <= 0 || estimate.dot(target) < 0;
      return mirrored ? Eigen::Vector2d::Constant(std::numeric_limits<double>::quiet_NaN()) : estimate;
    }
    estimate -= jacobian.inverse() * error;
  }
  return Eigen::Vector2d::Constant(std::numeric_limits<double>::quiet_NaN());
}

}  // namespace fringeslam
