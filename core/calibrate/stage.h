// SPDX-License-Identifier: Apache-2.0
// Calibrates the sensor's mount on its stage or robot (docs/method.md, section 11.2; thesis 4.1.1, eq. 8): estimates
// X = robot_from_camera from the corners of a static board seen during P commanded motions.
//
// A corner seen by the camera at c_0 from the pose W_0 = world_from_robot and at c_i from W_i is fixed in the world:
//
//   W_0 X c_0 = W_i X c_i,   or   R_0 M c_0 - R_i M c_i + (R_0 - R_i) t = w_i - w_0   for X = [M t], W = [R w]
//
// This is linear in the 12 unknowns [M t] of the papers; N corners and P motions give 3 N P equations. The rigid
// transform nearest to the solution initialises a maximum-likelihood estimate on SE(3), in which the world positions
// p_j of the corners are unknowns as well:
//
//   min sum_ij |W_i X c_ij - p_j|^2 weighted by the covariance of c_ij
#pragma once

#include <optional>
#include <vector>

#include "core/types/frame.h"
#include "core/types/pose.h"

namespace fringeslam {

struct CornerPoint {
  Eigen::Vector3d point_m;  // camera frame
  Eigen::Matrix3d covariance_m2;
};

// A commanded pose and the corners measured from it.
struct StageView {
  Pose world_from_robot;
  std::vector<std::optional<CornerPoint>> corners;  // in the same order in all views
};

struct StageCalibration {
  Eigen::Matrix<double, 3, 4> affine;      // the 12 unknowns
  double affinity = 0;                     // Frobenius norm |M^T M - I|, the deviation from a rigid transform
  Pose nearest_rigid;                      // rigid transform nearest to `affine`
  Pose robot_from_camera;                  // maximum likelihood
  Matrix6d covariance = Matrix6d::Zero();  // of retract(robot_from_camera, .)
  double rms_m = 0;                        // of the 3D corner residuals
  int corners = 0, motions = 0;
};

// Estimates robot_from_camera from at least four views. Throws Error stating the missing motion if the motions do not
// determine the transform.
StageCalibration calibrate_stage(const std::vector<StageView>& views);

// Intersects a corner's ray with the plane fitted to the cloud within `radius_px`. Empty if fewer than 12 points are
// valid or they do not fit a plane.
std::optional<CornerPoint> corner_point(const Frame& frame, const Pinhole& camera, const Eigen::Vector2d& corner_px,
                                        double radius_px);

}  // namespace fringeslam
