// SPDX-License-Identifier: Apache-2.0
// Synthetic pipeline results without running the pipeline: small, with the poses and corrections that a test needs.
#pragma once

#include <cmath>

#include "tests/support/fringes.h"
#include "tests/support/scene.h"
#include "tests/tools/fake_rig.h"
#include "tools/live/live_feed.h"

namespace fringeslam::test {

// Fringes along a ramp of coordinates; they match no scene but have light.
inline FringeStack ramp_stack(double modulation_dn, int index = 0) {
  const RigModel rig = tiny_rig();
  cv::Mat1d coordinate_px(rig.camera.height, rig.camera.width);
  for (int row = 0; row < coordinate_px.rows; ++row)
    support::ramp(300, 700, rig.camera.width).copyTo(coordinate_px.row(row));
  FringeStack stack =
      support::fringe_stack(coordinate_px, short_sequence(), {.mean_dn = 120, .modulation_dn = modulation_dn}, CV_8UC1);
  stack.index = index;
  stack.timestamp_s = 0.1 * index;
  stack.exposure_time_s = exposure_times_s(stack.timestamp_s, stack.images.size(), rig.timing);
  return stack;
}

inline Pose shifted(double x_m) { return {Eigen::Matrix3d::Identity(), {x_m, 0, 0}}; }

inline tools::LiveSetup run_setup() {
  return {.verb = "run", .name = "made", .rig = tiny_rig(), .sequence = short_sequence(), .stacks = 10, .maps = true};
}

// Advances a centimetre per view; every third view is a keyframe with a landmark.
class SyntheticRun {
 public:
  SyntheticRun() : rig_(tiny_rig()), map_(rig_, {}) {
    frame_ = support::observe(support::plane(Eigen::Vector3d::UnitZ(), 1), rig_, {}, 0);
    frame_.texture = cv::Mat1b(frame_.points_m.size(), 90);
    frame_.depth_image = cv::Mat1b(frame_.points_m.size(), 128);
    frame_.sigma_m = cv::Mat1f(frame_.points_m.size(), 1e-4f);
  }

  void track(tools::LiveFeed& feed, bool relocalized = false) {
    FrameResult result = seen();
    const Pose pose = shifted(0.01 * number_);
    result.tracking = trajectory_.empty() ? Tracking::first : Tracking::followed;
    result.relocalized = relocalized;
    result.world_from_robot = pose;
    trajectory_.push_back({0.1 * number_, pose});
    if (number_ % 3 == 0) result.keyframe = add_keyframe(pose);
    show(feed, result);
  }
  void lose(tools::LiveFeed& feed) {
    FrameResult result = seen();
    result.tracking = Tracking::lost;
    show(feed, result);
  }
  // Later views determine the pose of the last one, which was lost.
  void recover() { trajectory_.push_back({0.1 * (number_ - 1), shifted(0.01 * (number_ - 1))}); }
  // Adds a view after which the first keyframe has another frame, whose surface lies 10 mm further along x.
  void improve(tools::LiveFeed& feed) {
    Frame better = frame_;
    better.points_m = 0.9 * frame_.points_m;
    map_.replace_frame(0, better, shifted(0.01));
    track(feed);
  }
  // Adds a view that closes a loop, which shifts the whole map by `y_m`.
  void correct(tools::LiveFeed& feed, double y_m) {
    FrameResult result = seen();
    std::vector<Keyframe> keyframes = map_.keyframes();
    for (Keyframe& keyframe : keyframes) keyframe.world_from_camera.translation.y() = y_m;
    KeyframeMap corrected(rig_, {});
    corrected.restore(keyframes, map_.frames(), map_.links());
    map_ = corrected;
    result.tracking = Tracking::refined;
    result.corrected = true;
    result.loops = 1;
    trajectory_.push_back({0.1 * number_, shifted(0.01 * number_)});
    for (TimedPose& timed : trajectory_) timed.world_from_robot.translation.y() = y_m;
    result.world_from_robot = trajectory_.back().world_from_robot;
    show(feed, result);
  }

  // The result of a view without its pose.
  FrameResult seen() const {
    FrameResult result;
    result.frame = frame_;
    result.decoded.modulation = cv::Mat1f(frame_.points_m.size(), 60.0f);
    result.decoded.finest_period_px = 131;
    result.landmarks = landmarks();
    return result;
  }

 private:
  static Landmarks landmarks() {
    Landmarks found;
    found.keypoints.keypoints.resize(2);
    found.keypoints.keypoints[0].point_m = {0.01, 0.02, 0.9};
    found.keypoints.keypoints[1].point_m = {0.03, 0.02, 1.1};
    found.landmarks.push_back({{}, {{1, 1}, {9, 1}, {9, 9}}, {0, 1}});
    return found;
  }
  int add_keyframe(const Pose& pose) { return map_.add_keyframe(frame_, landmarks(), pose); }
  void show(tools::LiveFeed& feed, const FrameResult& result) {
    feed.show(
        ramp_stack(60, number_++), result, map_, [this] { return trajectory_; }, 0);
  }

  RigModel rig_;
  KeyframeMap map_;
  Frame frame_;
  Trajectory trajectory_;
  int number_ = 0;
};

}  // namespace fringeslam::test
