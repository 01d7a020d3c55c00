// SPDX-License-Identifier: Apache-2.0
// Pictures of what happened, 8-bit BGR.
#pragma once

#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "core/mapper/pipeline.h"

namespace fringeslam::tools {

// Values of [low, high] in the Turbo colour map; NaN is black. Signed errors use [-limit, limit].
cv::Mat3b false_colour(const cv::Mat1f& values, double low, double high);

cv::Mat3b grey_picture(const cv::Mat& image, double full_scale);

// Matched keypoints of two textures side by side: supporters of the motion green, the rest red.
cv::Mat3b match_picture(const Keyframe& reference, const FrameResult& current);

// Temperatures laid onto the texture, from the surroundings' to 15 K above it, with the warm regions in frames:
// candidates for a victim red, the rest yellow, each with what it is.
cv::Mat3b warm_picture(const FrameResult& view);

// The map seen from where the first camera looks, in parallel projection, shaded by its normals, with the camera
// positions.
cv::Mat3b map_picture(const std::vector<CloudPoint>& points, const std::vector<Pose>& world_from_camera, cv::Size size);

struct Panel {
  std::string title;
  cv::Mat3b picture;
  int columns = 1;  // of the sheet's grid
};

// Rows of panels, each panel scaled into its cell under its title.
cv::Mat3b sheet(const std::vector<std::vector<Panel>>& rows, cv::Size cell);

// Lines of monospaced text, light on dark.
cv::Mat3b text_picture(const std::vector<std::string>& lines, cv::Size size);

}  // namespace fringeslam::tools
