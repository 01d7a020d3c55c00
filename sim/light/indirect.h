// SPDX-License-Identifier: Apache-2.0
// Denoising of indirect light. The indirect irradiance on diffuse surfaces varies slowly, but its Monte Carlo estimate
// from a few paths per pixel is noisy. An edge-avoiding a-trous filter (Dammertz et al. 2010) averages it over pixels
// that see the same smooth surface: three passes of 5 x 5 B-spline taps, spaced 1, 2 and 4 px, each weighted by the
// distance of the neighbour's point from the pixel's tangent plane and by the agreement of the normals. All patterns
// use the same weights, so a pixel's values under all patterns remain consistent with one set of paths.
#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <vector>

namespace fringeslam::sim {

struct IndirectLightBuffer {
  IndirectLightBuffer(cv::Size image_size, int light_channels);

  cv::Size size;
  int channels = 0;                       // per pixel: one per pattern, then the pattern-independent light
  std::vector<float> lux;                 // irradiance, pixel-major
  std::vector<float> albedo;              // factor from irradiance to W
  std::vector<Eigen::Vector3f> normal;    // of the surface that the pixel sees; 0: none
  std::vector<Eigen::Vector3f> position;  // world, m

  float* at(int row, int col) { return lux.data() + index(row, col) * static_cast<size_t>(channels); }
  size_t index(int row, int col) const {
    return static_cast<size_t>(row) * static_cast<size_t>(size.width) + static_cast<size_t>(col);
  }
};

// Smooths the irradiance in place. `pixel_m`: width of a pixel's footprint at 1 m; `origin`: camera position, world, m.
void smooth(IndirectLightBuffer& light, double pixel_m, const Eigen::Vector3d& origin);

}  // namespace fringeslam::sim
