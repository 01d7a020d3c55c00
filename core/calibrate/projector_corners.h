// SPDX-License-Identifier: Apache-2.0
// Locates a board's corners in the image of the projector, regarded as an inverse camera. The decoded coordinates of
// the pixels around a corner define a homography from camera to projector pixels, which transfers the corner with
// sub-pixel accuracy (Moreno and Taubin, 3DIMPVT 2012). The homography is local to a window rather than global to the
// board, so that the distortion of the two lenses is negligible.
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
  Eigen::Vector2d sigma_px{0, 0};         // of the transferred corner, from the residuals
  int pixels = 0;

  Eigen::Vector2d operator()(const Eigen::Vector2d& camera_px) const {
    const Eigen::Vector3d p = projector_from_camera * Eigen::Vector3d(camera_px.x(), camera_px.y(), 1);
    return p.head<2>() / p.z();
  }
  // Derivative of the projector pixel with respect to the camera pixel.
  Eigen::Matrix2d jacobian(const Eigen::Vector2d& camera_px) const {
    const Eigen::Matrix3d& h = projector_from_camera;
    const Eigen::Vector3d p = h * Eigen::Vector3d(camera_px.x(), camera_px.y(), 1);
    return (h.topLeftCorner<2, 2>() - p.head<2>() / p.z() * h.block<1, 2>(2, 0)) / p.z();
  }
};

// Fits the homography to the pixels within `radius_px` of the corner, weighted by their sigmas; rejects residuals
// beyond 4 robust standard deviations. Empty if fewer than 20 pixels or a third of the window have coordinates, or if
// these do not surround the corner.
std::optional<LocalHomography> local_homography(const ProjectorCoordinates& coordinates,
                                                const Eigen::Vector2d& corner_px, double radius_px);

}  // namespace fringeslam
