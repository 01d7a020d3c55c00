// SPDX-License-Identifier: Apache-2.0
// Planes that fit windows of an organised cloud. Under perspective a plane n.P = d is linear in inverse depth,
// 1/z = (n/d).(x, y, 1), so a fit is a 3 x 3 linear system; many windows are fitted side by side, a pixel a lane.
#pragma once

#include <opencv2/core.hpp>

#include "core/types/frame.h"
#include "core/types/instruction_set.h"

namespace fringeslam {

// The images of a fit, an array a quantity, with margins so that windows may reach over the border.
class FitImage {
 public:
  // points_m: NaN where nothing was measured; the margin, px, is the largest radius that may be asked for.
  FitImage(const cv::Mat3f& points_m, const PixelRays& rays, const cv::Mat1f& sigma_m, int margin);

  struct Row {
    const float *x, *y, *z, *w;  // rays, depth (1e30 where nothing was measured) and its inverse, at column 0
    const float* sigma;
  };
  Row row(int row) const;
  ptrdiff_t stride() const { return static_cast<ptrdiff_t>(x_.step1()); }
  int width() const { return width_; }

 private:
  int width_, margin_;
  cv::Mat1f x_, y_, z_, w_, sigma_;
};

struct PlaneFit {
  int radius = 5;         // half width of the window, px
  float per_depth = 0;    // a neighbour k pixels off is of the surface when its depth differs by at most
                          // k (per_depth z + 6 sigma)
  float max_chi2 = 2.5f;  // per degree of freedom, of a window that is a plane
};

// Unit normals, towards the camera, of the windows about the pixels of a row that are `wanted` (not 0). A window takes
// only pairs of pixels that mirror each other, which gives the pixel itself no say in the slopes. NaN where fewer than
// half of the window are of the surface, and where it is no plane within the noise; what is not wanted is NaN, too.
void fit_planes(const FitImage& image, int row, const PlaneFit& fit, const uchar* wanted, cv::Vec3f* normals,
                InstructionSet set = widest_instruction_set());

}  // namespace fringeslam
