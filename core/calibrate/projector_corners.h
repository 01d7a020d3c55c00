// SPDX-License-Identifier: Apache-2.0
// What the projector, as an inverse camera, "sees" of a board's corners: the decoded coordinates of the pixels round a
// corner define a homography from camera to projector pixels, which carries the corner over with sub-pixel accuracy
// (Moreno and Taubin, 3DIMPVT 2012). A homography of the window, and not of the board, so that neither lens's
// distortion matters.
#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <optional>

namespace fringeslam {

// Projector coordinates of every camera pixel, H x W, NaN where unknown.
struct ProjectorCoordinates {
  cv::Mat1f column_px, row_px, column_sigma_px, row_sigma_px;
};

struct LocalHomography {
  Eigen::Matrix3d projector_from_camera;  // homogeneous pixels
  Eigen::Vector2d sigma_px{0, 0};         // of the corner carried over, from the residuals
  int pixels = 0;

  Eigen::Vector2d operator()(const Eigen::Vector2d& camera_px) const {
    const Eigen::Vector3d p = projector_from_camera * Eigen::Vector3d(camera_px.x(), camera_px.y(), 1);
    return p.head<2>() / p.z();
  }
  // Of the projector pixel with respect to the camera pixel.
  Eigen::Matrix2d jacobian(const Eigen::Vector2d& camera_px) const {
    const Eigen::Matrix3d& h = projector_from_camera;
    const Eigen::Vector3d p = h * Eigen::Vector3d(camera_px.x(), camera_px.y(), 1);
    return (h.topLeftCorner<2, 2>() - p.head<2>() / p.z() * h.block<1, 2>(2, 0)) / p.z();
  }
};

// From the pixels within `radius_px` of the corner, weighted by their sigmas; those off by more than 4 robust standard
// deviations are left out. Empty when fewer than a third of the window's pixels are known, or its corner is not
// surrounded by them.
std::optional<LocalHomography> local_homography(const ProjectorCoordinates& coordinates,
                                                const Eigen::Vector2d& corner_px, double radius_px);

}  // namespace fringeslam
