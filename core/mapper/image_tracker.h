// SPDX-License-Identifier: Apache-2.0
// Poses at camera rate: each image is compared with its prediction from a reference view
// (core/registration/image_pose.h), starting from the pose that constant velocity predicts (docs/method.md, section 9.5).
//
// The filter's state is the pose world_from_camera, its rate of change in the tangent of retract(), and the covariance of
// both. Accelerations are white noise. What all images of a reference have in common, the error of its pose and the
// systematic part of theirs, is kept apart, because it does not average out. The registered poses of later views determine
// the error of the motion that the reference was decoded with, which is the largest part.
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "core/mapper/front_end.h"
#include "core/registration/image_pose.h"
#include "core/types/camera_motion.h"
#include "core/types/fringe_stack.h"

namespace fringeslam {

struct ImageTrackerOptions {
  int stride = 1;
  double acceleration_m_s2 = 0.5, turn_rad_s2 = 1;
  double max_rms_sigma = 1.6, max_distance = 0.15;
  double max_gap_s = 0.15;

  template <class Visitor>
  void describe(Visitor& v) {
    v.field("stride", stride, {1, 16}, "every stride-th pixel of the reference in each direction is used");
    v.field("acceleration_m_s2", acceleration_m_s2, {0, 100},
            "acceleration between two images, standard deviation, m/s2");
    v.field("turn_rad_s2", turn_rad_s2, {0, 1000},
            "angular acceleration between two images, standard deviation, rad/s2");
    v.field("max_rms_sigma", max_rms_sigma, {1, 100}, "residuals beyond which the reference is to be replaced, sigmas");
    v.field("max_distance", max_distance, {0, 10},
            "distance from the reference beyond which it is to be replaced, relative to the middle of the rig's range");
    v.field("max_gap_s", max_gap_s, {0, 10},
            "longest time without a pose after which velocity still predicts the next, s");
  }
};

// The camera's predicted pose at a time, and its motion about that time.
struct CameraPrediction {
  Pose world_from_camera;
  Matrix6d covariance = Matrix6d::Zero();  // tangent of retract()
  MotionPrior motion;                      // of a stack with this reference time
};

struct TrackedImage {
  double timestamp_s = 0;
  bool tracked = false;  // false: no pose
  Pose world_from_camera;
  Matrix6d covariance = Matrix6d::Zero();  // tangent of retract(); includes that of the reference
  ImagePose relative;                      // to the reference, given the prediction, without corrections
  // The pattern that the image shows: the expected one, or another one of the sequence. Empty: none of them.
  std::optional<Pattern> shown;
  bool as_expected = false;
};

// Returns what single images are compared with: the view of a stack with known motion, from its finest fringes along the
// columns. Throws Error if the view was not decoded from fringes.
ImageReference image_reference(const ReconstructedView& view, const FringeStack& stack);

class ImageTracker {
 public:
  // `sequence` holds all patterns that an image may show. Throws Error if an option is out of range.
  ImageTracker(const RigModel& rig, const PatternSequence& sequence, const ImageTrackerOptions& options = {});

  // Compares the following images with this view, taken at `timestamp_s` from `world_from_camera` with `covariance`
  // (tangent of retract()). `motion`, if known, is the motion about that time; it starts the filter unless the filter
  // runs already.
  void set_reference(const ImageReference& reference, const Pose& world_from_camera, const Matrix6d& covariance,
                     double timestamp_s, const std::optional<MotionPrior>& motion);

  // Moves the reference and the filter with the map, which was corrected.
  void move(const Pose& new_from_old);

  // True if there is no reference, or if it no longer explains the images well or lies far behind: the next view should
  // replace it.
  bool needs_reference() const;

  // True if the motion of this view is known better than the reference's by a factor of two, or if a reference is needed.
  // An error of the reference's motion shifts all poses relative to it.
  bool should_replace_reference(const ImageReference& view) const;

  // Tracks the image that was exposed at `time_s` (middle) while `expected` should have been shown. An image that shows
  // another pattern of the sequence, or of those that were `requested` for the same stack, is tracked with that one.
  // Images have to come in the order of their times. Images without a model are not tracked (has_image_model()).
  TrackedImage track(const cv::Mat& image, const Pattern& expected, double time_s,
                     const std::vector<Pattern>& requested = {});

  // Corrects the images that follow by the pose world_from_camera of an image that was tracked, known from elsewhere with
  // `covariance` (tangent of retract()): it determines the error of the reference's motion, which all images share.
  void compare(const TrackedImage& image, const Pose& world_from_camera, const Matrix6d& covariance);

  // Predicts the pose and the motion at a time, which may be slightly in the past. Empty without a reference, or if the
  // last pose is too old.
  std::optional<CameraPrediction> predict(double time_s) const;

 private:
  struct State {
    double time_s = 0;
    Pose world_from_camera;
    Vector6d rate = Vector6d::Zero();
    Matrix12d covariance = Matrix12d::Zero();  // of pose and rate, without what the images have in common
  };
  State at(double time_s) const;
  // Variance of the apparent motion at the middle of the range, m2/s2.
  double speed_variance(const ImageReference& reference) const;
  void correct(State state, const ImagePose& found);

  RigModel rig_;
  PatternSequence sequence_;
  ImageTrackerOptions options_;
  std::shared_ptr<const ImagePoseEstimator> estimator_;
  Pose world_from_reference_;
  Matrix6d reference_covariance_ = Matrix6d::Zero();  // of the reference's pose
  double reference_speed_variance_ = 0;
  // Error of the motion that the reference was decoded with, as far as comparisons determine it.
  Vector12d motion_error_ = Vector12d::Zero();
  Matrix12d motion_error_covariance_ = Matrix12d::Zero();
  Matrix6d common_ = Matrix6d::Zero();  // of the last image, in the world
  std::optional<State> state_;
  ImagePose last_;  // relative to the reference
};

// Returns the index of the first image of a stack that does not show its pattern, for instance because an image was
// dropped or repeated. Empty if all agree, or if the tracker has no prediction to compare with.
std::optional<size_t> first_inconsistent_image(ImageTracker tracker, const FringeStack& stack);

}  // namespace fringeslam
