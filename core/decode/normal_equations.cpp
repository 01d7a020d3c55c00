// SPDX-License-Identifier: Apache-2.0
#include "core/decode/normal_equations.h"

#include <algorithm>

#include "core/types/selected_instruction_set.h"

namespace fringeslam {

namespace {

constexpr int kWidth = RowProducts::kWidth, kTogether = 4;

// Adds the products of `count` rows, a multiple of kTogether.
FRINGESLAM_INLINE void add_products_body(const double* rows, int count, double* __restrict sums) {
  for (int r = 0; r < count; r += kTogether) {
    const double* const a = rows + r * kWidth;
    for (int i = 0; i < kWidth; ++i) {
      double* __restrict const sum = sums + i * kWidth;
      for (int j = 0; j < kWidth; ++j) {
        sum[j] += (a[i] * a[j] + a[kWidth + i] * a[kWidth + j]) +
                  (a[2 * kWidth + i] * a[2 * kWidth + j] + a[3 * kWidth + i] * a[3 * kWidth + j]);
      }
    }
  }
}

}  // namespace

void RowProducts::flush() {
  static const auto add_products = Variants<add_products_body>::of(selected_instruction_set());
  add_products(rows_.data(), (filled_ + kTogether - 1) / kTogether * kTogether, sums_.data());
  std::fill(rows_.begin(), rows_.end(), 0.0);
  filled_ = 0;
}

}  // namespace fringeslam
