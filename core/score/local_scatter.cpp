// SPDX-License-Identifier: Apache-2.0
#include "core/score/local_scatter.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <vector>

#include "core/base/parallel.h"
#include "core/types/linear_algebra.h"

namespace fringeslam {

namespace {

constexpr int kRadius = 4, kTerms = 6;
using Terms = Eigen::Matrix<double, kTerms, 1>;

Terms terms_at(int dx, int dy) {
  const double x = dx, y = dy;
  Terms terms;
  terms << 1, x, y, x * x, x * y, y * y;
  return terms;
}

struct Quadric {
  Terms coefficients;
  int samples = 0;
  double value_squares = 0, sigma_squares = 0;  // sums of squared residuals, plain and divided by the variances
};

// Calls visit(terms, value, sigma) for the valid pixels of a window.
template <class Visit>
void for_window(const cv::Mat1f& values, const cv::Mat1f& sigma, int row, int col, Visit&& visit) {
  for (int dy = -kRadius; dy <= kRadius; ++dy) {
    for (int dx = -kRadius; dx <= kRadius; ++dx) {
      const int r = row + dy, c = col + dx;
      if (r < 0 || c < 0 || r >= values.rows || c >= values.cols) continue;
      const float value = values(r, c), s = sigma(r, c);
      if (std::isfinite(value) && s > 0) visit(terms_at(dx, dy), static_cast<double>(value), static_cast<double>(s));
    }
  }
}

std::optional<Quadric> fit(const cv::Mat1f& values, const cv::Mat1f& sigma, int row, int col, int least) {
  Eigen::Matrix<double, kTerms, kTerms> normal = Eigen::Matrix<double, kTerms, kTerms>::Zero();
  Terms right = Terms::Zero();
  Quadric quadric;
  for_window(values, sigma, row, col, [&](const Terms& terms, double value, double s) {
    const double weight = 1 / (s * s);
    normal += weight * terms * terms.transpose();
    right += weight * value * terms;
    ++quadric.samples;
  });
  if (quadric.samples < least) return std::nullopt;
  quadric.coefficients = solve_symmetric(Matrix6d(normal), Vector6d(right));
  for_window(values, sigma, row, col, [&](const Terms& terms, double value, double s) {
    const double residual = value - terms.dot(quadric.coefficients);
    quadric.value_squares += residual * residual;
    quadric.sigma_squares += residual * residual / (s * s);
  });
  return quadric;
}

double median(std::vector<double> values) {
  if (values.empty()) return std::numeric_limits<double>::quiet_NaN();
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace

LocalScatter local_scatter(const cv::Mat1f& values, const cv::Mat1f& sigma) {
  constexpr int kStride = 5, kLeast = 73;
  std::vector<double> scatter, over_sigma;
  for (int row = kRadius; row + kRadius < values.rows; row += kStride) {
    for (int col = kRadius; col + kRadius < values.cols; col += kStride) {
      const auto quadric = fit(values, sigma, row, col, kLeast);
      if (!quadric) continue;
      const double dof = quadric->samples - kTerms;
      scatter.push_back(std::sqrt(quadric->value_squares / dof));
      over_sigma.push_back(std::sqrt(quadric->sigma_squares / dof));
    }
  }
  const int windows = static_cast<int>(scatter.size());
  return {median(std::move(scatter)), median(std::move(over_sigma)), windows};
}

cv::Mat1f locally_smoothed(const cv::Mat1f& values, const cv::Mat1f& sigma) {
  constexpr int kLeast = 40;
  cv::Mat1f smooth(values.size(), std::numeric_limits<float>::quiet_NaN());
  for_each_row(values.rows, [&](int row) {
    for (int col = 0; col < values.cols; ++col) {
      if (!std::isfinite(values(row, col))) continue;
      const auto quadric = fit(values, sigma, row, col, kLeast);
      if (quadric) smooth(row, col) = static_cast<float>(quadric->coefficients[0]);
    }
  });
  return smooth;
}

}  // namespace fringeslam
