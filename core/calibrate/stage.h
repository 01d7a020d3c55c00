// SPDX-License-Identifier: Apache-2.0
// How the sensor sits on its stage or robot (METHOD S19; thesis 4.1.1, eq. 8): X = robot_from_camera, from the corners
// of a board that stands still while the robot takes P commanded motions.
//
// A corner that the camera sees at c_0 from the pose W_0 = world_from_robot and at c_i from W_i stays where it is:
//
//   W_0 X c_0 = W_i X c_i,   or   R_0 M c_0 - R_i M c_i + (R_0 - R_i) t = w_i - w_0   for X = [M t], W = [R w]
//
// linear in the papers' 12 unknowns [M t]; N corners and P motions give 3 N P equations. The nearest rigid transform
// starts a maximum-likelihood estimate on SE(3) in which the corners' world positions are unknowns, too:
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

// One commanded pose and what the camera saw of each corner from there.
struct StageView {
  Pose world_from_robot;
  std::vector<std::optional<CornerPoint>> corners;  // of one order in all views
};

struct StageCalibration {
  Eigen::Matrix<double, 3, 4> affine;      // the 12 unknowns
  double affinity = 0;                     // |M^T M - 1|, Frobenius: how far from rigid they came out
  Pose nearest_rigid;                      // of the 12
  Pose robot_from_camera;                  // maximum likelihood
  Matrix6d covariance = Matrix6d::Zero();  // of retract(robot_from_camera, .)
  double rms_m = 0;                        // of what is left of the corners, 3-D
  int corners = 0, motions = 0;
};

// Throws Error saying what is missing when the motions do not determine the transform.
StageCalibration calibrate_stage(const std::vector<StageView>& views);

// The point where a corner's ray meets the plane through the cloud within `radius_px` of it. Empty when there are too
// few points or they are no plane.
std::optional<CornerPoint> corner_point(const Frame& frame, const Pinhole& camera, const Eigen::Vector2d& corner_px,
                                        double radius_px);

}  // namespace fringeslam
