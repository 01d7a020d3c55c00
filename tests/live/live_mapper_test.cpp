// SPDX-License-Identifier: Apache-2.0
#include "tools/live/live_mapper.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "core/patterns/design.h"
#include "tests/live/synthetic_run.h"
#include "tests/support/bump_rig.h"

namespace fringeslam::tools {
namespace {

class Mapped : public testing::Test {
 protected:
  Mapped()
      : feed_({.verb = "capture", .name = "bumps", .rig = rig_.model(), .sequence = sequence_, .maps = true}),
        mapper_(rig_.model(), sequence_, options(), feed_) {}
  static PipelineOptions options() {
    PipelineOptions options;
    options.tracking.max_displacement_sigma_m = 5e-3;  // a tenth of the pixels, few keypoints
    options.icp.min_overlap = 0.1;
    return options;
  }
  FringeStack captured() { return *rig_.capture(sequence_); }
  nlohmann::json views() const { return nlohmann::json::parse(feed_.snapshot())["views"]["list"]; }

  support::BumpRig rig_{100};
  const PatternSequence sequence_ = phase_shift_sequence(1024, 768, {1040, 131, 16.5}, 3, Axis::columns, 8);
  LiveFeed feed_;
  LiveMapper mapper_;
};

TEST_F(Mapped, OfferedStacksAppearWithTheirPosesAndInTheMap) {
  for (int view = 0; view < 4; ++view) {
    mapper_.offer(captured());
    mapper_.finish();
  }
  const auto seen = views();
  ASSERT_EQ(seen.size(), 4u);
  for (int view = 0; view < 4; ++view) {
    EXPECT_EQ(seen[static_cast<size_t>(view)]["index"], view);
    EXPECT_EQ(seen[static_cast<size_t>(view)]["tracking"], view == 0 ? "first" : view == 1 ? "refined" : "followed");
    const double along = seen[static_cast<size_t>(view)]["pose"][0];
    EXPECT_NEAR(along, 0.008 * view, 1e-3);
  }
  EXPECT_FALSE(nlohmann::json::parse(feed_.snapshot())["keyframes"]["list"].empty());
  EXPECT_EQ(mapper_.dropped(), 0);
}

TEST_F(Mapped, TheOldestAreDroppedWhereMappingIsBehind) {
  constexpr int kStacks = 20;
  std::vector<FringeStack> stacks;
  for (int i = 0; i < kStacks; ++i) stacks.push_back(captured());
  for (const FringeStack& stack : stacks) mapper_.offer(stack);  // without pauses
  mapper_.finish();
  const auto seen = views();
  EXPECT_GT(mapper_.dropped(), 0);
  EXPECT_EQ(static_cast<int>(seen.size()) + mapper_.dropped(), kStacks);
  EXPECT_EQ(seen.back()["index"], kStacks - 1);
  EXPECT_EQ(nlohmann::json::parse(feed_.snapshot())["dropped"], mapper_.dropped());
}

TEST_F(Mapped, AStackThatCannotBeMappedEndsTheMapAndNothingElse) {
  mapper_.offer(captured());
  mapper_.finish();
  FringeStack torn = captured();
  torn.images[3] = torn.images[3].rowRange(0, 10).clone();
  testing::internal::CaptureStderr();
  mapper_.offer(torn);
  mapper_.finish();
  EXPECT_EQ(testing::internal::GetCapturedStderr().rfind("live: no map from stack 1 on: ", 0), 0u);
  mapper_.offer(captured());
  mapper_.finish();
  const auto seen = views();
  ASSERT_EQ(seen.size(), 3u);
  EXPECT_TRUE(seen[0].contains("pose"));
  EXPECT_FALSE(seen[2].contains("pose"));
}

// The marks of warm things move with the map, also while the camera sees nothing warm.
TEST(ShowMapped, ACorrectionSendsTheCandidatesAgain) {
  const LiveSetup setup = test::run_setup();
  LiveFeed feed(setup);
  const Mapper mapper(setup.rig, {}, Pose{});
  const ThermalObserver observer(setup.rig, {});
  FrameResult result = test::SyntheticRun().seen();
  result.tracking = Tracking::followed;
  const auto sends_candidates = [&](bool corrected) {
    const auto before = nlohmann::json::parse(feed.snapshot());
    result.corrected = corrected;
    show_mapped(feed, test::ramp_stack(60), result, mapper, {}, observer, 0);
    return nlohmann::json::parse(feed.changes(before["run"], before["sequence"])).contains("candidates");
  };
  EXPECT_TRUE(sends_candidates(true));
  EXPECT_FALSE(sends_candidates(false));
  EXPECT_TRUE(sends_candidates(true));
}

}  // namespace
}  // namespace fringeslam::tools
