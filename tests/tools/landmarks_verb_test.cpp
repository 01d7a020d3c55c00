// SPDX-License-Identifier: Apache-2.0
// fringeslam landmarks: its output files, their reproducibility, and a scene without landmarks.
#include <gmock/gmock.h>

#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "core/io/files.h"
#include "tests/tools/child.h"

namespace fringeslam {
namespace {

using test::run_program;
using test::run_successfully;
namespace fs = std::filesystem;

std::string text_of(const fs::path& file) {
  std::ifstream in(file);
  std::stringstream text;
  text << in.rdbuf();
  return text.str();
}
nlohmann::json json_of(const fs::path& file) { return nlohmann::json::parse(text_of(file)); }

const std::string kScenes = std::string(FRINGESLAM_SOURCE_DIR) + "/scenes/";

TEST(LandmarksVerb, WritesPicturesAndTables) {
  const test::TempFolder temp;
  const fs::path out = temp / "out";
  run_successfully({"landmarks", kScenes + "face_mask", "--out", out.string(), "--set", "render.samples_per_pixel=1"});
  const nlohmann::json views = json_of(out / "landmarks.json");
  ASSERT_EQ(views.size(), 3U);
  int recognised = 0;
  for (const auto& landmark : views[1]["landmarks"]) {
    EXPECT_GE(landmark["keypoints"].get<int>(), 20);
    EXPECT_GE(landmark["outline_px"].size(), 3U);
    EXPECT_NEAR(landmark["centre_m"][2].get<double>(), 1.0, 0.3);
    if (!landmark.contains("recognised")) continue;
    ++recognised;
    EXPECT_EQ(landmark["recognised"]["keyframe"], 0);
    EXPECT_GE(landmark["recognised"]["matches"].get<int>(), 4);
  }
  EXPECT_GE(recognised, 2);
  for (const char* name : {"stages", "foreground", "edges", "dilated", "thinned", "cleaned", "clusters", "landmarks",
                           "texture_keypoints", "depth_keypoints", "matches"})
    EXPECT_TRUE(fs::exists(out / "frames/000001" / (std::string(name) + ".png"))) << name;
  std::istringstream table(text_of(out / "frames/000001/keypoints.csv"));
  std::string line;
  std::getline(table, line);
  EXPECT_EQ(line, "keypoint,x_px,y_px,depth_level,scale_px,orientation_rad,cluster,order,connections,samples");
  int rows = 0;
  while (std::getline(table, line)) {
    EXPECT_EQ(std::count(line.begin(), line.end(), ','), 9);
    ++rows;
  }
  EXPECT_EQ(rows, views[1]["depth_keypoints"]);
}

TEST(LandmarksVerb, ResultDoesNotDependOnTheNumberOfThreads) {
  const test::TempFolder temp;
  std::string first;
  for (const char* threads : {"1", "2"}) {
    const fs::path out = temp / threads;
    run_successfully({"--threads", threads, "landmarks", kScenes + "face_mask", "--out", out.string()});
    const std::string all = text_of(out / "landmarks.json") + text_of(out / "frames/000002/keypoints.csv") +
                            text_of(out / "frames/000001/matches.png");
    if (first.empty()) first = all;
    EXPECT_TRUE(all == first);
  }
}

TEST(LandmarksVerb, ABareBoardHasNone) {
  const test::TempFolder temp;
  const fs::path out = temp / "out";
  run_successfully({"landmarks", kScenes + "flat_board", "--out", out.string()});
  EXPECT_TRUE(json_of(out / "landmarks.json")[0]["landmarks"].empty());
}

}  // namespace
}  // namespace fringeslam
