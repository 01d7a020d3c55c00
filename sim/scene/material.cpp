// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "sim/scene/noise.h"
#include "sim/scene/scene.h"

namespace fringeslam::sim {

namespace {

// Fibres and specks over faint stains; blots of print here and there.
double cardboard(const Eigen::Vector3d& p, uint32_t seed) {
  const Eigen::Vector3d stretched(p.x() * 0.5, p.y() * 2, p.z() * 2);
  const double fibres = fractal_noise(stretched * 2, 4, seed);
  const double print = value_noise(p * 0.7, seed + 7) > 0.45 ? -0.6 : 0.0;
  return 0.7 * fibres + print;
}

// Rings around the object's x axis, bent by noise.
double wood(const Eigen::Vector3d& p, uint32_t seed) {
  const double radius = std::hypot(p.y(), p.z()) + 0.6 * fractal_noise(p * 0.5, 3, seed);
  return 0.6 * std::sin(6.28318 * radius) + 0.5 * fractal_noise({p.x(), p.y() * 5, p.z() * 5}, 4, seed + 3);
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

}  // namespace

double Material::albedo_at(const Eigen::Vector3d& point, uint32_t seed) const {
  if (grain == Grain::plain) return albedo;
  if (grain == Grain::checkerboard) return on_square(*this, point.x(), point.y()) ? print_albedo : albedo;
  if (grain == Grain::circles || grain == Grain::asymmetric_circles)
    return on_circle(*this, point.x(), point.y()) ? print_albedo : albedo;
  // Away from the lattice's mirror point at the origin.
  const Eigen::Vector3d p = point / grain_m + Eigen::Vector3d::Constant(1000);
  double value = 0;
  switch (grain) {
    case Grain::cardboard:
      value = cardboard(p, seed);
      break;
    case Grain::foam:
      value = 1.4 * fractal_noise(p * 2, 3, seed);
      break;
    case Grain::wood:
      value = wood(p, seed);
      break;
    default:
      value = 1.6 * fractal_noise(p, 5, seed);
  }
  return std::clamp(albedo * (1 + contrast * std::clamp(value, -1.0, 1.0)), 0.0, 1.0);
}

}  // namespace fringeslam::sim
