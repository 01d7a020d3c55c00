// SPDX-License-Identifier: Apache-2.0
// External view of a scene: diffuse shading with soft sky light, a lamp over the viewer's left shoulder, and warm light
// of the projector at its first pose.
#pragma once

#include <opencv2/core.hpp>

#include "sim/preview/viewpoint.h"

namespace fringeslam::sim {

struct Overview {
  cv::Mat3b picture;     // H x W of the viewpoint's camera, BGR; kPaper where no surface is hit
  cv::Mat1f distance_m;  // from the viewpoint along the pixel's centre ray; infinite where no surface is hit
};

inline const cv::Vec3b kPaper(24, 22, 20);

// Renders the external view from a viewpoint; throws Error if a texture cannot be read.
Overview render_overview(const Scene& scene, const RayScene& world, const Viewpoint& viewpoint);

}  // namespace fringeslam::sim
