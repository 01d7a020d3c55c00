// SPDX-License-Identifier: Apache-2.0
// Overview image of a scene. Left: an external view of the scene around the trajectory, with the camera path, the
// camera and projector frusta between the rig's near_m and far_m, and the footprint of the first view's image. Right:
// the first view under white projector light, and its depth image.
#pragma once

#include <opencv2/core.hpp>

#include "sim/scene/scene.h"

namespace fringeslam::sim {

// Renders the preview of a scene; H x W, BGR. The result is independent of the number of threads. Throws Error if the
// size is less than 320 x 200 px or a texture cannot be read.
cv::Mat3b preview_picture(const Scene& scene, cv::Size size = {1200, 800});

// Renders its external view alone. Throws Error if a texture cannot be read.
cv::Mat3b overview_picture(const Scene& scene, cv::Size size);

}  // namespace fringeslam::sim
