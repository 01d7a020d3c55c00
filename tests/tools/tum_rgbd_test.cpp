// SPDX-License-Identifier: Apache-2.0
// Reads a rendered folder in TUM RGB-D layout as another system does.
#include <gmock/gmock.h>

#include <cmath>
#include <iterator>
#include <nlohmann/json.hpp>
#include <sstream>

#include "core/io/files.h"
#include "core/io/tum_file.h"
#include "core/score/score.h"
#include "core/score/truth_files.h"
#include "tests/tools/child.h"

namespace fringeslam {
namespace {

using test::run_program;
using test::run_successfully;
using testing::HasSubstr;

class TumRgbd : public testing::Test {
 protected:
  void SetUp() override { test::write_small_scene(temp_ / "scene"); }
  std::string at(const std::string& name) const { return (temp_ / name).string(); }
  void render(const std::string& out, const std::vector<std::string>& more) const {
    std::vector<std::string> words = {
        "render", at("scene"), "--out", at(out), "--quiet", "--set", "render.samples_per_pixel=1"};
    words.insert(words.end(), more.begin(), more.end());
    run_successfully(words);
  }
  cv::Mat depth(const std::string& folder, const std::string& time) const {
    return read_grey(temp_ / folder / "depth" / (time + ".png"));
  }

  test::TempFolder temp_;
};

// Every pixel is correct to half a unit, and zero where `depth_m` has no depth.
void expect_depth(const cv::Mat& units, const cv::Mat1f& depth_m, double units_per_m) {
  ASSERT_EQ(units.type(), CV_16UC1);
  ASSERT_EQ(units.size(), depth_m.size());
  int known = 0, wrong = 0;
  for (int row = 0; row < units.rows; ++row) {
    for (int col = 0; col < units.cols; ++col) {
      const double expected = static_cast<double>(depth_m(row, col)) * units_per_m;
      const int value = units.at<uint16_t>(row, col);
      if (std::isnan(expected) || expected > 65535.5)
        wrong += value != 0;
      else
        wrong += !(std::abs(value - expected) <= 0.5);
      known += value > 0;
    }
  }
  EXPECT_EQ(wrong, 0);
  EXPECT_GT(known, units.rows * units.cols / 2);
}

TEST_F(TumRgbd, DepthIsTheTruthOrWhatTheSensorMeasuresToHalfAUnit) {
  render("data", {});
  render("true", {"--format", "tum-rgbd", "--depth", "truth", "--distorted"});
  render("measured", {"--format", "tum-rgbd", "--distorted", "--depth-scale", "20000"});
  run_successfully({"run", at("data"), "--out", at("run"), "--quiet"});
  for (const auto& [index, time] :
       {std::pair("000000", "0000000000.000000"), std::pair("000001", "0000000000.500000")}) {
    const std::string number = index;
    expect_depth(depth("true", time), read_truth_frame(temp_ / ("data/truth/" + number + ".exr")).depth_m, 5000);
    expect_depth(depth("measured", time), read_depth_estimate(temp_ / ("run/frames/" + number + "/depth.exr")).depth_m,
                 20000);
    // The texture has three equal channels.
    const cv::Mat texture = read_as_grey(temp_ / "measured/rgb" / (std::string(time) + ".png"), GreyFrom::green);
    EXPECT_EQ(cv::norm(texture, read_grey(temp_ / ("run/frames/" + number + "/texture.png")), cv::NORM_INF), 0);
    EXPECT_THAT(test::message_of([&, t = std::string(time)] { read_grey(temp_ / "measured/rgb" / (t + ".png")); }),
                HasSubstr("has 3 channels"));
  }
}

TEST_F(TumRgbd, DepthIsCompensatedForTheMotionDuringAView) {
  const auto render_moving = [&](const std::string& out, std::vector<std::string> more) {
    more.insert(more.end(), {"--format", "tum-rgbd", "--depth-scale", "20000", "--with",
                             "trajectory.while_capturing.velocity_mm_s=[0, 0, 100]"});
    render(out, more);
  };
  render_moving("true", {"--depth", "truth"});
  render_moving("measured", {});
  render_moving("as_if_at_rest", {"--set", "tracking.at_rest=true"});
  // Deviations from the true depth, in units of 0.05 mm.
  const auto errors_of = [&](const std::string& folder) {
    const std::string time = "0000000000.500000";
    const cv::Mat1w exact = depth("true", time), found = depth(folder, time);
    std::vector<double> errors;
    for (int i = 0; i < static_cast<int>(exact.total()); ++i) {
      if (exact(i) > 0 && found(i) > 0) errors.push_back(std::abs(found(i) - exact(i)));
    }
    return errors;
  };
  const std::vector<double> compensated = errors_of("measured"), at_rest = errors_of("as_if_at_rest");
  EXPECT_GT(compensated.size(), 20000u);
  EXPECT_GT(compensated.size(), 3 * at_rest.size());
  EXPECT_LT(median_of(compensated), 3);
}

// Returns the words of the lines that are not comments; expects `comments` comment lines.
std::vector<std::vector<std::string>> table(const test::fs::path& file, int comments) {
  std::istringstream lines(test::read_bytes(file));
  std::vector<std::vector<std::string>> rows;
  for (std::string line; std::getline(lines, line);) {
    if (line.starts_with("#")) {
      --comments;
      continue;
    }
    std::istringstream words(line);
    rows.emplace_back(std::istream_iterator<std::string>(words), std::istream_iterator<std::string>());
  }
  EXPECT_EQ(comments, 0) << file;
  return rows;
}

double value_of(const std::string& yaml, const std::string& key) {
  const size_t at = yaml.find(key + ": ");
  EXPECT_NE(at, std::string::npos) << key;
  return at == std::string::npos ? NAN : std::stod(yaml.substr(at + key.size() + 2));
}

// Points of one view, transformed to the next with groundtruth.txt and camera.yaml alone, match its depth.
TEST_F(TumRgbd, PosesCarryDepthFromViewToView) {
  for (const std::string depth_of : {"truth", "measured"}) {
    render("rgbd", {"--format", "tum-rgbd", "--depth", depth_of});
    const auto rows = table(temp_ / "rgbd/associations.txt", 0);
    ASSERT_EQ(rows.size(), 2u);
    ASSERT_EQ(rows[1].size(), 4u);
    EXPECT_EQ(rows[1][0], "0.500000");
    const cv::Mat1w first = read_grey(temp_ / "rgbd" / rows[0][3]), second = read_grey(temp_ / "rgbd" / rows[1][3]);
    const Trajectory camera = read_tum(temp_ / "rgbd/groundtruth.txt");
    ASSERT_EQ(camera.size(), 2u);
    const Pose second_from_first = camera[1].world_from_robot.inverse() * camera[0].world_from_robot;
    const std::string settings = test::read_bytes(temp_ / "rgbd/camera.yaml");
    const double fx = value_of(settings, "Camera1.fx"), fy = value_of(settings, "Camera1.fy"),
                 cx = value_of(settings, "Camera1.cx"), cy = value_of(settings, "Camera1.cy"),
                 factor = value_of(settings, "RGBD.DepthMapFactor");
    for (const char* key : {"Camera1.k1", "Camera1.k2", "Camera1.p1", "Camera1.p2", "Camera1.k3"})
      EXPECT_EQ(value_of(settings, key), 0);
    std::vector<double> off_m;
    for (int row = 0; row < first.rows; ++row) {
      for (int col = 0; col < first.cols; ++col) {
        if (first(row, col) == 0) continue;
        const double z = first(row, col) / factor;
        const Eigen::Vector3d there = second_from_first * Eigen::Vector3d((col - cx) / fx * z, (row - cy) / fy * z, z);
        const auto u = static_cast<int>(std::lround(fx * there.x() / there.z() + cx)),
                   v = static_cast<int>(std::lround(fy * there.y() / there.z() + cy));
        if (u < 0 || v < 0 || u >= second.cols || v >= second.rows || second(v, u) == 0) continue;
        off_m.push_back(std::abs(there.z() - second(v, u) / factor));
      }
    }
    ASSERT_GT(off_m.size(), first.total() / 2) << depth_of;
    // Tolerances: half a unit per image, the surface's slope over half a pixel, and noise.
    EXPECT_LT(median_of(off_m), 0.0005) << depth_of;
    EXPECT_LT(quantile_of(off_m, 0.8), 0.002) << depth_of;
  }
}

TEST_F(TumRgbd, ListsAndSettingsAreThoseOfTheBenchmark) {
  render("rgbd", {"--format", "tum-rgbd"});
  for (const std::string kind : {"rgb", "depth"}) {
    const auto rows = table(temp_ / "rgbd" / (kind + ".txt"), 3);
    ASSERT_EQ(rows.size(), 2u);
    EXPECT_EQ(rows[0], (std::vector<std::string>{"0.000000", kind + "/0000000000.000000.png"}));
    EXPECT_TRUE(test::fs::exists(temp_ / "rgbd" / rows[1][1]));
  }
  EXPECT_EQ(table(temp_ / "rgbd/groundtruth.txt", 3).size(), 2u);
  EXPECT_FALSE(test::fs::exists(temp_ / "rgbd/truth"));
  const RigModel rig = test::thesis_rig_reduced(2);
  const auto intrinsic = nlohmann::json::parse(test::read_bytes(temp_ / "rgbd/intrinsic.json"));
  EXPECT_EQ(intrinsic.at("intrinsic_matrix"),
            nlohmann::json({rig.camera.fx, 0, 0, 0, rig.camera.fy, 0, rig.camera.cx, rig.camera.cy, 1}));
  render("distorted", {"--format", "tum-rgbd", "--distorted"});
  const std::string settings = test::read_bytes(temp_ / "distorted/camera.yaml");
  EXPECT_EQ(value_of(settings, "Camera1.k1"), rig.camera.distortion.k1);
  EXPECT_EQ(value_of(settings, "Camera.width"), rig.camera.width);
  // The camera's true trajectory is scored against the folder.
  const test::Finished score =
      run_successfully({"score", at("rgbd/groundtruth.txt"), "--truth", at("rgbd"), "--align", "none", "--json"});
  EXPECT_EQ(nlohmann::json::parse(score.out).at("ape_m").at("max"), 0);
}

// A recorded dataset keeps its lens distortion.
TEST_F(TumRgbd, OfADataset) {
  render("data", {});
  run_successfully({"render", at("data"), "--out", at("rgbd"), "--format", "tum-rgbd", "--distorted", "--quiet"});
  render("direct", {"--format", "tum-rgbd", "--distorted"});
  EXPECT_EQ(test::listing(temp_ / "rgbd"), test::listing(temp_ / "direct"));
  for (const std::string& name : test::listing(temp_ / "direct")) {
    if (!test::fs::is_directory(temp_ / "direct" / name)) {
      EXPECT_EQ(test::read_bytes(temp_ / "rgbd" / name), test::read_bytes(temp_ / "direct" / name)) << name;
    }
  }
  const test::Finished refused = run_program({"render", at("data"), "--out", at("no"), "--format", "tum-rgbd"});
  EXPECT_EQ(refused.exit_code, 2);
  EXPECT_THAT(refused.err, HasSubstr("add --distorted"));
}

TEST_F(TumRgbd, NothingIsLeftOfWhatFails) {
  test::write_bytes(temp_ / "results/theirs/thesis.txt", "precious");
  for (const auto& [out, more, says] :
       {std::tuple("results/theirs", std::vector<std::string>{"--format", "tum-rgbd"}, "exists and was not written by"),
        std::tuple("results/a", std::vector<std::string>{"--format", "tum"}, "--format"),
        std::tuple("results/b", std::vector<std::string>{"--depth", "truth"}, "--depth"),
        std::tuple("results/c", std::vector<std::string>{"--format", "fringes", "--distorted"}, "has no effect"),
        std::tuple("results/d", std::vector<std::string>{"--format", "tum-rgbd", "--depth-scale", "50000"},
                   "--depth-scale: at 50000 units per meter, 16 bits end at 1.3107 m"),
        std::tuple("results/d", std::vector<std::string>{"--format", "tum-rgbd", "--depth-scale", "0"},
                   "--depth-scale"),
        std::tuple("results/e",
                   std::vector<std::string>{"--format", "tum-rgbd", "--set", "decode.unwrapping=predicted"},
                   "predicted")}) {
    std::vector<std::string> words = {"render", at("scene"), "--out", at(out)};
    words.insert(words.end(), more.begin(), more.end());
    const test::Finished finished = run_program(words);
    EXPECT_EQ(finished.exit_code, 2) << out;
    EXPECT_EQ(std::count(finished.err.begin(), finished.err.end(), '\n'), 1) << finished.err;
    EXPECT_THAT(finished.err, HasSubstr(says));
  }
  EXPECT_EQ(test::listing(temp_ / "results"), (std::set<std::string>{"theirs", "theirs/thesis.txt"}));
}

}  // namespace
}  // namespace fringeslam
