// SPDX-License-Identifier: Apache-2.0
// Planes that fit windows of an organised cloud. Under perspective a plane n.P = d is linear in inverse depth,
//
//   w = 1/z = (n/d).(x, y, 1),
//
// and over a window the ray's (x, y) is linear in column and row: a lens bends it by some 1e-5 of a window's width, to
// both sides alike, which slopes do not see. So a fit is a 2 x 2 linear system in whole pixels, whose slopes the ray's
// Jacobian turns into n/d; many windows are fitted side by side, a pixel a lane.
#pragma once

#include <opencv2/core.hpp>
#include <utility>

#include "core/base/instruction_set.h"
#include "core/types/frame.h"

namespace fringeslam {

// An image with margins, so that windows may reach over the border and vectors beyond the end of a row; zeros at first.
template <class Value>
class PaddedImage {
 public:
  PaddedImage(const cv::Size& size, int margin) : PaddedImage(margin, size) { values_.setTo(Value{0}); }
  // The margins alone are zeros: for an image all of which is written anyway.
  static PaddedImage framed(const cv::Size& size, int margin) {
    PaddedImage image(margin, size);
    const int right = margin + size.width, below = margin + size.height;
    image.values_.rowRange(0, margin).setTo(Value{0});
    image.values_.rowRange(below, below + margin).setTo(Value{0});
    image.values_.colRange(0, margin).setTo(Value{0});
    image.values_.colRange(right, image.values_.cols).setTo(Value{0});
    return image;
  }
  // Column 0 of a row; rows and columns reach from -margin on.
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

// The images of a fit, an array a quantity. All have the same strides.
struct FitImage {
  // points_m: NaN where nothing was measured; the margin, px, is the largest radius that may be asked for, 1 or more.
  FitImage(const cv::Mat3f& points_m, const PixelRays& rays, const cv::Mat1f& sigma_m, int margin);

  cv::Size size;
  int margin;
  PaddedImage<float> x, y;   // rays, known one pixel beyond the border
  PaddedImage<float> z, w;   // depth and its inverse; kNowhere where nothing was measured
  PaddedImage<float> sigma;  // of the depth, as a share of it; 0 where nothing was measured

  // No surface reaches there, and its square is still a number.
  static constexpr float kNowhere = 1e15f;
};

// Unit vectors, zeros where there is none, of FitImage's size and margins.
struct NormalImages {
  explicit NormalImages(const FitImage& image)
      : x(image.size, image.margin), y(image.size, image.margin), z(image.size, image.margin) {}
  // To be written whole.
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
  int radius = 5;         // half width of the window, px; 15 at most
  float per_depth = 0;    // a neighbour k pixels off is of the surface when its depth differs by at most
                          // k (per_depth z + 6 sigma)
  float max_chi2 = 2.5f;  // per degree of freedom, of a window that is a plane
};

// Unit normals, towards the camera, of the windows about the pixels of a row that are `wanted` (-1, else 0). A window
// takes only pairs of pixels that mirror each other, which gives the pixel itself no say in the slopes. Zeros where
// fewer than half of the window are of the surface, where it is no plane within the noise, and where nothing is wanted.
void fit_planes(const FitImage& image, int row, const PlaneFit& fit, const int32_t* wanted, NormalImages& normals,
                InstructionSet set = widest_instruction_set());

}  // namespace fringeslam
