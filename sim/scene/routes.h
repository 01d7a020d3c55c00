// SPDX-License-Identifier: Apache-2.0
// Trajectory generators for a camera or a robot: poses in the world frame, one per view. Lengths in m, angles in rad.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "core/types/pose.h"

namespace fringeslam::sim {

// Returns world_from_camera for a camera at `eye` with `target` on its optical axis (+z) and its image upright (y down
// along -up). If the axis is parallel to `up`, the top of the image points towards world +x. Throws Error if eye and
// target coincide.
Pose looking_at(const Eigen::Vector3d& eye, const Eigen::Vector3d& target,
                const Eigen::Vector3d& up = Eigen::Vector3d::UnitZ());

// Interpolates from a (share 0) to b (share 1), or extrapolates: translation linearly, rotation about a fixed axis.
Pose interpolate(const Pose& a, const Pose& b, double share);

// Evaluates the Catmull-Rom segment between p[1] and p[2] at knot value `at` (Barry and Goldman 1988).
Pose catmull_rom(const Pose p[4], const double knot[4], double at);

// Samples `count` poses at equal steps along a centripetal Catmull-Rom curve through the waypoints, evaluated with
// Barry and Goldman's pyramid of `interpolate` calls. Step length is translation plus `turn_m_per_rad` times rotation.
// Requires at least two waypoints; the last view of a closed curve coincides with the first.
std::vector<Pose> sample_spline(const std::vector<Pose>& waypoints, int count, bool closed,
                                double turn_m_per_rad = 0.5);

struct Orbit {
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();  // target point
  double radius = 1, height = 0;                     // of the camera, around and above the centre
  double from = 0, to = 0;                           // angles about world z, measured from world x
  int count = 2;
};
// Returns world_from_camera at `count` equal angular steps from `from` to `to`, both included.
std::vector<Pose> orbit_route(const Orbit& orbit);

struct RandomWalk {
  Pose start;
  int count = 2;
  Eigen::Vector3d step = Eigen::Vector3d::Zero();  // standard deviation of a step along the world axes
  Eigen::Vector3d turn = Eigen::Vector3d::Zero();  // standard deviation of a rotation step about the start pose's axes
  Eigen::Vector3d low = Eigen::Vector3d::Zero(), high = Eigen::Vector3d::Zero();  // position bounds
  double max_turn = 0;                                                            // bound on each accumulated angle
};
// Generates a random walk, starting at `start`, that is reflected at the bounds on position and accumulated rotation.
std::vector<Pose> random_walk(const RandomWalk& walk, uint64_t seed);

// Reflects a coordinate back into [low, high].
double reflected(double value, double low, double high);

}  // namespace fringeslam::sim
