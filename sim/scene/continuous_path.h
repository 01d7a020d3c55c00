// SPDX-License-Identifier: Apache-2.0
// Continuous-time trajectory of a robot: a cubic B-spline on SO(3) x R^3 through time, with optional vibration
// (docs/method.md, section 12.4). Position and rotation are C^2 in time.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "core/types/trajectory.h"

namespace fringeslam::sim {

// Speed profile along a route.
struct Travel {
  double speed_m_s = 0.3;
  double max_rad_s = 1;  // turn rate; slows the robot down where it turns faster
  // Bound on the acceleration, along and across the path; slows the robot down in tight curves. Angular accelerations are
  // bounded by acceleration_m_s2 max_rad_s / speed_m_s.
  double acceleration_m_s2 = 0.5;
  bool from_rest = false;         // false: the robot moves at full speed from the first image on
  double move_s = 0, stop_s = 0;  // stop and go: alternate moving and standing; 0: never stop
};

// Sum of harmonics with random phases and directions, band-limited to [low_hz, high_hz].
struct Vibration {
  double amplitude_m = 0, amplitude_rad = 0;  // root mean square over time, of the whole vector
  double low_hz = 10, high_hz = 30;
};

class ContinuousPath {
 public:
  // Cubic B-spline with control poses at knots `knot_s` apart, the first at time 0. Throws Error with fewer than two
  // control poses.
  ContinuousPath(std::vector<Pose> controls, double knot_s, const Vibration& vibration, uint64_t seed);

  double duration_s() const;
  // world_from_robot; before 0 and after duration_s() the path continues at the velocity of its ends.
  Pose at(double time_s) const;

 private:
  struct Harmonic {
    double rad_s = 0, phase_rad = 0;
    Eigen::Vector3d shift_m = Eigen::Vector3d::Zero(), turn_rad = Eigen::Vector3d::Zero();
  };

  Pose control(long index) const;

  std::vector<Pose> controls_;
  double knot_s_;
  std::vector<Harmonic> harmonics_;
};

// Poses at equal time steps of `step_s` along a densely sampled smooth route that is travelled with the given speed
// profile, at full speed from the start unless `travel` says otherwise. The last pose lies up to a step beyond the end of
// the route, which the robot passes at its speed. Throws Error if all poses are the same.
std::vector<Pose> travelled(const std::vector<Pose>& route, const Travel& travel, double step_s);

// Poses at equal time steps along timed poses, interpolated by Catmull-Rom splines in time; the last one lies less than a
// step beyond the end, at the velocity there.
std::vector<Pose> resampled(const Trajectory& timed, double step_s);

}  // namespace fringeslam::sim
