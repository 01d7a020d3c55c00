// SPDX-License-Identifier: Apache-2.0
// The data sent to viewers: the whole state or the changes, with bounded memory.
#include "tools/live/live_feed.h"

#include <gmock/gmock.h>

#include <nlohmann/json.hpp>
#include <thread>

#include "tests/live/synthetic_run.h"

namespace fringeslam {
namespace {

using nlohmann::json;
using test::SyntheticRun;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using tools::LiveFeed;

// Accumulates answers as the page's script does.
class Viewer {
 public:
  explicit Viewer(const LiveFeed& feed) : feed_(feed) {}

  void ask() {
    json changes = json::parse(feed_.changes(run_, sequence_));
    if (changes.contains("about")) known_ = json{{"views", json::array()}, {"keyframes", json::array()}};
    for (const char* list : {"views", "keyframes"}) {
      const json part = changes[list];
      changes.erase(list);
      json& mine = known_[list];
      while (mine.size() > part["from"]) mine.erase(mine.size() - 1);
      for (const json& entry : part["list"]) mine.push_back(entry);
      received_ += part["list"].size();
    }
    known_.update(changes);
    run_ = known_["run"];
    sequence_ = known_["sequence"];
  }
  const json& known() const { return known_; }
  size_t received() const { return received_; }

 private:
  const LiveFeed& feed_;
  std::string run_;
  uint64_t sequence_ = 0;
  json known_;
  size_t received_ = 0;
};

TEST(LiveFeed, WhoComesLateKnowsWhatWhoWasThereFromTheStartKnows) {
  LiveFeed feed(test::run_setup());
  SyntheticRun run;
  Viewer early(feed), rare(feed);
  const auto step = [&](auto&& act) {
    act();
    early.ask();
    Viewer late(feed);
    late.ask();
    EXPECT_EQ(early.known(), late.known());
  };
  early.ask();
  for (int i = 0; i < 5; ++i) step([&] { run.track(feed); });
  rare.ask();
  step([&] { run.lose(feed); });
  step([&] { run.track(feed, true); });
  step([&] { run.correct(feed, 0.02); });
  step([&] { feed.show_candidates({{{1, 2, 3}, 0.2, "seen once", "warmer than what is around it"}}); });
  for (int i = 0; i < 4; ++i) step([&] { run.track(feed); });
  step([&] { feed.finish(); });
  rare.ask();
  EXPECT_EQ(early.known(), rare.known());
  EXPECT_EQ(early.known()["views"].size(), 12u);
  EXPECT_EQ(early.known()["finished"], true);
}

TEST(LiveFeed, SendsOnlyWhatIsNew) {
  LiveFeed feed(test::run_setup());
  SyntheticRun run;
  Viewer viewer(feed);
  for (int i = 0; i < 60; ++i) {
    run.track(feed);
    viewer.ask();
  }
  EXPECT_EQ(viewer.received(), 60u + 20u);
  // A correction sends all poses again.
  run.correct(feed, 0.01);
  viewer.ask();
  EXPECT_EQ(viewer.received(), 80u + 61u + 20u);
}

TEST(LiveFeed, ViewsTellHowTheyWereTracked) {
  LiveFeed feed(test::run_setup());
  SyntheticRun run;
  run.track(feed);
  run.track(feed);
  run.lose(feed);
  const json lost = json::parse(feed.snapshot());
  EXPECT_THAT(lost["newest"]["warnings"].dump(), HasSubstr("Tracking is lost"));
  run.track(feed, true);
  const json found = json::parse(feed.snapshot());
  EXPECT_THAT(found["newest"]["warnings"], IsEmpty());
  std::vector<std::string> states;
  for (const json& view : found["views"]["list"]) states.push_back(view["tracking"]);
  EXPECT_THAT(states, ElementsAre("first", "followed", "lost", "followed"));
  EXPECT_FALSE(found["views"]["list"][2].contains("pose"));
  EXPECT_EQ(found["views"]["list"][3]["relocalized"], true);
  EXPECT_EQ(found["views"]["list"][3]["pose"], json::parse("[0.03, 0, 0, 0, 0, 0, 1]"));
}

TEST(LiveFeed, ACorrectionMovesAllPublishedViews) {
  LiveFeed feed(test::run_setup());
  SyntheticRun run;
  Viewer viewer(feed);
  run.track(feed);
  run.lose(feed);
  run.track(feed);
  viewer.ask();
  EXPECT_EQ(viewer.known()["views"][0]["pose"][1], 0);
  run.correct(feed, 0.05);
  viewer.ask();
  for (const int view : {0, 2, 3})
    EXPECT_EQ(viewer.known()["views"][static_cast<size_t>(view)]["pose"][1], 0.05) << view;
  EXPECT_FALSE(viewer.known()["views"][1].contains("pose"));
  EXPECT_EQ(viewer.known()["keyframes"][0]["pose"][1], 0.05);
  EXPECT_EQ(viewer.known()["views"][3]["corrected"], true);
  EXPECT_EQ(viewer.known()["views"][3]["loops"], 1);
  EXPECT_FALSE(viewer.known()["views"][2].contains("corrected"));
}

TEST(LiveFeed, ACorrectionMovesEachViewByItsOwnPose) {
  LiveFeed feed(test::run_setup());
  SyntheticRun run;
  run.track(feed);
  run.lose(feed);
  run.recover();
  run.track(feed);
  run.correct(feed, 0.05);
  const json views = json::parse(feed.snapshot())["views"]["list"];
  EXPECT_EQ(views[2]["pose"], json::parse("[0.02, 0.05, 0, 0, 0, 0, 1]"));
  EXPECT_EQ(views[3]["pose"], json::parse("[0.03, 0.05, 0, 0, 0, 0, 1]"));
}

TEST(LiveFeed, AReplacedFrameIsShown) {
  LiveFeed feed(test::run_setup());
  SyntheticRun run;
  for (int i = 0; i < 4; ++i) run.track(feed);
  const auto before = feed.points_of(0);
  EXPECT_FALSE(json::parse(feed.snapshot())["keyframes"]["list"][0].contains("version"));
  run.improve(feed);
  const json improved = json::parse(feed.snapshot())["keyframes"]["list"][0];
  EXPECT_EQ(improved["version"], 1);
  EXPECT_EQ(improved["landmarks"], json::parse("[[0.03, 0.02, 1.0]]"));
  EXPECT_NE(feed.points_of(0), before);
  EXPECT_EQ(feed.points_of(1), before);
}

TEST(LiveFeed, LandmarksAreTheMeanOfTheirKeypointsAndOutlined) {
  LiveFeed feed(test::run_setup());
  SyntheticRun().track(feed);
  const json all = json::parse(feed.snapshot());
  EXPECT_EQ(all["keyframes"]["list"][0]["landmarks"], json::parse("[[0.02, 0.02, 1.0]]"));
  EXPECT_EQ(all["newest"]["landmarks"],
            json::parse(R"([{"outline_px": [[1, 1], [9, 1], [9, 9]], "recognised": false}])"));
}

TEST(LiveFeed, CandidatesCarryTheirReason) {
  LiveFeed feed(test::run_setup());
  EXPECT_EQ(json::parse(feed.snapshot())["candidates"], json::array());
  feed.show_candidates(
      {{{0.5, -1, 0.25}, 0.3, "confirmed", "35 °C over 0.1 m²"}, {{1, 2, 3}, 0.1, "warm", "flat", false}});
  EXPECT_EQ(json::parse(feed.snapshot())["candidates"],
            json::parse(R"([{"position_m": [0.5, -1.0, 0.25], "radius_m": 0.3, "state": "confirmed",
                             "reason": "35 °C over 0.1 m²", "victim": true},
                            {"position_m": [1.0, 2.0, 3.0], "radius_m": 0.1, "state": "warm", "reason": "flat",
                             "victim": false}])"));
}

TEST(LiveFeed, SendsAnotherRunFromItsStart) {
  LiveFeed before(test::run_setup()), after(test::run_setup());
  SyntheticRun one, other;
  for (int i = 0; i < 3; ++i) one.track(before);
  other.track(after);
  const json old = json::parse(before.snapshot());
  const json answer = json::parse(after.changes(old["run"], old["sequence"]));
  EXPECT_NE(answer["run"], old["run"]);
  EXPECT_TRUE(answer.contains("about"));
  EXPECT_EQ(answer["views"]["list"].size(), 1u);
}

// Only a few views are kept, for viewers that may still request their pictures; stacks are released once decoded.
TEST(LiveFeed, NoMoreViewsAreKeptThanViewersMayAskFor) {
  LiveFeed feed(test::run_setup());
  SyntheticRun run;
  for (int i = 0; i < 100; ++i) run.track(feed);
  EXPECT_EQ(feed.views_kept(), 1u);  // not yet reported to any viewer
  Viewer viewer(feed);
  for (int i = 0; i < 100; ++i) {
    run.track(feed);
    viewer.ask();
  }
  EXPECT_EQ(feed.views_kept(), 8u);
  EXPECT_NE(feed.view(200), nullptr);
  EXPECT_NE(feed.view(193), nullptr);
  EXPECT_EQ(feed.view(192), nullptr);
  EXPECT_TRUE(feed.had_view(192));
  EXPECT_FALSE(feed.had_view(201));
  EXPECT_FALSE(feed.had_view(0));
}

TEST(LiveFeed, PointsAreThoseOfTheKeyframes) {
  LiveFeed feed(test::run_setup());
  SyntheticRun run;
  for (int i = 0; i < 4; ++i) run.track(feed);
  EXPECT_TRUE(feed.points_of(0).has_value());
  EXPECT_EQ(feed.points_of(0), feed.points_of(1));
  for (const int none : {-1, 2}) EXPECT_FALSE(feed.points_of(none).has_value()) << none;
}

TEST(LiveFeed, WaitingEndsWithTheChange) {
  LiveFeed feed(test::run_setup());
  const json start = json::parse(feed.snapshot());
  std::atomic<bool> notified = false;
  std::thread viewer([&] {
    feed.await_change(start["run"], start["sequence"], std::chrono::hours(1), [] { return false; });
    notified = true;
  });
  EXPECT_FALSE(notified);
  SyntheticRun().track(feed);
  viewer.join();  // would wait for an hour if it were not notified
  EXPECT_TRUE(notified);
  // Returns immediately for another run, and as soon as `give_up` is true.
  feed.await_change("another", 99, std::chrono::hours(1), [] { return false; });
  feed.await_change(start["run"], 99, std::chrono::hours(1), [] { return true; });
}

TEST(LiveFeed, AnUnknownMotionIsReported) {
  const tools::LiveSetup setup = test::run_setup();
  LiveFeed feed(setup);
  const KeyframeMap map(setup.rig, {});
  FrameResult result;
  result.frame = support::observe(support::plane(Eigen::Vector3d::UnitZ(), 1), setup.rig, {}, 0);
  result.frame.texture = cv::Mat1b(result.frame.points_m.size(), 90);
  result.frame.depth_image = cv::Mat1b(result.frame.points_m.size(), 128);
  result.decoded.modulation = cv::Mat1f(result.frame.points_m.size(), 60.0f);
  result.decoded.finest_period_px = 16.5;
  result.motion.emplace();
  const auto warned = [&](int index, bool known) {
    result.motion->converged = known;
    result.tracking = known ? Tracking::followed : Tracking::lost;
    feed.show(
        test::ramp_stack(60, index), result, map, [] { return Trajectory(); }, 0);
    return json::parse(feed.snapshot())["newest"]["warnings"].dump();
  };
  EXPECT_EQ(warned(0, true), "[]");
  EXPECT_THAT(warned(1, false), HasSubstr("Moving too fast"));
}

}  // namespace
}  // namespace fringeslam
