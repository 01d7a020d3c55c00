// SPDX-License-Identifier: Apache-2.0
// The world from outside: matt surfaces in their albedo under a soft sky and a lamp over the viewer's left shoulder,
// and in the warm light of the projector at its first view.
#pragma once

#include <opencv2/core.hpp>

#include "sim/preview/viewpoint.h"

namespace fringeslam::sim {

struct Overview {
  cv::Mat3b picture;     // H x W of the viewpoint's camera, BGR; kPaper where there is nothing
  cv::Mat1f distance_m;  // from the viewpoint to what the pixel's centre sees; infinite where there is nothing
};

inline const cv::Vec3b kPaper(24, 22, 20);

Overview render_overview(const Scene& scene, const RayWorld& world, const Viewpoint& viewpoint);

}  // namespace fringeslam::sim
