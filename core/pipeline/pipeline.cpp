// SPDX-License-Identifier: Apache-2.0
#include "core/pipeline/pipeline.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

namespace fringeslam {

namespace {

std::vector<PointPair> point_pairs(const Keypoints& previous, const Keypoints& current,
                                   const std::vector<KeypointMatch>& matches) {
  std::vector<PointPair> pairs;
  for (const KeypointMatch& match : matches) {
    const Keypoint& p = previous.keypoints[static_cast<size_t>(match.earlier)];
    const Keypoint& c = current.keypoints[static_cast<size_t>(match.current)];
    pairs.push_back({p.point_m, c.point_m, p.covariance_m2, c.covariance_m2});
  }
  return pairs;
}

// How far off surfaces may be when registration starts from the landmarks' motion: six sigmas of a point at the given
// distance, and not less than a few times what depth noise does. Wider, registration would pair things with what
// stands behind them.
double start_error_m(const MotionEstimate& motion, double distance_m) {
  constexpr double kSigmas = 6, kLeast = 1e-3;
  Eigen::Matrix<double, 3, 6> jacobian;
  jacobian << -skew(motion.previous_from_current.rotation * Eigen::Vector3d(0, 0, distance_m)),
      Eigen::Matrix3d::Identity();
  const Eigen::Matrix3d covariance = jacobian * motion.covariance * jacobian.transpose();
  return std::max(kLeast, kSigmas * std::sqrt(covariance.trace()));
}

// Whether registration stayed within what the landmarks' covariance allows (chi-square of six degrees of freedom, one
// false alarm in 10^7): it refines their motion, it does not overrule it.
bool agree(const Pose& refined, const MotionEstimate& motion) {
  constexpr double kMaxSquare = 45;
  const Vector6d offset = difference(refined, motion.previous_from_current);
  return offset.dot(motion.covariance.inverse() * offset) <= kMaxSquare;
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
      triangulation_(rig, rays_, options.depth.near_m, options.depth.far_m),
      database_(rig.camera, options.recognition),
      map_(options.cloud),
      start_(start) {
  options_.for_each_stage([](const char* name, auto& stage) { check_options(stage, name); });
}

FrameResult Pipeline::process(const FringeStack& stack) {
  FrameResult result;
  result.decoded = decode(stack, sequence_, rig_, options_.decode);
  result.frame = reconstruct(result.decoded, rig_, triangulation_, options_.depth);
  result.keypoints = detect_keypoints(result.frame, rig_, rays_, options_.keypoints);
  find_landmarks(result, stack.index);
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

void Pipeline::find_landmarks(FrameResult& result, int index) {
  result.landmarks = identify_landmarks(result.frame, result.keypoints, rig_, options_.keypoints, options_.conditioning,
                                        options_.clusters, options_.landmarks, &result.landmark_stages);
  result.recognitions = database_.recognise(result.landmarks);
  database_.add(index, result.landmarks);
}

void Pipeline::track(FrameResult& result) const {
  result.matches = match_keypoints(last_->keypoints, result.keypoints, options_.matching);
  result.motion = estimate_motion(point_pairs(last_->keypoints, result.keypoints, result.matches), options_.motion);
  if (result.motion.status != MotionStatus::determined) return;

  result.tracking = Tracking::landmarks;
  result.previous_from_current = result.motion.previous_from_current;
  result.covariance = result.motion.covariance;
  IcpOptions icp = options_.icp;
  icp.max_distance_m = std::min(icp.max_distance_m, start_error_m(result.motion, 0.5 * (rig_.near_m + rig_.far_m)));
  result.icp = point_to_plane_icp(last_->frame, result.frame, rig_.camera, result.previous_from_current, icp,
                                  result.motion.covariance.inverse());
  if (result.icp.converged && agree(result.icp.target_from_source, result.motion)) {
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
