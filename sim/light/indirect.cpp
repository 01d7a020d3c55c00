// SPDX-License-Identifier: Apache-2.0
#include "sim/light/indirect.h"

#include <algorithm>
#include <cmath>

#include "core/base/parallel.h"

namespace fringeslam::sim {

namespace {

constexpr float kSpline[5] = {1 / 16.0f, 1 / 4.0f, 3 / 8.0f, 1 / 4.0f, 1 / 16.0f};

// Returns a weight from 0 to 1 for how likely two pixels see the same smooth surface.
float likeness(const IndirectLightBuffer& light, size_t p, size_t q, float tolerance_m) {
  const Eigen::Vector3f &n = light.normal[p], &m = light.normal[q];
  if (m.isZero()) return 0;
  constexpr float kLeastCosine = 0.8f;
  const float agree = (n.dot(m) - kLeastCosine) / (1 - kLeastCosine);
  if (agree <= 0) return 0;
  const Eigen::Vector3f apart = light.position[q] - light.position[p];
  const float off = std::max(std::abs(n.dot(apart)), std::abs(m.dot(apart))) / tolerance_m;
  return off >= 1 ? 0 : agree * (1 - off) * (1 - off);
}

void smooth_row(const IndirectLightBuffer& light, int row, int step, float pixel_m, const Eigen::Vector3f& origin,
                std::vector<float>& out) {
  const auto channels = static_cast<size_t>(light.channels);
  for (int col = 0; col < light.size.width; ++col) {
    const size_t p = light.index(row, col);
    float* sums = out.data() + p * channels;
    const float* own = light.lux.data() + p * channels;
    if (light.normal[p].isZero()) {
      std::copy_n(own, channels, sums);
      continue;
    }
    const float tolerance = static_cast<float>(step) * pixel_m * (light.position[p] - origin).norm();
    std::fill_n(sums, channels, 0.0f);
    float total = 0;
    for (int i = -2; i <= 2; ++i) {
      const int y = row + i * step;
      if (y < 0 || y >= light.size.height) continue;
      for (int j = -2; j <= 2; ++j) {
        const int x = col + j * step;
        if (x < 0 || x >= light.size.width) continue;
        const size_t q = light.index(y, x);
        const float weight = kSpline[i + 2] * kSpline[j + 2] * (p == q ? 1 : likeness(light, p, q, tolerance));
        if (weight == 0) continue;
        total += weight;
        const float* other = light.lux.data() + q * channels;
        for (size_t k = 0; k < channels; ++k) sums[k] += weight * other[k];
      }
    }
    for (size_t k = 0; k < channels; ++k) sums[k] /= total;
  }
}

}  // namespace

IndirectLightBuffer::IndirectLightBuffer(cv::Size image_size, int light_channels)
    : size(image_size),
      channels(light_channels),
      lux(static_cast<size_t>(image_size.area()) * static_cast<size_t>(light_channels)),
      albedo(static_cast<size_t>(image_size.area())),
      normal(albedo.size(), Eigen::Vector3f::Zero()),
      position(albedo.size(), Eigen::Vector3f::Zero()) {}

void smooth(IndirectLightBuffer& light, double pixel_m, const Eigen::Vector3d& origin) {
  std::vector<float> out(light.lux.size());
  for (const int step : {1, 2, 4}) {
    for_each_row(light.size.height, [&](int row) {
      smooth_row(light, row, step, static_cast<float>(pixel_m), origin.cast<float>(), out);
    });
    light.lux.swap(out);
  }
}

}  // namespace fringeslam::sim
