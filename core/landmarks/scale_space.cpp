// SPDX-License-Identifier: Apache-2.0
#include "core/landmarks/scale_space.h"

#include <algorithm>
#include <opencv2/imgproc.hpp>

#include "core/base/instruction_set.h"
#include "core/base/lanes.h"
#include "core/base/parallel.h"

namespace fringeslam {

namespace {

constexpr double kSigmaOfImages = 0.5;  // of the camera's own blur, px (Lowe)

// Returns half of a symmetric kernel, from the centre on.
std::vector<float> gaussian_half(double sigma) {
  const int radius = static_cast<int>(std::ceil(3.5 * sigma));
  std::vector<double> weights;
  double sum = 0;
  for (int i = 0; i <= radius; ++i) {
    weights.push_back(std::exp(-i * i / (2 * sigma * sigma)));
    sum += i == 0 ? weights.back() : 2 * weights.back();
  }
  std::vector<float> half;
  for (const double weight : weights) half.push_back(static_cast<float>(weight / sum));
  return half;
}

int mirrored(int i, int count) {
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

cv::Mat1f every_second_pixel(const cv::Mat1f& image) {
  cv::Mat1f result((image.rows + 1) / 2, (image.cols + 1) / 2);
  for_each_row(result.rows, [&](int row) {
    const float* const from = image[2 * row];
    float* const to = result[row];
    for (int col = 0; col < result.cols; ++col) to[col] = from[2 * col];
  });
  return result;
}

}  // namespace

cv::Mat1f blurred(const cv::Mat1f& image, double sigma) {
  static const auto sum = Variants<sum_body<4>, sum_body<8>, sum_body<16>>::of(widest_instruction_set());
  const std::vector<float> half = gaussian_half(sigma);
  const int count = static_cast<int>(half.size()), radius = count - 1;
  cv::Mat1f result(image.size());
  for_each_range(image.rows, [&](int first, int end) {
    std::vector<const float*> before(half.size()), after(half.size());
    const RowPairs pairs{before.data(), after.data(), half.data(), count};
    std::vector<float> padded(static_cast<size_t>(image.cols + 2 * radius));
    float* const middle = padded.data() + radius;
    for (int row = first; row < end; ++row) {
      for (int k = 0; k < count; ++k) {
        before[static_cast<size_t>(k)] = image[mirrored(row - k, image.rows)];
        after[static_cast<size_t>(k)] = image[mirrored(row + k, image.rows)];
      }
      sum(pairs, image.cols, middle);
      for (int k = 1; k <= radius; ++k) {
        middle[-k] = middle[mirrored(-k, image.cols)];
        middle[image.cols - 1 + k] = middle[mirrored(image.cols - 1 + k, image.cols)];
      }
      for (int k = 0; k < count; ++k)
        before[static_cast<size_t>(k)] = middle - k, after[static_cast<size_t>(k)] = middle + k;
      sum(pairs, image.cols, result[row]);
    }
  });
  return result;
}

std::vector<Octave> scale_space(const cv::Mat1b& image) {
  constexpr int kSmallest = 8;  // pixels across
  std::vector<Octave> octaves;
  if (std::min(image.rows, image.cols) < kSmallest / 2) return octaves;
  cv::Mat1f grey, first;
  image.convertTo(grey, CV_32F);
  cv::resize(grey, first, {}, 2, 2, cv::INTER_LINEAR);
  first = blurred(first, std::sqrt(kFinestSigma * kFinestSigma - 4 * kSigmaOfImages * kSigmaOfImages));
  while (std::min(first.rows, first.cols) >= kSmallest) {
    Octave& octave = octaves.emplace_back();
    octave[0] = first;
    for (size_t level = 1; level < kLevels; ++level) {
      const double before = level_sigma(static_cast<double>(level) - 1), now = level_sigma(static_cast<double>(level));
      octave[level] = blurred(octave[level - 1], std::sqrt(now * now - before * before));
    }
    first = every_second_pixel(octave[kScalesPerOctave]);
  }
  return octaves;
}

}  // namespace fringeslam
