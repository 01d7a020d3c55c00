// SPDX-License-Identifier: Apache-2.0
// Runs with many views: tracking, loss, relocalization, dropped views, and saved maps.
#include <gmock/gmock.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <regex>

#include "core/io/tum_file.h"
#include "core/score/score.h"
#include "tests/tools/child.h"

namespace fringeslam {
namespace {

using nlohmann::json;
using test::run_program;
using test::run_successfully;
using testing::HasSubstr;

constexpr const char* kStep = "    - {translation_mm: [6, 4, 0], rotation_deg: [0, 0, 1]}\n";
constexpr const char* kBack = "    - {translation_mm: [-6, -4, 0], rotation_deg: [0, 0, -1]}\n";

std::string repeated(const std::string& text, int times) {
  std::string all;
  for (int i = 0; i < times; ++i) all += text;
  return all;
}

class ManyViews : public testing::Test {
 protected:
  std::string at(const std::string& name) const { return (temp_ / name).string(); }

  // Writes the small scene with other motions.
  std::string scene(const std::string& name, const std::string& motions) const {
    test::write_small_scene(temp_ / name);
    const std::string text(test::kSmallScene);
    const size_t first = text.find("    - {translation_mm");
    test::write_bytes(temp_ / name / "scene.yaml", text.substr(0, first) + motions);
    return at(name);
  }
  json run(const std::string& scene, const std::string& out, const std::vector<std::string>& more = {}) const {
    std::vector<std::string> words = {"run", scene, "--out", at(out), "--quiet", "--set", "render.samples_per_pixel=1"};
    words.insert(words.end(), more.begin(), more.end());
    run_successfully(words);
    return read(out + "/frames.json");
  }
  json read(const std::string& name) const { return json::parse(test::read_bytes(temp_ / name)); }
  std::vector<std::string> tracking(const json& frames) const {
    std::vector<std::string> states;
    for (const json& frame : frames) states.push_back(frame.at("tracking"));
    return states;
  }

  test::TempFolder temp_;
};

TEST_F(ManyViews, AreFollowedWithoutLandmarks) {
  const json frames = run(scene("straight", repeated(kStep, 4)), "run");
  EXPECT_THAT(tracking(frames), testing::ElementsAre("first", "refined", "followed", "followed", "followed"));
  for (const json& frame : frames) {
    if (frame["tracking"] == "followed") {
      EXPECT_EQ(frame["keypoints_detected"], 0);
    }
  }
  EXPECT_LT(read("run/score.json")["trajectory"]["ate_rmse_mm"], 0.05);
}

TEST_F(ManyViews, HavePosesAtEverySingleImageIfWanted) {
  const json frames =
      run(scene("straight", repeated(kStep, 3)), "run",
          {"--with", "trajectory.continuous.speed_m_s=0.03", "--image-poses", "--animation", "--no-report"});
  const json images = read("run/images.json"), score = read("run/score.json");
  size_t tracked = 0;
  double variance_m2 = 0;
  std::vector<int> of_stack(frames.size());
  for (const json& image : images) {
    ++of_stack.at(image.at("stack").get<size_t>());
    EXPECT_FALSE(image.contains("unexpected")) << image;
    if (!image.at("tracked")) continue;
    ++tracked;
    const double sigma_m = image.at("sigma_m");
    EXPECT_GT(sigma_m, 0);
    variance_m2 += 3 * sigma_m * sigma_m;
  }
  for (size_t i = 0; i < frames.size(); ++i) EXPECT_EQ(of_stack[i], frames[i].at("images")) << i;
  EXPECT_GT(tracked, images.size() / 2);
  EXPECT_EQ(read_tum(temp_ / "run/images.tum").size(), tracked);
  EXPECT_EQ(score.at("images").at("poses"), tracked);
  // They are aligned by the first view, like the errors of their positions.
  EXPECT_DOUBLE_EQ(score.at("images").at("ate_rmse_mm"), 1e3 * score.at("images").at("ape_m").at("rmse").get<double>());
  // The sigmas are those of the worst direction.
  EXPECT_LT(score.at("images").at("ate_rmse_mm"), 1.5e3 * std::sqrt(variance_m2 / static_cast<double>(tracked)));
  EXPECT_LT(score.at("images").at("ate_rmse_mm"), 1);
  EXPECT_THAT(test::read_bytes(temp_ / "run/animation.gif"),
              testing::AllOf(testing::StartsWith("GIF89a"), testing::EndsWith(";")));
}

// The number of stacks along a path depends on the patterns that the pipeline requests.
TEST_F(ManyViews, AreCountedInContinuousMotion) {
  const json frames = run(scene("straight", repeated(kStep, 4)), "run",
                          {"--with", "trajectory.continuous.speed_m_s=0.03", "--no-report"});
  ASSERT_GT(frames.size(), 1u);
  EXPECT_EQ(read("run/score.json")["stacks"], frames.size());
  EXPECT_LE(read("run/score.json")["tracked"], frames.size());
}

// Predicted unwrapping (docs/method.md, section 3.2): three images where the map predicts the fringe orders, otherwise
// all nine.
TEST_F(ManyViews, TakeTheFinestFringesAloneWhereTheMapDeterminesTheirOrders) {
  // Rocks instead of boxes: on a bare table only the boxes' walls constrain the pose, but near walls the fringe order
  // cannot be predicted at first.
  const std::string here = scene("stones", repeated(kStep, 5));
  std::string text = test::read_bytes(temp_ / "stones/scene.yaml");
  text = test::replaced(test::replaced(text, "shape: box", "shape: rock"), "count: 12", "count: 20");
  test::write_bytes(temp_ / "stones/scene.yaml", text);
  const json frames = run(here, "run", {"--set", "decode.unwrapping=predicted"});
  std::vector<int> images;
  for (const json& frame : frames) images.push_back(frame["images"]);
  EXPECT_THAT(images, testing::ElementsAre(9, 9, 9, 3, 3, 3));
  EXPECT_EQ(frames[4]["unwrapping"], "predicted");
  const json score = read("run/score.json");
  EXPECT_EQ(score["tracked"], 6);
  EXPECT_LT(score["trajectory"]["ate_rmse_mm"], 0.05);
  for (const json& frame : score["frames"]) {
    EXPECT_LT(frame["wrong_order"], 1e-3);
    EXPECT_GT(frame["valid_fraction"], 0.6);
  }
  // A recording of all nine images works as well.
  run_successfully({"render", here, "--out", at("dataset"), "--quiet", "--set", "render.samples_per_pixel=1"});
  run_successfully({"run", at("dataset"), "--out", at("replayed"), "--quiet", "--set", "decode.unwrapping=predicted"});
  EXPECT_EQ(read("replayed/frames.json")[4]["images"], 3);
  EXPECT_LT(read("replayed/score.json")["trajectory"]["ate_rmse_mm"], 0.05);
}

TEST_F(ManyViews, LeaveASurfaceThatViewersOpen) {
  run(scene("straight", repeated(kStep, 2)), "run", {"--vdb"});
  EXPECT_THAT(test::read_bytes(temp_ / "run/mesh.ply"), testing::StartsWith("ply\nformat binary_little_endian 1.0\n"));
  const std::string glb = test::read_bytes(temp_ / "run/mesh.glb");
  EXPECT_THAT(glb, testing::StartsWith("glTF"));
  EXPECT_GT(glb.size(), 100000u);
  const std::string vdb = test::read_bytes(temp_ / "run/surface.vdb");
  EXPECT_THAT(vdb, testing::StartsWith(" BDV"));
  EXPECT_GT(vdb.size(), 100000u);
}

TEST_F(ManyViews, OneThatShowsNothingIsLostAndTheNextFoundAgain) {
  const std::string away = "    - {translation_mm: [3000, 0, 0], rotation_deg: [0, 0, 0]}\n";
  const std::string back = "    - {translation_mm: [-3000, 0, 0], rotation_deg: [0, 0, 0]}\n";
  const json frames = run(scene("away", repeated(kStep, 2) + away + back + kStep), "run");
  EXPECT_EQ(tracking(frames)[3], "lost");
  EXPECT_EQ(tracking(frames)[4], "refined");
  EXPECT_TRUE(frames[4].value("relocalized", false));
  EXPECT_FALSE(frames[5].value("relocalized", false));
  EXPECT_EQ(read("run/score.json")["tracked"], 5);
  EXPECT_LT(read("run/score.json")["trajectory"]["ate_rmse_mm"], 0.05);
  EXPECT_THAT(test::read_bytes(temp_ / "run/trajectory.tum"), testing::StartsWith("# lost: stacks 3\n"));
}

// The camera is upside down: it is either registered correctly or lost.
TEST_F(ManyViews, OneThatIsUpsideDownIsNotMistaken) {
  const json frames = run(scene("turned", "    - {translation_mm: [0, 0, 0], rotation_deg: [0, 0, 180]}\n"), "run");
  const json score = read("run/score.json");
  if (tracking(frames)[1] == "lost")
    EXPECT_EQ(score["tracked"], 1);
  else
    EXPECT_LT(score["trajectory"]["ate_rmse_mm"], 0.1);
}

TEST_F(ManyViews, IdenticalOnesDoNotFillTheMap) {
  const std::string still = "    - {translation_mm: [0, 0, 0], rotation_deg: [0, 0, 0]}\n";
  run(scene("one", still), "few", {"--save-map"});
  const json frames = run(scene("many", repeated(still, 6)), "more", {"--save-map"});
  EXPECT_LT(read("more/score.json")["trajectory"]["ate_rmse_mm"], 0.01);
  EXPECT_EQ(test::fs::file_size(temp_ / "few/saved.map"), test::fs::file_size(temp_ / "more/saved.map"));
  EXPECT_EQ(test::read_bytes(temp_ / "few/map.ply"), test::read_bytes(temp_ / "more/map.ply"));
}

// Views from a camera that takes all of them within about a millisecond: mapped views stay in order, the others are
// counted as dropped.
TEST_F(ManyViews, ThatComeTooFastInRealTimeAreDroppedAndCounted) {
  constexpr int kViews = 12;
  run_successfully({"render", scene("fast", repeated(kStep, kViews - 1)), "--out", at("images"), "--quiet", "--set",
                    "render.samples_per_pixel=1"});
  for (int i = 0; i < kViews; ++i) {
    char name[64];
    std::snprintf(name, sizeof name, "images/stacks/%06d/stack.yaml", i);
    const std::string text =
        std::regex_replace(test::read_bytes(temp_ / name), std::regex("exposure_time_s: .*\n"), "");
    test::write_bytes(temp_ / name, std::regex_replace(text, std::regex("timestamp_s: .*"),
                                                       "timestamp_s: " + std::to_string(1e-4 * i)));
  }
  // The ground truth has the times of the rendering.
  test::write_bytes(temp_ / "images/dataset.yaml",
                    test::replaced(test::read_bytes(temp_ / "images/dataset.yaml"), "truth: true", "truth: false"));
  const test::Finished finished =
      run_successfully({"run", at("images"), "--out", at("run"), "--real-time", "--json", "--no-report"});
  const int dropped = json::parse(finished.out)["dropped"];
  const json frames = read("run/frames.json");
  EXPECT_EQ(dropped + static_cast<int>(frames.size()), kViews);
  EXPECT_GE(frames.size(), 2u) << "waiting views are mapped at the end";
  EXPECT_EQ(frames.back()["index"], kViews - 1);
  for (size_t i = 1; i < frames.size(); ++i) EXPECT_GT(frames[i]["index"], frames[i - 1]["index"]);

  const json all = run(at("fast"), "slow");
  EXPECT_EQ(all.size(), static_cast<size_t>(kViews)) << "without --real-time no view is dropped";
}

TEST_F(ManyViews, GoOnInASavedMap) {
  run(scene("out", repeated(kStep, 3)), "before", {"--save-map"});
  const std::string saved = at("before/saved.map");
  // The second run follows the same path out and back; its poses must agree with the first run's.
  const std::string motions = repeated(kBack, 3);
  const std::string other = scene("back", repeated(kStep, 3) + motions);
  const json frames = run(other, "after", {"--map", saved});
  EXPECT_EQ(tracking(frames)[0], "refined");
  for (const json& frame : frames) EXPECT_NE(frame["tracking"], "lost");
  const Trajectory before = read_tum(temp_ / "before/trajectory.tum"), after = read_tum(temp_ / "after/trajectory.tum");
  ASSERT_EQ(after.size(), 7u);
  for (size_t i = 0; i < before.size(); ++i) {
    const Pose offset = before[i].world_from_robot.inverse() * after[i].world_from_robot;
    EXPECT_LT(translation_m(offset), 5e-5) << "view " << i;
  }
}

TEST_F(ManyViews, OfAnotherPlaceAreNotFoundInASavedMap) {
  const std::string here = scene("here", kStep);
  run(here, "before", {"--save-map"});
  const test::Finished finished = run_program({"run", here, "--seed", "77", "--out", at("elsewhere"), "--quiet",
                                               "--map", at("before/saved.map"), "--set", "render.samples_per_pixel=1"});
  EXPECT_EQ(finished.exit_code, 1);
  EXPECT_THAT(finished.err, HasSubstr(here + ": no view of 2 has a pose: none was found in " + at("before/saved.map")));
}

// The first view in the map has no predecessor that predicts its motion.
TEST_F(ManyViews, GoOnInASavedMapInMotion) {
  const std::string loop = std::string(FRINGESLAM_SOURCE_DIR) + "/scenes/loop";
  run(loop, "before", {"--views", "2", "--save-map", "--no-report"});
  const json frames = run(loop, "after",
                          {"--views", "3", "--map", at("before/saved.map"), "--with",
                           "trajectory.continuous.speed_m_s=0.3", "--no-report"});
  EXPECT_THAT(tracking(frames), testing::Each(testing::AnyOf("refined", "followed")));
  EXPECT_LT(read("after/score.json")["trajectory"]["ate_rmse_mm"], 0.3);
}

TEST_F(ManyViews, AFileThatIsNoMapIsRefused) {
  const std::string here = scene("scene", kStep);
  run(here, "run", {"--save-map"});
  const std::string map = test::read_bytes(temp_ / "run/saved.map");
  const auto refusal = [&](const std::string& bytes) {
    test::write_bytes(temp_ / "broken.map", bytes);
    const test::Finished finished = run_program({"run", here, "--out", at("refused"), "--map", at("broken.map")});
    EXPECT_EQ(finished.exit_code, 2);
    EXPECT_FALSE(test::fs::exists(temp_ / "refused"));
    EXPECT_THAT(finished.err, HasSubstr(at("broken.map") + ": "));
    return finished.err;
  };
  EXPECT_THAT(refusal(""), HasSubstr("is not a map"));
  EXPECT_THAT(refusal("solid cube"), HasSubstr("is not a map"));
  EXPECT_THAT(refusal("FringeSLAM map 9\n" + map.substr(17)), HasSubstr("another format version"));
  EXPECT_THAT(refusal(map.substr(0, 20)), HasSubstr("it is truncated"));
  EXPECT_THAT(refusal(map.substr(0, map.size() / 2)), HasSubstr("it is truncated"));
  std::string flipped = map;
  flipped[map.size() / 3] = static_cast<char>(flipped[map.size() / 3] ^ 1);
  EXPECT_THAT(refusal(flipped), HasSubstr("checksum"));

  test::write_bytes(temp_ / "scene/rig.yaml", to_yaml(test::thesis_rig_reduced(4)));
  EXPECT_THAT(refusal(map), HasSubstr("another camera"));
}

// The next view comes after more seconds than a clock can count. Neither a finished run nor one that fails waits for it.
TEST_F(ManyViews, ThatAreNotAwaitedInRealTimeDoNotHoldUpTheEnd) {
  constexpr int kViews = 3;
  run_successfully({"render", scene("paused", repeated(kStep, kViews - 1)), "--out", at("images"), "--quiet", "--set",
                    "render.samples_per_pixel=1"});
  test::write_bytes(temp_ / "images/dataset.yaml",
                    test::replaced(test::read_bytes(temp_ / "images/dataset.yaml"), "truth: true", "truth: false"));
  const auto put_at = [&](int view, const std::string& time_s) {
    const test::fs::path file = temp_ / ("images/stacks/00000" + std::to_string(view) + "/stack.yaml");
    const std::string text = std::regex_replace(test::read_bytes(file), std::regex("exposure_time_s: .*\n"), "");
    test::write_bytes(file, std::regex_replace(text, std::regex("timestamp_s: .*"), "timestamp_s: " + time_s));
  };
  put_at(0, "0"), put_at(1, "1e12"), put_at(2, "2e12");
  run_successfully({"run", at("images"), "--out", at("run"), "--real-time", "--views", "1", "--quiet", "--no-report"});
  EXPECT_EQ(read("run/frames.json").size(), 1u);
  put_at(1, "0");
  const test::Finished failed = run_program({"run", at("images"), "--out", at("none"), "--real-time", "--no-report"});
  EXPECT_EQ(failed.exit_code, 2);
  EXPECT_THAT(failed.err, HasSubstr("stack 1: its timestamp_s, 0, is not later than that of the stack before it"));
}

}  // namespace
}  // namespace fringeslam
