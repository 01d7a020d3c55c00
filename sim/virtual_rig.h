// SPDX-License-Identifier: Apache-2.0
// The rig in the simulated world: implements Rig, and hands the truth of each view to a sink that the
// pipeline never sees.
#pragma once

#include <functional>
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
    v.field("samples_per_pixel", samples_per_pixel, {1, 256}, "rays a pixel: 1, 4 or another square number");
    v.field("noise", noise, "shot and dark noise of the camera");
    v.field("quantise", quantise, "grey values of the camera's bits; off: float images");
    effects.describe(v);
  }
  // Throws Error when out of range.
  void check() const;
};

using TruthSink = std::function<void(const TruthFrame&)>;

// The images of a stack are taken at the camera's rate, about the time of the pose; that is also the truth's.
class VirtualRig : public Rig {
 public:
  VirtualRig(const Scene& scene, const RenderOptions& options, TruthSink truth = {});
  const RigModel& model() const override { return calibration_; }
  std::optional<FringeStack> capture(const PatternSequence& sequence) override;
  // What is true of the view from pose `pose` of the trajectory, as the sink gets it but for fringe orders. No image is
  // rendered.
  TruthFrame truth_of(size_t pose) const;
  // One image from pose `pose` of the trajectory, exposed for exposure_s, while the projector shows `screen` (8 bits,
  // of its size). `number` keys the noise.
  cv::Mat look(const cv::Mat1b& screen, size_t pose, double exposure_s, int number);

 private:
  BlurRange blur_range() const;
  // The patterns as light: all at once, or each alone when the robot moves between them.
  const std::vector<ShownPatterns>& shown(const PatternSequence& sequence);
  // Poses of the camera while image `image` of `images` is exposed.
  std::vector<Pose> camera_poses(const TimedPose& pose, int image, int images) const;
  std::vector<cv::Mat1f> light(const PatternSequence& sequence, const TimedPose& pose, TruthFrame* truth);
  void note_thermal(TruthFrame& truth) const;
  bool moving() const { return options_.effects.motion && !scene_.motion.still(); }

  const Scene& scene_;
  RigModel calibration_;
  RenderOptions options_;
  TruthSink truth_;
  Renderer renderer_;
  Camera camera_;
  std::optional<SampleRays> thermal_rays_;
  PatternSequence shown_sequence_;
  std::vector<ShownPatterns> shown_;
  size_t next_ = 0;
};

// Writes truth/000000.exr … (core/types/truth.h) into an existing folder.
void write_truth(const TruthFrame& truth, const std::filesystem::path& folder);

}  // namespace fringeslam::sim
