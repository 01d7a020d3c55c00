// SPDX-License-Identifier: Apache-2.0
// The parts of a scene file: included files, trajectories, piles.
#include <gmock/gmock.h>
#include <sys/stat.h>

#include <chrono>
#include <cmath>
#include <cstdlib>
#include <set>

#include "sim/scene/cache.h"
#include "sim/scene/pile.h"
#include "sim/scene/scene.h"
#include "tests/support/matchers.h"
#include "tests/support/temp_folder.h"

namespace fringeslam::sim {
namespace {

using support::error_of;
using testing::HasSubstr;

const std::string kHead = "name: world\nrig: {file: " FRINGESLAM_SOURCE_DIR
                          "/scenes/rigs/thesis.yaml}\npatterns: {steps: 3, periods_px: [16.5]}\n";
const std::string kMaterials = "materials: {grey: {grain: plain, albedo: 0.5}}\n";
const std::string kBoard = "objects: [{shape: plane, size_m: [1, 1], material: grey}]\n";

class SceneParts : public testing::Test {
 protected:
  void SetUp() override { setenv("FRINGESLAM_CACHE", (temp_ / "cache").c_str(), 1); }
  void TearDown() override { unsetenv("FRINGESLAM_CACHE"); }
  std::filesystem::path file(const std::string& name, const std::string& text) const {
    test::write_bytes(temp_ / name, text);
    return temp_ / name;
  }
  Scene scene(const std::string& text) const { return load_scene(file("scene.yaml", text)); }
  Trajectory route(const std::string& trajectory) const {
    return scene(kHead + kMaterials + kBoard + "trajectory: " + trajectory + "\n").trajectory;
  }
  test::TempFolder temp_;
};

// --- the cache ---

// Writing to the pipe would wait for a reader forever.
TEST_F(SceneParts, APipeInTheCacheIsReplaced) {
  const std::filesystem::path pile = cache_folder() / "baked" / content_hash("pile"),
                              texture = cache_folder() / "textures/wall.png";
  for (const std::filesystem::path& entry : {pile, texture}) {
    std::filesystem::create_directories(entry.parent_path());
    ASSERT_EQ(mkfifo(entry.c_str(), 0600), 0);
  }
  EXPECT_TRUE(store("pile", "settled"));
  EXPECT_EQ(cached("pile"), "settled");
  EXPECT_EQ(test::read_bytes(cached_file("textures/wall.png", "image")), "image");
}

// --- included files ---

TEST_F(SceneParts, IncludedFilesAddObjectsAndMaterialsAndLendSections) {
  file("common/base.yaml", kHead + "light: {ambient_lux: 30}\n" + kMaterials + kBoard);
  const auto path = file("mine/scene.yaml",
                         "name: mine\ninclude: ../common/base.yaml\nmaterials: {dark: {grain: plain, albedo: 0.1}}\n"
                         "objects: [{shape: sphere, radius_m: 0.1, material: dark}]\ntrajectory: {}\n");
  const Scene read = load_scene(path);
  EXPECT_EQ(read.name, "mine");
  EXPECT_EQ(read.ambient_lux, 30);
  ASSERT_EQ(read.objects.size(), 2u);  // the including file's first
  EXPECT_EQ(read.objects[0].material.albedo, 0.1);
  EXPECT_EQ(read.objects[1].material.albedo, 0.5);

  const Scene brighter = load_scene(file("mine/scene.yaml",
                                         "name: mine\ninclude: [../common/base.yaml]\nlight: {ambient_lux: 90}\n"
                                         "materials: {grey: {grain: plain, albedo: 0.7}}\ntrajectory: {}\n"));
  EXPECT_EQ(brighter.ambient_lux, 90);
  EXPECT_EQ(brighter.objects.at(0).material.albedo, 0.7);  // the including file takes precedence
}

TEST_F(SceneParts, ErrorsNameTheFileThatTheyAreIn) {
  file("base.yaml", kHead + kMaterials + "objects:\n  - {shape: plane, size_m: [1], material: grey}\n");
  const auto path = file("scene.yaml", "name: mine\ninclude: base.yaml\ntrajectory: {}\n");
  EXPECT_THAT(error_of([&] { load_scene(path); }), testing::StartsWith((temp_ / "base.yaml").string() + ":6: "));
  file("base.yaml", kHead + kMaterials + kBoard + "surplus: 1\n");
  EXPECT_THAT(error_of([&] { load_scene(path); }), HasSubstr("base.yaml:6: unknown key 'surplus'"));
  file("scene.yaml", "name: mine\ninclude: none.yaml\ntrajectory: {}\n");
  EXPECT_THAT(error_of([&] { load_scene(path); }), HasSubstr("scene.yaml:2: "));
}

TEST_F(SceneParts, FilesThatIncludeOneAnotherAreReadOnce) {
  file("a.yaml", "include: [b.yaml, scene.yaml]\n" + kMaterials);
  file("b.yaml", "include: a.yaml\n" + kBoard);
  EXPECT_EQ(scene(kHead + "include: [a.yaml, b.yaml]\ntrajectory: {}\n").objects.size(), 1u);
}

// The resolved scene is an equivalent single file, with the seed and the values drawn in included files.
TEST_F(SceneParts, TheResolvedSceneNeedsNoIncludes) {
  file("common/base.yaml", kHead + "materials: {grey: {grain: plain, albedo: {uniform: [0.1, 0.9]}}}\n" + kBoard);
  const auto path =
      file("mine/scene.yaml",
           "name: mine\ninclude: ../common/base.yaml\ndescription: \"two: lines\"\n"
           "objects:\n  - shape: rock\n    size_m: [0.1, 0.1, {uniform: [0.05, 0.2]}]\n    material: grey\n"
           "trajectory:\n  motions:\n    - {translation_mm: [1, 2, 3], rotation_deg: [0, 0, 0]}\n");
  const Scene drawn = load_scene(path, {77, nullptr, temp_ / "elsewhere/deep"});
  const Scene read = load_scene(file("elsewhere/deep/scene.yaml", drawn.resolved));
  EXPECT_EQ(read.seed, 77u);
  ASSERT_EQ(read.objects.size(), drawn.objects.size());
  for (size_t i = 0; i < read.objects.size(); ++i) {
    EXPECT_EQ(read.objects[i].mesh->vertices, drawn.objects[i].mesh->vertices);
    EXPECT_EQ(read.objects[i].material.albedo, drawn.objects[i].material.albedo);
    EXPECT_EQ(read.objects[i].texture_seed, drawn.objects[i].texture_seed);
  }
  EXPECT_EQ(to_tum(read.trajectory), to_tum(drawn.trajectory));
  EXPECT_EQ(drawn.resolved.find("include"), std::string::npos);
}

TEST_F(SceneParts, AllErrorsInOneReading) {
  const auto path = file("scene.yaml", kHead +
                                           "materials: {a: {grain: wod, albedo: 2}}\nobjects:\n"
                                           "  - {shape: box, size_m: [1, 1], material: b}\n  - {shape: egg}\n"
                                           "  - {shape: box, size_m: [1, 1, 1], material: a, colour: red}\n");
  std::vector<std::string> errors;
  load_scene(path, {{}, &errors});
  const std::string at = path.string();
  EXPECT_THAT(errors, testing::UnorderedElementsAre(
                          HasSubstr(at + ":4: 'grain: wod' is not one of"), HasSubstr(at + ":4: 'albedo' is 2"),
                          HasSubstr(at + ":6: 'size_m' must be a list of 3"), HasSubstr(at + ":6: 'material: b'"),
                          HasSubstr(at + ":7: 'shape: egg'"), HasSubstr(at + ":8: unknown key 'colour'"),
                          HasSubstr("'trajectory' is missing")));
  // Reading without error collection throws the first of them.
  EXPECT_EQ(error_of([&] { load_scene(path); }), errors.front());
}

// --- trajectories ---

TEST_F(SceneParts, PosesAreGivenForTheRobotOrByWhatItsCameraSees) {
  const Trajectory poses =
      route("{interval_s: 2, poses: [{translation_m: [1, 2, 3]}, {camera_m: [0, 0, 1], look_at_m: [0, 1, 0]}]}");
  ASSERT_EQ(poses.size(), 2u);
  EXPECT_EQ(poses[0].world_from_robot.translation, Eigen::Vector3d(1, 2, 3));
  EXPECT_EQ(poses[1].timestamp_s, 2);
  const RigModel rig = scene(kHead + kMaterials + kBoard + "trajectory: {}\n").rig;
  const Pose world_from_camera = poses[1].world_from_robot * rig.robot_from_camera;
  EXPECT_NEAR((world_from_camera.translation - Eigen::Vector3d(0, 0, 1)).norm(), 0, 1e-12);
  EXPECT_NEAR((world_from_camera.inverse() * Eigen::Vector3d(0, 1, 0)).head<2>().norm(), 0, 1e-12);
}

TEST_F(SceneParts, RoutesOfEachKind) {
  EXPECT_EQ(route("{}").size(), 1u);
  const std::string corners = "[{translation_m: [0, 0, 0]}, {translation_m: [1, 0, 0]}, {translation_m: [1, 1, 0]}]";
  const Trajectory loop = route("{spline: {waypoints: " + corners + ", count: 100, closed: true}}");
  ASSERT_EQ(loop.size(), 100u);
  EXPECT_NEAR((loop.front().world_from_robot.translation - loop.back().world_from_robot.translation).norm(), 0, 1e-12);
  EXPECT_EQ(route("{orbit: {centre_m: [0, 0, 0], radius_m: 0.5, height_m: 0.8, count: 9}}").size(), 9u);
  const std::string walk =
      "{start: {translation_m: [0, 0, 0.1]}, random_walk: {count: 20, step_mm: [9, 9, 2], "
      "turn_deg: [1, 1, 1], low_m: [-1, -1, 0], high_m: [1, 1, 0.2]}}";
  EXPECT_EQ(route(walk).size(), 20u);
  file("route.tum", "0 0 0 0 0 0 0 1\n1.5 0.1 0 0 0 0 0 1\n");
  EXPECT_EQ(route("{file: route.tum}")[1].timestamp_s, 1.5);
}

TEST_F(SceneParts, InvalidRoutes) {
  const auto refused = [&](const std::string& trajectory) { return error_of([&] { route(trajectory); }); };
  EXPECT_THAT(refused("{poses: []}"), HasSubstr("at least 1 pose"));
  EXPECT_THAT(refused("{spline: {waypoints: [{}], count: 5}}"), HasSubstr("at least 2 poses"));
  EXPECT_THAT(refused("{poses: [{camera_m: [0, 0, 1], look_at_m: [0, 0, 1]}]}"), HasSubstr("coincides with"));
  EXPECT_THAT(refused("{poses: [{camera_m: [0, 0, 1], look_at_m: [0, 0, 0], rotation_deg: [0, 0, 0]}]}"),
              HasSubstr("give camera_m and look_at_m"));
  EXPECT_THAT(refused("{motions: [], poses: []}"), HasSubstr("not both"));
  EXPECT_THAT(refused("{start: {}, poses: [{}]}"), HasSubstr("no effect"));
  EXPECT_THAT(refused("{random_walk: {count: 2, step_mm: [1, 1, 1], low_m: [1, 0, 0], high_m: [2, 1, 1]}}"),
              HasSubstr("must start between"));
  EXPECT_THAT(refused("{file: none.tum}"), HasSubstr("does not exist"));
}

// --- piles ---

Pile small_pile(int variants = 0) {
  Pile pile;
  pile.count = 12;
  pile.area = {0.3, 0.3, 0.2};
  for (const char* kind : {"brick", "stone"}) {
    PileItem item;
    item.kind = kind;
    item.size_min = {0.05, 0.04, 0.03};
    item.size_max = {0.09, 0.07, 0.05};
    item.variants = variants;
    pile.items.push_back(item);
  }
  return pile;
}

void expect_same(const PileObjects& a, const PileObjects& b) {
  ASSERT_EQ(a.objects.size(), b.objects.size());
  for (size_t i = 0; i < a.objects.size(); ++i) {
    EXPECT_EQ(a.objects[i].mesh->vertices, b.objects[i].mesh->vertices);
    EXPECT_EQ(a.objects[i].world_from_object.translation, b.objects[i].world_from_object.translation);
    EXPECT_EQ(a.objects[i].world_from_object.rotation, b.objects[i].world_from_object.rotation);
  }
}

TEST_F(SceneParts, APileIsSettledOnceAndTheSameFromTheCache) {
  const PileObjects first = pile_objects(small_pile(), 4, 0), second = pile_objects(small_pile(), 4, 0);
  EXPECT_FALSE(first.from_cache);
  EXPECT_TRUE(second.from_cache);
  expect_same(first, second);
  EXPECT_LT(second.settled.penetration_m, 1e-3);
  EXPECT_LT(second.settled.energy_j_per_kg, 2e-6);
  Pile wider = small_pile();
  wider.area.size_x = 0.4;
  EXPECT_FALSE(pile_objects(wider, 4, 0).from_cache);
  EXPECT_FALSE(pile_objects(small_pile(), 5, 0).from_cache);
}

// Pieces with a fixed number are added to those drawn by weight, which are unaffected.
TEST_F(SceneParts, APileHoldsExactlyWhatIsAskedFor) {
  Pile pile = small_pile();
  PileItem item;
  item.kind = "pipe";
  item.size_min = item.size_max = {0.02, 0.02, 0.1};
  item.material.name = "pipe";
  item.weight = 0;
  item.exactly = 2;
  item.after = 0.5;
  pile.items.push_back(item);
  const PileObjects with = pile_objects(pile, 4, 0), without = pile_objects(small_pile(), 4, 0);
  ASSERT_EQ(with.objects.size(), 14u);
  for (size_t i = 0; i < 14; ++i) EXPECT_EQ(with.objects[i].material.name, i == 6 || i == 7 ? "pipe" : "") << i;
  for (size_t i = 0; i < 12; ++i)
    EXPECT_EQ(with.objects[i < 6 ? i : i + 2].mesh->vertices, without.objects[i].mesh->vertices) << i;
}

// A damaged cache never affects the result.
TEST_F(SceneParts, ABrokenCacheIsNotBelieved) {
  const PileObjects first = pile_objects(small_pile(), 4, 0);
  for (const auto& entry : std::filesystem::directory_iterator(temp_ / "cache/baked")) {
    test::truncate_file(entry.path(), 0.9);
    const PileObjects cut = pile_objects(small_pile(), 4, 0);
    EXPECT_FALSE(cut.from_cache);
    expect_same(first, cut);
    std::string bytes = test::read_bytes(entry.path());
    bytes[bytes.size() - 100] ^= 1;
    test::write_bytes(entry.path(), bytes);
    EXPECT_FALSE(pile_objects(small_pile(), 4, 0).from_cache);
  }
  std::filesystem::remove_all(temp_ / "cache");
  test::write_bytes(temp_ / "cache", "no folder");
  expect_same(first, pile_objects(small_pile(), 4, 0));
}

TEST_F(SceneParts, VariantsAreHeldOnce) {
  const PileObjects pile = pile_objects(small_pile(2), 4, 0);
  std::set<const Mesh*> meshes;
  for (const Object& object : pile.objects) meshes.insert(object.mesh.get());
  EXPECT_LE(meshes.size(), 4u);
  EXPECT_GE(meshes.size(), 2u);
}

TEST_F(SceneParts, EveryKindOfPieceFitsItsSize) {
  const Eigen::Vector3d size(0.1, 0.08, 0.3);
  for (const std::string& kind : piece_kinds()) {
    const Solid piece = make_piece(kind, size, 3, 5);
    ASSERT_FALSE(piece.mesh.triangles.empty()) << kind;
    ASSERT_FALSE(piece.hulls.empty()) << kind;
    double reach = 0;
    for (const Eigen::Vector3d& v : piece.mesh.vertices) reach = std::max(reach, v.norm());
    EXPECT_LT(reach, 0.35) << kind;
    EXPECT_GT(reach, 0.04) << kind;
  }
}

TEST_F(SceneParts, HashesOfFilesOfAnySizeDependOnTheirContent) {
  const auto small = file("small.ply", "content");
  EXPECT_EQ(contents_hash({small}), content_hash(content_hash("content") + "\n"));
  EXPECT_EQ(contents_hash({file("empty.ply", "")}), content_hash(content_hash("") + "\n"));
  // More than the largest image file, and than fits into a block.
  const auto large = file("large.ply", "");
  std::filesystem::resize_file(large, (uintmax_t{1} << 30) + 1);
  const std::string before = contents_hash({large});
  std::filesystem::resize_file(large, uintmax_t{1} << 30);
  test::write_bytes(temp_ / "tail", "x");
  ASSERT_EQ(std::system(("cat " + (temp_ / "tail").string() + " >> " + large.string()).c_str()), 0);
  EXPECT_NE(contents_hash({large}), before);
}

TEST_F(SceneParts, UnreadableFilesAreDistinguished) {
  // Even the superuser cannot read a folder.
  const std::filesystem::path folder = temp_ / "folder";
  std::filesystem::create_directory(folder);
  const std::string before = contents_hash({folder}), missing = contents_hash({temp_ / "none"});
  EXPECT_NE(before, missing);
  std::filesystem::last_write_time(folder, std::filesystem::last_write_time(folder) - std::chrono::hours(1));
  EXPECT_NE(contents_hash({folder}), before);
  EXPECT_EQ(contents_hash({temp_ / "none"}), missing);
}

TEST_F(SceneParts, AFileThatCannotBeFollowedIsReportedWhereItIsNamed) {
  file("route.tum", "0 0 0 0 0 0 0 1\n");
  EXPECT_THAT(
      error_of([&] { route("{file: route.tum, continuous: {}}"); }),
      testing::StartsWith((temp_ / "scene.yaml:6: ").string() + "a trajectory to follow needs at least two poses"));
}

TEST_F(SceneParts, SettingsOfTheTrajectoryWithoutEffectAreRefused) {
  file("route.tum", "0 0 0 0 0 0 0 1\n1.5 0.1 0 0 0 0 0 1\n");
  const std::string where = (temp_ / "scene.yaml:6: ").string();
  const auto refused = [&](const std::string& trajectory) { return error_of([&] { route(trajectory); }); };
  const auto ineffective = [&](const std::string& key) {
    return testing::StartsWith(where + "'" + key + "' has no effect");
  };
  EXPECT_THAT(refused("{interval_s: 2, file: route.tum}"), ineffective("interval_s"));
  EXPECT_THAT(refused("{commanded: true, poses: [{}, {translation_m: [1, 0, 0]}], continuous: {speed_m_s: 0.1}}"),
              ineffective("commanded"));
  EXPECT_THAT(refused("{board_views: {count: 3, distance_m: [0.8, 1], max_tilt_deg: 30, extent_m: [0.1, 0.1]}, "
                      "continuous: {speed_m_s: 0.1}}"),
              ineffective("continuous"));
  // In other combinations, these keys have an effect.
  EXPECT_EQ(route("{interval_s: 0.5, file: route.tum, continuous: {}}").size(), 4u);
  EXPECT_EQ(route("{commanded: true, file: route.tum}").size(), 2u);
}

}  // namespace
}  // namespace fringeslam::sim
