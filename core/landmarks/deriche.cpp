// SPDX-License-Identifier: Apache-2.0
// Recursive filter of the Canny-Deriche detector; see edges.h.
#include <algorithm>
#include <cmath>
#include <cstring>
#include <opencv2/imgproc.hpp>
#include <utility>
#include <vector>

#include "core/landmarks/edges.h"
#include "core/types/selected_instruction_set.h"

namespace fringeslam {

namespace {

// Second-order recursions down and up the columns, on whole rows at a time:
//   down[n] = a0 x[n] + a1 x[n-1] + b1 down[n-1] + b2 down[n-2]
//   up[n]   = a2 x[n+1] + a3 x[n+2] + b1 up[n+1] + b2 up[n+2]
struct Recursion {
  float a0, a1, a2, a3, b1, b2;
};

Recursion smoothing(double alpha) {
  const double q = std::exp(-alpha), k = (1 - q) * (1 - q) / (1 + 2 * alpha * q - q * q);
  return {static_cast<float>(k),
          static_cast<float>(k * q * (alpha - 1)),
          static_cast<float>(k * q * (alpha + 1)),
          static_cast<float>(-k * q * q),
          static_cast<float>(2 * q),
          static_cast<float>(-q * q)};
}

// The response to a unit step is one at the step.
Recursion derivative(double alpha) {
  const double q = std::exp(-alpha), c = (1 - q) * (1 - q);
  return {0, static_cast<float>(-c), static_cast<float>(c), 0, static_cast<float>(2 * q), static_cast<float>(-q * q)};
}

// Filters `count` steps of `lanes` values each, with the given strides. Border values are replicated: the recursions
// start from their steady state.
template <int lanes>
FRINGESLAM_INLINE void filter_lanes(const float* __restrict in, float* __restrict out, int count, size_t in_stride,
                                    size_t out_stride, const Recursion& f) {
  const float gain = 1 / (1 - f.b1 - f.b2), down = (f.a0 + f.a1) * gain, up = (f.a2 + f.a3) * gain;
  float x1[lanes], x2[lanes], y1[lanes], y2[lanes];
  for (int i = 0; i < lanes; ++i) {
    x1[i] = in[i];
    y1[i] = y2[i] = down * x1[i];
  }
  for (int n = 0; n < count; ++n) {
    const float* x = in + static_cast<size_t>(n) * in_stride;
    float* y = out + static_cast<size_t>(n) * out_stride;
    for (int i = 0; i < lanes; ++i) {
      const float value = f.a0 * x[i] + f.a1 * x1[i] + f.b1 * y1[i] + f.b2 * y2[i];
      y2[i] = y1[i], y1[i] = value, x1[i] = x[i];
      y[i] = value;
    }
  }
  const float* last = in + static_cast<size_t>(count - 1) * in_stride;
  for (int i = 0; i < lanes; ++i) {
    x1[i] = x2[i] = last[i];
    y1[i] = y2[i] = up * x1[i];
  }
  for (int n = count - 1; n >= 0; --n) {
    const float* x = in + static_cast<size_t>(n) * in_stride;
    float* y = out + static_cast<size_t>(n) * out_stride;
    for (int i = 0; i < lanes; ++i) {
      const float value = f.a2 * x1[i] + f.a3 * x2[i] + f.b1 * y1[i] + f.b2 * y2[i];
      y2[i] = y1[i], y1[i] = value, x2[i] = x1[i], x1[i] = x[i];
      y[i] += value;
    }
  }
}

// Columns are filtered in wide groups, so that rows are read from memory in long runs; rows are filtered through a
// copy that stays in the L1 cache, in narrower groups.
constexpr int kColumns = 64, kRows = 16;

// Applies both filters to the same columns.
FRINGESLAM_INLINE void columns_body(const float* in, float* smooth, float* slope, int count, size_t in_stride,
                                    size_t out_stride, const Recursion& smoothing, const Recursion& derivative) {
  filter_lanes<kColumns>(in, smooth, count, in_stride, out_stride, smoothing);
  filter_lanes<kColumns>(in, slope, count, in_stride, out_stride, derivative);
}

using Four = float __attribute__((vector_size(16)));
FRINGESLAM_INLINE Four load(const float* from) {
  Four four;
  std::memcpy(&four, from, sizeof four);
  return four;
}
FRINGESLAM_INLINE void store(float* to, Four four) { std::memcpy(to, &four, sizeof four); }

// Transposes a block of 4 x 4 values with the given row strides.
FRINGESLAM_INLINE void transpose(const float* from, size_t from_stride, float* to, size_t to_stride) {
  const Four a = load(from), b = load(from + from_stride), c = load(from + 2 * from_stride),
             d = load(from + 3 * from_stride);
  const Four ab_low = __builtin_shufflevector(a, b, 0, 4, 1, 5), ab_high = __builtin_shufflevector(a, b, 2, 6, 3, 7);
  const Four cd_low = __builtin_shufflevector(c, d, 0, 4, 1, 5), cd_high = __builtin_shufflevector(c, d, 2, 6, 3, 7);
  store(to, __builtin_shufflevector(ab_low, cd_low, 0, 1, 4, 5));
  store(to + to_stride, __builtin_shufflevector(ab_low, cd_low, 2, 3, 6, 7));
  store(to + 2 * to_stride, __builtin_shufflevector(ab_high, cd_high, 0, 1, 4, 5));
  store(to + 3 * to_stride, __builtin_shufflevector(ab_high, cd_high, 2, 3, 6, 7));
}

// Filters kRows rows in place. `columns` is a buffer of twice as many values.
FRINGESLAM_INLINE void rows_body(float* rows, size_t stride, int width, const Recursion& f, float* columns) {
  const int whole = width - width % 4;
  float* filtered = columns + static_cast<size_t>(width) * kRows;
  for (int c = 0; c < whole; c += 4) {
    for (size_t lane = 0; lane < kRows; lane += 4)
      transpose(rows + lane * stride + c, stride, columns + static_cast<size_t>(c) * kRows + lane, kRows);
  }
  for (int c = whole; c < width; ++c) {
    for (size_t lane = 0; lane < kRows; ++lane)
      columns[static_cast<size_t>(c) * kRows + lane] = rows[lane * stride + c];
  }
  filter_lanes<kRows>(columns, filtered, width, kRows, kRows, f);
  for (int c = 0; c < whole; c += 4) {
    for (size_t lane = 0; lane < kRows; lane += 4)
      transpose(filtered + static_cast<size_t>(c) * kRows + lane, kRows, rows + lane * stride + c, stride);
  }
  for (int c = whole; c < width; ++c) {
    for (size_t lane = 0; lane < kRows; ++lane)
      rows[lane * stride + c] = filtered[static_cast<size_t>(c) * kRows + lane];
  }
}

// Number of rows after which a recursion has forgotten its initial state.
int memory_px(double alpha) { return static_cast<int>(std::ceil(16 / alpha)); }

}  // namespace

// The filters of the two axes commute: columns are filtered by both first, then each result's rows by the other
// filter.
Gradient deriche_gradient(const cv::Mat1f& levels, double alpha, cv::Range rows) {
  static const auto filter_columns = Variants<columns_body>::of(selected_instruction_set());
  static const auto filter_rows = Variants<rows_body>::of(selected_instruction_set());
  if (rows == cv::Range::all()) rows = {0, levels.rows};
  if (levels.empty() || rows.empty()) return {};
  if (levels.cols < kColumns) {
    // Replicate the border.
    cv::Mat1f padded;
    cv::copyMakeBorder(levels, padded, 0, 0, kColumns, kColumns, cv::BORDER_REPLICATE);
    const Gradient gradient = deriche_gradient(padded, alpha, rows);
    const cv::Range inner(kColumns, kColumns + levels.cols);
    return {gradient.x.colRange(inner).clone(), gradient.y.colRange(inner).clone()};
  }
  const Recursion smooth = smoothing(alpha), slope = derivative(alpha);
  const cv::Mat1f near =
      levels.rowRange(std::max(0, rows.start - memory_px(alpha)), std::min(levels.rows, rows.end + memory_px(alpha)));
  cv::Mat1f x(near.size()), y(near.size());
  const auto filter_group = [&](int first) {
    filter_columns(near[0] + first, x[0] + first, y[0] + first, near.rows, near.step1(), x.step1(), smooth, slope);
  };
  for (int first = 0; first + kColumns <= levels.cols; first += kColumns) filter_group(first);
  // The remaining columns are filtered together with some of the last group.
  if (levels.cols % kColumns != 0) filter_group(levels.cols - kColumns);

  const int above = rows.start - std::max(0, rows.start - memory_px(alpha));
  const Gradient gradient{x.rowRange(above, above + rows.size()), y.rowRange(above, above + rows.size())};
  std::vector<float> columns(2 * kRows * static_cast<size_t>(levels.cols));
  for (int first = 0; first < rows.size(); first += kRows) {
    const cv::Range group(first, std::min(rows.size(), first + kRows));
    for (auto& [image, f] : {std::pair(gradient.x.rowRange(group), slope), {gradient.y.rowRange(group), smooth}}) {
      cv::Mat whole = image;
      if (group.size() < kRows) cv::copyMakeBorder(image, whole, 0, kRows - group.size(), 0, 0, cv::BORDER_REPLICATE);
      filter_rows(whole.ptr<float>(), whole.step1(), levels.cols, f, columns.data());
      if (group.size() < kRows) whole.rowRange(0, group.size()).copyTo(image);
    }
  }
  return gradient;
}

}  // namespace fringeslam
