// SPDX-License-Identifier: Apache-2.0
#include "core/depth/texture_bias.h"

#include <algorithm>
#include <cmath>

namespace fringeslam {

namespace {

// Bend of the coordinate over three pixels at an edge: that of a surface, plus twice that of noise, sqrt(6) sigma.
constexpr float kMostBend_px = 0.5f, kMostBendSigmas = 5;

struct AxisTerm {
  float product, noise;
};

// Product of the gradients along one axis, of five coordinates and the modulation beside the middle one; 0 at an edge.
FRINGESLAM_INLINE AxisTerm along_axis(const float (&u)[5], float before_dn, float after_dn, float phase_per_px,
                                      float most_bend_px) {
  // (b - a) / (b + a) is ln(b / a) / 2 to third order.
  const float growth = (after_dn - before_dn) / (after_dn + before_dn);
  const float slope = 0.5f * (u[3] - u[1]), product = slope * growth, phase_slope = phase_per_px * slope;
  const bool usable = (std::abs(u[0] - 2 * u[1] + u[2]) <= most_bend_px) &
                      (std::abs(u[1] - 2 * u[2] + u[3]) <= most_bend_px) &
                      (std::abs(u[2] - 2 * u[3] + u[4]) <= most_bend_px) &  // false for NaN
                      (product == product);                                 // no modulation has no gradient
  return {usable ? product : 0.0f, usable ? 0.5f * (phase_slope * phase_slope + growth * growth) : 0.0f};
}

FRINGESLAM_INLINE void row_body(const TextureRows& rows, int width, float* gradient, float* noise) {
  const FiveRows &u = rows.coordinate_px, &b = rows.modulation_dn;
  const float *const u0 = u[0], *const u1 = u[1], *const u2 = u[2], *const u3 = u[3], *const u4 = u[4];
  const float *const above = b[1], *const here = b[2], *const below = b[3], *const sigma_px = rows.sigma_px;
  const float phase_per_px = rows.phase_per_px;
#pragma GCC ivdep
  for (int i = kTextureBorder; i < width - kTextureBorder; ++i) {
    const float most_bend_px = kMostBend_px + kMostBendSigmas * sigma_px[i];
    const float across[5] = {u2[i - 2], u2[i - 1], u2[i], u2[i + 1], u2[i + 2]},
                down[5] = {u0[i], u1[i], u2[i], u3[i], u4[i]};
    const AxisTerm along_row = along_axis(across, here[i - 1], here[i + 1], phase_per_px, most_bend_px),
                   along_column = along_axis(down, above[i], below[i], phase_per_px, most_bend_px);
    gradient[i] = along_row.product + along_column.product;
    noise[i] = along_row.noise + along_column.noise;
  }
}

}  // namespace

void texture_gradient_row(const TextureRows& rows, int width, float* gradient, float* noise, InstructionSet set) {
  for (int i = 0; i < std::min(kTextureBorder, width); ++i)
    gradient[i] = gradient[width - 1 - i] = noise[i] = noise[width - 1 - i] = 0;
  Variants<row_body>::of(set)(rows, width, gradient, noise);
}

}  // namespace fringeslam
