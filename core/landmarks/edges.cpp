// SPDX-License-Identifier: Apache-2.0
#include "core/landmarks/edges.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numbers>
#include <opencv2/imgproc.hpp>

#include "core/types/error.h"
#include "core/types/instruction_set.h"
#include "core/types/parallel.h"

namespace fringeslam {

namespace {

int clamped(int i, int size) { return std::clamp(i, 0, size - 1); }

template <class Measure>
Gradient gradient_of(const cv::Mat1f& levels, const Measure& measure) {
  Gradient gradient{cv::Mat1f(levels.size()), cv::Mat1f(levels.size())};
  for_each_row(levels.rows, [&](int r) {
    for (int c = 0; c < levels.cols; ++c) {
      const auto at = [&](int dr, int dc) {
        return levels(clamped(r + dr, levels.rows), clamped(c + dc, levels.cols));
      };
      measure(at, gradient.x(r, c), gradient.y(r, c));
    }
  });
  return gradient;
}

}  // namespace

Gradient prewitt_gradient(const cv::Mat1f& levels) {
  return gradient_of(levels, [](const auto& at, float& x, float& y) {
    x = (at(-1, 1) + at(0, 1) + at(1, 1) - at(-1, -1) - at(0, -1) - at(1, -1)) / 3;
    y = (at(1, -1) + at(1, 0) + at(1, 1) - at(-1, -1) - at(-1, 0) - at(-1, 1)) / 3;
  });
}

Gradient roberts_gradient(const cv::Mat1f& levels) {
  return gradient_of(levels, [](const auto& at, float& x, float& y) {
    const float falling = at(1, 1) - at(0, 0), rising = at(0, 1) - at(1, 0);
    x = (falling + rising) / 2;
    y = (falling - rising) / 2;
  });
}

namespace {

// One recursion of second order down the columns and one up, of whole rows at a time:
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

// A step of one gives one.
Recursion derivative(double alpha) {
  const double q = std::exp(-alpha), c = (1 - q) * (1 - q);
  return {0, static_cast<float>(-c), static_cast<float>(c), 0, static_cast<float>(2 * q), static_cast<float>(-q * q)};
}

// Along `count` steps of `lanes` values each, `stride` values apart. What is beyond the border is its value, to which
// the recursions have settled.
template <int lanes>
FRINGESLAM_INLINE void filter_lanes(const float* __restrict in, float* __restrict out, int count, size_t stride,
                                    const Recursion& f) {
  const float gain = 1 / (1 - f.b1 - f.b2), down = (f.a0 + f.a1) * gain, up = (f.a2 + f.a3) * gain;
  float x1[lanes], x2[lanes], y1[lanes], y2[lanes];
  for (int i = 0; i < lanes; ++i) {
    x1[i] = in[i];
    y1[i] = y2[i] = down * x1[i];
  }
  for (int n = 0; n < count; ++n) {
    const float* x = in + static_cast<size_t>(n) * stride;
    float* y = out + static_cast<size_t>(n) * stride;
    for (int i = 0; i < lanes; ++i) {
      const float value = f.a0 * x[i] + f.a1 * x1[i] + f.b1 * y1[i] + f.b2 * y2[i];
      y2[i] = y1[i], y1[i] = value, x1[i] = x[i];
      y[i] = value;
    }
  }
  const float* last = in + static_cast<size_t>(count - 1) * stride;
  for (int i = 0; i < lanes; ++i) {
    x1[i] = x2[i] = last[i];
    y1[i] = y2[i] = up * x1[i];
  }
  for (int n = count - 1; n >= 0; --n) {
    const float* x = in + static_cast<size_t>(n) * stride;
    float* y = out + static_cast<size_t>(n) * stride;
    for (int i = 0; i < lanes; ++i) {
      const float value = f.a2 * x1[i] + f.a3 * x2[i] + f.b1 * y1[i] + f.b2 * y2[i];
      y2[i] = y1[i], y1[i] = value, x2[i] = x1[i], x1[i] = x[i];
      y[i] += value;
    }
  }
}

// Columns are filtered many at once, so that their rows come from memory in long runs; rows, which go through a copy
// that stays in the nearest cache, in fewer.
constexpr int kColumns = 64, kRows = 16;

FRINGESLAM_INLINE void filter_body(const float* in, float* out, int count, size_t stride, int lanes,
                                   const Recursion& f) {
  if (lanes == kColumns)
    filter_lanes<kColumns>(in, out, count, stride, f);
  else
    filter_lanes<kRows>(in, out, count, stride, f);
}
void filter_portable(const float* in, float* out, int count, size_t stride, int lanes, const Recursion& f) {
  filter_body(in, out, count, stride, lanes, f);
}
FRINGESLAM_AVX2 void filter_avx2(const float* in, float* out, int count, size_t stride, int lanes, const Recursion& f) {
  filter_body(in, out, count, stride, lanes, f);
}
FRINGESLAM_AVX512 void filter_avx512(const float* in, float* out, int count, size_t stride, int lanes,
                                     const Recursion& f) {
  filter_body(in, out, count, stride, lanes, f);
}

const auto filter = widest(filter_portable, filter_avx2, filter_avx512);

// Groups of columns or rows. What is left of them is done again with some of the last group, once that is finished.
template <class Visit>
void for_each_group(int size, int lanes, const Visit& visit) {
  for_each_row(size / lanes, [&](int group) { visit(group * lanes); });
  if (size % lanes != 0) visit(size - lanes);
}

cv::Mat1f filtered_columns(const cv::Mat1f& in, const Recursion& f) {
  cv::Mat1f out(in.size());
  for_each_group(in.cols, kColumns,
                 [&](int first) { filter(in[0] + first, out[0] + first, in.rows, in.step1(), kColumns, f); });
  return out;
}

cv::Mat1f filtered_rows(const cv::Mat1f& in, const Recursion& f) {
  cv::Mat1f out(in.size());
  for_each_group(in.rows, kRows, [&](int first) {
    const auto size = static_cast<size_t>(in.cols) * kRows;
    std::vector<float> columns(2 * size);
    for (int lane = 0; lane < kRows; ++lane) {
      const float* row = in[first + lane];
      for (int c = 0; c < in.cols; ++c) columns[static_cast<size_t>(c * kRows + lane)] = row[c];
    }
    filter(columns.data(), columns.data() + size, in.cols, kRows, kRows, f);
    for (int lane = 0; lane < kRows; ++lane) {
      float* row = out[first + lane];
      for (int c = 0; c < in.cols; ++c) row[c] = columns[size + static_cast<size_t>(c * kRows + lane)];
    }
  });
  return out;
}

}  // namespace

Gradient deriche_gradient(const cv::Mat1f& levels, double alpha) {
  if (levels.empty()) return {};
  if (levels.cols < kColumns || levels.rows < kRows) {
    // The border goes on beyond the image; far enough for the recursions to forget that.
    const int border = kColumns + static_cast<int>(30 / alpha);
    cv::Mat1f padded;
    cv::copyMakeBorder(levels, padded, border, border, border, border, cv::BORDER_REPLICATE);
    const Gradient gradient = deriche_gradient(padded, alpha);
    const cv::Rect inner(border, border, levels.cols, levels.rows);
    return {gradient.x(inner).clone(), gradient.y(inner).clone()};
  }
  const Recursion smooth = smoothing(alpha), derive = derivative(alpha);
  return {filtered_rows(filtered_columns(levels, smooth), derive),
          filtered_columns(filtered_rows(levels, smooth), derive)};
}

namespace {

// The gradient's length one pixel on along its direction, between two pixels of the square around.
float length_along(const cv::Mat1f& length, int r, int c, float x, float y) {
  const bool flat = std::abs(x) >= std::abs(y);
  const float share = flat ? std::abs(y / x) : std::abs(x / y);
  const int sx = x > 0 ? 1 : -1, sy = y > 0 ? 1 : -1;
  const float straight = flat ? length(r, c + sx) : length(r + sy, c);
  return (1 - share) * straight + share * length(r + sy, c + sx);
}

// Weak pixels that are linked with strong ones, eight neighbours each.
cv::Mat1b linked(const cv::Mat1b& weak_or_strong) {
  constexpr uchar kStrong = 2;
  cv::Mat1b edges(weak_or_strong.size(), uchar{0});
  std::vector<cv::Point> open;
  for (int r = 0; r < edges.rows; ++r) {
    const uchar *first = weak_or_strong[r], *end = first + edges.cols;
    for (const uchar* at = first;
         (at = static_cast<const uchar*>(std::memchr(at, kStrong, static_cast<size_t>(end - at)))); ++at) {
      const int c = static_cast<int>(at - first);
      if (edges(r, c)) continue;
      edges(r, c) = 255;
      open.emplace_back(c, r);
      while (!open.empty()) {
        const cv::Point p = open.back();
        open.pop_back();
        for (int row = std::max(0, p.y - 1); row <= std::min(edges.rows - 1, p.y + 1); ++row) {
          for (int col = std::max(0, p.x - 1); col <= std::min(edges.cols - 1, p.x + 1); ++col) {
            if (!weak_or_strong(row, col) || edges(row, col)) continue;
            edges(row, col) = 255;
            open.emplace_back(col, row);
          }
        }
      }
    }
  }
  return edges;
}

}  // namespace

cv::Mat1b ridges(const Gradient& gradient, double low, double high) {
  const cv::Size size = gradient.x.size();
  cv::Mat1f length(size);
  cv::Mat1b kind(size, uchar{0});
  const auto weak = static_cast<float>(low), strong = static_cast<float>(high);
  for_each_row(size.height, [&](int r) {
    const float *x = gradient.x[r], *y = gradient.y[r];
    float* out = length[r];
    for (int c = 0; c < size.width; ++c) out[c] = std::sqrt(x[c] * x[c] + y[c] * y[c]);
  });
  // Nothing is known beyond the border.
  for_each_row(size.height - 2, [&](int inner) {
    const int r = inner + 1;
    for (int c = 1; c + 1 < size.width; ++c) {
      const float here = length(r, c);
      if (here < weak) continue;
      const float x = gradient.x(r, c), y = gradient.y(r, c);
      // Of two alike that lie side by side the first is the ridge.
      if (here > length_along(length, r, c, -x, -y) && here >= length_along(length, r, c, x, y))
        kind(r, c) = here >= strong ? 2 : 1;
    }
  });
  return linked(kind);
}

cv::Mat1b log_edges(const cv::Mat1f& levels, double sigma, double threshold) {
  cv::Mat1f smooth, response;
  cv::GaussianBlur(levels, smooth, {}, sigma, sigma, cv::BORDER_REPLICATE);
  cv::Laplacian(smooth, response, CV_32F, 1, 1, 0, cv::BORDER_REPLICATE);
  // Between the two pixels beside an ideal step of one: the difference of its second derivative half a pixel to both
  // sides of it.
  const double step = std::exp(-1 / (8 * sigma * sigma)) / (sigma * sigma * sigma * std::sqrt(2 * std::numbers::pi));
  const auto least = static_cast<float>(threshold * step);
  cv::Mat1b edges(levels.size(), uchar{0});
  for_each_row(levels.rows - 1, [&](int r) {
    for (int c = 0; c + 1 < levels.cols; ++c) {
      const float here = response(r, c);
      for (const float other : {response(r, c + 1), response(r + 1, c)}) {
        // Of the two beside the crossing the left or upper one.
        if ((here < 0) != (other < 0) && std::abs(here - other) >= least) edges(r, c) = 255;
      }
    }
  });
  return edges;
}

const std::vector<std::string>& edge_detectors() {
  static const std::vector<std::string> names = {"canny_deriche", "prewitt", "roberts", "log"};
  return names;
}

cv::Mat1b detect_edges(const cv::Mat1f& levels, const std::string& detector, double alpha, double low, double high) {
  if (levels.rows < 3 || levels.cols < 3) return cv::Mat1b(levels.size(), uchar{0});
  if (detector == "canny_deriche") return ridges(deriche_gradient(levels, alpha), low, high);
  if (detector == "prewitt") return ridges(prewitt_gradient(levels), high, high);
  if (detector == "roberts") return ridges(roberts_gradient(levels), high, high);
  if (detector == "log") return log_edges(levels, std::numbers::sqrt2 / alpha, high);
  throw Error("'" + detector + "' is no edge detector; canny_deriche, prewitt, roberts and log are");
}

}  // namespace fringeslam
