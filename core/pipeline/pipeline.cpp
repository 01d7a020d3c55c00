// SPDX-License-Identifier: Apache-2.0
#include "core/pipeline/pipeline.h"

#include <Eigen/LU>

namespace fringeslam {

namespace {

std::vector<PointPair> point_pairs(const Keypoints& previous, const Keypoints& current,
                                   const std::vector<Match>& matches) {
  std::vector<PointPair> pairs;
  for (const Match& match : matches) {
    const Keypoint& p = previous.keypoints[static_cast<size_t>(match.previous)];
    const Keypoint& c = current.keypoints[static_cast<size_t>(match.current)];
    pairs.push_back({p.point_m, c.point_m, p.covariance_m2, c.covariance_m2});
  }
  return pairs;
}

}  // namespace

std::string to_string(Tracking tracking) {
  switch (tracking) {
    case Tracking::first:
      return "first";
    case Tracking::refined:
      return "refined";
    case Tracking::landmarks:
      return "landmarks";
    case Tracking::lost:
      return "lost";
  }
  return "unknown";
}

Pipeline::Pipeline(const RigModel& rig, const PatternSequence& sequence, const PipelineOptions& options,
                   const Pose& start)
    : rig_(rig),
      sequence_(sequence),
      options_(options),
      rays_(pixel_rays(rig.camera)),
      map_(options.cloud),
      start_(start) {
  options_.for_each_stage([](const char* name, auto& stage) { check_options(stage, name); });
}

FrameResult Pipeline::process(const FringeStack& stack) {
  FrameResult result;
  result.decoded = decode(stack, sequence_, rig_.sensor, options_.decode);
  result.frame = reconstruct(result.decoded, rig_, rays_, options_.depth);
  result.keypoints = detect_keypoints(result.frame, rig_, rays_, options_.keypoints);
  if (last_) {
    track(result);
  } else {
    result.tracking = Tracking::first;
    result.world_from_robot = start_;
  }
  if (result.tracking != Tracking::lost) {
    map_.add(result.frame, result.world_from_robot * rig_.robot_from_camera);
    last_ = result;
  }
  return result;
}

void Pipeline::track(FrameResult& result) const {
  result.matches = match_keypoints(last_->keypoints, result.keypoints, options_.matching);
  result.motion = estimate_motion(point_pairs(last_->keypoints, result.keypoints, result.matches), options_.motion);
  if (result.motion.status != MotionStatus::determined) return;

  result.tracking = Tracking::landmarks;
  result.previous_from_current = result.motion.previous_from_current;
  result.covariance = result.motion.covariance;
  result.icp = point_to_plane_icp(last_->frame, result.frame, rig_.camera, result.previous_from_current, options_.icp);
  if (result.icp.converged) {
    result.tracking = Tracking::refined;
    result.previous_from_current = result.icp.target_from_source;
    // Residuals wider than the sigmas say that the sigmas are too small, by as much.
    const double excess = std::max(1.0, result.icp.rms_sigma * result.icp.rms_sigma);
    result.covariance = excess * result.icp.information.inverse();
  }
  // METHOD S21: world_from_robot(i+1) = world_from_robot(i) robot_from_camera motion camera_from_robot
  result.world_from_robot = orthonormalised(last_->world_from_robot * rig_.robot_from_camera *
                                            result.previous_from_current * rig_.robot_from_camera.inverse());
}

}  // namespace fringeslam
