// SPDX-License-Identifier: Apache-2.0
// Reads a rendered folder in EuRoC's layout as another system does.
#include "tools/euroc.h"

#include <gmock/gmock.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "core/io/files.h"
#include "core/io/tum_file.h"
#include "core/io/yaml.h"
#include "core/score/trajectory_file.h"
#include "core/score/truth_files.h"
#include "tests/tools/child.h"

namespace fringeslam {
namespace {

using test::run_program;
using test::run_successfully;
using testing::HasSubstr;

class Euroc : public testing::Test {
 protected:
  void SetUp() override { test::write_small_scene(temp_ / "scene"); }
  std::string at(const std::string& name) const { return (temp_ / name).string(); }
  void render(const std::string& out, const std::vector<std::string>& more) const {
    std::vector<std::string> words = {
        "render", at("scene"), "--out", at(out), "--quiet", "--set", "render.samples_per_pixel=1"};
    words.insert(words.end(), more.begin(), more.end());
    run_successfully(words);
  }
  test::TempFolder temp_;
};

const char* const kTimes[] = {"1000000000000000000", "1000000000500000000"};

TEST_F(Euroc, ImagesAreThoseOfTheTumLayout) {
  render("euroc", {"--format", "euroc", "--depth-scale", "20000"});
  render("tum", {"--format", "tum-rgbd", "--depth-scale", "20000"});
  for (const auto& [time, tum] :
       {std::pair(kTimes[0], "0000000000.000000.png"), std::pair(kTimes[1], "0000000000.500000.png")}) {
    const std::string name = std::string(time) + ".png";
    const cv::Mat texture = read_grey(temp_ / "euroc/mav0/cam0/data" / name),
                  depth = read_grey(temp_ / "euroc/mav0/depth0/data" / name);
    EXPECT_EQ(cv::norm(texture, read_as_grey(temp_ / "tum/rgb" / tum, GreyFrom::green), cv::NORM_INF), 0);
    EXPECT_EQ(cv::norm(depth, read_grey(temp_ / "tum/depth" / tum), cv::NORM_INF), 0);
  }
  for (const std::string sensor : {"cam0", "depth0"}) {
    EXPECT_EQ(test::read_bytes(temp_ / "euroc/mav0" / sensor / "data.csv"),
              "#timestamp [ns],filename\n1000000000000000000,1000000000000000000.png\n"
              "1000000000500000000,1000000000500000000.png\n");
    const YamlMap yaml = YamlMap::load(temp_ / "euroc/mav0" / sensor / "sensor.yaml");
    const RigModel rig = test::thesis_rig_reduced(2);
    EXPECT_EQ(yaml.numbers("resolution", 2, {0, 1e4}),
              (std::vector<double>{double(rig.camera.width), double(rig.camera.height)}));
    EXPECT_EQ(yaml.numbers("intrinsics", 4, {0, 1e4}),
              (std::vector<double>{rig.camera.fx, rig.camera.fy, rig.camera.cx, rig.camera.cy}));
    EXPECT_EQ(yaml.numbers("distortion_coefficients", 4, {-9, 9}), std::vector<double>(4, 0));
    EXPECT_EQ(yaml.number("rate_hz", {0, 1e4}), 2);
    if (sensor == "depth0") {
      EXPECT_EQ(yaml.number("units_per_m", {0, 1e6}), 20000);
    }
  }
  render("distorted", {"--format", "euroc", "--distorted"});
  const Distortion d = test::thesis_rig_reduced(2).camera.distortion;
  EXPECT_EQ(YamlMap::load(temp_ / "distorted/mav0/cam0/sensor.yaml").numbers("distortion_coefficients", 0, {-9, 9}),
            (std::vector<double>{d.k1, d.k2, d.p1, d.p2}));
}

TEST_F(Euroc, TruthIsThatOfTheCamera) {
  render("euroc", {"--format", "euroc"});
  render("tum", {"--format", "tum-rgbd"});
  const Trajectory truth = read_trajectory(temp_ / "euroc" / tools::kEurocTruthFile),
                   tum = read_tum(temp_ / "tum/groundtruth.txt");
  ASSERT_EQ(truth.size(), tum.size());
  for (size_t i = 0; i < truth.size(); ++i) {
    EXPECT_EQ(truth[i].timestamp_s, tum[i].timestamp_s + 1e9);
    EXPECT_LT(difference(truth[i].world_from_robot, tum[i].world_from_robot).norm(), 1e-9);
  }
  // `score` accepts the folder as truth.
  const test::Finished score = run_successfully({"score", at("euroc/mav0/state_groundtruth_estimate0/data.csv"),
                                                 "--truth", at("euroc"), "--align", "none", "--json"});
  EXPECT_EQ(nlohmann::json::parse(score.out).at("ape_m").at("max"), 0);
}

TEST_F(Euroc, EvaluationHidesTheTruth) {
  test::write_bytes(temp_ / "suite.yaml", "datasets:\n  - {name: small, scene: scene, seeds: 1}\n");
  const test::Finished finished = run_successfully(
      {"evaluate", at("suite.yaml"), "--name", "a", "--format", "euroc", "--out", at("out"), "--json", "--with",
       "find {dataset} > {out}/../files; cp {dataset}/../truth/groundtruth.txt {out}/trajectory.txt"});
  EXPECT_LT(nlohmann::json::parse(finished.out).at("results").at(0).at("ate_m").get<double>(), 1e-9);
  const std::string files = test::read_bytes(temp_ / "out/outputs/a/suite/small-1/files");
  EXPECT_THAT(files, HasSubstr("mav0/cam0/data/1000000000500000000.png"));
  for (const char* hidden : {"groundtruth", "resolved_scene", "render.yaml", "truth.tum"})
    EXPECT_THAT(files, testing::Not(HasSubstr(hidden)));
}

}  // namespace
}  // namespace fringeslam
