// SPDX-License-Identifier: Apache-2.0
// Where a camera or a robot goes: poses in the world's frame, one a view. Lengths in m, angles in rad.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "core/types/pose.h"

namespace fringeslam::sim {

// world_from_camera of a camera at `eye` with `target` on its axis (z), its image upright (y down along -up); where the
// axis is parallel to `up`, the image's top is towards world x. Throws Error when eye and target coincide.
Pose looking_at(const Eigen::Vector3d& eye, const Eigen::Vector3d& target,
                const Eigen::Vector3d& up = Eigen::Vector3d::UnitZ());

// On the way from a (0) to b (1) and beyond: translations on a line, rotations about one axis.
Pose interpolate(const Pose& a, const Pose& b, double share);

// Poses at even steps along a smooth curve through the waypoints (Catmull-Rom by Barry and Goldman's pyramid, which
// needs no more than `interpolate`; centripetal knots). A step is measured as its translation plus `turn_m_per_rad`
// times its rotation. At least two waypoints; a closed curve returns to the first, where the last view is again.
std::vector<Pose> spline_route(const std::vector<Pose>& waypoints, int count, bool closed, double turn_m_per_rad = 0.5);

struct Orbit {
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();  // looked at
  double radius = 1, height = 0;                     // of the eye about the centre and above it
  double from = 0, to = 0;                           // about the world's z, from its x axis
  int count = 2;
};
// world_from_camera, from `from` to `to`, both included.
std::vector<Pose> orbit_route(const Orbit& orbit);

struct RandomWalk {
  Pose start;
  int count = 2;
  Eigen::Vector3d step = Eigen::Vector3d::Zero();  // standard deviation of a step along the world's axes
  Eigen::Vector3d turn = Eigen::Vector3d::Zero();  // and of a turn about the start's axes
  Eigen::Vector3d low = Eigen::Vector3d::Zero(), high = Eigen::Vector3d::Zero();  // bounds of the position
  double max_turn = 0;                                                            // of each turn's sum
};
// A walk that bounces off its bounds, of the position and of the turns' sum; the start is the first.
std::vector<Pose> random_walk(const RandomWalk& walk, uint64_t seed);

// A coordinate folded back into [low, high] as a ball between two walls is.
double reflected(double value, double low, double high);

}  // namespace fringeslam::sim
