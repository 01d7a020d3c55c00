// SPDX-License-Identifier: Apache-2.0
#include "core/score/depth_honesty.h"

#include <cmath>

namespace fringeslam {

void DepthHonesty::add(const Frame& frame, const TruthFrame& truth) {
  constexpr float kSigmas = 4;
  for (int row = 0; row < truth.depth_m.rows; ++row) {
    for (int col = 0; col < truth.depth_m.cols; ++col) {
      if (!is_lit_surface(static_cast<int>(truth.mask(row, col)))) continue;
      ++lit;
      const float error = frame.points_m(row, col)[2] - truth.depth_m(row, col);
      if (std::isnan(error)) continue;
      ++measured;
      dishonest += std::abs(error) > kSigmas * frame.sigma_m(row, col);
    }
  }
}

}  // namespace fringeslam
