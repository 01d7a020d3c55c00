// SPDX-License-Identifier: Apache-2.0
// Fringe images in, poses and map out: the stages in their order.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "core/decode/decode.h"
#include "core/depth/depth.h"
#include "core/landmarks/keypoints.h"
#include "core/landmarks/landmarks.h"
#include "core/landmarks/recognition.h"
#include "core/map/cloud.h"
#include "core/map/icp.h"
#include "core/motion/ego_motion.h"

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
  CloudOptions cloud;

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
    visit("cloud", cloud);
  }
};

enum class Tracking {
  first,      // nothing to register against
  refined,    // landmarks, then ICP
  landmarks,  // ICP did not settle; the pose is the landmarks'
  lost        // no pose; the frame is left out of trajectory and map
};
std::string to_string(Tracking tracking);

struct FrameResult {
  DecodedStack decoded;
  Frame frame;
  Keypoints keypoints;
  std::vector<KeypointMatch> matches;  // against the last tracked frame
  Landmarks landmarks;
  LandmarkStages landmark_stages;
  std::vector<Recognition> recognitions;  // of landmarks of earlier frames, by FringeStack::index
  MotionEstimate motion;
  IcpResult icp;
  Tracking tracking = Tracking::lost;
  Pose previous_from_current;              // camera motion since the last tracked frame
  Matrix6d covariance = Matrix6d::Zero();  // of previous_from_current
  Pose world_from_robot;
};

class Pipeline {
 public:
  // `start`: where the robot is when the first stack is taken.
  Pipeline(const RigModel& rig, const PatternSequence& sequence, const PipelineOptions& options, const Pose& start);

  FrameResult process(const FringeStack& stack);

  // The frame that the next one is registered against; empty before the first.
  const std::optional<FrameResult>& last_tracked() const { return last_; }
  const CloudMap& map() const { return map_; }

 private:
  void find_landmarks(FrameResult& result, int index);
  void track(FrameResult& result) const;

  RigModel rig_;
  PatternSequence sequence_;
  PipelineOptions options_;
  PixelRays rays_;
  Triangulation triangulation_;
  LandmarkDatabase database_;
  CloudMap map_;
  Pose start_;
  std::optional<FrameResult> last_;
};

}  // namespace fringeslam
