// SPDX-License-Identifier: Apache-2.0
#include "core/depth/texture_bias.h"

#include <algorithm>
#include <cmath>

namespace fringeslam {

namespace {

constexpr float kMostBend_px = 0.5f;  // of the coordinate over three pixels
constexpr float kEdge = 0.2f;         // bend of ln B over three pixels above which B has an edge

// Product of the gradients along one axis; 0 at an edge.
FRINGESLAM_INLINE float along_axis(float before_px, float here_px, float after_px, float before_dn, float here_dn,
                                   float after_dn) {
  // 2 (b - a) / (b + a) is ln(b / a) to third order.
  const float first = 2 * (here_dn - before_dn) / (here_dn + before_dn),
              second = 2 * (after_dn - here_dn) / (after_dn + here_dn);
  const float least = std::min(std::abs(first), std::abs(second));
  const float limited = first * second > 0 ? (first > 0 ? least : -least) : 0.0f;
  const float growth = std::abs(second - first) <= kEdge ? 0.5f * (first + second) : limited;
  const float product = 0.5f * (after_px - before_px) * growth;
  const bool smooth = std::abs(before_px - 2 * here_px + after_px) <= kMostBend_px;  // false for NaN
  return smooth & (product == product) ? product : 0.0f;                             // no modulation has no gradient
}

FRINGESLAM_INLINE void row_body(const ThreeRows& u, const ThreeRows& b, int width, float* gradient) {
#pragma GCC ivdep
  for (int i = 1; i < width - 1; ++i)
    gradient[i] = along_axis(u.here[i - 1], u.here[i], u.here[i + 1], b.here[i - 1], b.here[i], b.here[i + 1]) +
                  along_axis(u.above[i], u.here[i], u.below[i], b.above[i], b.here[i], b.below[i]);
}

}  // namespace

void texture_gradient_row(const ThreeRows& coordinate_px, const ThreeRows& modulation_dn, int width, float* gradient,
                          InstructionSet set) {
  gradient[0] = gradient[width - 1] = 0;
  Variants<row_body>::of(set)(coordinate_px, modulation_dn, width, gradient);
}

}  // namespace fringeslam
