// SPDX-License-Identifier: Apache-2.0
// Fringe images in, poses and map out: the stages in their order.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "core/base/stage_clock.h"
#include "core/decode/decode.h"
#include "core/decode/motion.h"
#include "core/depth/depth.h"
#include "core/landmarks/keypoints.h"
#include "core/landmarks/landmarks.h"
#include "core/landmarks/recognition.h"
#include "core/map/keyframe_map.h"
#include "core/map/surface.h"
#include "core/mapper/view_registration.h"
#include "core/thermal/victims.h"
#include "core/types/fringe_stack.h"
#include "core/types/trajectory.h"

namespace fringeslam {

struct PipelineOptions {
  DecodeOptions decode;
  DepthOptions depth;
  KeypointOptions keypoints;
  MatchOptions matching;
  ConditioningOptions conditioning;
  ClusterOptions clusters;
  LandmarkOptions landmarks;
  RecognitionOptions recognition;
  MotionOptions motion;
  IcpOptions icp;
  TrackingOptions tracking;
  MappingOptions mapping;
  PoseGraphOptions pose_graph;
  CloudOptions cloud;
  SurfaceOptions surface;
  ThermalOptions thermal;

  // visit(name, options) for each stage, in order.
  template <class Visit>
  void for_each_stage(Visit&& visit) {
    visit("decode", decode);
    visit("depth", depth);
    visit("keypoints", keypoints);
    visit("matching", matching);
    visit("conditioning", conditioning);
    visit("clusters", clusters);
    visit("landmarks", landmarks);
    visit("recognition", recognition);
    visit("motion", motion);
    visit("icp", icp);
    visit("tracking", tracking);
    visit("mapping", mapping);
    visit("pose_graph", pose_graph);
    visit("cloud", cloud);
    visit("surface", surface);
    visit("thermal", thermal);
  }
};

enum class Tracking {
  first,      // nothing to register against
  followed,   // ICP from where constant velocity let expect it
  refined,    // landmarks, then ICP
  landmarks,  // ICP did not settle; the pose is the landmarks'
  lost        // no pose; the frame is left out of trajectory and map
};
std::string to_string(Tracking tracking);

struct FrameResult {
  DecodedStack decoded;
  Frame frame;
  Keypoints keypoints;  // where landmarks were looked for
  Landmarks landmarks;
  LandmarkStages landmark_stages;
  std::vector<Recognition> recognitions;  // of landmarks of earlier views, by the number of their keyframe
  std::vector<KeypointMatch> matches;     // with the reference; none where it was followed
  ViewRegistration registration;          // with the reference
  Tracking tracking = Tracking::lost;
  bool found_again = false;                // tracked, after one that was lost
  int reference = -1;                      // keyframe
  int keyframe = -1;                       // its own number where it became one
  bool in_map = false;                     // it shows enough that is new
  int images = 0;                          // that it was decoded from
  int loops = 0;                           // earlier keyframes that it was linked with then, beside the reference
  bool corrected = false;                  // by which the map moved
  Pose previous_from_current;              // camera motion since the last tracked frame
  Matrix6d covariance = Matrix6d::Zero();  // of the camera's motion since the reference
  WarmView warm;                           // without a thermal image nothing
  Pose world_from_robot;                   // as known when it was processed; see Pipeline::trajectory()
};

// What one stack tells without the map.
struct SeenStack {
  FringeStack stack;
  // Empty where images are only understood by the map, or by the robot's velocity.
  std::optional<DecodedStack> decoded;
  Frame frame;
};

class Pipeline {
 public:
  // `start`: where the robot is when the first stack is taken.
  Pipeline(const RigModel& rig, const PatternSequence& sequence, const PipelineOptions& options, const Pose& start);
  // Goes on in a map; the robot has to be found in it.
  Pipeline(KeyframeMap map, const PatternSequence& sequence, const PipelineOptions& options);

  // What to project next: all patterns, or with `predicted` unwrapping the finest fringes alone where the map tells the
  // fringe orders.
  const PatternSequence& next_patterns() const { return wants_all_ ? sequence_ : finest_; }

  // The stack's images are those of the whole sequence, or of the finest fringes. Throws Error when they are neither.
  FrameResult process(const FringeStack& stack) { return process(see_ahead(stack, clock_)); }
  // The same in two steps. The first may run in another thread while the second is at the stack before, and the result
  // is that of one after the other; `clock`, if any, has to be that thread's own.
  SeenStack see_ahead(FringeStack stack, StageClock* clock = nullptr) const;
  FrameResult process(SeenStack seen);
  // Whether what to project next is known before the stack at hand is processed.
  bool knows_patterns_ahead() const { return options_.decode.unwrapping != "predicted"; }
  // Tells `clock` from now on which stage is at work; it has to outlive the pipeline.
  void time_stages(StageClock& clock) { clock_ = &clock; }

  // The last tracked frame; empty before the first.
  const std::optional<FrameResult>& last_tracked() const { return last_; }
  const KeyframeMap& map() const { return map_; }
  // Of all frames of the map where they are now known to be. It is fused when it is asked for: a loop closure moves
  // nearly every frame by more than its noise, so that most of what was fused before one is of no use after it.
  SurfaceModel surface() const { return surface_of(map_, options_.surface); }
  // Of all tracked frames, in the order of their stacks, by what is known now.
  Trajectory trajectory() const;
  // Warm things, victims among them, by what is known now.
  std::vector<WarmThing> warm_things() const;

 private:
  // A tracked frame and where it is, whatever becomes of its keyframe.
  struct Located {
    double timestamp_s = 0;
    int keyframe = 0;
    Pose keyframe_from_camera;
  };

  RegistrationOptions registration_options() const {
    return {options_.matching, options_.motion, options_.icp, options_.tracking};
  }
  Pose world_from_camera(const Located& located) const;
  std::optional<Pose> predicted_camera(double timestamp_s) const;
  const Frame& reference_image(int keyframe);

  std::pair<DecodedStack, Frame> see(const FringeStack& stack, const ExpectedCoordinate* expected,
                                     StageClock* clock) const;
  void see(FrameResult& result, const FringeStack& stack, const ExpectedCoordinate* expected) const {
    std::tie(result.decoded, result.frame) = see(stack, expected, clock_);
  }
  bool see_by_prediction(FrameResult& result, const FringeStack& stack, const Pose& predicted);
  ExpectedCoordinate expected(const Pose& world_from_current, const Matrix6d& covariance, bool by_reference);
  void note_innovation(const Pose& predicted, const Pose& found);
  void plan_next(const FrameResult& result);
  CameraTwist twist() const;
  void enter(const char* stage) const { enter(stage, clock_); }
  static void enter(const char* stage, StageClock* clock) {
    if (clock != nullptr) clock->enter(stage);
  }
  void find_landmarks(FrameResult& result) const;
  void find_warmth(FrameResult& result, const FringeStack& stack);
  bool follow(FrameResult& result, const Pose& predicted, const Matrix6d& prior = Matrix6d::Zero());
  bool locate(FrameResult& result);
  bool becomes_keyframe(const FrameResult& result, const Pose& world_from_camera, int keyframe) const;
  void extend_map(FrameResult& result);
  void add_keyframe(FrameResult& result, const Pose& world_from_camera);
  int close_loops(const FrameResult& result);

  RigModel rig_;
  PatternSequence sequence_, finest_;
  PipelineOptions options_;
  PixelRays rays_;
  Triangulation triangulation_;
  LandmarkDatabase database_;
  KeyframeMap map_;
  Pose start_;
  std::vector<Located> track_;
  std::map<size_t, LocatedRegions> warm_;  // by place in track_; their poses are those of track_
  bool lost_ = false;                      // since the last one of track_
  bool wants_all_ = true;
  bool prediction_failed_ = false;  // since the last keyframe
  Matrix6d prediction_covariance_ = Matrix6d::Zero();
  int reference_ = -1;
  Frame reference_frame_;
  std::optional<FrameResult> last_;
  StageClock* clock_ = nullptr;
};

}  // namespace fringeslam
