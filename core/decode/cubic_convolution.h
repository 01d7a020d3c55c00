// SPDX-License-Identifier: Apache-2.0
// Cubic convolution (Keys 1981, a = -1/2).
#pragma once

namespace fringeslam {

// Weights of four samples at the fraction t between the second and the third, and their derivatives with respect to t.
struct CubicWeights {
  float weight[4], slope[4];
  explicit CubicWeights(float t)
      : weight{((-0.5f * t + 1) * t - 0.5f) * t, (1.5f * t - 2.5f) * t * t + 1, ((-1.5f * t + 2) * t + 0.5f) * t,
               (0.5f * t - 0.5f) * t * t},
        slope{(-1.5f * t + 2) * t - 0.5f, (4.5f * t - 5) * t, (-4.5f * t + 4) * t + 0.5f, (1.5f * t - 1) * t} {}
};

}  // namespace fringeslam
