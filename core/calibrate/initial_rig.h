// SPDX-License-Identifier: Apache-2.0
// Closed-form starts of the rig calibration.
#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <vector>

#include "core/types/pinhole.h"
#include "core/types/pose.h"

namespace fringeslam {

// Zhang's calibration of one camera from plane corners (OpenCV's), with two radial terms. `poses`: camera_from_board of
// each view. Throws Error when the views do not determine it.
Pinhole initial_camera(const std::vector<std::vector<cv::Point2f>>& corners, const std::vector<Eigen::Vector3d>& board,
                       cv::Size size, std::vector<Pose>& poses);

// Direct linear transform of points in space that do not lie in one plane: lens without distortion, and
// lens_from_points. Throws Error when they do.
Pinhole initial_projector(const std::vector<Eigen::Vector3d>& points, const std::vector<Eigen::Vector2d>& pixels,
                          cv::Size size, Pose& projector_from_camera);

}  // namespace fringeslam
