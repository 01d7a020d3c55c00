// SPDX-License-Identifier: Apache-2.0
// Pinhole model with Brown-Conrady distortion for the camera and the projector (as an inverse camera). OpenCV's
// conventions: integer pixel coordinates at pixel centres, coefficients k1 k2 p1 p2 k3.
//
//   r2 = x^2 + y^2,  radial = 1 + k1 r2 + k2 r2^2 + k3 r2^3
//   x_d = x radial + 2 p1 x y + p2 (r2 + 2 x^2),  y_d = y radial + p1 (r2 + 2 y^2) + 2 p2 x y
//   u = fx x_d + cx,  v = fy y_d + cy
#pragma once

#include <Eigen/Core>

namespace fringeslam {

struct Distortion {
  double k1 = 0, k2 = 0, p1 = 0, p2 = 0, k3 = 0;
  bool is_zero() const { return *this == Distortion{}; }
  bool operator==(const Distortion&) const = default;
};

struct Pinhole {
  int width = 0, height = 0;  // px
  double fx = 0, fy = 0, cx = 0, cy = 0;
  Distortion distortion;

  bool operator==(const Pinhole&) const = default;

  // Applies the distortion to normalised image coordinates (x/z, y/z).
  Eigen::Vector2d distort(const Eigen::Vector2d& normalised) const;

  // Projects a point in the device frame (m, z > 0) to a pixel.
  Eigen::Vector2d project(const Eigen::Vector3d& point) const;

  // Returns the undistorted normalised coordinates of a pixel by Newton's method, to 1e-12; NaN where the distortion
  // polynomial cannot be inverted near the pixel.
  Eigen::Vector2d undistort(const Eigen::Vector2d& pixel) const;

  // Returns the largest squared distance from the axis, in undistorted normalised coordinates, of what the image shows. Farther
  // points are outside the image, even if the distortion polynomial folds back into it.
  double largest_r2() const;

  // True if the pixel lies in the image area, [-0.5, width - 0.5) x [-0.5, height - 0.5).
  bool contains(const Eigen::Vector2d& pixel) const {
    return pixel.x() >= -0.5 && pixel.x() < width - 0.5 && pixel.y() >= -0.5 && pixel.y() < height - 0.5;
  }

  // Projects a point in the device frame into `pixel`; returns whether the image shows it. `largest_r2` is largest_r2().
  bool shows(const Eigen::Vector3d& point, double largest_r2, Eigen::Vector2d& pixel) const {
    pixel = project(point);
    return point.z() > 0 && point.head<2>().squaredNorm() <= largest_r2 * point.z() * point.z() && contains(pixel);
  }
};

}  // namespace fringeslam
