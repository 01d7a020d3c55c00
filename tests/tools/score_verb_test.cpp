// SPDX-License-Identifier: Apache-2.0
// Scores trajectories and maps of other systems on the command line.
#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <sstream>

#include "core/io/ply.h"
#include "core/io/tum_file.h"
#include "core/score/trajectory_score.h"
#include "core/score/truth_files.h"
#include "tests/tools/child.h"

namespace fringeslam {
namespace {

using nlohmann::json;
using test::run_program;
using test::run_successfully;
using testing::HasSubstr;

constexpr const char* kMoreMotions =
    "    - {translation_mm: [10, 5, -5], rotation_deg: [3, 1, -2]}\n"
    "    - {translation_mm: [-10, 15, 5], rotation_deg: [0, 2, 1]}\n"
    "    - {translation_mm: [5, -10, 10], rotation_deg: [-2, 0, 1]}\n";

class Score : public testing::Test {
 protected:
  std::string at(const std::string& name) const { return (temp_ / name).string(); }
  std::string file(const std::string& name, const std::string& text) const {
    test::write_bytes(temp_ / name, text);
    return at(name);
  }
  // Writes the small scene with four views that are not collinear, and its true surface as a mesh.
  void make_world() const {
    test::write_small_scene(temp_ / "scene");
    const std::string text(test::kSmallScene);
    file("scene/scene.yaml", text.substr(0, text.find("    - {translation_mm")) + kMoreMotions);
    run_successfully({"scene", "export", at("scene"), "--out", at("world.ply"), "--quiet"});
  }
  json score(std::vector<std::string> words) const {
    words.insert(words.begin(), {"score", "--json"});
    const json result = json::parse(run_successfully(words).out, nullptr, false);
    EXPECT_FALSE(result.is_discarded());
    return result;
  }
  void expect_refused(std::vector<std::string> words, const std::string& says) const {
    words.insert(words.begin(), "score");
    const test::Finished finished = run_program(words);
    EXPECT_EQ(finished.exit_code, 2);
    EXPECT_EQ(finished.out, "");
    EXPECT_EQ(std::count(finished.err.begin(), finished.err.end(), '\n'), 1) << finished.err;
    EXPECT_THAT(finished.err, HasSubstr(says));
  }

  test::TempFolder temp_;
};

void expect_perfect(const json& score) {
  EXPECT_EQ(score.at("f_score"), 1);
  EXPECT_LT(score.at("accuracy_mm").at("rms"), 1e-4);
  EXPECT_LT(score.at("completeness_mm").at("rms"), 1e-3);
  EXPECT_GT(score.at("completeness_mm").at("points"), 3000);
}

std::string ascii_ply(const PlyMap& map) {
  std::ostringstream text;
  text.precision(17);
  text << "ply\nformat ascii 1.0\nelement vertex " << map.vertices.size()
       << "\nproperty double x\nproperty double y\nproperty double z\nelement face " << map.triangles.size()
       << "\nproperty list uchar int vertex_indices\nend_header\n";
  for (const Eigen::Vector3d& v : map.vertices) text << v.x() << ' ' << v.y() << ' ' << v.z() << '\n';
  for (const Eigen::Vector3i& t : map.triangles) text << "3 " << t.x() << ' ' << t.y() << ' ' << t.z() << '\n';
  return text.str();
}

// Returns the surface points seen by all pixels of a dataset's views.
PlyMap true_cloud(const test::fs::path& data) {
  const RigModel rig = read_rig(data / "rig.yaml");
  const PixelRays rays = pixel_rays(rig.camera);
  const Trajectory trajectory = read_tum(data / "truth/truth.tum");
  PlyMap cloud;
  for (size_t i = 0; i < trajectory.size(); ++i) {
    const cv::Mat1f depth_m = read_truth_frame(data / "truth" / (stack_name(static_cast<int>(i)) + ".exr")).depth_m;
    const Pose world_from_camera = trajectory[i].world_from_robot * rig.robot_from_camera;
    for (int row = 0; row < depth_m.rows; ++row) {
      for (int col = 0; col < depth_m.cols; ++col) {
        const double z = depth_m(row, col), x = rays(row, col)[0], y = rays(row, col)[1];
        if (z > 0) cloud.vertices.push_back(world_from_camera * Eigen::Vector3d(x * z, y * z, z));
      }
    }
  }
  return cloud;
}

// A victim that only a view without a pose shows counts as not found.
TEST_F(Score, VictimsOfLostViewsAreMissed) {
  test::write_small_scene(temp_ / "scene");
  file("scene/rig.yaml",
       test::read_bytes(temp_ / "scene/rig.yaml") +
           "thermal: {width_px: 160, height_px: 120, fx_px: 130, fy_px: 130, cx_px: 79.5, cy_px: 59.5, netd_k: 0.05, "
           "range_c: [-40, 330], thermal_from_camera: {translation_m: [0.05, 0, 0], rotation_deg: [0, 0, 0]}}\n");
  std::string text(test::kSmallScene);
  text.replace(text.find("objects:\n"), 9,
               "  skin: {grain: stone, albedo: 0.5, temperature_c: 34, emissivity: 0.98, victim: true}\n"
               "objects:\n"
               "  - {shape: box, size_m: [0.08, 0.08, 0.04], material: skin, pose: {translation_m: [0.2, 0, 0.02]}}\n");
  text.resize(text.find("    - {translation_mm"));
  file("scene/scene.yaml", text + "    - {translation_mm: [150, 0, 0], rotation_deg: [0, 0, 0]}\n");
  run_successfully({"run", at("scene"), "--out", at("run"), "--set", "render.samples_per_pixel=1", "--quiet"});
  const std::string poses = test::read_bytes(temp_ / "run/trajectory.tum");
  file("run/trajectory.tum", poses.substr(0, poses.find('\n') + 1));
  const json victims = score({at("run")}).at("victims");
  EXPECT_EQ(victims.at("to_find"), 1);
  EXPECT_EQ(victims.at("recall"), 0);
  // Once no stack of the run shows it, it need not be found.
  test::fs::remove(temp_ / "run/truth/000001.exr");
  EXPECT_EQ(score({at("run")}).at("victims").at("to_find"), 0);
}

TEST_F(Score, TheTrueSurfaceIsAPerfectMapForEachSourceOfTruth) {
  make_world();
  const json of_scene = score({at("world.ply"), "--truth", at("scene")});
  expect_perfect(of_scene);
  const std::vector<std::string> fast = {"--set", "render.samples_per_pixel=1", "--quiet"};
  const auto rendered = [&](std::vector<std::string> words) {
    words.insert(words.end(), fast.begin(), fast.end());
    run_successfully(words);
  };
  rendered({"render", at("scene"), "--out", at("data")});
  rendered({"run", at("scene"), "--out", at("elsewhere/run")});
  rendered({"render", at("scene"), "--out", at("deep/er/rgbd"), "--format", "tum-rgbd"});
  EXPECT_EQ(score({at("world.ply"), "--truth", at("data")}), of_scene);
  EXPECT_EQ(score({at("world.ply"), "--truth", at("elsewhere/run")}), of_scene);
  expect_perfect(score({at("world.ply"), "--truth", at("deep/er/rgbd")}));
  expect_perfect(score({file("cloud.ply", ascii_ply(true_cloud(temp_ / "data"))), "--truth", at("scene")}));
  // The run's own map is in the frame of the first view.
  const json own = score({at("elsewhere/run/mesh.ply"), "--truth", at("elsewhere/run"), "--trajectory",
                          at("elsewhere/run/trajectory.tum")});
  EXPECT_GT(own.at("precision"), 0.95);
  EXPECT_GT(own.at("recall"), 0.9);
  EXPECT_LT(own.at("accuracy_mm").at("median"), 0.2);
}

TEST_F(Score, SurfaceOfViewsThatWereNotTakenNeedNotBeFound) {
  make_world();
  const std::string fast = "render.samples_per_pixel=1";
  run_successfully({"render", at("scene"), "--out", at("data"), "--quiet", "--set", fast});
  run_successfully(
      {"run", at("scene"), "--out", at("of_scene"), "--views", "1", "--no-report", "--quiet", "--set", fast});
  run_successfully({"run", at("data"), "--out", at("of_data"), "--views", "1", "--no-report", "--quiet"});
  const auto seen_points = [&](const std::string& truth) {
    return score({at("world.ply"), "--truth", at(truth)}).at("completeness_mm").at("points").get<size_t>();
  };
  const size_t of_all = seen_points("data"), of_one = seen_points("of_scene");
  EXPECT_GT(of_one, 100u);
  EXPECT_LT(of_one, of_all / 2);
  EXPECT_EQ(seen_points("of_data"), of_one);
  std::string info = test::read_bytes(temp_ / "data/dataset.yaml");
  info.replace(info.find("stacks: 4"), 9, "stacks: 1");
  file("data/dataset.yaml", info);
  EXPECT_EQ(seen_points("data"), of_one);
}

TEST_F(Score, DistancesOfAPointAreThoseToTheFloor) {
  make_world();
  // Far from the boxes the floor is the nearest surface; the three points are 0, 1 and 4 mm above it.
  const std::string cloud =
      "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty "
      "float z\nend_header\n0.39 0.39 0\n0.39 0.38 0.001\n0.38 0.38 0.004\n";
  const json score_of_cloud = score({file("cloud.ply", cloud), "--truth", at("scene"), "--threshold", "0.002"});
  EXPECT_EQ(score_of_cloud.at("accuracy_mm").at("points"), 3);
  EXPECT_NEAR(score_of_cloud.at("accuracy_mm").at("mean"), 5.0 / 3, 1e-5);
  EXPECT_NEAR(score_of_cloud.at("accuracy_mm").at("median"), 1, 1e-5);
  EXPECT_NEAR(score_of_cloud.at("accuracy_mm").at("p90"), 1 + 0.8 * 3, 1e-5);
  EXPECT_NEAR(score_of_cloud.at("accuracy_mm").at("rms"), std::sqrt(17.0 / 3), 1e-5);
  EXPECT_DOUBLE_EQ(score_of_cloud.at("precision"), 2.0 / 3);
  EXPECT_EQ(score_of_cloud.at("recall"), 0);
}

// The other system's world frame is rotated, translated and scaled; its trajectory determines the alignment.
TEST_F(Score, AMapIsAlignedByItsTrajectory) {
  make_world();
  run_successfully({"render", at("scene"), "--out", at("data"), "--set", "render.samples_per_pixel=1", "--quiet"});
  const Similarity theirs{3.7, {rotation_exp({0.3, -2, 0.4}), {5, -3, 2}}};
  PlyMap map = read_ply(temp_ / "world.ply");
  for (Eigen::Vector3d& vertex : map.vertices) vertex = theirs * vertex;
  Trajectory trajectory = read_tum(temp_ / "data/truth/truth.tum");
  for (TimedPose& pose : trajectory) pose.world_from_robot = theirs * pose.world_from_robot;
  const std::string mesh = file("theirs.ply", ascii_ply(map)), path = file("theirs.tum", to_tum(trajectory));
  const json aligned = score({mesh, "--truth", at("scene"), "--trajectory", path, "--align", "sim3"});
  expect_perfect(aligned);
  EXPECT_NEAR(aligned.at("scale"), 1 / 3.7, 1e-9);
  EXPECT_LT(score({mesh, "--truth", at("scene"), "--trajectory", path, "--align", "se3"}).at("f_score"), 0.1);
  EXPECT_LT(score({mesh, "--truth", at("scene")}).at("f_score"), 0.1);
}

TEST_F(Score, ATrajectoryOfAnotherFormatAndWorld) {
  // A square of 2 m, estimated 1.25 times too large, as in trajectory_score_test.cpp.
  const std::string truth = file("truth.csv",
                                 "#timestamp,x,y,z,qw,qx,qy,qz,vx\n0,1,1,0,1,0,0,0,9\n"
                                 "1000000000,-1,1,0,1,0,0,0,9\n2000000000,-1,-1,0,1,0,0,0,9\n"
                                 "3000000000,1,-1,0,1,0,0,0,9\n");
  const std::string estimate = file("estimate.txt",
                                    "0.004 1.25 1.25 0 0 0 0 1\n1.004 -1.25 1.25 0 0 0 0 1\n"
                                    "2.004 -1.25 -1.25 0 0 0 0 1\n3.004 1.25 -1.25 0 0 0 0 1\n");
  const json se3 = score({estimate, "--truth", truth, "--align", "se3"});
  EXPECT_NEAR(se3.at("ape_m").at("rmse"), 0.25 * std::sqrt(2.0), 1e-12);
  EXPECT_NEAR(se3.at("rpe_translation_m").at("mean"), 0.5, 1e-12);
  EXPECT_NEAR(score({estimate, "--truth", truth, "--align", "sim3"}).at("ape_m").at("max"), 0, 1e-12);
  const json steps = score({estimate, "--truth", truth, "--delta", "2", "--all-pairs", "--relation", "full"});
  EXPECT_EQ(steps.at("steps"), 2);
  EXPECT_NEAR(steps.at("rpe_translation_m").at("mean"), 0.5 * std::sqrt(2.0), 1e-12);
  expect_refused({estimate, "--truth", truth, "--max-gap", "0.003"}, "only 0 poses");
  EXPECT_THAT(run_successfully({"score", estimate, "--truth", truth, "--align", "sim3"}).out, HasSubstr("scale 0.8"));
}

TEST_F(Score, ARunIsScoredWithTheSameOptionsAsItsTrajectory) {
  make_world();
  run_successfully({"run", at("scene"), "--out", at("run"), "--set", "render.samples_per_pixel=1", "--quiet"});
  const std::string trajectory = at("run/trajectory.tum"), truth = at("run/truth/truth.tum");
  for (const std::vector<std::string>& options : std::vector<std::vector<std::string>>{
           {}, {"--align", "se3"}, {"--relation", "full", "--delta", "2", "--all-pairs"}}) {
    std::vector<std::string> of_run = {at("run")}, of_trajectory = {trajectory, "--truth", truth};
    of_run.insert(of_run.end(), options.begin(), options.end());
    of_trajectory.insert(of_trajectory.end(), options.begin(), options.end());
    EXPECT_EQ(score(of_run).at("trajectory"), score(of_trajectory));
    of_run.insert(of_run.begin(), "score");
    const std::string table = run_successfully(of_run).out;
    EXPECT_THAT(table, HasSubstr("trajectory of 4 poses: ATE "));
    EXPECT_EQ(table.find("APE") != std::string::npos, !options.empty()) << table;
  }
  expect_refused({at("run"), "--truth", truth}, "its own ground truth; leave out --truth");
  expect_refused({at("run"), "--threshold", "1"}, "--threshold has no effect on a trajectory");
}

TEST_F(Score, UnscorableInput) {
  const std::string tum = file("good.tum", "0 0 0 0 0 0 0 1\n1 1 0 0 0 0 0 1\n");
  const std::string csv = file("bad.csv", "#t\n0,0,0,0,1,0,0,0\n1000000000,0,0,0,1,0,0\n");
  const std::string head =
      "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\n";
  const std::string bad = file("bad.ply", head + "end_header\n0 0 0\n0 0 zero\n");
  const std::string good = file("good.ply", head + "end_header\n0 0 0\n0 0 1\n");
  test::fs::create_directory(temp_ / "empty");
  expect_refused({csv, "--truth", tum}, csv + ":3: needs eight finite numbers");
  expect_refused({bad, "--truth", at("scene")}, bad + ":9: ");
  const std::string none = file("none.ply", head + "end_header\nnan 0 0\n0 0 inf\n");
  expect_refused({none, "--truth", at("scene")}, none + ": contains no finite vertex");
  expect_refused({good}, "add --truth SCENE");
  expect_refused({good, "--truth", at("nowhere")}, at("nowhere") + ": does not exist");
  expect_refused({good, "--truth", at("empty")}, at("empty") + ": contains neither");
  expect_refused({good, "--truth", at("empty"), "--delta", "2"}, "--delta has no effect on a map");
  expect_refused({good, "--truth", at("empty"), "--align", "se3"}, "add --trajectory");
  expect_refused({good, "--truth", at("empty"), "--max-gap", "1"}, "--max-gap has no effect on a map without");
  expect_refused({tum, "--truth", tum, "--threshold", "1"}, "--threshold has no effect on a trajectory");
  expect_refused({tum, "--truth", at("empty")}, at("empty") + ": contains neither");
  expect_refused({tum, "--truth", tum, "--align", "sim4"}, "--align");
  expect_refused({tum, "--truth", tum, "--align", "se3", "--relation", "full"}, "collinear positions");
  expect_refused({tum, "--truth", tum, "--delta", "5"}, "no two of 2 associated poses are 5 frames apart");
}

// A run has a trajectory.tum and a mesh.ply of its own, which must not be taken for those of its scene.
TEST_F(Score, AFolderHasTheTruthOfItsSceneForAnyNamesOfItsFiles) {
  make_world();
  PlyMap pyramid;
  pyramid.vertices = {{-0.1, -0.1, 0}, {0.1, -0.1, 0}, {0, 0.1, 0}, {0, 0, 0.1}};
  pyramid.triangles = {{0, 1, 3}, {1, 2, 3}, {2, 0, 3}};
  file("scene/mesh.ply", ascii_ply(pyramid));
  file("scene/trajectory.tum", "0 0.03 -0.02 0 0 0 0 1\n0.5 0.05 0 0 0 0 0 1\n");
  const std::string text = test::replaced(test::kSmallScene, "objects:\n",
                                          "objects:\n  - {shape: mesh, file: mesh.ply, unit_m: 1, up: z}\n");
  file("scene/scene.yaml", text.substr(0, text.find("trajectory:")) + "trajectory: {file: trajectory.tum}\n");
  run_successfully({"scene", "export", at("scene"), "--out", at("world.ply"), "--quiet"});
  const std::vector<std::string> fast = {"--set", "render.samples_per_pixel=1", "--quiet"};
  run_successfully({"render", at("scene"), "--out", at("data"), fast[0], fast[1], fast[2]});
  run_successfully({"run", at("data"), "--out", at("deep/er/run"), "--no-report", "--quiet"});
  const json of_scene = score({at("world.ply"), "--truth", at("scene")});
  expect_perfect(of_scene);
  for (const char* folder : {"data", "deep/er/run"})
    EXPECT_EQ(score({at("world.ply"), "--truth", at(folder)}), of_scene) << folder;
  EXPECT_LT(score({at("deep/er/run/mesh.ply"), "--truth", at("deep/er/run")}).at("f_score"), 1);
  // Elsewhere, it needs the scene's files.
  test::fs::rename(temp_ / "scene/mesh.ply", temp_ / "scene/other.ply");
  expect_refused({at("world.ply"), "--truth", at("deep/er/run")}, at("scene/mesh.ply") + " does not exist");
}

// The pipeline's calibration may be wrong; the images are those of the scene's rig.
TEST_F(Score, TheTrueSurfaceIsThatOfTheRigThatTookTheImages) {
  make_world();
  const std::string text = test::read_bytes(temp_ / "scene/scene.yaml");
  const std::vector<std::string> fast = {"--set", "render.samples_per_pixel=1", "--quiet"};
  const json right = score({at("world.ply"), "--truth", at("scene")});
  file("scene/scene.yaml", text + "calibration_error: {focal_percent: 10}\n");
  run_successfully({"render", at("scene"), "--out", at("data"), fast[0], fast[1], fast[2]});
  EXPECT_EQ(score({at("world.ply"), "--truth", at("data")}), right);
  // Texture and depth images have no lens distortion, even if the scene overrides that of its rig file. The share of the seen
  // surface that lies on a part of the floor depends on the lens.
  PlyMap part;
  part.vertices = {{-0.12, -0.12, 0}, {0.12, -0.12, 0}, {0.12, 0.12, 0}, {-0.12, 0.12, 0}};
  part.triangles = {{0, 1, 2}, {0, 2, 3}};
  file("part.ply", ascii_ply(part));
  const auto seen_share = [&](const std::string& folder) {
    return score({at("part.ply"), "--truth", at(folder)}).at("recall").get<double>();
  };
  const auto with_distortion = [&](const std::string& k1) {
    const std::string rig = "  file: rig.yaml\n";
    file("scene/scene.yaml", test::replaced(text, rig, rig + "  camera: {distortion: [" + k1 + ", 0, 0, 0, 0]}\n"));
    return seen_share("scene");
  };
  const double straight = with_distortion("0"), bent = with_distortion("-5");
  EXPECT_GT(std::abs(bent - straight), 0.05);
  run_successfully({"render", at("scene"), "--out", at("rgbd"), "--format", "tum-rgbd", fast[0], fast[1], fast[2]});
  EXPECT_NEAR(seen_share("rgbd"), straight, 0.002);
  run_successfully({"render", at("scene"), "--out", at("bent"), fast[0], fast[1], fast[2]});
  EXPECT_EQ(seen_share("bent"), bent);
}

}  // namespace
}  // namespace fringeslam
