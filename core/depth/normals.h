// SPDX-License-Identifier: Apache-2.0
// Normals of an organised cloud for use in registration (docs/method.md, sections 4.3 and 7.1).
//
// Registration multiplies the normal of a pixel by the residual of the same pixel. Three effects would bias it:
//   - Normals smoothed across an edge: windows that do not fit a plane within the noise give no normal.
//   - Normals correlated with the pixel's own noise: the centre pixel does not contribute to the slopes of its window.
//   - The noise of small windows: near an edge, a pixel first takes the normal of a larger neighbouring window on whose
//     plane it lies; only then are smaller windows tried.
#pragma once

#include <opencv2/core.hpp>

#include "core/depth/plane_fit.h"

namespace fringeslam {

// Returns camera-facing unit normals, H x W, NaN where unavailable. `widest` describes the largest window; its radius
// must equal the image's margin.
cv::Mat3f estimate_normals(const FitImage& image, const PlaneFit& widest);

}  // namespace fringeslam
