// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/material.h"

#include <algorithm>
#include <cmath>

namespace fringeslam::sim {

namespace {

// Offset, in grains, of the noise from the lattice origin, which coincides with the objects' centres of symmetry.
constexpr float kAway = 1000;

NoisePoints scaled(const NoisePoints& p, float x, float y, float z) {
  NoisePoints result;
  for (int i = 0; i < kNoiseLanes; ++i) {
    result.x[i] = x * p.x[i];
    result.y[i] = y * p.y[i];
    result.z[i] = z * p.z[i];
  }
  return result;
}

NoisePoints scaled(const NoisePoints& p, float s) { return scaled(p, s, s, s); }

template <class Function>
NoiseValues each(const Function& function) {
  NoiseValues result;
  for (int i = 0; i < kNoiseLanes; ++i) result.value[i] = function(i);
  return result;
}

// Fibres with scattered blots of print.
NoiseValues cardboard(const NoisePoints& p, uint32_t seed) {
  const NoiseValues fibres = fractal_noise(scaled(p, 1, 4, 4), 4, seed);
  const NoiseValues blots = value_noise(scaled(p, 0.7f), seed + 7);
  return each([&](int i) { return 0.7f * fibres.value[i] + (blots.value[i] > 0.45f ? -0.6f : 0.0f); });
}

// Growth rings around the object's x axis, distorted by noise, with fibres along it.
NoiseValues wood(const NoisePoints& p, uint32_t seed) {
  const NoiseValues bend = fractal_noise(scaled(p, 0.5f), 3, seed);
  const NoiseValues fibres = fractal_noise(scaled(p, 1, 5, 5), 4, seed + 3);
  return each([&](int i) {
    const float y = p.y[i] - kAway, z = p.z[i] - kAway;
    const float radius = std::sqrt(y * y + z * z) + 0.6f * bend.value[i];
    return 0.6f * std::sin(6.28318f * radius) + 0.5f * fibres.value[i];
  });
}

// Blotches and dark pores.
NoiseValues concrete(const NoisePoints& p, uint32_t seed) {
  const NoiseValues blotches = fractal_noise(p, 5, seed), pores = value_noise(scaled(p, 5), seed + 11);
  return each([&](int i) { return 0.9f * blotches.value[i] + (pores.value[i] > 0.6f ? -0.7f : 0.1f); });
}

// Lines of print, one word per grain, on a nearly uniform background.
NoiseValues paper(const NoisePoints& p, uint32_t seed) {
  const NoiseValues words = value_noise(scaled(p, 1, 0.25f, 0.25f), seed),
                    letters = value_noise(scaled(p, 6, 2, 2), seed + 5);
  return each([&](int i) {
    const float line = p.y[i] + p.z[i] - std::floor(p.y[i] + p.z[i]);
    return line < 0.45f && words.value[i] > -0.3f && letters.value[i] > -0.1f ? -1.0f : 0.05f;
  });
}

// Running bond with courses of about a third of the brick length; each brick has its own shade, with mortar between.
NoiseValues brick(const NoisePoints& p, uint32_t seed) {
  constexpr float kCourse = 0.33f, kJoint = 0.05f;
  NoisePoints cells;
  bool mortar[kNoiseLanes];
  for (int i = 0; i < kNoiseLanes; ++i) {
    const float course = std::floor(p.z[i] / kCourse);
    const float shift = 0.5f * (course - 2 * std::floor(0.5f * course));
    const float x = p.x[i] + p.y[i] + shift;
    cells.x[i] = std::floor(x), cells.y[i] = course, cells.z[i] = 0;
    mortar[i] = x - cells.x[i] < kJoint || p.z[i] / kCourse - course < kJoint / kCourse;
  }
  const NoiseValues shade = value_noise(scaled(cells, 1), seed), grit = fractal_noise(scaled(p, 8), 4, seed + 1);
  return each(
      [&](int i) { return mortar[i] ? 0.7f + 0.2f * grit.value[i] : 0.5f * shade.value[i] + 0.4f * grit.value[i]; });
}

// Brush marks along the object's x axis, with stains.
NoiseValues metal(const NoisePoints& p, uint32_t seed) {
  const NoiseValues brushed = fractal_noise(scaled(p, 0.5f, 20, 20), 3, seed), stains = fractal_noise(p, 3, seed + 1);
  return each([&](int i) { return 0.5f * brushed.value[i] + (stains.value[i] > 0.3f ? -0.6f : 0.1f); });
}

bool on_square(const Material& m, double x, double y) {
  const int column = static_cast<int>(std::floor(x / m.spacing_m + 0.5 * (m.columns + 1)));
  const int row = static_cast<int>(std::floor(y / m.spacing_m + 0.5 * (m.rows + 1)));
  return column >= 0 && column <= m.columns && row >= 0 && row <= m.rows && (column + row) % 2 == 0;
}

bool on_circle(const Material& m, double x, double y) {
  const bool asymmetric = m.grain == Grain::asymmetric_circles;
  const double row_m = asymmetric ? 0.5 * m.spacing_m : m.spacing_m;
  const double middle = 0.5 * (m.columns - 1) * m.spacing_m + (asymmetric ? 0.25 * m.spacing_m : 0);
  const double row = std::round(y / row_m + 0.5 * (m.rows - 1));
  if (row < 0 || row > m.rows - 1) return false;
  const double shift = asymmetric && std::fmod(row, 2) != 0 ? 0.5 * m.spacing_m : 0;
  const double column = std::clamp(std::round((x + middle - shift) / m.spacing_m), 0.0, m.columns - 1.0);
  return std::hypot(x + middle - shift - column * m.spacing_m, y - (row - 0.5 * (m.rows - 1)) * row_m) <
         0.5 * m.diameter_m;
}

// Evaluates the relative deviation from the mean albedo, in [-1, 1] except for rare peaks; p in grains.
NoiseValues grain_value(Grain grain, const NoisePoints& p, uint32_t seed) {
  switch (grain) {
    case Grain::cardboard:
      return cardboard(p, seed);
    case Grain::foam: {
      const NoiseValues cells = fractal_noise(scaled(p, 2), 3, seed);
      return each([&](int i) { return 1.4f * cells.value[i]; });
    }
    case Grain::wood:
      return wood(p, seed);
    case Grain::concrete:
      return concrete(p, seed);
    case Grain::paper:
      return paper(p, seed);
    case Grain::brick:
      return brick(p, seed);
    case Grain::metal:
      return metal(p, seed);
    default: {
      const NoiseValues speckle = fractal_noise(p, 5, seed);
      return each([&](int i) { return 1.6f * speckle.value[i]; });
    }
  }
}

}  // namespace

NoiseValues Material::albedo_at(const NoisePoints& points_m, uint32_t seed) const {
  const auto mean = static_cast<float>(albedo), print = static_cast<float>(print_albedo);
  const auto printed = [&](bool (*on)(const Material&, double, double)) {
    return each([&](int i) {
      return on(*this, static_cast<double>(points_m.x[i]), static_cast<double>(points_m.y[i])) ? print : mean;
    });
  };
  if (grain == Grain::plain) return each([&](int) { return mean; });
  if (grain == Grain::checkerboard) return printed(on_square);
  if (grain == Grain::circles || grain == Grain::asymmetric_circles) return printed(on_circle);
  NoisePoints p = scaled(points_m, static_cast<float>(1 / grain_m));
  for (int i = 0; i < kNoiseLanes; ++i) p.x[i] += kAway, p.y[i] += kAway, p.z[i] += kAway;
  const NoiseValues deviation = grain_value(grain, p, seed);
  const auto peak = static_cast<float>(contrast);
  return each(
      [&](int i) { return std::clamp(mean * (1 + peak * std::clamp(deviation.value[i], -1.0f, 1.0f)), 0.0f, 1.0f); });
}

}  // namespace fringeslam::sim
