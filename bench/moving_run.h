// SPDX-License-Identifier: Apache-2.0
// A run of the pipeline on a robot that moves continuously, scored view by view against ground truth.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "core/mapper/pipeline.h"
#include "sim/virtual_rig.h"

namespace fringeslam::bench {

// One view: its depth, and its pose relative to the keyframe that it was registered with.
struct MovingView {
  double time_s = 0;
  Tracking tracking = Tracking::lost;
  int images = 0;
  bool keyframe = false;
  bool has_pose = false;  // registered with a keyframe; the following fields are set
  double baseline_m = 0;  // distance of the camera from that of the keyframe
  double off_m = 0;       // largest displacement of points of the view (core/score/pose_honesty.h)
  double sigmas = 0;      // Mahalanobis distance of the pose error; its square is the NEES
  bool confidently_wrong = false;
  double over_bound = NAN;    // error relative to the Cramer-Rao bound; NaN unless requested
  double depth_m = NAN;       // median absolute depth error; NaN if no pixel was reconstructed
  double depth_sigmas = NAN;  // median of |error| / sigma: 0.67 if the sigmas are right
  double velocity_m_s = NAN;  // error of the velocity and of the turn rate; NaN if they were not estimated
  double angular_rad_s = NAN;
};

struct MovingRun {
  std::vector<MovingView> views;
  double ate_m = INFINITY;  // of all tracked views, by the final map; infinite if there are none

  int lost() const;
  // Views registered from a predicted pose, keyframes excluded.
  std::vector<const MovingView*> tracked() const;
};

struct MovingRunOptions {
  int most_views = 1'000'000;
  bool predicted = true;  // three images a view once the robot is tracked
  bool bound = false;     // compute over_bound
  sim::RenderOptions render;
  PipelineOptions pipeline = {};
  // Called before each stack is processed; may drop or damage it. Returns false to skip the stack.
  std::function<bool(FringeStack&)> disturb = {};
};

// Runs the scene, whose path must be set, to its end.
MovingRun moving_run(const sim::Scene& scene, const MovingRunOptions& options);

// A scene whose camera passes through the scene's first pose at half time with constant velocity, in the axes of the
// camera there.
sim::Scene scene_with_constant_motion(const std::string& name, uint64_t seed, const Eigen::Vector3d& velocity_m_s,
                                      const Eigen::Vector3d& angular_rad_s, double duration_s, double view_rate_hz);

// A scene with `trajectory.continuous` and other keys changed.
sim::Scene scene_with(const std::string& name, uint64_t seed,
                      const std::vector<std::pair<std::string, std::string>>& changes);

}  // namespace fringeslam::bench
