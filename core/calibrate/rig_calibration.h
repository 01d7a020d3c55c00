// SPDX-License-Identifier: Apache-2.0
// Camera, projector and their relative pose from views of a flat board (METHOD §3, rig calibration).
//
// Every view gives the board's corners in the camera image and, carried over by local homographies, in the projector's.
// The camera starts from Zhang's closed form; with it each board has a pose, and the projector starts from the direct
// linear transform of all boards' corners, which are not coplanar together: no guess of its principal point, which in
// projectors lies far from the middle. Then both lenses, their relative pose and all board poses are refined together:
//
//   min sum rho(|r_c|^2 / sigma_c^2) + rho(|r_p - H r_c|^2 / sigma_p^2),
//   r_c = pi_c(T_i X_j) - c_ij,   r_p = pi_p(projector_from_camera T_i X_j) - p_ij
//
// with the local homography's Jacobian H: a corner that was found a little off in the camera image is as much off in
// the projector's, while what the two images say of one another is as exact as the phase.
#pragma once

#include <string>
#include <vector>

#include "core/calibrate/board.h"
#include "core/calibrate/projector_corners.h"
#include "core/types/options.h"
#include "core/types/rig_model.h"

namespace fringeslam {

struct RigCalibrationOptions {
  int radial_terms = 2;    // k1, k2, k3
  bool tangential = true;  // p1, p2
  double window = 0.6;     // of the local homographies: radius in corner spacings
  double max_window_px = 40;
  double max_reprojection_px = 1;  // RMS of a view that may stay
  double max_focal_sigma = 0.01;   // relative
  int min_views = 3;

  template <class Visitor>
  void describe(Visitor& v) {
    v.field("radial_terms", radial_terms, {0, 3}, "radial distortion terms of each lens: k1, k2, k3");
    v.field("tangential", tangential, "tangential distortion of each lens: p1, p2");
    v.field("window", window, {0.1, 3}, "radius of the local homographies, corner spacings");
    v.field("max_window_px", max_window_px, {3, 500}, "largest radius of the local homographies, px");
    v.field("max_reprojection_px", max_reprojection_px, {0.01, 100}, "largest RMS reprojection error of a view, px");
    v.field("max_focal_sigma", max_focal_sigma, {1e-6, 1}, "largest relative standard deviation of a focal length");
    v.field("min_views", min_views, {3, 1000}, "least number of views");
  }
};

// One view as it was measured.
struct BoardView {
  std::string name;                                          // for messages
  std::vector<cv::Point2f> corners_px;                       // camera; empty when the board was not found
  std::vector<std::optional<LocalHomography>> homographies;  // of each corner
};

// Finds the board and its local homographies in one view.
BoardView observe_board(const std::string& name, const cv::Mat1f& texture, const ProjectorCoordinates& coordinates,
                        const Board& board, const RigCalibrationOptions& options);

struct ViewResult {
  std::string name;
  bool used = false;
  std::string reason;  // why not
  Pose camera_from_board;
  double camera_rms_px = 0, projector_rms_px = 0;
  // Measured corners and what is left of them, corner by corner; NaN where there is none.
  std::vector<Eigen::Vector2d> camera_px, projector_px, camera_residual_px, projector_residual_px;
};

struct LensSigmas {
  double fx = 0, fy = 0, cx = 0, cy = 0;
  Distortion distortion;
};

struct RigCalibration {
  RigModel rig;  // the given one with lenses and relative pose replaced
  LensSigmas camera_sigma, projector_sigma;
  Eigen::Vector3d rotation_sigma_rad{0, 0, 0}, translation_sigma_m{0, 0, 0};  // of projector_from_camera
  // 24 x 24: camera (fx fy cx cy k1 k2 p1 p2 k3), projector (the same), projector_from_camera (rotation, translation);
  // zero rows for what was not estimated.
  Eigen::MatrixXd covariance;
  double camera_rms_px = 0, projector_rms_px = 0;
  std::vector<ViewResult> views;
};

// Image sizes, sensor and mount are taken from `rig`, lenses and poses are not. Throws Error saying what is missing
// when the views do not determine the rig.
RigCalibration calibrate_rig(const std::vector<BoardView>& views, const Board& board, const RigModel& rig,
                             const RigCalibrationOptions& options);

}  // namespace fringeslam
