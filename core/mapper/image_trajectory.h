// SPDX-License-Identifier: Apache-2.0
// Observer: the pose at every image of a run, by ImageTracker (docs/method.md, section 9.5).
#pragma once

#include <optional>
#include <vector>

#include "core/mapper/image_tracker.h"
#include "core/mapper/mapper.h"

namespace fringeslam {

// One image of a stack.
struct ImageOfRun {
  int stack = 0, image = 0;    // FringeStack::index, and the position within the stack
  double timestamp_s = 0;      // middle of the exposure
  bool tracked = false;        // false: the following three fields are not set
  int view = -1;               // reference, a position among the tracked views
  Pose reference_from_camera;  // in the axes of the reference's frame, Mapper::world_from_frame()
  Matrix6d covariance =
      Matrix6d::Zero();          // of the camera relative to the map near it, world axes, tangent of retract()
  bool as_expected = true;       // false: contradicts the pattern that it should show
  std::optional<Pattern> shown;  // if it contradicts: the pattern that explains it
};

class ImageTrajectory {
 public:
  // Throws Error if an option is out of range.
  ImageTrajectory(const RigModel& rig, const PatternSequence& sequence, const ImageTrackerOptions& options = {});

  // Tracks the images of a stack that `mapper` has just processed with `result`; then compares later images with its view,
  // if its motion is known better or the images need another reference. Images before the first view have no pose.
  void add(const FringeStack& stack, const FrameResult& result, const Mapper& mapper);

  const std::vector<ImageOfRun>& images() const { return images_; }
  // Poses of the robot at the tracked images, given the current map.
  Trajectory trajectory(const Mapper& mapper) const;

 private:
  ImageTracker tracker_;
  Pose camera_from_robot_;
  int reference_view_ = -1;
  Pose world_from_reference_;
  std::vector<ImageOfRun> images_;
};

}  // namespace fringeslam
