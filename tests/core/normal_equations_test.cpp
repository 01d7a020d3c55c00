// SPDX-License-Identifier: Apache-2.0
#include "core/decode/normal_equations.h"

#include <gtest/gtest.h>

namespace fringeslam {
namespace {

// Rows of small integers, so that the sums are exact: row r holds r + 1, 2 (r + 1), ... The sum of its products is
// (i + 1) (j + 1) n (n + 1) (2 n + 1) / 6.
TEST(RowProducts, SumsOfSquaresHaveTheirClosedForm) {
  for (const int count : {1, 3, 4, 64, 65, 200}) {
    RowProducts products;
    for (int r = 0; r < count; ++r) {
      double* const row = products.next_row();
      for (int i = 0; i < RowProducts::kWidth; ++i) row[i] = (r + 1) * (i + 1);
    }
    products.flush();
    const double squares = count * (count + 1.0) * (2.0 * count + 1) / 6;
    const auto sums = products.block<RowProducts::kWidth, RowProducts::kWidth>(0, 0);
    for (int i = 0; i < RowProducts::kWidth; ++i) {
      for (int j = 0; j < RowProducts::kWidth; ++j) EXPECT_EQ(sums(i, j), (i + 1) * (j + 1) * squares) << count;
    }
  }
}

TEST(RowProducts, ValuesThatAreNotSetAreZero) {
  RowProducts products;
  for (int r = 0; r < 70; ++r) products.next_row()[0] = 1;
  products.flush();
  products.next_row()[1] = 2;
  products.flush();
  const auto sums = products.block<2, 2>(0, 0);
  EXPECT_EQ(sums(0, 0), 70);
  EXPECT_EQ(sums(1, 1), 4);
  EXPECT_EQ(sums(0, 1), 0);
}

}  // namespace
}  // namespace fringeslam
