// SPDX-License-Identifier: Apache-2.0
#include "core/mapper/image_trajectory.h"

namespace fringeslam {

namespace {

struct PoseEstimate {
  Pose world_from_camera;
  Matrix6d covariance;  // tangent of retract()
};

// Covariance of a view's registration in world axes; that of the result is in the axes of the keyframe.
Matrix6d covariance_in_world(const FrameResult& view, const Mapper& mapper) {
  if (view.reference < 0) return view.covariance;
  const Pose& keyframe = mapper.map().keyframes()[static_cast<size_t>(view.reference)].world_from_camera;
  return rotated_covariance(keyframe.rotation, view.covariance);
}

// Pose at a time after a view's reference time, from its registration and its motion, which is known.
PoseEstimate pose_during(const FrameResult& view, const Mapper& mapper, double after_s) {
  const Pose at_view = mapper.world_from_camera(view.view);
  const Matrix6d turn = rotated_tangent(at_view.rotation);
  Eigen::Matrix<double, 6, 12> by_motion;
  by_motion << after_s * turn, 0.5 * after_s * after_s * turn;
  return {at_view * view.motion->motion.at(after_s),
          covariance_in_world(view, mapper) + by_motion * view.motion->covariance * by_motion.transpose()};
}

}  // namespace

ImageTrajectory::ImageTrajectory(const RigModel& rig, const PatternSequence& sequence,
                                 const ImageTrackerOptions& options)
    : tracker_(rig, sequence, options), camera_from_robot_(rig.robot_from_camera.inverse()) {}

void ImageTrajectory::add(const FringeStack& stack, const FrameResult& result, const Mapper& mapper) {
  if (reference_view_ >= 0) {
    // A correction of the map moves the reference.
    const Pose now = mapper.world_from_frame(reference_view_);
    if (now.rotation != world_from_reference_.rotation || now.translation != world_from_reference_.translation)
      tracker_.move(now * world_from_reference_.inverse());
    world_from_reference_ = now;
  }
  std::vector<TrackedImage> tracked(stack.images.size());
  for (size_t k = 0; k < stack.images.size(); ++k) {
    ImageOfRun image;
    image.stack = stack.index;
    image.image = static_cast<int>(k);
    image.timestamp_s = stack.exposure_time_s[k];
    if (tracker_.predict(image.timestamp_s)) {
      const TrackedImage& found = tracked[k] =
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
  if (result.view >= 0 && result.motion && result.motion->converged) {
    for (size_t k = 0; k < tracked.size(); ++k) {
      const PoseEstimate of_view = pose_during(result, mapper, stack.exposure_time_s[k] - stack.timestamp_s);
      tracker_.compare(tracked[k], of_view.world_from_camera, of_view.covariance);
    }
  }
  const bool decoded_from_fringes = !result.decoded.mean.empty() && result.decoded.finest_period_px > 0;
  if (result.view < 0 || !decoded_from_fringes) return;
  const ImageReference reference = image_reference(result, stack);
  if (!result.complete && !tracker_.should_replace_reference(reference)) return;
  std::optional<MotionPrior> motion;
  if (result.motion && result.motion->converged) motion = MotionPrior{result.motion->motion, result.motion->covariance};
  reference_view_ = result.view;
  world_from_reference_ = mapper.world_from_frame(result.view);
  tracker_.set_reference(reference, world_from_reference_, covariance_in_world(result, mapper), stack.timestamp_s,
                         motion);
}

Trajectory ImageTrajectory::trajectory(const Mapper& mapper) const {
  Trajectory poses;
  for (const ImageOfRun& image : images_) {
    if (!image.tracked) continue;
    poses.push_back(
        {image.timestamp_s, mapper.world_from_frame(image.view) * image.reference_from_camera * camera_from_robot_});
  }
  return poses;
}

}  // namespace fringeslam
