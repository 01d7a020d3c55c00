// SPDX-License-Identifier: Apache-2.0
// Malformed and extreme scene files, most of them found by tests/fuzz.
#include <gmock/gmock.h>

#include "core/io/files.h"
#include "sim/scene/scene.h"
#include "tests/support/matchers.h"
#include "tests/support/temp_folder.h"

namespace fringeslam::sim {
namespace {

using support::error_of;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;
using testing::SizeIs;

// A board in front of the thesis rig; each member overrides one part of the scene file.
struct Said {
  std::string rig = FRINGESLAM_SOURCE_DIR "/scenes/rigs/thesis.yaml";
  std::string patterns = "{steps: 3, periods_px: [16.5]}";
  std::string material = "{grain: plain, albedo: 0.5}";
  std::string object = "{shape: plane, size_m: [1, 1], material: a}";
  std::string trajectory = "{}";
  std::string more = "";
};

class SceneFile : public testing::Test {
 protected:
  std::filesystem::path file(const Said& said) const {
    write_text(temp_ / "scene.yaml", "name: odd\nrig: {file: " + said.rig + "}\npatterns: " + said.patterns +
                                         "\nmaterials: {a: " + said.material + "}\nobjects:\n  - " + said.object +
                                         "\ntrajectory: " + said.trajectory + "\n" + said.more);
    return temp_ / "scene.yaml";
  }
  // Expects an error at this line, and at least one error when errors are collected.
  void refused(const Said& said, int line, const std::string& says, const SceneLimits& limits = {}) const {
    const auto place = file(said).string() + ":" + std::to_string(line) + ": ";
    SceneLoadOptions reading;
    reading.limits = limits;
    EXPECT_THAT(error_of([&] { load_scene(file(said), reading); }),
                testing::AllOf(testing::StartsWith(place), HasSubstr(says)));
    std::vector<std::string> errors;
    reading.errors = &errors;
    try {
      load_scene(file(said), reading);
    } catch (const Error& error) {
      errors.push_back(error.what());
    }
    EXPECT_THAT(errors, Not(IsEmpty()));
  }

  test::TempFolder temp_;
};

TEST_F(SceneFile, ThatIsPlainIsRead) { EXPECT_THAT(load_scene(file({})).objects, SizeIs(1)); }

// The operating system rejects overlong names with its own exceptions, and devices can be read without end.
TEST_F(SceneFile, ThatNamesWhatCannotBeAFileIsRefused) {
  const std::string endless(5000, 'x');
  refused({.rig = endless}, 2, "does not exist");
  refused({.rig = "/dev/zero"}, 2, "is not a regular file");
  refused({.rig = "."}, 2, "is not a regular file");
  refused({.material = "{texture: " + endless + "}"}, 4, "does not exist");
  refused({.material = "{texture: .}"}, 4, "is not a regular file");
  refused({.object = "{shape: mesh, file: " + endless + "}"}, 6, "does not exist");
  refused({.trajectory = "{file: " + endless + "}"}, 7, "does not exist");
  refused({.trajectory = "{file: /dev/zero}"}, 7, "is not a regular file");
  refused({.more = "include: " + endless + "\n"}, 8, "does not exist");
}

// It would be expanded forever.
TEST_F(SceneFile, WithADistributionOfItselfIsRefused) {
  refused({.more = "light: {ambient_lux: &lux {choice: [*lux]}}\n"}, 8, "anchors and aliases");
}

// Reading time must not be quadratic in the file size.
TEST_F(SceneFile, ThatIsLongIsReadInAMoment) {
  std::string object = "{shape: box, size_m: [1, 1, 1], material: a}";
  std::string objects = object;
  for (int i = 1; i < 5000; ++i) objects += "\n  - " + object;
  EXPECT_THAT(load_scene(file({.object = objects})).objects, SizeIs(5000));
  const std::string name(300000, 'x');
  refused({.material = "{grain: " + name + "}"}, 4, "is not one of");
  refused({.more = "? " + name + "\n: 1\n"}, 8, "unknown key");
}

// Every shape with size_m, as cubes and extreme boxes; a wire as thick as its cube must keep a centre line.
TEST_F(SceneFile, WithCubesOfAllKindsHasFiniteMeshes) {
  for (const char* shape : {"box", "face_mask", "rock", "wedge", "stone", "brick", "slab", "pipe", "plank", "rebar",
                            "paper", "carton", "foam", "arm", "wire", "bag"}) {
    for (const char* size : {"[1e-4, 1e-4, 1e-4]", "[0.1, 0.1, 0.1]", "[100, 100, 100]", "[100, 1e-4, 100]"}) {
      SCOPED_TRACE(std::string(shape) + " " + size);
      const Said said{.object = std::string("{shape: ") + shape + ", size_m: " + size + ", material: a}"};
      const Scene scene = load_scene(file(said));
      EXPECT_FALSE(scene.objects.at(0).mesh->triangles.empty());
      for (const Eigen::Vector3d& vertex : scene.objects.at(0).mesh->vertices) ASSERT_TRUE(vertex.allFinite());
    }
  }
}

TEST_F(SceneFile, InWhichNothingFitsIsRefused) {
  refused({.object = "{shape: scatter, count: 3, area_m: [1, 1], max_height_m: 0.1, items: "
                     "[{shape: box, size_min_m: [1, 1, 1], size_max_m: [1, 1, 1], material: a}]}"},
          5, "no object");
}

TEST_F(SceneFile, ThatAsksForTooMuchIsRefused) {
  const Said boxes{.object =
                       "{shape: scatter, count: 9, area_m: [9, 9], max_height_m: 1, items: "
                       "[{shape: box, size_min_m: [1, 1, 1], size_max_m: [1, 1, 1], material: a}]}"};
  EXPECT_NO_THROW(load_scene(file(boxes)));
  refused(boxes, 6, "'count' is 9", {.scattered = 8});
  refused(boxes, 6, "triangles; at most 20 are allowed", {.triangles = 20});
  refused(boxes, 6, "objects; at most 1 are allowed", {.objects = 1});
  const Said stones{.object =
                        "{shape: pile, count: 5000, area_m: [9, 9], items: [{shape: stone, detail: 7, "
                        "size_min_m: [1, 1, 1], size_max_m: [1, 1, 1], material: a}]}"};
  refused(stones, 6, "the stones of the pile have about 1638400000 triangles; at most 30000000 are allowed");
  const Said exact{.object =
                       "{shape: pile, count: 1, area_m: [9, 9], items: [{shape: stone, detail: 7, exactly: 1000, "
                       "size_min_m: [1, 1, 1], size_max_m: [1, 1, 1], material: a}, {shape: stone, detail: 1, "
                       "size_min_m: [1, 1, 1], size_max_m: [1, 1, 1], material: a}]}"};
  refused(exact, 6, "the stones of the pile have about 327680080 triangles");
  const SceneLimits two_views{.views = 2};
  const std::string motion = "{translation_mm: [0, 0, 1], rotation_deg: [0, 0, 0]}";
  refused({.trajectory = "{motions: [" + motion + ", " + motion + "]}"}, 7, "fewer than 2 motions", two_views);
  refused({.trajectory = "{poses: [{}, {}, {}]}"}, 7, "at most 2 poses", two_views);
  refused({.trajectory = "{spline: {waypoints: [{}, {translation_m: [1, 0, 0]}], count: 3}}"}, 7, "'count' is 3",
          two_views);
  refused({.trajectory = "{orbit: {centre_m: [0, 0, 0], radius_m: 1, height_m: 1, count: 3}}"}, 7, "'count' is 3",
          two_views);
  refused({.trajectory = "{random_walk: {count: 3, step_mm: [1, 1, 1], low_m: [-1, -1, -1], high_m: [1, 1, 1]}}"}, 7,
          "'count' is 3", two_views);
  refused({.trajectory = "{board_views: {count: 3, distance_m: [1, 1], max_tilt_deg: 1, extent_m: [0.1, 0.1]}}"}, 7,
          "'count' is 3", two_views);
  std::string periods = "16.5";
  for (int i = 0; i < 100; ++i) periods += ", 16.5";
  refused({.patterns = "{steps: 3, periods_px: [" + periods + "]}"}, 3, "more than 100 periods");
}

TEST_F(SceneFile, RefusesImpossibleBuildingsAndTours) {
  refused({.trajectory = "{tour: {}}"}, 7, "a tour needs a building; add the section 'building'");
  const auto building = [](const std::string& more) {
    return "building: {walls: {material: a}, floors: {material: a}" + more + "}";
  };
  const std::string items =
      "items: [{shape: box, size_min_m: [0.1, 0.1, 0.1], size_max_m: [0.2, 0.2, 0.2], material: a}]";
  refused({.more = "building: {floors: {material: a}}"}, 8, "'walls'");
  refused({.more = building(", rooms: 1")}, 8, "'rooms' is 1");
  refused({.more = building(", door_m: 2")}, 8, "'door_m' is 2");
  refused({.more = building(", rubble_per_m2: 5")}, 8, "'items'");
  refused({.more = building(", rooms: 50, storeys: 20, rubble_per_m2: 20, " + items)}, 8, "pieces; at most 100000");
  refused({.trajectory = "{tour: {step_m: 0.001}}", .more = building("")}, 7, "increase step_m or reduce laps");
  refused({.trajectory = "{tour: {laps: 0}}", .more = building("")}, 7, "'laps' is 0");
  refused({.trajectory = "{tour: {stepp_m: 1}}", .more = building("")}, 7, "stepp_m");
}

}  // namespace
}  // namespace fringeslam::sim
