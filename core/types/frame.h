// SPDX-License-Identifier: Apache-2.0
// One reconstructed view: pixel-aligned texture and depth of the camera (docs/method.md, section 4.2).
#pragma once

#include <opencv2/core.hpp>

#include "core/types/pinhole.h"

namespace fringeslam {

// All images are H x W in the camera's pixel grid. Invalid pixels are NaN in float images.
struct Frame {
  int index = 0;
  double timestamp_s = 0;
  cv::Mat1b texture;      // fringe-free intensity I', full scale = 255
  cv::Mat1b depth_image;  // near = bright, 0 = no data
  cv::Mat3f points_m;     // camera frame; z is the depth
  cv::Mat1f sigma_m;      // standard deviation of the depth z
  cv::Mat3f normals;      // unit, camera frame, facing the camera

  int width() const { return points_m.cols; }
  int height() const { return points_m.rows; }
  bool valid(int row, int col) const { return points_m(row, col)[2] == points_m(row, col)[2]; }
};

inline Eigen::Vector3d vector_of(const cv::Vec3f& v) {
  return {static_cast<double>(v[0]), static_cast<double>(v[1]), static_cast<double>(v[2])};
}

// Returns the camera-facing unit normal from the point and, along its row and its column, the neighbour that is closer
// in depth; NaN if a row or column has no valid neighbour. It is noisy, but available at edges, where Frame::normals is
// NaN.
cv::Vec3f neighbour_normal(const cv::Mat3f& points_m, int row, int col);

// Undistorted viewing ray (x, y, 1) of each pixel, H x W.
using PixelRays = cv::Mat2f;

// Returns the viewing rays of all pixels, NaN where distortion cannot be inverted. Callers share the memory: do not write.
PixelRays pixel_rays(const Pinhole& camera);

}  // namespace fringeslam
