// SPDX-License-Identifier: Apache-2.0
// Front end, mapper and pattern schedule as one: fringe stacks in, poses and map out. Driver (driver.h) runs it on a rig.
#pragma once

#include <memory>
#include <optional>

#include "core/map/cloud.h"
#include "core/map/surface.h"
#include "core/mapper/front_end.h"
#include "core/mapper/mapper.h"
#include "core/mapper/pattern_schedule.h"
#include "core/thermal/options.h"

namespace fringeslam {

// The options of all stages, as settings name them (`decode.unwrapping`, `icp.stride`, …).
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
  AmbiguityOptions ambiguity;
  MotionLimits motion_prior;
  MappingOptions mapping;
  PoseGraphOptions pose_graph;
  CloudOptions cloud;
  SurfaceOptions surface;
  ThermalOptions thermal;

  // Calls visit(name, options) for each stage, in order.
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
    visit("ambiguity", ambiguity);
    visit("motion_prior", motion_prior);
    visit("mapping", mapping);
    visit("pose_graph", pose_graph);
    visit("cloud", cloud);
    visit("surface", surface);
    visit("thermal", thermal);
  }

  FrontEndOptions front_end() const { return {decode, depth, tracking.at_rest}; }
  MapperOptions mapper() const {
    return {{keypoints, conditioning, clusters, landmarks, recognition},
            {matching, motion, icp, tracking, ambiguity, motion_prior},
            mapping,
            pose_graph};
  }
};

// A stack, and its view if that could be reconstructed without the map.
struct PreprocessedStack {
  FringeStack stack;
  std::optional<ReconstructedView> view;
};

class Pipeline {
 public:
  // `world_from_robot` is the pose of the robot at the first stack. Throws Error if an option is out of range or the
  // patterns cannot be decoded.
  Pipeline(const RigModel& rig, const PatternSequence& sequence, const PipelineOptions& options,
           const Pose& world_from_robot);
  // Continues in a map, in which the robot has to be relocalized.
  Pipeline(KeyframeMap map, const PatternSequence& sequence, const PipelineOptions& options);
  // Reconstructs with another front end.
  Pipeline(std::shared_ptr<const FrontEnd> front_end, Mapper mapper, const PatternSequence& sequence,
           const PipelineOptions& options);

  // Patterns to project for the next stack.
  const PatternSequence& next_patterns() const { return next_; }
  // True if next_patterns() does not depend on stacks that are still to be processed.
  bool has_fixed_patterns() const { return schedule_.is_fixed(); }

  // Requests whole sequences even in motion, for images that cannot show anything else. Does not affect
  // decode.unwrapping=predicted.
  void keep_all_patterns();

  // Throws Error if the stack cannot be decoded.
  FrameResult process(FringeStack stack) { return process(preprocess(std::move(stack))); }
  // The same in two steps. preprocess() needs no map: other threads may call it for later stacks meanwhile, with the same
  // results.
  PreprocessedStack preprocess(FringeStack stack) const;
  FrameResult process(PreprocessedStack preprocessed);

  const Mapper& mapper() const { return mapper_; }
  const KeyframeMap& map() const { return mapper_.map(); }
  Trajectory trajectory() const { return mapper_.trajectory(); }
  // Fuses the surface of all frames of the map at their current poses. A loop closure moves nearly every frame, so the
  // surface is fused on request instead of with each view.
  SurfaceModel surface() const { return surface_of(map(), surface_); }

 private:
  double predictable_orders(const FringeStack& stack) const;

  std::shared_ptr<const FrontEnd> front_end_;
  Mapper mapper_;
  PatternSchedule schedule_;
  PatternSequence next_;
  SurfaceOptions surface_;
  double last_timestamp_s_ = 0;
};

}  // namespace fringeslam
