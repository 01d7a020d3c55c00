// SPDX-License-Identifier: Apache-2.0
// Simulated rig: implements Rig by rendering a scene. The ground truth of a view is a value beside its stack, which the
// pipeline does not accept.
#pragma once

#include <optional>

#include "core/rig/rig.h"
#include "core/types/options.h"
#include "core/types/truth.h"
#include "sim/light/camera.h"
#include "sim/light/renderer.h"
#include "sim/light/sample_rays.h"
#include "sim/scene/scene.h"

namespace fringeslam::sim {

struct RenderOptions {
  int samples_per_pixel = 4;
  bool noise = true;
  bool quantise = true;
  Effects effects = {};

  template <class Visitor>
  void describe(Visitor& v) {
    v.field("samples_per_pixel", samples_per_pixel, {1, 256}, "rays per pixel; must be a square number (1, 4, 9, ...)");
    v.field("noise", noise, "shot and dark noise of the camera, NETD of the thermal camera");
    v.field("quantise", quantise, "quantise images to the camera's bit depth; off: float images");
    effects.describe(v);
  }
  // Throws Error if an option is out of range.
  void check() const;
};

struct SimulatedView {
  FringeStack stack;
  TruthFrame truth;
};

// Returns the range of blur at the distances of the rig's scenes, beyond which it is clamped.
BlurRange blur_range(const RigModel& rig, const Effects& effects);

// The images of a stack are exposed at the camera's frame rate; the ground truth refers to the stack's reference time.
// Without a continuous path, each trajectory pose is the reference of one stack. Along a path, the rig runs on its own
// clock: the first exposure slot starts at time 0, and the patterns of each stack follow those of the last one without
// pause, or in the pace of the scene's view rate.
class VirtualRig : public Rig {
 public:
  VirtualRig(const Scene& scene, const RenderOptions& options);
  const RigModel& model() const override { return calibration_; }
  // Renders the next stack, without ground truth; empty after the last pose or at the end of the path. Throws Error if
  // the camera cannot take the images of a stack at the scene's view rate.
  std::optional<FringeStack> capture(const PatternSequence& sequence) override;
  // Like capture(), with the ground truth of the view.
  std::optional<SimulatedView> simulate(const PatternSequence& sequence);
  // Returns the ground truth of the view from trajectory pose `pose`, without fringe orders and without rendering
  // images.
  TruthFrame truth_of(size_t pose) const;
  // Returns one image from trajectory pose `pose`, exposed for exposure_s while the projector shows `screen` (8 bits);
  // `number` keys the noise. Throws Error if the screen differs from the projector's resolution.
  cv::Mat look(const cv::Mat1b& screen, size_t pose, double exposure_s, int number);

 private:
  // Returns the patterns as projected light: one set, or one per pattern if the robot moves during a stack.
  const std::vector<ProjectedPatterns>& shown(const PatternSequence& sequence);
  // Returns the reference pose and exposure times of the next stack; empty at the end.
  struct Schedule {
    TimedPose reference;
    std::vector<double> exposure_time_s;
  };
  std::optional<Schedule> schedule(const PatternSequence& sequence) const;
  Pose robot_at(const TimedPose& reference, double time_s) const;
  // Returns the camera poses during an exposure.
  std::vector<Pose> camera_poses(const TimedPose& reference, double middle_s, double exposure_s) const;
  // `truth` may be null.
  std::optional<FringeStack> next_stack(const PatternSequence& sequence, TruthFrame* truth);
  // Renders the images of a stack as electrons per second; those of a moving robot are blurred over `exposure_s`.
  std::vector<cv::Mat1f> light(const PatternSequence& sequence, const Schedule& when, double exposure_s,
                               TruthFrame* truth);
  TruthFrame truth_at(const TimedPose& pose, int index) const;
  void note_thermal(TruthFrame& truth) const;
  bool moving() const { return options_.effects.motion && scene_.moves_while_capturing(); }

  const Scene& scene_;
  RigModel calibration_;
  RenderOptions options_;
  Renderer renderer_;
  Camera camera_;
  std::optional<SampleRays> thermal_rays_;
  PatternSequence shown_sequence_;
  std::vector<ProjectedPatterns> shown_;
  size_t next_ = 0;
  double clock_s_ = 0;  // along a path: start of the next exposure slot
};

// Writes the ground truth of one view as <index>.exr (channels: core/types/truth.h) into an existing folder.
void write_truth(const TruthFrame& truth, const std::filesystem::path& folder);

}  // namespace fringeslam::sim
