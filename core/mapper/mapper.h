// SPDX-License-Identifier: Apache-2.0
// The mapper: reconstructed views in, poses and a keyframe map out (docs/method.md, sections 6 to 9). For each view it
// predicts the pose, registers the view with the keyframe that shows most of it (or relocalizes by landmarks), extends
// the map where the view shows something new, and closes loops.
#pragma once

#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/map/keyframe_map.h"
#include "core/mapper/front_end.h"
#include "core/mapper/landmark_finder.h"
#include "core/mapper/motion_predictor.h"
#include "core/mapper/vibration.h"
#include "core/mapper/view_registration.h"
#include "core/registration/motion_registration.h"
#include "core/types/trajectory.h"

namespace fringeslam {

struct MapperOptions {
  LandmarkFinderOptions finder;
  RegistrationOptions registration;
  MappingOptions mapping;
  PoseGraphOptions pose_graph;
};

enum class Tracking {
  first,      // nothing to register with
  followed,   // registered from the predicted pose
  refined,    // relocalized by landmarks, then registered
  landmarks,  // registration did not converge; the pose is that of the landmarks, and depth does not contradict it
  ambiguous,  // several poses explain the view equally well; left out of trajectory and map
  lost        // no pose; left out of trajectory and map
};
std::string to_string(Tracking tracking);
constexpr bool has_pose(Tracking tracking) { return tracking != Tracking::lost && tracking != Tracking::ambiguous; }

struct FrameResult : ReconstructedView {
  Keypoints keypoints;  // empty if landmarks were not searched for
  Landmarks landmarks;
  std::vector<Recognition> recognitions;   // re-identified landmarks of earlier keyframes
  std::vector<KeypointMatch> matches;      // with the reference; empty if the view was followed
  ViewRegistration registration;           // with the reference; its alternatives if the view is ambiguous
  Matrix6d covariance = Matrix6d::Zero();  // of registration.earlier_from_current, tangent of retract()
  Tracking tracking = Tracking::lost;
  bool relocalized = false;      // tracked, after a view without a pose
  bool leaves_keyframe = false;  // shows so much beyond its keyframe that it starts another one
  int view = -1;                 // position among the views tracked immediately; -1: no pose, or recovered later
  int reference = -1;            // keyframe that it was registered with
  int keyframe = -1;             // its own number if it became one
  int unlinked = -1;             // earlier reference that no short path of links joins with this one: a loop to close
  bool in_map = false;           // its surface is part of the map
  double predictable = 1;  // complete views in motion: share of the next view's fringe orders that the map determines
  int images = 0;          // number of images it was decoded from
  int loops = 0;           // earlier keyframes linked with it, besides the reference
  bool corrected = false;  // closing loops moved the map
  bool motion_by_prediction = false;  // the motion during the stack was estimated with a prediction as prior
  Pose previous_from_current;         // camera motion since the previous tracked view
  Pose world_from_robot;              // as estimated when the view was processed; see Mapper::trajectory()
  // Results of earlier views, processed without a pose, which this view allows to be registered.
  std::vector<std::shared_ptr<const FrameResult>> recovered;
};

// A view for the mapper: reconstructed already, or to be reconstructed with what the map predicts of it.
struct MapperInput {
  double timestamp_s = 0;
  std::optional<ReconstructedView> view;
  bool needs_prior = false;     // reconstruct() needs the expected depth
  int images = 0;               // of the stack
  double image_interval_s = 0;  // between them; 0: that of the rig's camera rate
  std::function<ReconstructedView(const ReconstructionPrior&)> reconstruct = {};
  // FrontEnd::depth_slopes() of the view; without it, the motion during the stack is not estimated by registration.
  std::function<std::vector<DepthSlope>(const ReconstructedView&, int stride)> depth_slopes = {};
};

class Mapper {
 public:
  // `world_from_robot` is the pose of the robot at the first view. Throws Error if an option is out of range.
  Mapper(const RigModel& rig, const MapperOptions& options, const Pose& world_from_robot);
  // Continues an existing map, in which the robot must first be relocalized.
  Mapper(KeyframeMap map, const MapperOptions& options);

  FrameResult process(MapperInput input);
  // Registers a frame from any source and adds it to the map.
  FrameResult process(const Frame& frame) { return process({frame.timestamp_s, ReconstructedView{frame, {}, true}}); }

  const KeyframeMap& map() const { return map_; }
  // Robot poses of all tracked views in the order of time, given the current map.
  Trajectory trajectory() const;
  // Returns the depth that the camera is expected to see at a time after the last view if it moves on as it did; empty if
  // that is not predicted.
  std::optional<ExpectedView> expected_at(double timestamp_s) const;
  // Camera pose of a tracked view (FrameResult::view), given the current map.
  Pose world_from_camera(int view) const { return world_from_camera(track_[static_cast<size_t>(view)]); }
  // Returns the pose of the axes of FrameResult::frame in the current map, so that the frame's surface lies on the map's. It
  // differs from world_from_camera() if the first view was reconstructed again with a better estimate of its motion.
  Pose world_from_frame(int view) const;

 private:
  // A tracked view and its pose relative to a keyframe, which moves when loops are closed.
  struct TrackedView {
    double timestamp_s = 0;
    int keyframe = 0;
    Pose keyframe_from_camera;
    int registered_with = -1;                 // keyframe; -1: first view
    PoseVariance variance = {}, shared = {};  // of the pose; `shared` by all views registered with the same keyframe
    // Estimated from the stack without a prediction; null once the view is too old to predict others.
    std::shared_ptr<const StackMotion> own_motion = {};

    std::optional<StackMotion> motion() const { return own_motion ? std::optional(*own_motion) : std::nullopt; }
  };

  // The next view as expected from the last ones.
  struct Prediction {
    Pose world_from_camera;
    Matrix6d covariance;
    MotionPrior motion;
  };

  // How the error of the motion during a stack changes the frame's pose.
  struct FrameMotion {
    Matrix6x12d pose_by_motion = Matrix6x12d::Zero();
    Matrix12d covariance = Matrix12d::Zero();

    // Covariance of the pose that the uncertain motion causes.
    Matrix6d spread() const { return pose_by_motion * covariance * pose_by_motion.transpose(); }
  };

  // The first keyframe, to be re-decoded once later views determine its motion better than its own stack.
  struct FirstKeyframe {
    MapperInput input;
    MotionPrior own;   // estimated from its own stack
    size_t views = 4;  // in the track when it is re-decoded
  };

  // How the pose relative to keyframe `reference` depends on the motion during the stack; -1: not computed yet.
  struct MotionEffect {
    int reference = -1;
    Matrix6x12d pose_by_motion = Matrix6x12d::Zero();
  };

  Pose world_from_camera(const TrackedView& view) const;
  static Prediction with_shared_errors(const MotionPrediction& motion);
  std::optional<Prediction> predict_between(double timestamp_s) const;
  std::optional<Prediction> predict(double timestamp_s) const;
  std::optional<Pose> camera_at_constant_velocity(double timestamp_s) const;
  std::vector<PoseSample> last_samples() const;
  std::vector<PoseSample> last_samples(int registered_with, const PoseVariance& shared) const;
  const Frame& keyframe_image(int keyframe);
  void reconstruct(FrameResult& result, const MapperInput& input, const ReconstructionPrior& prior) const;
  void reconstruct_unless_predicted(FrameResult& result, MapperInput& input,
                                    const std::optional<Prediction>& predicted) const;
  void track(FrameResult& result, const MapperInput& input, std::optional<Prediction> predicted, MotionEffect& effect);
  void find_landmarks(FrameResult& result, bool longer = false) const;
  // True if the landmarks of every view are wanted.
  bool wants_landmarks(const FrameResult& result) const;

  bool moves_on(FrameResult& result, const MapperInput& input);
  MotionPrior motion_like_last(double timestamp_s) const;
  int best_reference(const Frame& frame, const Pose& predicted) const;
  bool follow(FrameResult& result, const Pose& predicted, const Matrix6d& prior = Matrix6d::Zero(),
              double max_error_m = std::numeric_limits<double>::infinity());
  Pose estimate_motion(FrameResult& result, const MapperInput& input, const Prediction& predicted,
                       const ExpectedView* expected, const MotionPrior& prior, MotionEffect& effect);
  void confirm_in_motion(FrameResult& result, const MapperInput& input);
  Prediction corrected(Prediction predicted, const FrameResult& result) const;
  bool follow_in_motion(FrameResult& result, const MapperInput& input, const Prediction& predicted,
                        MotionEffect& effect);
  Prediction registered(const FrameResult& result, const MapperInput& input);
  void fill_fringe_orders(FrameResult& result, const MapperInput& input);
  void follow_again(FrameResult& result, const MapperInput& input, const MotionPrior& prior, MotionEffect& effect);
  bool follow_by_finest(FrameResult& result, const MapperInput& input, const std::optional<Prediction>& predicted,
                        MotionEffect& effect);
  bool follow_by_prediction(FrameResult& result, const MapperInput& input, const Prediction& predicted,
                            MotionEffect& effect);
  bool follow_from(FrameResult& result, const MapperInput& input, const Prediction& from, const MotionPrior& prior,
                   bool motion_is_known, const Matrix6d& information, MotionEffect& effect);
  bool follow_known_motion(FrameResult& result, const MapperInput& input, const Prediction& predicted,
                           MotionEffect& effect);
  double largest_error_m(const Prediction& predicted) const;
  FrameMotion frame_motion(const ReconstructedView& view, const MapperInput& input, const Frame& target,
                           const Pose& target_from_source) const;
  FrameMotion own_motion(const FrameResult& result, const MapperInput& input, const MotionEffect& effect);
  Matrix6d by_motion_of_reference(const FrameResult& result) const;
  void widen_first_motion();
  std::optional<StackMotion> motion_since_last(const FrameResult& result, const Eigen::Matrix3d& axes) const;
  void assume_motion(FrameResult& result) const;
  void assume_first_motion(const FrameResult& result);
  FrameMotion add_motion_uncertainty(FrameResult& result, const MapperInput& input, const MotionEffect& effect);
  void note_first_keyframe(const FrameResult& result, MapperInput input);
  void improve_first_keyframe();
  void hold(MapperInput input);
  bool follow_held_sequence(FrameResult& result, const MapperInput& input, const Prediction& predicted,
                            MotionEffect& effect);
  bool follow_held_view(FrameResult& result, const MapperInput& input, const Prediction& predicted,
                        MotionEffect& effect);
  void recover_held_views(FrameResult& result);
  std::shared_ptr<const FrameResult> recovered(const MapperInput& input);
  bool relocalize(FrameResult& result);
  int unlinked_from(int reference) const;
  Matrix6d with_parallax(const Matrix6d& covariance, const FrameResult& result, const Pose& earlier_from_current) const;
  bool leaves_keyframe(const FrameResult& result, const Pose& world_from_camera, int keyframe) const;
  ExpectedView expected_view(const Pose& world_from_current, const Matrix6d& covariance, bool by_reference) const;

  void restart();
  void extend_map(FrameResult& result, const FrameMotion& motion);
  void add_keyframe(FrameResult& result, TrackedView& here, const FrameMotion& motion);
  int close_loops(const FrameResult& result);
  bool link_with(int keyframe, const FrameResult& result, const std::vector<KeypointMatch>& matches, bool loop);
  // Adds a registration to the map; its covariance accounts for the errors that the links of a keyframe share.
  void link(int from, int to, const Pose& from_from_to, const Matrix6d& covariance, bool loop);
  void note_prediction_error(const FrameResult& result, const Prediction& predicted);
  void note_pose(FrameResult& result);

  RigModel rig_;
  MapperOptions options_;
  LandmarkFinder finder_;
  KeyframeMap map_;
  Pose start_;
  std::vector<TrackedView> track_;
  bool lost_ = false;       // since the last view of track_
  bool corrected_ = false;  // the points of all keyframes, for texture
  Matrix6d prediction_covariance_ = Matrix6d::Zero();
  PoseVariance variance_, shared_variance_;  // of the current view's pose, without vibration that is not certain
  bool prediction_checked_ = false;          // the last view was where it had been predicted
  int image_keyframe_ = -1;                  // whose image keyframe_image_ is
  Frame keyframe_image_;
  Frame last_frame_;  // of the last tracked view
  std::optional<StackMotion> last_motion_;
  bool in_motion_ = false;  // the last stack was exposed in motion
  // Log-likelihood ratio: that a robot whose stacks do not show it moves on during them.
  double evidence_of_motion_ = 0;
  int last_keyframe_ = -1;
  int unlinked_ = -1;           // of the last tracked view, unless it became a keyframe
  size_t continuous_from_ = 0;  // first view of track_ since tracking was last lost
  // Motion of the first keyframe, in its own axes, until another view confirms it. The map contains it widened by the vibration
  // that later views reveal.
  std::optional<FrameMotion> first_motion_;
  // The stack of the first keyframe cannot show its motion, which the next view bounds.
  bool first_is_untested_ = false;
  Vibration vibration_;
  std::optional<FirstKeyframe> first_keyframe_;
  Pose first_new_from_old_;             // movement of the first frame's surface by reconstructing it again
  std::vector<MapperInput> held_;       // the last views without a pose, in the order of time
  std::vector<TrackedView> recovered_;  // views registered later, in any order
};

}  // namespace fringeslam
