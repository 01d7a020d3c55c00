// SPDX-License-Identifier: Apache-2.0
#include "core/depth/plane_fit.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>

#include "core/types/parallel.h"

// The vectors below never pass between functions that are not inlined.
#pragma GCC diagnostic ignored "-Wpsabi"

namespace fringeslam {

namespace {

constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();
constexpr float kNowhere = 1e30f;  // depth of what was not measured: no surface reaches there, and no sum is spoilt
constexpr int kMostLanes = 16;

// Compilers take vectors of this kind apart at comparisons, so masks are made of sign bits.
template <int lanes>
struct Vector {
  typedef float Floats __attribute__((vector_size(4 * lanes)));
  typedef int32_t Mask __attribute__((vector_size(4 * lanes)));  // -1 or 0

  FRINGESLAM_INLINE static Floats load(const float* from) {
    Floats v;
    std::memcpy(&v, from, sizeof v);
    return v;
  }
  FRINGESLAM_INLINE static Floats masked(Floats v, Mask mask) { return Floats(Mask(v) & mask); }
  FRINGESLAM_INLINE static Floats magnitude(Floats v) { return Floats(Mask(v) & 0x7fffffff); }
  FRINGESLAM_INLINE static Mask not_negative(Floats v) { return ~(Mask(v) >> 31); }
};

struct FittedLanes {
  float n[3][kMostLanes];  // 1/z = n . (x, y, 1)
  float chi2[kMostLanes];  // per degree of freedom
  float count[kMostLanes];
};

template <int lanes>
FRINGESLAM_INLINE void fit_lanes(const FitImage::Row& r, ptrdiff_t stride, const PlaneFit& fit, int col,
                                 FittedLanes& result) {
  using Lanes = Vector<lanes>;
  using V = typename Lanes::Floats;
  using Mask = typename Lanes::Mask;
  const auto at = [](const float* from) __attribute__((always_inline)) { return Lanes::load(from); };
  const V x0 = at(r.x + col), y0 = at(r.y + col), z0 = at(r.z + col), w0 = at(r.w + col);
  const V sigma = at(r.sigma + col), step = fit.per_depth * z0 + 6 * sigma;
  // Whether both pixels, `by` before and after the centre, are of its surface.
  const auto both = [&](ptrdiff_t by, int distance) __attribute__((always_inline)) {
    const V reach = step * static_cast<float>(distance);
    return Lanes::not_negative(reach - Lanes::magnitude(at(r.z + col + by) - z0)) &
           Lanes::not_negative(reach - Lanes::magnitude(at(r.z + col - by) - z0));
  };
  // The slopes of inverse depth by the nearest neighbours, 0 where there are none: what the sums are relative to. A
  // steep plane's inverse depths would cancel in them to less than the noise.
  const auto slope = [&](const float* ray, ptrdiff_t by) __attribute__((always_inline)) {
    const V rise = at(r.w + col + by) - at(r.w + col - by), run = at(ray + col + by) - at(ray + col - by);
    return Lanes::masked(rise / run, both(by, 1));
  };
  const V slope_x = slope(r.x, 1), slope_y = slope(r.y, stride);
  // Sums of the normal equations; the centre itself is at the origin.
  V xx{}, xy{}, yy{}, x{}, y{}, w{}, xw{}, yw{}, ww{};
  Mask pairs{};
  for (int dr = 0; dr <= fit.radius; ++dr) {
    for (int dc = dr == 0 ? 1 : -fit.radius; dc <= fit.radius; ++dc) {
      const ptrdiff_t by = dr * stride + dc;
      const Mask mask = both(by, std::max(dr, std::abs(dc)));
      const auto add = [&](ptrdiff_t pixel) __attribute__((always_inline)) {
        const V dx = Lanes::masked(at(r.x + pixel) - x0, mask), dy = Lanes::masked(at(r.y + pixel) - y0, mask);
        const V dw = Lanes::masked(at(r.w + pixel) - w0, mask) - slope_x * dx - slope_y * dy;
        xx += dx * dx, xy += dx * dy, yy += dy * dy, x += dx, y += dy;
        w += dw, xw += dx * dw, yw += dy * dw, ww += dw * dw;
      };
      add(col + by);
      add(col - by);
      pairs -= mask;
    }
  }
  const V count = 1 + 2 * __builtin_convertvector(pairs, V);
  const V mean_x = x / count, mean_y = y / count, mean_w = w / count;
  xx -= mean_x * x, xy -= mean_x * y, yy -= mean_y * y;
  xw -= mean_x * w, yw -= mean_y * w, ww -= mean_w * w;
  const V scale = 1 / (xx * yy - xy * xy);
  const V a = scale * (yy * xw - xy * yw), b = scale * (xx * yw - xy * xw);
  const V sigma_w = sigma * w0 * w0, chi2 = (ww - a * xw - b * yw) / (sigma_w * sigma_w * (count - 3));
  // Back from coordinates relative to the centre.
  const V nx = a + slope_x, ny = b + slope_y, nz = w0 + mean_w - a * mean_x - b * mean_y - nx * x0 - ny * y0;
  std::memcpy(result.n[0], &nx, sizeof nx);
  std::memcpy(result.n[1], &ny, sizeof ny);
  std::memcpy(result.n[2], &nz, sizeof nz);
  std::memcpy(result.chi2, &chi2, sizeof chi2);
  std::memcpy(result.count, &count, sizeof count);
}

// The unit normal towards the camera, where the window is a plane.
cv::Vec3f judged(const FittedLanes& fitted, int lane, const PlaneFit& fit) {
  const int window = (2 * fit.radius + 1) * (2 * fit.radius + 1);
  if (fitted.count[lane] * 2 < static_cast<float>(window) || !(fitted.chi2[lane] <= fit.max_chi2))
    return cv::Vec3f::all(kNaN);
  // Depth is positive, so n . (x, y, 1) is, and -n faces the camera.
  const float x = fitted.n[0][lane], y = fitted.n[1][lane], z = fitted.n[2][lane];
  const float scale = -1 / std::sqrt(x * x + y * y + z * z);
  return {scale * x, scale * y, scale * z};
}

template <int lanes>
FRINGESLAM_INLINE void fit_row(const FitImage& image, int row, const PlaneFit& fit, const uchar* wanted,
                               cv::Vec3f* normals) {
  const FitImage::Row r = image.row(row);
  for (int col = 0; col < image.width(); col += lanes) {
    const int end = std::min(col + lanes, image.width());
    std::fill(normals + col, normals + end, cv::Vec3f::all(kNaN));
    if (std::find_if(wanted + col, wanted + end, [](uchar w) { return w != 0; }) == wanted + end) continue;
    FittedLanes fitted;
    fit_lanes<lanes>(r, image.stride(), fit, col, fitted);
    for (int i = 0; i < end - col; ++i) {
      if (wanted[col + i] != 0) normals[col + i] = judged(fitted, i, fit);
    }
  }
}

void fit_portable(const FitImage& image, int row, const PlaneFit& fit, const uchar* wanted, cv::Vec3f* normals) {
  fit_row<4>(image, row, fit, wanted, normals);
}
FRINGESLAM_AVX2 void fit_avx2(const FitImage& image, int row, const PlaneFit& fit, const uchar* wanted,
                              cv::Vec3f* normals) {
  fit_row<8>(image, row, fit, wanted, normals);
}
FRINGESLAM_AVX512 void fit_avx512(const FitImage& image, int row, const PlaneFit& fit, const uchar* wanted,
                                  cv::Vec3f* normals) {
  fit_row<16>(image, row, fit, wanted, normals);
}

}  // namespace

FitImage::FitImage(const cv::Mat3f& points_m, const PixelRays& rays, const cv::Mat1f& sigma_m, int margin)
    : width_(points_m.cols), margin_(margin), sigma_(points_m.rows, points_m.cols + kMostLanes, kNaN) {
  const cv::Size padded(points_m.cols + 2 * margin + kMostLanes, points_m.rows + 2 * margin);
  for (cv::Mat1f* plane : {&x_, &y_, &w_}) *plane = cv::Mat1f(padded, 0.0f);
  z_ = cv::Mat1f(padded, kNowhere);
  for_each_row(points_m.rows, [&](int row) {
    const size_t start = static_cast<size_t>(margin);
    float *x = x_[row + margin] + start, *y = y_[row + margin] + start;
    float *z = z_[row + margin] + start, *w = w_[row + margin] + start;
    for (int col = 0; col < points_m.cols; ++col) {
      x[col] = rays(row, col)[0];
      y[col] = rays(row, col)[1];
      if (std::isnan(points_m(row, col)[2])) continue;
      z[col] = points_m(row, col)[2];
      w[col] = 1 / z[col];
    }
    std::copy_n(sigma_m[row], points_m.cols, sigma_[row]);
  });
}

FitImage::Row FitImage::row(int row) const {
  const size_t start = static_cast<size_t>(margin_);
  const int at = row + margin_;
  return {x_[at] + start, y_[at] + start, z_[at] + start, w_[at] + start, sigma_[row]};
}

void fit_planes(const FitImage& image, int row, const PlaneFit& fit, const uchar* wanted, cv::Vec3f* normals,
                InstructionSet set) {
#if defined(__x86_64__)
  if (set == InstructionSet::avx512) return fit_avx512(image, row, fit, wanted, normals);
  if (set == InstructionSet::avx2) return fit_avx2(image, row, fit, wanted, normals);
#endif
  fit_portable(image, row, fit, wanted, normals);
}

}  // namespace fringeslam
