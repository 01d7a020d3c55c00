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

}  // namespace
}  // namespace fringeslam
