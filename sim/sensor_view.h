// SPDX-License-Identifier: Apache-2.0
// Renders the camera view of a scene from any pose of the robot at rest, reduced and fast or in full: images under
// white light or the scene's patterns, and the ground truth. The full images are those of VirtualRig.
#pragma once

#include <map>
#include <memory>
#include <mutex>
#include <opencv2/core.hpp>
#include <optional>

#include "core/types/fringe_stack.h"
#include "core/types/truth.h"
#include "sim/light/camera.h"
#include "sim/light/renderer.h"
#include "sim/scene/scene.h"

namespace fringeslam::sim {

// Returns the rig with its camera's resolution changed to `size`; field of view, lens and mean exposure of a pixel stay
// the same.
RigModel with_camera_size(const RigModel& rig, const cv::Size& size);

// True if light reaches surfaces by others or from below.
bool has_indirect_light(const Scene& scene);

// Returns the pattern that lights all projector pixels.
Pattern white_pattern();

class SensorView {
 public:
  static constexpr int kReduction = 4;  // ratio of width and height between full and reduced images

  // `scene` must outlive this. Throws Error if a texture cannot be read.
  explicit SensorView(const Scene& scene);
  SensorView(const SensorView&) = delete;
  SensorView& operator=(const SensorView&) = delete;

  // Returns the camera's image, CV_8U or CV_16U grey values, under pattern number `pattern` of the scene, or without
  // one under white light. Reduced images have no noise and fewer light paths. Empty if `stop` returned true
  // meanwhile. Throws std::out_of_range if the scene has no such pattern.
  cv::Mat image(const Pose& world_from_robot, std::optional<size_t> pattern, bool reduced, const Stop& stop = nullptr);
  // Returns the ground truth of a view, without time and fringe orders. All its images are empty if `stop` returned true
  // meanwhile.
  TruthFrame truth(const Pose& world_from_robot, bool reduced, const Stop& stop = nullptr) const;
  // Returns the share of the projector's white light that reaches a pixel by other surfaces or from below its own, 0 to 1;
  // NaN without light. Empty if the scene has no such light, or if `stop` returned true meanwhile.
  cv::Mat1f indirect_share(const Pose& world_from_robot, bool reduced, const Stop& stop = nullptr);
  // A stack of reduced images under all patterns, without noise, and its ground truth without time and fringe orders. Its
  // pixels are as small as those of the full images, of which they are a sample, so that small surfaces keep their share; the lens
  // does not blur them.
  struct Stack {
    FringeStack stack;
    TruthFrame truth;
  };
  // Empty if `stop` returned true meanwhile.
  std::optional<Stack> stack(const TimedPose& pose, const Stop& stop = nullptr);
  // The rig with the camera of the reduced images.
  const RigModel& reduced_rig() const { return reduced_scene_.rig; }

 private:
  std::shared_ptr<const ProjectedPatterns> shown(std::optional<size_t> pattern);
  // Returns the exposure time of a pattern, whose own factor is 1; `brightest` is the light of the brightest image.
  double exposure_s(const Camera& camera, const cv::Mat1f& brightest) const;

  const Scene& scene_;
  Scene reduced_scene_;
  Renderer full_, reduced_, sampled_;
  Camera full_camera_, reduced_camera_;
  // The light of white alone and of the most recent pattern, followed by white.
  std::mutex mutex_;
  std::map<std::optional<size_t>, std::shared_ptr<const ProjectedPatterns>> shown_;
  std::shared_ptr<const ProjectedPatterns> all_shown_;  // all patterns
};

}  // namespace fringeslam::sim
