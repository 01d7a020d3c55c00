// SPDX-License-Identifier: Apache-2.0
// One decoded view: texture and depth of the same camera pixels (METHOD S4, S5).
#pragma once

#include <opencv2/core.hpp>

#include "core/types/pinhole.h"

namespace fringeslam {

// All images are H x W and pixel for pixel the camera's. "No depth here" is NaN in every float image.
struct Frame {
  int index = 0;
  double timestamp_s = 0;
  cv::Mat1b texture;      // fringe-free intensity I', full scale = 255
  cv::Mat1b depth_image;  // near = bright, 0 = no data (METHOD S5)
  cv::Mat3f points_m;     // camera frame; z is the depth
  cv::Mat1f sigma_m;      // standard deviation of the depth z
  cv::Mat3f normals;      // unit, camera frame, facing the camera
  // Apparent, of what each pixel shows; NaN where the thermal camera does not see it. Empty without such a camera.
  cv::Mat1f temperature_c;

  int width() const { return points_m.cols; }
  int height() const { return points_m.rows; }
  bool valid(int row, int col) const { return points_m(row, col)[2] == points_m(row, col)[2]; }
};

// The normal of the plane through a point and the nearer in depth of its neighbours to both sides, facing the camera;
// NaN where it has none along its row or its column. Rough, but there is one at edges, where frames have no normals.
cv::Vec3f neighbour_normal(const cv::Mat3f& points_m, int row, int col);

// Pixel -> (x, y) with the viewing ray (x, y, 1), distortion removed: H x W.
using PixelRays = cv::Mat2f;

// Undistorted viewing rays of all pixels; NaN where the lens has no inverse.
PixelRays pixel_rays(const Pinhole& camera);

}  // namespace fringeslam
