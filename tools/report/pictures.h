// SPDX-License-Identifier: Apache-2.0
// Pictures of a run's results, 8-bit BGR.
#pragma once

#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "core/mapper/pipeline.h"
#include "core/mapper/thermal_observer.h"

namespace fringeslam::tools {

// Maps values of [low, high] to the Turbo colour map; NaN is black. Signed errors use [-limit, limit].
cv::Mat3b false_colour(const cv::Mat1f& values, double low, double high);

// Surface under a light from above left, by its normals; black where there are none.
cv::Mat3b shaded_picture(const cv::Mat3f& normals);

// Limits that contain all valid values but the lowest and highest 1 %; {0, 1} if there are none.
std::pair<double, double> content_limits(const cv::Mat1f& values);

cv::Mat3b grey_picture(const cv::Mat& image, double full_scale);

// Matched keypoints of two textures side by side: inliers of the motion green, the rest red.
cv::Mat3b match_picture(const Keyframe& reference, const FrameResult& current);

// Temperatures overlaid on the texture, from the surroundings' to 15 K above, with boxes around the warm regions:
// victim candidates red, the rest yellow, each labelled with its kind.
cv::Mat3b warm_picture(const cv::Mat1b& texture, const ThermalView& thermal);

// The map in parallel projection along the first camera's viewing direction, shaded by its normals, with the camera
// positions. The picture frames the points `framed`, by default those drawn.
cv::Mat3b map_picture(const std::vector<CloudPoint>& points, const std::vector<Pose>& world_from_camera, cv::Size size,
                      const std::vector<CloudPoint>* framed = nullptr);

struct Panel {
  std::string title;
  cv::Mat3b picture;
  int columns = 1;  // spanned in the sheet's grid
};

// Arranges panels in rows, each scaled into its cell below its title.
cv::Mat3b sheet(const std::vector<std::vector<Panel>>& rows, cv::Size cell);

// Renders lines of monospaced text, light on dark.
cv::Mat3b text_picture(const std::vector<std::string>& lines, cv::Size size);

}  // namespace fringeslam::tools
