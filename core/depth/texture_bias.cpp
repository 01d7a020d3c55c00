// SPDX-License-Identifier: Apache-2.0
#include "core/depth/texture_bias.h"

#include <algorithm>
#include <cmath>

namespace fringeslam {

namespace {

constexpr float kMostBend_px = 0.5f;  // of the coordinate over three pixels
// Bend of ln B over three pixels above which B has an edge: that of texture, plus twice that of noise, sqrt(6) sigma.
constexpr float kEdge = 0.2f, kEdgeSigmas = 5;

struct AxisTerm {
  float product, noise;
};

// Product of the gradients along one axis; 0 at an edge. `relative` is the standard deviation of ln B.
FRINGESLAM_INLINE AxisTerm along_axis(float before_px, float here_px, float after_px, float before_dn, float here_dn,
                                      float after_dn, float phase_per_px, float relative) {
  // 2 (b - a) / (b + a) is ln(b / a) to third order.
  const float first = 2 * (here_dn - before_dn) / (here_dn + before_dn),
              second = 2 * (after_dn - here_dn) / (after_dn + here_dn);
  const float least = std::min(std::abs(first), std::abs(second));
  const float limited = first * second > 0 ? (first > 0 ? least : -least) : 0.0f;
  const float growth = std::abs(second - first) <= kEdge + kEdgeSigmas * relative ? 0.5f * (first + second) : limited;
  const float slope = 0.5f * (after_px - before_px), product = slope * growth, phase_slope = phase_per_px * slope;
  const bool smooth = std::abs(before_px - 2 * here_px + after_px) <= kMostBend_px;  // false for NaN
  const bool usable = smooth & (product == product);                                 // no modulation has no gradient
  return {usable ? product : 0.0f, usable ? 0.5f * (phase_slope * phase_slope + growth * growth) : 0.0f};
}

FRINGESLAM_INLINE void row_body(const TextureRows& rows, int width, float* gradient, float* noise) {
  const ThreeRows &u = rows.coordinate_px, &b = rows.modulation_dn;
  const float phase_per_px = rows.phase_per_px;
#pragma GCC ivdep
  for (int i = 1; i < width - 1; ++i) {
    const float relative = phase_per_px * rows.sigma_px[i];
    const AxisTerm along_row = along_axis(u.here[i - 1], u.here[i], u.here[i + 1], b.here[i - 1], b.here[i],
                                          b.here[i + 1], phase_per_px, relative),
                   along_column = along_axis(u.above[i], u.here[i], u.below[i], b.above[i], b.here[i], b.below[i],
                                             phase_per_px, relative);
    gradient[i] = along_row.product + along_column.product;
    noise[i] = along_row.noise + along_column.noise;
  }
}

}  // namespace

void texture_gradient_row(const TextureRows& rows, int width, float* gradient, float* noise, InstructionSet set) {
  gradient[0] = gradient[width - 1] = noise[0] = noise[width - 1] = 0;
  Variants<row_body>::of(set)(rows, width, gradient, noise);
}

}  // namespace fringeslam
