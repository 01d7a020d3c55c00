// SPDX-License-Identifier: Apache-2.0
#include "sim/light/sample_rays.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>

#include "core/base/parallel.h"

namespace fringeslam::sim {

namespace {

// Sample positions in the unit pixel, relative to its centre, with zero mean. Rotated grid: no two samples share a row
// or column, so an axis-aligned edge is anti-aliased in as many steps as there are samples.
std::vector<Eigen::Vector2d> sample_offsets(int per_pixel) {
  if (per_pixel == 4) return {{-0.125, -0.375}, {0.375, -0.125}, {0.125, 0.375}, {-0.375, 0.125}};
  const int side = static_cast<int>(std::lround(std::sqrt(per_pixel)));
  std::vector<Eigen::Vector2d> offsets;
  for (int i = 0; i < side * side; ++i) {
    const int col = i % side, row = i / side;
    offsets.emplace_back((col + (row + 0.5) / side) / side - 0.5, (row + (side - col - 0.5) / side) / side - 0.5);
  }
  return offsets;
}

// Maps the square [-1, 1]^2 to the unit disc (concentric mapping).
Eigen::Vector2d on_disc(double a, double b) {
  if (a == 0 && b == 0) return {0, 0};
  const bool wide = std::abs(a) > std::abs(b);
  const double r = wide ? a : b;
  const double phi = wide ? std::numbers::pi / 4 * (b / a) : std::numbers::pi / 2 - std::numbers::pi / 4 * (a / b);
  return {r * std::cos(phi), r * std::sin(phi)};
}

// Ray origins of a pixel's samples in the unit pupil. They are the same for all pixels and symmetric about the centre,
// so that fringes on a defocused smooth surface are blurred but not randomly shifted. Rows of the pixel grid map to
// shuffled columns of the pupil grid, which decorrelates pixel and pupil positions.
std::vector<Eigen::Vector2d> pupil_offsets(int per_pixel) {
  const int side = static_cast<int>(std::lround(std::sqrt(per_pixel)));
  int stride = std::max(1, static_cast<int>(std::lround(0.382 * side)));
  while (std::gcd(stride, side) != 1) ++stride;
  const auto place = [&](int i) { return (2 * (i * stride % side) + 1.0) / side - 1; };
  std::vector<Eigen::Vector2d> offsets;
  for (int i = 0; i < per_pixel; ++i) offsets.push_back(on_disc(place(i / side), place(i % side)));
  return offsets;
}

}  // namespace

SampleRays sample_rays(const Pinhole& camera, int per_pixel, double extent) {
  const std::vector<Eigen::Vector2d> offsets = sample_offsets(per_pixel);
  SampleRays rays;
  rays.per_pixel = per_pixel;
  rays.extent = extent;
  rays.pupil = pupil_offsets(per_pixel);
  const auto pixels = static_cast<size_t>(camera.width) * static_cast<size_t>(camera.height);
  rays.centres.resize(pixels);
  rays.samples.resize(pixels * offsets.size());
  for_each_row(camera.height, [&](int row) {
    for (int col = 0; col < camera.width; ++col) {
      const auto pixel = static_cast<size_t>(row * camera.width + col);
      const Eigen::Vector2d centre(col, row);
      rays.centres[pixel] = camera.undistort(centre);
      for (size_t s = 0; s < offsets.size(); ++s)
        rays.samples[pixel * offsets.size() + s] = camera.undistort(centre + extent * offsets[s]);
    }
  });
  return rays;
}

}  // namespace fringeslam::sim
