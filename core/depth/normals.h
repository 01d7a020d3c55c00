// SPDX-License-Identifier: Apache-2.0
// Normals of an organised cloud that registration can trust (METHOD S22).
//
// Registration multiplies this normal with this pixel's residual, and three things would bias it. A normal rounded over
// an edge: a window that does not look like a plane within the noise gives none. A normal that knows the pixel's own
// noise: a window gives the pixel itself no say in the slopes. And the noise of small windows: near an edge a pixel
// first takes the normal of a wider window beside it whose plane it lies on; only then are smaller windows tried.
#pragma once

#include <opencv2/core.hpp>

#include "core/depth/plane_fit.h"

namespace fringeslam {

// Unit normals towards the camera, H x W, NaN where there is none. widest: of the largest window; its radius is the
// image's margin.
cv::Mat3f estimate_normals(const FitImage& image, const PlaneFit& widest);

}  // namespace fringeslam
