// SPDX-License-Identifier: Apache-2.0
#include "core/mapper/image_trajectory.h"

namespace fringeslam {

ImageTrajectory::ImageTrajectory(const RigModel& rig, const PatternSequence& sequence,
                                 const ImageTrackerOptions& options)
    : tracker_(rig, sequence, options), camera_from_robot_(rig.robot_from_camera.inverse()) {}

void ImageTrajectory::add(const FringeStack& stack, const FrameResult& result, const Mapper& mapper) {
  for (size_t k = 0; k < stack.images.size(); ++k) {
    ImageOfRun image;
    image.stack = stack.index;
    image.image = static_cast<int>(k);
    image.timestamp_s = stack.exposure_time_s[k];
    if (tracker_.predict(image.timestamp_s)) {
      const TrackedImage found =
          tracker_.track(stack.images[k], stack.patterns.patterns[k], image.timestamp_s, stack.patterns.patterns);
      image.tracked = found.tracked;
      image.as_expected = found.as_expected;
      if (!found.as_expected) image.shown = found.shown;
      if (found.tracked) {
        image.view = reference_view_;
        image.reference_from_camera = world_from_reference_.inverse() * found.world_from_camera;
        image.covariance = found.covariance;
      }
    }
    images_.push_back(image);
  }
  const bool decoded_from_fringes = !result.decoded.mean.empty() && result.decoded.finest_period_px > 0;
  if (result.view < 0 || !decoded_from_fringes) return;
  const ImageReference reference = image_reference(result, stack);
  if (!result.complete && !tracker_.should_replace_reference(reference)) return;
  std::optional<MotionPrior> motion;
  if (result.motion && result.motion->converged) motion = MotionPrior{result.motion->motion, result.motion->covariance};
  reference_view_ = result.view;
  world_from_reference_ = mapper.world_from_camera(result.view);
  tracker_.set_reference(reference, world_from_reference_, result.covariance, stack.timestamp_s, motion);
}

Trajectory ImageTrajectory::trajectory(const Mapper& mapper) const {
  Trajectory poses;
  for (const ImageOfRun& image : images_) {
    if (!image.tracked) continue;
    poses.push_back(
        {image.timestamp_s, mapper.world_from_camera(image.view) * image.reference_from_camera * camera_from_robot_});
  }
  return poses;
}

}  // namespace fringeslam
