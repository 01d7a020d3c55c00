// SPDX-License-Identifier: Apache-2.0
// Light that reaches matt surfaces over other surfaces: it changes slowly, but each pixel's few random paths estimate
// it with noise. An edge-avoiding a-trous filter (Dammertz et al. 2010) shares it between pixels that see one smooth
// surface: three rounds of 5 x 5 B-spline taps, 1, 2 and 4 px apart, each weighted by how well the neighbour's point
// lies in the pixel's tangent plane and their normals agree. All patterns are shared with the same weights, so that a
// pixel's light under them stays that of one set of paths.
#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <vector>

namespace fringeslam::sim {

struct IndirectLight {
  IndirectLight(cv::Size image_size, int light_channels);

  cv::Size size;
  int channels = 0;                       // a pixel: each pattern's, then what no pattern changes
  std::vector<float> lux;                 // irradiance, pixel-major
  std::vector<float> albedo;              // by which it counts
  std::vector<Eigen::Vector3f> normal;    // of what the pixel sees; 0: nothing
  std::vector<Eigen::Vector3f> position;  // world, m

  float* at(int row, int col) { return lux.data() + index(row, col) * static_cast<size_t>(channels); }
  size_t index(int row, int col) const {
    return static_cast<size_t>(row) * static_cast<size_t>(size.width) + static_cast<size_t>(col);
  }
};

// `pixel_m`: what a pixel covers across its ray at 1 m; `origin` the camera's position.
void smooth(IndirectLight& light, double pixel_m, const Eigen::Vector3d& origin);

}  // namespace fringeslam::sim
