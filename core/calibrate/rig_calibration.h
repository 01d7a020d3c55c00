// SPDX-License-Identifier: Apache-2.0
// Calibrates camera, projector and their relative pose from views of a planar board (docs/method.md, section 11.1).
//
// Every view provides the board's corners in the camera image and, transferred by local homographies, in the projector
// image. The camera is initialised by Zhang's closed form, which also gives the board poses. The projector is
// initialised by a direct linear transform from the corners of all boards, which together are not coplanar; this
// requires no guess of its principal point, which in projectors lies far from the image centre. Both lenses, their
// relative pose and all board poses are then refined jointly:
//
//   min sum rho(|r_c|^2 / sigma_c^2) + rho(|r_p - H r_c|^2 / sigma_p^2),
//   r_c = pi_c(T_i X_j) - c_ij,   r_p = pi_p(projector_from_camera T_i X_j) - p_ij
//
// H is the Jacobian of the local homography. It accounts for the error of the camera corner, which the transfer carries
// into the projector corner; the remaining error r_p - H r_c is that of the decoded phase.
#pragma once

#include <string>
#include <vector>

#include "core/calibrate/board.h"
#include "core/calibrate/projector_corners.h"
#include "core/types/options.h"
#include "core/types/rig_model.h"

namespace fringeslam {

struct RigCalibrationOptions {
  int radial_terms = 2;    // number of estimated terms of k1, k2, k3
  bool tangential = true;  // estimate p1, p2
  double window = 0.6;     // radius of the local homographies, corner spacings
  double max_window_px = 40;
  double max_reprojection_px = 1;  // largest RMS of a view that is kept
  double max_focal_sigma = 0.01;   // relative
  int min_views = 3;

  template <class Visitor>
  void describe(Visitor& v) {
    v.field("radial_terms", radial_terms, {0, 3}, "number of radial terms (k1, k2, k3) estimated per lens");
    v.field("tangential", tangential, "estimate tangential distortion (p1, p2) of each lens");
    v.field("window", window, {0.1, 3}, "radius of the local homographies, corner spacings");
    v.field("max_window_px", max_window_px, {3, 500}, "maximum radius of the local homographies, px");
    v.field("max_reprojection_px", max_reprojection_px, {0.01, 100}, "maximum RMS reprojection error of a view, px");
    v.field("max_focal_sigma", max_focal_sigma, {1e-6, 1}, "maximum relative standard deviation of a focal length");
    v.field("min_views", min_views, {3, 1000}, "minimum number of views");
  }
};

// Measurements of one view.
struct BoardView {
  std::string name;                                          // for messages
  std::vector<cv::Point2f> corners_px;                       // camera; empty when the board was not found
  std::vector<std::optional<LocalHomography>> homographies;  // one per corner
  bool continues = false;                                    // the board is larger than described
};

// Detects the board in the texture and fits a local homography at each corner.
BoardView observe_board(const std::string& name, const cv::Mat1f& texture, const ProjectorCoordinates& coordinates,
                        const Board& board, const RigCalibrationOptions& options);

struct ViewResult {
  std::string name;
  bool used = false;
  std::string reason;      // why the view is not used; empty if it is used
  bool continues = false;  // the board is larger than described
  Pose camera_from_board;
  double camera_rms_px = 0, projector_rms_px = 0;
  // Measured corners and residuals (measured minus projected) in the order of the corners; NaN where unmeasured.
  std::vector<Eigen::Vector2d> camera_px, projector_px, camera_residual_px, projector_residual_px;
};

// Measurements of a board with the rig calibrated from the other boards.
struct HeldOutBoard {
  std::string name;
  double plane_rms_m = 0;  // of the corners, triangulated from the camera's corners and the projector columns
  double scale_error = 0;  // of the corners' distances, relative
  // Changes of the lenses' parameters, in the order of RigCalibration::covariance.
  Eigen::VectorXd change;
};

struct LensSigmas {
  double fx = 0, fy = 0, cx = 0, cy = 0;
  Distortion distortion;
};

struct RigCalibration {
  RigModel rig;  // the given rig with lenses and relative pose replaced
  LensSigmas camera_sigma, projector_sigma;
  Eigen::Vector3d rotation_sigma_rad{0, 0, 0}, translation_sigma_m{0, 0, 0};  // of projector_from_camera
  // 24 x 24: camera (fx fy cx cy k1 k2 p1 p2 k3), projector (the same), projector_from_camera (rotation, translation);
  // zero rows and columns for parameters that were not estimated. It contains what the views' disagreement shows beyond
  // the noise of independent corners; the sigmas follow from it.
  Eigen::MatrixXd covariance;
  double covariance_factor = 1;        // by which that disagreement exceeds the noise of independent corners
  std::vector<HeldOutBoard> held_out;  // one per used view
  std::vector<std::string> warnings;   // one sentence for each reason to doubt the calibration
  // Share of an 8 x 8 grid over the images in which corners were seen.
  double camera_coverage = 0, projector_coverage = 0;
  double camera_rms_px = 0, projector_rms_px = 0;
  std::vector<ViewResult> views;
};

// Calibrates the rig; takes image sizes, sensor and mount from `rig` but not its lenses and relative pose. Rejects
// views with outlying reprojection errors. Throws Error naming the missing motion or views if the rig is not
// determined.
RigCalibration calibrate_rig(const std::vector<BoardView>& views, const Board& board, const RigModel& rig,
                             const RigCalibrationOptions& options);

}  // namespace fringeslam
