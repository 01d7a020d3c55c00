// SPDX-License-Identifier: Apache-2.0
// Trigonometric functions of angles in turns, for kernels: compilers vectorize the polynomials, and all instruction sets
// give the same bits.
#pragma once

#include <cmath>

#include "core/base/constants.h"
#include "core/base/instruction_set.h"

namespace fringeslam {

// Returns atan2(y, x) in turns, by a minimax polynomial of degree 15 on [0, 1] with an error of 4e-8 rad before
// rounding.
FRINGESLAM_INLINE float atan2_turns(float y, float x) {
  const float ax = std::abs(x), ay = std::abs(y);
  const float large = ax > ay ? ax : ay, small = ax > ay ? ay : ax;
  const float q = small / (large > 1e-30f ? large : 1e-30f), q2 = q * q;
  float sum = -6.4530303783e-04f;
  sum = sum * q2 + 3.4795931326e-03f;
  sum = sum * q2 - 8.8987169102e-03f;
  sum = sum * q2 + 1.5346029490e-02f;
  sum = sum * q2 - 2.2136270011e-02f;
  sum = sum * q2 + 3.1745944977e-02f;
  sum = sum * q2 - 5.3046120950e-02f;
  sum = sum * q2 + 1.5915483735e-01f;
  float turns = q * sum;
  turns = ay > ax ? 0.25f - turns : turns;
  turns = x < 0 ? 0.5f - turns : turns;
  return y < 0 ? -turns : turns;
}

// Cosine and sine of `quarters` quarter turns more than an angle whose cosine and sine are c and s.
template <class Real>
FRINGESLAM_INLINE void turn_by_quarters(Real quarters, Real c, Real s, Real& cosine, Real& sine) {
  const Real quadrant = quarters - 4 * std::floor(quarters / 4);
  const bool odd = quadrant == 1 || quadrant == 3;
  const Real swapped_c = odd ? s : c, swapped_s = odd ? c : s;
  cosine = quadrant == 1 || quadrant == 2 ? -swapped_c : swapped_c;
  sine = quadrant >= 2 ? -swapped_s : swapped_s;
}

// Taylor polynomials on a quarter turn, with an error of 2e-7.
FRINGESLAM_INLINE void cosine_sine(float turns, float& cosine, float& sine) {
  const float quarters = std::floor(4 * turns + 0.5f);
  const float x = (turns - 0.25f * quarters) * kTwoPiFloat, x2 = x * x;
  const float s = x * (1 + x2 * (-1.0f / 6 + x2 * (1.0f / 120 + x2 * (-1.0f / 5040 + x2 * (1.0f / 362880)))));
  const float c = 1 + x2 * (-0.5f + x2 * (1.0f / 24 + x2 * (-1.0f / 720 + x2 * (1.0f / 40320))));
  turn_by_quarters(quarters, c, s, cosine, sine);
}

// With an error of 1e-14.
FRINGESLAM_INLINE void cosine_sine(double turns, double& cosine, double& sine) {
  const double quarters = std::floor(4 * turns + 0.5);
  const double x = (turns - 0.25 * quarters) * kTwoPi, x2 = x * x;
  double s = 1.0 / 6227020800;
  s = s * x2 - 1.0 / 39916800;
  s = s * x2 + 1.0 / 362880;
  s = s * x2 - 1.0 / 5040;
  s = s * x2 + 1.0 / 120;
  s = s * x2 - 1.0 / 6;
  s = x + x * x2 * s;
  double c = -1.0 / 87178291200;
  c = c * x2 + 1.0 / 479001600;
  c = c * x2 - 1.0 / 3628800;
  c = c * x2 + 1.0 / 40320;
  c = c * x2 - 1.0 / 720;
  c = c * x2 + 1.0 / 24;
  c = c * x2 - 0.5;
  c = 1 + x2 * c;
  turn_by_quarters(quarters, c, s, cosine, sine);
}

}  // namespace fringeslam
