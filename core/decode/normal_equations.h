// SPDX-License-Identifier: Apache-2.0
// Normal equations of many residuals with few unknowns.
#pragma once

#include <Eigen/Core>
#include <vector>

namespace fringeslam {

// Sum of the products row^T row of rows of kWidth values.
class RowProducts {
 public:
  static constexpr int kWidth = 20;

  // Returns a row of zeros to fill.
  double* next_row() {
    if (filled_ == kRows) flush();
    return rows_.data() + kWidth * filled_++;
  }

  // Adds the rows filled so far; needed before block().
  void flush();

  template <int Rows, int Cols>
  Eigen::Matrix<double, Rows, Cols> block(int row, int col) const {
    return Eigen::Map<const Eigen::Matrix<double, kWidth, kWidth>>(sums_.data()).template block<Rows, Cols>(row, col);
  }

 private:
  static constexpr int kRows = 64;

  int filled_ = 0;
  std::vector<double> rows_ = std::vector<double>(kWidth * kRows), sums_ = std::vector<double>(kWidth * kWidth);
};

}  // namespace fringeslam
