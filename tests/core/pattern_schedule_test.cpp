// SPDX-License-Identifier: Apache-2.0
#include "core/mapper/pattern_schedule.h"

#include <gtest/gtest.h>

#include "core/mapper/pipeline.h"
#include "core/patterns/patterns.h"
#include "tests/support/scene.h"

namespace fringeslam {
namespace {

const PatternSequence kSequence = phase_shift_sequence(912, 1140, {1040, 131, 16.5}, 3, Axis::columns, 8);
constexpr double kKeyframeOverlap = 0.7, kMinPredicted = 0.75;

FrameResult followed(bool moving) {
  FrameResult result;
  result.tracking = Tracking::followed;
  result.registration.icp.overlap = 1;
  result.decoded.wrapped_phase = result.decoded.coordinate_px = cv::Mat1f(4, 4, 1.0f);
  result.motion.emplace();
  result.motion->converged = true;
  if (moving) result.motion->motion.velocity_m_s = {0.3, 0, 0};
  return result;
}

PatternSchedule schedule(FinestAlone finest) { return {kSequence, finest, kKeyframeOverlap, kMinPredicted}; }

TEST(PatternSchedule, FinestFringesAloneWhileTheRobotMoves) {
  PatternSchedule patterns = schedule(FinestAlone::in_motion);
  EXPECT_TRUE(patterns.is_fixed());
  patterns.update(followed(false));
  EXPECT_EQ(patterns.next(), kSequence);
  EXPECT_TRUE(patterns.is_fixed());
  patterns.update(followed(true));
  EXPECT_EQ(patterns.next(), finest_patterns(kSequence, Axis::columns));
  EXPECT_FALSE(patterns.is_fixed());
  patterns.update(followed(false));
  EXPECT_EQ(patterns.next(), kSequence);
}

TEST(PatternSchedule, AllPatternsUntilTheMapPredictsTheirFringeOrders) {
  PatternSchedule patterns = schedule(FinestAlone::in_motion);
  FrameResult result = followed(true);
  result.predictable = kMinPredicted - 0.01;
  patterns.update(result);
  EXPECT_EQ(patterns.next(), kSequence);
  result.predictable = kMinPredicted;
  patterns.update(result);
  EXPECT_EQ(patterns.next(), finest_patterns(kSequence, Axis::columns));
}

TEST(PatternSchedule, AllPatternsAfterTrackingWasLost) {
  PatternSchedule patterns = schedule(FinestAlone::in_motion);
  patterns.update(followed(true));
  FrameResult lost = followed(true);
  lost.tracking = Tracking::lost;
  patterns.update(lost);
  EXPECT_EQ(patterns.next(), kSequence);
}

TEST(PatternSchedule, AllPatternsWhereALoopCanBeClosed) {
  PatternSchedule patterns = schedule(FinestAlone::in_motion);
  FrameResult result = followed(true);
  result.unlinked = 7;
  patterns.update(result);
  EXPECT_EQ(patterns.next(), kSequence);
  result.keyframe = 9;
  patterns.update(result);
  EXPECT_EQ(patterns.next(), finest_patterns(kSequence, Axis::columns)) << "the loop is closed";
}

TEST(PatternSchedule, RecordingsKeepAllPatterns) {
  PatternSchedule in_motion = schedule(FinestAlone::in_motion), always = schedule(FinestAlone::always);
  for (PatternSchedule* patterns : {&in_motion, &always}) {
    patterns->keep_all();
    patterns->update(followed(true));
  }
  EXPECT_EQ(in_motion.next(), kSequence);
  EXPECT_TRUE(in_motion.is_fixed());
  EXPECT_EQ(always.next(), finest_patterns(kSequence, Axis::columns));
}

TEST(Mapper, AViewWithoutDepthDoesNotStartAMap) {
  const RigModel rig = support::small_rig(true);
  Frame frame = support::observe(support::bumps(1, 0.03, 0.2), rig, {}, 1e-4, nullptr);
  frame.texture.create(frame.points_m.size());
  frame.texture = uchar{100};
  Mapper mapper(rig, PipelineOptions{}.mapper(), {});
  Frame empty = frame;
  empty.points_m = cv::Mat3f(frame.points_m.size(), cv::Vec3f::all(std::nanf("")));
  EXPECT_EQ(mapper.process(empty).tracking, Tracking::lost);
  EXPECT_TRUE(mapper.map().keyframes().empty());
  EXPECT_EQ(mapper.process(frame).tracking, Tracking::first);
}

// A robot that returns to its start and stops there closes the loop, although it sees nothing new.
TEST(Mapper, LoopIsClosedWhereTheRobotReturns) {
  const RigModel rig = support::small_rig(true);
  support::Random noise(3);
  PipelineOptions options;
  options.mapping.min_loop_overlap = 0.65;  // so that no regular keyframe closes the loop
  Mapper mapper(rig, options.mapper(), {});
  constexpr int kViews = 90;
  constexpr double kRadius_m = 0.2;
  int unlinked = 0, last_keyframe = 0;
  for (int i = 0; i <= kViews; ++i) {
    const double angle = 2 * CV_PI * i / kViews;
    const Pose pose{Eigen::Matrix3d::Identity(), {kRadius_m * (std::cos(angle) - 1), kRadius_m * std::sin(angle), 0}};
    Frame frame = support::observe(support::bumps(1, 0.03, 0.23), rig, pose, 1e-4, &noise);
    frame.timestamp_s = 0.1 * i;
    support::print_texture(frame, pose);
    const FrameResult result = mapper.process(frame);
    ASSERT_TRUE(has_pose(result.tracking)) << i;
    unlinked += result.unlinked >= 0;
    if (result.keyframe >= 0) last_keyframe = result.keyframe;
  }
  EXPECT_EQ(unlinked, 1) << "once is enough";
  EXPECT_GE(last_keyframe, 8);
  EXPECT_TRUE(mapper.map().linked_within(0, last_keyframe, 1));
  EXPECT_TRUE(mapper.map().linked_within(0, last_keyframe - 1, 2));
  EXPECT_FALSE(mapper.map().linked_within(0, last_keyframe / 2, 3));
  // Only the chain of keyframes is beyond doubt.
  for (const PoseEdge& link : mapper.map().links())
    EXPECT_EQ(link.loop, link.to - link.from > 1) << link.from << " to " << link.to;
}

}  // namespace
}  // namespace fringeslam
