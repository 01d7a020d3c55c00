// SPDX-License-Identifier: Apache-2.0
#include "core/base/symmetric_filter.h"

#include <algorithm>
#include <cmath>

#include "core/base/lanes.h"
#include "core/base/parallel.h"

namespace fringeslam {

namespace {

int inside(int i, int count, FilterBorder border) {
  if (border == FilterBorder::replicated) return std::clamp(i, 0, count - 1);
  if (count <= 1) return 0;
  while (i < 0 || i >= count) i = i < 0 ? -i : 2 * (count - 1) - i;
  return i;
}

// Weighted sum over pairs of rows: before[k][x] and after[k][x] have the weight half[k]; for k = 0 both are the centre
// row.
struct RowPairs {
  const float* const* before;
  const float* const* after;
  const float* half;
  int count;
};

template <int lanes>
FRINGESLAM_INLINE void sum_block(const RowPairs& rows, int x, float* sums) {
  using L = Lanes<lanes>;
  const auto both = [&](int k, int i) {
    return L::load(rows.before[k] + x + i * lanes) + L::load(rows.after[k] + x + i * lanes);
  };
  // Four independent sums hide the latency of additions.
  typename L::Floats sum[4];
  for (int i = 0; i < 4; ++i) sum[i] = rows.half[0] * L::load(rows.before[0] + x + i * lanes);
  for (int k = 1; k < rows.count; ++k) {
    for (int i = 0; i < 4; ++i) sum[i] += rows.half[k] * both(k, i);
  }
  for (int i = 0; i < 4; ++i) L::store(sum[i], sums + x + i * lanes);
}

template <int lanes>
FRINGESLAM_INLINE void sum_body(const RowPairs& rows, int cols, float* sums) {
  constexpr int kBlock = 4 * lanes;
  for (int x = 0; x + kBlock <= cols; x += kBlock) sum_block<lanes>(rows, x, sums);
  if (cols % kBlock == 0) return;
  if (cols > kBlock) return sum_block<lanes>(rows, cols - kBlock, sums);
  for (int x = 0; x < cols; ++x) {
    float sum = rows.half[0] * rows.before[0][x];
    for (int k = 1; k < rows.count; ++k) sum += rows.half[k] * (rows.before[k][x] + rows.after[k][x]);
    sums[x] = sum;
  }
}

// One half of a Gaussian at whole pixels.
struct Sampled {
  std::vector<double> weights{1};
  double sum = 1, variance = 0;  // of both halves

  Sampled(double sigma, int radius) {
    for (int i = 1; i <= radius; ++i) {
      weights.push_back(std::exp(-i * i / (2 * sigma * sigma)));
      sum += 2 * weights.back();
      variance += 2 * i * i * weights.back();
    }
    variance /= sum;
  }

  std::vector<float> half() const {
    std::vector<float> half;
    for (const double weight : weights) half.push_back(static_cast<float>(weight / sum));
    return half;
  }
};

}  // namespace

std::vector<float> gaussian_half(double sigma, double reach) {
  return Sampled(sigma, static_cast<int>(std::ceil(reach * sigma))).half();
}

std::vector<float> point_spread_half(double sigma) {
  const int radius = static_cast<int>(std::ceil(4 * sigma));
  // The bell whose samples have the variance is wider than sigma.
  double low = 0, high = sigma + 0.5;
  for (int i = 0; i < 40; ++i) {
    const double middle = (low + high) / 2;
    (Sampled(middle, radius).variance < sigma * sigma ? low : high) = middle;
  }
  return Sampled(high, radius).half();
}

cv::Mat1f filtered(const cv::Mat& given, const std::vector<float>& half, FilterBorder border, InstructionSet set) {
  const auto sum = Variants<sum_body<4>, sum_body<8>, sum_body<16>>::of(set);
  cv::Mat1f image;
  given.convertTo(image, CV_32F);
  const int count = static_cast<int>(half.size()), radius = count - 1;
  cv::Mat1f result(image.size());
  for_each_range(image.rows, [&](int first, int end) {
    std::vector<const float*> before(half.size()), after(half.size());
    const RowPairs pairs{before.data(), after.data(), half.data(), count};
    std::vector<float> padded(static_cast<size_t>(image.cols + 2 * radius));
    float* const middle = padded.data() + radius;
    for (int row = first; row < end; ++row) {
      for (int k = 0; k < count; ++k) {
        before[static_cast<size_t>(k)] = image[inside(row - k, image.rows, border)];
        after[static_cast<size_t>(k)] = image[inside(row + k, image.rows, border)];
      }
      sum(pairs, image.cols, middle);
      for (int k = 1; k <= radius; ++k) {
        middle[-k] = middle[inside(-k, image.cols, border)];
        middle[image.cols - 1 + k] = middle[inside(image.cols - 1 + k, image.cols, border)];
      }
      for (int k = 0; k < count; ++k)
        before[static_cast<size_t>(k)] = middle - k, after[static_cast<size_t>(k)] = middle + k;
      sum(pairs, image.cols, result[row]);
    }
  });
  return result;
}

}  // namespace fringeslam
