// SPDX-License-Identifier: Apache-2.0
#include "core/depth/plane_fit.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "core/base/lanes.h"
#include "core/base/parallel.h"

namespace fringeslam {

namespace {

constexpr int kMostRadius = 15;

// Pointers to column 0 of a row.
struct FitRow {
  const float *x, *y, *z, *w, *sigma;
  ptrdiff_t stride;
};

template <int lanes>
struct FittedLanes {
  typename Lanes<lanes>::Floats x, y, z;  // n / d of w = (n / d) . (x, y, 1)
  typename Lanes<lanes>::Mask holds;      // the window is a plane
};

template <int lanes>
FRINGESLAM_INLINE FittedLanes<lanes> fit_lanes(const FitRow& r, const PlaneFit& fit, int col) {
  using L = Lanes<lanes>;
  using V = typename L::Floats;
  using Mask = typename L::Mask;
  const auto at = [&](const float* from, ptrdiff_t by) __attribute__((always_inline)) {
    return L::load(from + col + by);
  };
  const V z0 = at(r.z, 0), w0 = at(r.w, 0), sigma = at(r.sigma, 0);
  // Range of inverse depths that belong to the surface, k pixels away.
  V low[kMostRadius + 1], high[kMostRadius + 1];
  const V step = z0 * (fit.per_depth + 6 * sigma), least = 1e-3f * z0;
  for (int k = 1; k <= fit.radius; ++k) {
    const V reach = static_cast<float>(k) * step, near = z0 - reach;
    low[k] = 1 / (z0 + reach);
    high[k] = 1 / L::chosen(L::negative(near - least), least, near);
  }
  const auto both = [&](V after, V before, int k) __attribute__((always_inline)) {
    return ~(L::negative(after - low[k]) | L::negative(high[k] - after) | L::negative(before - low[k]) |
             L::negative(high[k] - before));
  };
  // Slopes from the nearest neighbours, 0 if there are none. Sums are relative to these slopes, because the inverse
  // depths of a steep plane would cancel to less than the noise.
  const auto slope = [&](ptrdiff_t by) __attribute__((always_inline)) {
    const V after = at(r.w, by), before = at(r.w, -by);
    return L::masked(0.5f * (after - before), both(after, before, 1));
  };
  const V slope_col = slope(1), slope_row = slope(r.stride);
  // Sums over half of the window: the centre is the origin, and symmetric pixels cancel in the mean position. Two
  // integers share a lane: the sums of dc^2 and dr^2, and the count and the sum of dc dr.
  constexpr int kUpper = 1 << 16;
  V along_row[2 * kMostRadius + 1];
  for (int dc = -fit.radius; dc <= fit.radius; ++dc) along_row[kMostRadius + dc] = slope_col * static_cast<float>(dc);
  V mean{}, by_col{}, by_row{}, squares{};
  Mask count_and_mixed{};
  typename L::Bits moments{};
  for (int dr = 0; dr <= fit.radius; ++dr) {
    const V along_col = slope_row * static_cast<float>(dr);
    for (int dc = dr == 0 ? 1 : -fit.radius; dc <= fit.radius; ++dc) {
      const ptrdiff_t by = dr * r.stride + dc;
      const V after = at(r.w, by), before = at(r.w, -by);
      const Mask mask = both(after, before, std::max(dr, std::abs(dc)));
      const V along = along_row[kMostRadius + dc] + along_col;
      const V forth = L::masked(after - w0 - along, mask), back = L::masked(before - w0 + along, mask);
      const V difference = forth - back;
      mean += forth + back;
      by_col += difference * static_cast<float>(dc);
      by_row += difference * static_cast<float>(dr);
      squares += forth * forth + back * back;
      moments += typename L::Bits(mask) & static_cast<uint32_t>(dc * dc + kUpper * dr * dr);
      count_and_mixed += mask & (kUpper + dc * dr);
    }
  }
  const auto to_float = [](Mask v) __attribute__((always_inline)) { return __builtin_convertvector(v, V); };
  const Mask mixed = (count_and_mixed << 16) >> 16;
  const V count = 1 + 2 * to_float((count_and_mixed - mixed) >> 16);
  const V cc = 2 * to_float(Mask(moments & (kUpper - 1))), rr = 2 * to_float(Mask(moments >> 16)),
          cr = 2 * to_float(mixed);
  const V scale = 1 / (cc * rr - cr * cr);
  const V a = scale * (rr * by_col - cr * by_row), b = scale * (cc * by_row - cr * by_col);
  const V sigma_w = sigma * w0, average = mean / count;
  const V left = squares - average * mean - a * by_col - b * by_row;
  const V most = fit.max_chi2 * (sigma_w * sigma_w) * (count - 3);
  const int window = (2 * fit.radius + 1) * (2 * fit.radius + 1);

  // Converts slopes per column and row to slopes along the ray coordinates.
  const auto half = [&](const float* ray, ptrdiff_t by) __attribute__((always_inline)) {
    return 0.5f * (at(ray, by) - at(ray, -by));
  };
  const V x_col = half(r.x, 1), x_row = half(r.x, r.stride), y_col = half(r.y, 1), y_row = half(r.y, r.stride);
  const V g_col = a + slope_col, g_row = b + slope_row, area = 1 / (x_col * y_row - x_row * y_col);
  FittedLanes<lanes> result;
  result.x = area * (y_row * g_col - y_col * g_row);
  result.y = area * (x_col * g_row - x_row * g_col);
  result.z = w0 + average - result.x * at(r.x, 0) - result.y * at(r.y, 0);
  result.holds = L::not_negative(2 * count - static_cast<float>(window)) & L::not_negative(most - left);
  return result;
}

template <int lanes>
FRINGESLAM_INLINE void fit_row(const FitRow& r, int width, const PlaneFit& fit, const int32_t* wanted, float* x,
                               float* y, float* z) {
  using L = Lanes<lanes>;
  for (int col = 0; col < width; col += lanes) {
    const auto asked = L::load(wanted + col);
    FittedLanes<lanes> fitted{};
    if (L::any(asked)) fitted = fit_lanes<lanes>(r, fit, col);
    const auto given = fitted.holds & asked;
    // Depth is positive, so n . (x, y, 1) is positive and -n faces the camera.
    alignas(64) float scale[lanes];
    L::store(fitted.x * fitted.x + fitted.y * fitted.y + fitted.z * fitted.z, scale);
    for (float& s : scale) s = -1 / std::sqrt(s);
    const auto unit = L::load(scale);
    L::store(L::masked(unit * fitted.x, given), x + col);
    L::store(L::masked(unit * fitted.y, given), y + col);
    L::store(L::masked(unit * fitted.z, given), z + col);
  }
}

// Extrapolates a row of rays by one pixel on both sides.
void extend(float* row, int width) {
  row[-1] = width > 1 ? 2 * row[0] - row[1] : row[0];
  row[width] = width > 1 ? 2 * row[width - 1] - row[width - 2] : row[0];
}

}  // namespace

FitImage::FitImage(const cv::Mat3f& points_m, const PixelRays& rays, const cv::Mat1f& sigma_m, int margin_px)
    : size(points_m.size()),
      margin(margin_px),
      x(PaddedImage<float>::framed(size, margin)),
      y(PaddedImage<float>::framed(size, margin)),
      z(PaddedImage<float>::framed(size, margin)),
      w(PaddedImage<float>::framed(size, margin)),
      sigma(PaddedImage<float>::framed(size, margin)) {
  const int width = size.width, height = size.height;
  for_each_row(height + 2 * margin, [&](int padded_row) {
    const int row = padded_row - margin;
    std::fill(z[row] - margin, z[row] + width + margin, kNowhere);
    std::fill(w[row] - margin, w[row] + width + margin, kNowhere);
    if (row < 0 || row >= height) return;
    for (int col = 0; col < width; ++col) {
      const float depth = points_m(row, col)[2];
      const bool measured = depth > 0;  // false for NaN
      x[row][col] = rays(row, col)[0], y[row][col] = rays(row, col)[1];
      z[row][col] = measured ? depth : kNowhere;
      w[row][col] = measured ? 1 / depth : kNowhere;
      sigma[row][col] = measured ? sigma_m(row, col) / depth : 0;
    }
    extend(x[row], width), extend(y[row], width);
  });
  const int last = height - 1, other = std::min(1, last);
  for (PaddedImage<float>* ray : {&x, &y}) {
    for (int col = 0; col < width; ++col) {
      (*ray)[-1][col] = 2 * (*ray)[0][col] - (*ray)[other][col];
      (*ray)[height][col] = 2 * (*ray)[last][col] - (*ray)[last - other][col];
    }
  }
}

void fit_planes(const FitImage& image, int row, const PlaneFit& fit, const int32_t* wanted, NormalImages& normals,
                InstructionSet set) {
  const FitRow r{image.x[row], image.y[row], image.z[row], image.w[row], image.sigma[row], image.w.stride()};
  Variants<fit_row<4>, fit_row<8>, fit_row<16>>::of(set)(r, image.size.width, fit, wanted, normals.x[row],
                                                         normals.y[row], normals.z[row]);
}

}  // namespace fringeslam
