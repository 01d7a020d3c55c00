// SPDX-License-Identifier: Apache-2.0
// Plane fits to windows of an organised cloud. Under perspective projection a plane n.P = d is linear in inverse depth,
//
//   w = 1/z = (n/d).(x, y, 1),
//
// and within a window the ray's (x, y) is linear in column and row: lens distortion deviates from this by about 1e-5 of
// the window width, symmetrically on both sides, which does not affect the slopes. A fit is therefore a 2 x 2 linear
// system in integer pixel offsets, whose slopes are converted to n/d by the ray's Jacobian. Many windows are fitted in
// parallel, one pixel per SIMD lane. See docs/method.md, section 4.3.
#pragma once

#include <opencv2/core.hpp>
#include <utility>

#include "core/types/frame.h"
#include "core/types/selected_instruction_set.h"

namespace fringeslam {

// Image with margins, so that windows may extend past the border and vectors past the end of a row; initialised to
// zero.
template <class Value>
class PaddedImage {
 public:
  PaddedImage(const cv::Size& size, int margin) : PaddedImage(margin, size) { values_.setTo(Value{0}); }
  // Initialises only the margins; for images whose interior will be fully written.
  static PaddedImage framed(const cv::Size& size, int margin) {
    PaddedImage image(margin, size);
    const int right = margin + size.width, below = margin + size.height;
    image.values_.rowRange(0, margin).setTo(Value{0});
    image.values_.rowRange(below, below + margin).setTo(Value{0});
    image.values_.colRange(0, margin).setTo(Value{0});
    image.values_.colRange(right, image.values_.cols).setTo(Value{0});
    return image;
  }
  // Pointer to column 0 of a row; valid indices start at -margin.
  Value* operator[](int row) { return values_[row + margin_] + margin_; }
  const Value* operator[](int row) const { return values_[row + margin_] + margin_; }
  ptrdiff_t stride() const { return static_cast<ptrdiff_t>(values_.step1()); }

 private:
  static constexpr int kMostLanes = 16;
  PaddedImage(int margin, const cv::Size& size)
      : margin_(margin), values_(size.height + 2 * margin, size.width + 2 * margin + kMostLanes) {}
  int margin_;
  cv::Mat_<Value> values_;
};

// Input images of the plane fits, one array per quantity, all with the same stride.
struct FitImage {
  // points_m: NaN where nothing was measured; margin: the largest window radius to be used, px, at least 1.
  FitImage(const cv::Mat3f& points_m, const PixelRays& rays, const cv::Mat1f& sigma_m, int margin);

  cv::Size size;
  int margin;
  PaddedImage<float> x, y;   // rays, extrapolated one pixel beyond the border
  PaddedImage<float> z, w;   // depth and its inverse; kNowhere where nothing was measured
  PaddedImage<float> sigma;  // depth sigma relative to the depth; 0 where nothing was measured

  // Larger than any measured value, with a square that is still finite.
  static constexpr float kNowhere = 1e15f;
};

// Unit vectors, zero where unavailable, with FitImage's size and margins.
struct NormalImages {
  explicit NormalImages(const FitImage& image)
      : x(image.size, image.margin), y(image.size, image.margin), z(image.size, image.margin) {}
  // For images that will be fully written.
  static NormalImages framed(const FitImage& image) {
    const auto one = [&] { return PaddedImage<float>::framed(image.size, image.margin); };
    return {one(), one(), one()};
  }
  PaddedImage<float> x, y, z;

 private:
  NormalImages(PaddedImage<float> x_image, PaddedImage<float> y_image, PaddedImage<float> z_image)
      : x(std::move(x_image)), y(std::move(y_image)), z(std::move(z_image)) {}
};

struct PlaneFit {
  int radius = 5;         // half width of the window, px; at most 15
  float per_depth = 0;    // a neighbour k pixels away belongs to the surface if its depth differs by at most
                          // k (per_depth z + 6 sigma)
  float max_chi2 = 2.5f;  // maximum chi-square per degree of freedom for a plane
};

// Computes camera-facing unit normals of the windows centred at the `wanted` pixels (-1, else 0) of a row. A window
// uses only point-symmetric pixel pairs, so that the centre pixel does not contribute to the slopes. The result is zero
// where fewer than half of the window belongs to the surface, where the window is not a plane within the noise, and for
// pixels that are not wanted.
void fit_planes(const FitImage& image, int row, const PlaneFit& fit, const int32_t* wanted, NormalImages& normals,
                InstructionSet set = selected_instruction_set());

}  // namespace fringeslam
