// SPDX-License-Identifier: Apache-2.0
// One picture that shows at a glance what a scene is. Left: the world from outside around the trajectory, with the path
// of the camera, the frusta of camera and projector between the rig's near_m and far_m, and what the first view's
// camera has in its image. Right: what that camera sees in the projector's white light, and its depth.
#pragma once

#include <opencv2/core.hpp>

#include "sim/scene/scene.h"

namespace fringeslam::sim {

// H x W, BGR. The same for the same scene and size, whatever the number of threads. Throws Error when the size is less
// than 320 x 200 px or a texture cannot be read.
cv::Mat3b preview_picture(const Scene& scene, cv::Size size = {1200, 800});

}  // namespace fringeslam::sim
