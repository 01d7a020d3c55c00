// SPDX-License-Identifier: Apache-2.0
// Closed-form initial estimates for the rig calibration.
#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <vector>

#include "core/types/pinhole.h"
#include "core/types/pose.h"

namespace fringeslam {

// Camera intrinsics with two radial terms from planar corners by Zhang's method (OpenCV). Returns camera_from_board of
// each view in `poses`. Throws Error if the views do not determine the intrinsics.
Pinhole initial_camera(const std::vector<std::vector<cv::Point2f>>& corners, const std::vector<Eigen::Vector3d>& board,
                       cv::Size size, std::vector<Pose>& poses);

// Projector intrinsics without distortion and `projector_from_camera` from 3D points (camera frame, m) and their
// projector pixels by a direct linear transform. Throws Error if the points are coplanar or the pixels are mirrored.
Pinhole initial_projector(const std::vector<Eigen::Vector3d>& points, const std::vector<Eigen::Vector2d>& pixels,
                          cv::Size size, Pose& projector_from_camera);

}  // namespace fringeslam
