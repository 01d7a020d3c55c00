// SPDX-License-Identifier: Apache-2.0
#include "core/landmarks/edges.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <opencv2/imgproc.hpp>

#include "core/base/parallel.h"
#include "core/base/symmetric_filter.h"
#include "core/landmarks/morphology.h"
#include "core/types/selected_instruction_set.h"

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

// A strong pixel has both bits set.
enum : uchar { kNone = 0, kWeak = 1, kStrong = 3 };

// Gradient magnitudes of a row and of the rows above and below it.
struct LengthRows {
  const float *above, *here, *below;
};

// Classifies each pixel in [1, width - 1): it is on a ridge if its gradient is no shorter than the two interpolated
// one pixel to both sides along it. Of two equal neighbours the first is the ridge.
FRINGESLAM_INLINE void classify_body(const LengthRows& length, const float* x, const float* y, int width, float weak,
                                     float strong, uchar* __restrict kind) {
  const float *row_above = length.above, *row = length.here, *row_below = length.below;
  for (int c = 1; c + 1 < width; ++c) {
    const float here = row[c], across = std::abs(x[c]), along = std::abs(y[c]);
    const bool flat = across >= along;
    const float share = (flat ? along : across) / std::max(std::max(across, along), 1e-30f);
    // Neighbours to the right of the pixel (below it where the gradient is steep), and on the opposite side.
    const bool falling = (x[c] > 0) == (y[c] > 0);
    const float right_below = row_below[c + 1], left_below = row_below[c - 1];
    const float right_above = row_above[c + 1], left_above = row_above[c - 1];
    const float right = row[c + 1], left = row[c - 1], above = row_above[c], below = row_below[c];
    const float straight_on = flat ? right : below, straight_back = flat ? left : above;
    const float slanted_on = falling ? right_below : flat ? right_above : left_below;
    const float slanted_back = falling ? left_above : flat ? left_below : right_above;
    const float on = straight_on + share * (slanted_on - straight_on);
    const float back = straight_back + share * (slanted_back - straight_back);
    const bool ahead_is_on = (flat ? x[c] : y[c]) > 0;
    const float ahead = ahead_is_on ? on : back, behind = ahead_is_on ? back : on;
    const bool ridge = (here >= weak) & (here > behind) & (here >= ahead);
    kind[c] = static_cast<uchar>(ridge ? (here >= strong ? kStrong : kWeak) : kNone);
  }
}

// Classifies all rows of a gradient except the first and the last, into the rows of `kinds`.
void classify_rows(const Gradient& gradient, double low, double high, cv::Mat1b kinds) {
  static const auto classify = Variants<classify_body>::of(selected_instruction_set());
  cv::Mat1f length(gradient.x.size());
  for (int r = 0; r < length.rows; ++r) {
    const float *x = gradient.x[r], *y = gradient.y[r];
    float* out = length[r];
    for (int c = 0; c < length.cols; ++c) out[c] = std::sqrt(x[c] * x[c] + y[c] * y[c]);
  }
  for (int r = 1; r + 1 < length.rows; ++r)
    classify({length[r - 1], length[r], length[r + 1]}, gradient.x[r], gradient.y[r], length.cols,
             static_cast<float>(low), static_cast<float>(high), kinds[r - 1]);
}

// Processes the image in strips that fit a core's cache: strips of the gradient, each with one row above and below.
template <class GradientOf>
BitImage linked_ridges(cv::Size size, double low, double high, const GradientOf& gradient_of_rows) {
  constexpr int kStrip = 126;
  // Border pixels are never edges.
  const int inner = size.height - 2;
  cv::Mat1b kinds(size, uchar{kNone});
  for_each_row((inner + kStrip - 1) / kStrip, [&](int strip) {
    const cv::Range rows(1 + strip * kStrip, 1 + std::min(inner, (strip + 1) * kStrip));
    classify_rows(gradient_of_rows(cv::Range(rows.start - 1, rows.end + 1)), low, high, kinds.rowRange(rows));
  });
  return reconstructed(BitImage::from(kinds, kStrong & ~kWeak), BitImage::from(kinds));
}

}  // namespace

BitImage ridges(const Gradient& gradient, double low, double high) {
  return linked_ridges(gradient.x.size(), low, high, [&](const cv::Range& rows) {
    return Gradient{gradient.x.rowRange(rows), gradient.y.rowRange(rows)};
  });
}

BitImage log_edges(const cv::Mat1f& levels, double sigma, double threshold) {
  cv::Mat1f response;
  const cv::Mat1f smooth = filtered(levels, gaussian_half(sigma), FilterBorder::replicated, selected_instruction_set());
  cv::Laplacian(smooth, response, CV_32F, 1, 1, 0, cv::BORDER_REPLICATE);
  // Difference of the second derivative half a pixel to either side of an ideal unit step: the response difference of
  // the two pixels adjacent to it.
  const double step = std::exp(-1 / (8 * sigma * sigma)) / (sigma * sigma * sigma * std::sqrt(2 * std::numbers::pi));
  const auto least = static_cast<float>(threshold * step);
  cv::Mat1b edges(levels.size(), uchar{0});
  for_each_row(levels.rows - 1, [&](int r) {
    for (int c = 0; c + 1 < levels.cols; ++c) {
      const float here = response(r, c);
      for (const float other : {response(r, c + 1), response(r + 1, c)}) {
        // Marks the left or upper of the two pixels at the crossing.
        if ((here < 0) != (other < 0) && std::abs(here - other) >= least) edges(r, c) = 255;
      }
    }
  });
  return BitImage::from(edges);
}

BitImage detect_edges(const cv::Mat1f& levels, EdgeDetector detector, double alpha, double low, double high) {
  if (levels.rows < 3 || levels.cols < 3) return BitImage(levels.cols, levels.rows);
  switch (detector) {
    case EdgeDetector::canny_deriche:
      return linked_ridges(levels.size(), low, high,
                           [&](const cv::Range& rows) { return deriche_gradient(levels, alpha, rows); });
    case EdgeDetector::prewitt:
      return ridges(prewitt_gradient(levels), high, high);
    case EdgeDetector::roberts:
      return ridges(roberts_gradient(levels), high, high);
    case EdgeDetector::log:
      return log_edges(levels, std::numbers::sqrt2 / alpha, high);
  }
  return BitImage(levels.cols, levels.rows);
}

}  // namespace fringeslam
