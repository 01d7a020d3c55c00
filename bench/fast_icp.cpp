// SPDX-License-Identifier: Apache-2.0
#include "bench/fast_icp.h"

#include <opencv2/rgbd.hpp>

namespace fringeslam::bench {

std::optional<Pose> opencv_fast_icp(const FramePair& pair) {
  cv::Mat1f depth[2];
  const Frame* frames[2] = {&pair.target, &pair.source};
  for (int i = 0; i < 2; ++i) cv::extractChannel(frames[i]->points_m, depth[i], 2);
  const Pinhole& camera = pair.rig.camera;
  const cv::Matx33f matrix(static_cast<float>(camera.fx), 0, static_cast<float>(camera.cx), 0,
                           static_cast<float>(camera.fy), static_cast<float>(camera.cy), 0, 0, 1);
  const auto odometry = cv::rgbd::FastICPOdometry::create(cv::Mat(matrix), 0.1f);
  cv::Mat found;
  const cv::Mat none;
  // The pose maps from the first frame's camera to the second's.
  if (!odometry->compute(none, depth[1], none, none, depth[0], none, found) || found.empty()) return std::nullopt;
  const cv::Mat1d rt = cv::Mat1d(found);
  Pose pose;
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 3; ++c) pose.rotation(r, c) = rt(r, c);
    pose.translation[r] = rt(r, 3);
  }
  return pose;
}

}  // namespace fringeslam::bench
