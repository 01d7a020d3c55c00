// SPDX-License-Identifier: Apache-2.0
// Scenes that override their file's values: by SceneLoadOptions::changes, by keys of `rig:`, and by a calibration error.
#include <gmock/gmock.h>

#include <algorithm>
#include <numbers>

#include "core/io/files.h"
#include "core/rig/rig_file.h"
#include "sim/scene/scene.h"
#include "sim/virtual_rig.h"
#include "tests/support/matchers.h"
#include "tests/support/temp_folder.h"

namespace fringeslam::sim {
namespace {

using support::error_of;
using testing::AllOf;
using testing::HasSubstr;
using testing::StartsWith;

class SceneVariant : public testing::Test {
 protected:
  std::filesystem::path file(const std::string& rig = "", const std::string& more = "") const {
    write_text(temp_ / "scene.yaml", "name: variants\nrig: {file: " FRINGESLAM_SOURCE_DIR "/scenes/rigs/thesis.yaml" +
                                         rig +
                                         "}\npatterns: {steps: 3, periods_px: [16.5]}\n"
                                         "materials: {a: {grain: plain, albedo: 0.5}}\nobjects:\n"
                                         "  - {shape: plane, size_m: [1, 1], material: a}\n"
                                         "  - {shape: box, size_m: [0.1, 0.1, 0.1], material: a}\ntrajectory: {}\n" +
                                         more);
    return temp_ / "scene.yaml";
  }
  Scene with(const std::vector<std::pair<std::string, std::string>>& changes) const {
    SceneLoadOptions reading;
    reading.changes = changes;
    return load_scene(file(), reading);
  }

  test::TempFolder temp_;
};

TEST_F(SceneVariant, ChangesReachMapsListsAndWhatIsNotThere) {
  const Scene plain = load_scene(file());
  const Scene scene = with({{"light.ambient_lux", "123"},
                            {"objects.1.size_m", "[0.2, 0.1, 0.1]"},
                            {"rig.camera.sensor.dark_noise_electrons", "77"},
                            {"air.extinction_per_m", "0.5"}});
  EXPECT_EQ(scene.ambient_lux, 123);
  EXPECT_EQ(scene.air.extinction_per_m, 0.5);
  EXPECT_EQ(scene.rig.sensor.dark_noise_electrons, 77);
  double widest = 0;
  for (const Eigen::Vector3d& v : scene.objects[1].mesh->vertices) widest = std::max(widest, v.x());
  EXPECT_NEAR(widest, 0.1, 1e-9);
  // Everything else is unchanged.
  EXPECT_EQ(scene.rig.camera.fx, plain.rig.camera.fx);
  EXPECT_EQ(scene.rig.sensor.full_well_electrons, plain.rig.sensor.full_well_electrons);
}

TEST_F(SceneVariant, ResolvedItDescribesTheSameScene) {
  const Scene scene = with({{"rig.camera.sensor.bits", "12"}, {"light.ambient_lux", "{uniform: [10, 20]}"}});
  write_text(temp_ / "resolved.yaml", scene.resolved);
  const Scene again = load_scene(temp_ / "resolved.yaml");
  EXPECT_EQ(to_yaml(again.rig), to_yaml(scene.rig));
  EXPECT_EQ(again.ambient_lux, scene.ambient_lux);
  EXPECT_GE(again.ambient_lux, 10);
  EXPECT_LE(again.ambient_lux, 20);
}

TEST_F(SceneVariant, FilesThatASceneUsesAreListedEvenIfItIsWrong) {
  const std::filesystem::path rig = FRINGESLAM_SOURCE_DIR "/scenes/rigs/thesis.yaml";
  std::vector<std::filesystem::path> files;
  SceneLoadOptions reading;
  reading.files = &files;
  write_text(temp_ / "more.yaml", "light: {ambient_lux: 7}\n");
  EXPECT_EQ(load_scene(file("", "include: more.yaml\n"), reading).ambient_lux, 7);
  EXPECT_THAT(files, testing::UnorderedElementsAre(temp_ / "scene.yaml", temp_ / "more.yaml", rig));

  files.clear();
  write_text(temp_ / "more.yaml", "light: {ambient_lx: 7}\n");
  EXPECT_THROW(load_scene(file("", "include: [more.yaml]\n"), reading), Error);
  EXPECT_THAT(files, testing::UnorderedElementsAre(temp_ / "scene.yaml", temp_ / "more.yaml", rig));

  files.clear();
  EXPECT_THROW(load_scene(file("", "include: absent.yaml\n"), reading), Error);
  EXPECT_THAT(files, testing::UnorderedElementsAre(temp_ / "scene.yaml", temp_ / "absent.yaml"));
}

TEST_F(SceneVariant, WrongChangesSayWhere) {
  const std::string scene = file().string();
  EXPECT_THAT(error_of([&] {
                with({{"light.ambiant_lux", "1"}});
              }),
              AllOf(StartsWith(scene), HasSubstr("unknown key 'ambiant_lux'; did you mean 'ambient_lux'?")));
  EXPECT_THAT(error_of([&] {
                with({{"objects.2.size_m", "1"}});
              }),
              HasSubstr("objects.2.size_m: objects is a list of 2; its entries are numbered from 0"));
  EXPECT_THAT(error_of([&] { with({{"name.first", "1"}}); }), HasSubstr("name is a scalar and has no sub-keys"));
  EXPECT_THAT(error_of([&] { with({{"light.", "1"}}); }), HasSubstr("light is followed by an empty name"));
  EXPECT_THAT(error_of([&] { with({{"light.ambient_lux", "-5"}}); }), HasSubstr("'ambient_lux'"));
  EXPECT_THAT(error_of([&] { with({{"light.ambient_lux", "[1"}}); }), HasSubstr("not valid YAML"));
  EXPECT_THAT(error_of([&] { with({{"rig.camera.sensor.bit", "12"}}); }), HasSubstr("did you mean 'bits'"));
  for (const char* more : {"300\nfoo: bar", "300\nvalue: 7", "300\n---\nfoo"})
    EXPECT_THAT(error_of([&] { with({{"light.ambient_lux", more}}); }), StartsWith("light.ambient_lux=300 "));
}

// A change that nothing reads is an error, also beside sections of included files.
TEST_F(SceneVariant, ChangesOfUnknownSectionsAreRefused) {
  write_text(temp_ / "more.yaml", "light: {ambient_lux: 7}\n");
  const std::string scene = file("", "include: more.yaml\n").string();
  const auto changed = [&](const std::string& path, const std::string& value) {
    SceneLoadOptions reading;
    reading.changes = {{path, value}};
    return load_scene(scene, reading);
  };
  EXPECT_EQ(changed("light.ambient_lux", "300").ambient_lux, 300);
  EXPECT_EQ(changed("air.extinction_per_m", "0.5").air.extinction_per_m, 0.5);
  EXPECT_EQ(changed("description", "Other words").ambient_lux, 7);
  EXPECT_EQ(changed("seed", "9").seed, 9u);
  EXPECT_THAT(error_of([&] { changed("lihgt.ambient_lux", "300"); }),
              AllOf(StartsWith(scene), HasSubstr("unknown key 'lihgt'; did you mean 'light'?")));
  for (const std::string section : {"foo", "Light", " light", "ambient_lux", "camera", "board"}) {
    const std::string unknown = "unknown key '" + section + "'";
    write_text(temp_ / "more.yaml", "light: {ambient_lux: 7}\n");
    EXPECT_THAT(error_of([&] { changed(section, "300"); }), AllOf(StartsWith(scene), HasSubstr(unknown)));
    EXPECT_THAT(error_of([&] { changed(section + ".x.y", "300"); }), HasSubstr(unknown));
    write_text(temp_ / "more.yaml", "placed: {\"" + section + ".x\": 3}\n");
    EXPECT_THAT(error_of([&] { load_scene(scene); }), HasSubstr(unknown));
  }
  // All errors are found if they are collected.
  std::vector<std::string> errors;
  SceneLoadOptions collecting;
  collecting.errors = &errors;
  load_scene(scene, collecting);
  EXPECT_THAT(errors, testing::ElementsAre(HasSubstr("unknown key 'board'")));
}

TEST_F(SceneVariant, ChangesReachMaterialsOfIncludedFilesAndNoOthers) {
  write_text(temp_ / "more.yaml", "materials: {b: {grain: plain, albedo: 0.7}}\n");
  const std::string scene = file("", "include: more.yaml\n").string();
  const auto changed = [&](const std::vector<std::pair<std::string, std::string>>& changes) {
    SceneLoadOptions reading;
    reading.changes = changes;
    return load_scene(scene, reading);
  };
  const auto albedo = [](const Scene& of) { return of.objects[1].material.albedo; };
  EXPECT_NEAR(albedo(changed({{"materials.a.albedo", "0.3"}})), 0.3, 1e-6);
  EXPECT_NEAR(albedo(changed({{"objects.1.material", "b"}})), 0.7, 1e-6);
  const Scene smoother = changed({{"objects.1.material", "b"}, {"materials.b.roughness", "0.2"}});
  EXPECT_NEAR(albedo(smoother), 0.7, 1e-6);
  EXPECT_NEAR(smoother.objects[1].material.roughness, 0.2, 1e-6);
  EXPECT_NEAR(albedo(changed({{"materials.c", "{grain: plain, albedo: 0.2}"}, {"objects.1.material", "c"}})), 0.2,
              1e-6);
  EXPECT_THAT(error_of([&] {
                changed({{"materials.bb.albedo", "0.2"}});
              }),
              AllOf(StartsWith(scene), HasSubstr("there is no material 'bb'; there are: a, b")));
}

TEST_F(SceneVariant, MaterialsAreListedAsChangeableWhereChangesReachThem) {
  const std::string other = (temp_ / "more.yaml").string();
  write_text(other, "materials: {a: {grain: plain, albedo: 0.6}, b: {grain: plain, albedo: 0.7}}\n");
  std::vector<SceneValue> values;
  SceneLoadOptions reading;
  reading.values = &values;
  load_scene(file("", "include: more.yaml\n"), reading);
  std::vector<std::string> changeable, hidden;
  for (const SceneValue& value : values) {
    if (value.path.starts_with("materials.") && value.path.ends_with(".albedo") && value.place.starts_with(other))
      (value.changeable ? changeable : hidden).push_back(value.path);
  }
  EXPECT_THAT(changeable, testing::ElementsAre("materials.b.albedo"));
  EXPECT_THAT(hidden, testing::ElementsAre("materials.a.albedo"));
}

// Simulated images do not depend on it.
TEST_F(SceneVariant, ChangesOfTheRigsHardwareAreRefused) {
  for (const std::string path : {"rig.hardware", "rig.hardware.camera.exposure_s"})
    EXPECT_THAT(error_of([&] {
                  with({{path, "0.01"}});
                }),
                AllOf(StartsWith(file().string()), HasSubstr("scenes have no hardware")));
}

// They are read before the changes are made.
TEST_F(SceneVariant, ChangesOfWhatIsReadBeforeThemAreRefused) {
  const std::string scene = file().string();
  for (const std::string path : {"include", "include.0", "placed", "placed.light.ambient_lux"}) {
    EXPECT_THAT(error_of([&] {
                  with({{path, "more.yaml"}});
                }),
                AllOf(StartsWith(scene), HasSubstr("cannot be changed by key path")));
    const std::string placing = file("", "placed: {" + path + ": 3}\n").string();
    EXPECT_THAT(error_of([&] { load_scene(placing); }), HasSubstr("cannot be changed by key path"));
  }
}

TEST_F(SceneVariant, KeysOfTheRigReplaceThoseOfItsFileAndErrorsNameTheRightOne) {
  const std::string scene = file(", near_m: 0.9, camera: {sensor: {bits: 10}}").string();
  const Scene changed = load_scene(scene);
  EXPECT_EQ(changed.rig.near_m, 0.9);
  EXPECT_EQ(changed.rig.sensor.bits, 10);
  EXPECT_EQ(changed.rig.camera.width, 532);
  // A pose is replaced entirely, including the rotation from the rig file.
  const Scene mounted = load_scene(file(", robot_from_camera: {translation_m: [0, 0, 0.5]}"));
  EXPECT_TRUE(mounted.rig.robot_from_camera.rotation.isIdentity());
  EXPECT_THAT(error_of([&] { load_scene(file(", camera: {sensor: {bits: 99}}")); }), StartsWith(scene + ":2: "));
  EXPECT_THAT(error_of([&] { load_scene(file(", far_m: 0.1")); }), StartsWith(scene + ":2: "));
}

TEST_F(SceneVariant, ThePipelineGetsAWrongCalibration) {
  const Scene scene = load_scene(
      file("", "calibration_error: {translation_mm: [1, 0, 0], rotation_deg: [0, 0.5, 0], focal_percent: 2}\n"));
  const VirtualRig rig(scene, {});
  const RigModel calibration = rig.model();
  EXPECT_NEAR(calibration.camera.fx, 1.02 * scene.rig.camera.fx, 1e-9);
  const Pose off = scene.rig.projector_from_camera * calibration.projector_from_camera.inverse();
  EXPECT_NEAR(1e3 * off.translation.norm(), 1, 1e-9);
  EXPECT_NEAR(180 / std::numbers::pi * rotation_rad(off), 0.5, 1e-9);
  const Scene right = load_scene(file());
  EXPECT_EQ(to_yaml(VirtualRig(right, {}).model()), to_yaml(right.rig));
}

TEST_F(SceneVariant, ValuesAreListedWithPathPlaceAndDistribution) {
  write_text(temp_ / "other.yaml", "light: {ambient_lux: 7}\nair: {extinction_per_m: {uniform: [0.1, 0.2]}}\n");
  std::vector<SceneValue> values;
  SceneLoadOptions reading;
  reading.values = &values;
  const Scene scene =
      load_scene(file("", "include: other.yaml\nlight: {ambient_lux: {log_uniform: [100, 200]}}\n"), reading);
  const auto value = [&](const std::string& path) {
    const auto found = std::find_if(values.begin(), values.end(), [&](const SceneValue& v) { return v.path == path; });
    return found == values.end() ? SceneValue{} : *found;
  };
  const SceneValue lux = value("light.ambient_lux");
  EXPECT_EQ(lux.text, to_text(scene.ambient_lux));
  EXPECT_EQ(lux.distribution, "{log_uniform: [100, 200]}");
  EXPECT_EQ(lux.place, (temp_ / "scene.yaml").string() + ":10");
  EXPECT_EQ(lux.range->low, 0);
  EXPECT_TRUE(lux.changeable);
  EXPECT_EQ(value("objects.1.size_m.2").text, "0.1");
  EXPECT_EQ(value("objects.1.size_m.2").place, (temp_ / "scene.yaml").string() + ":7");
  EXPECT_EQ(value("air.extinction_per_m").text, to_text(scene.air.extinction_per_m));
  EXPECT_TRUE(value("patterns.steps").whole);
  EXPECT_EQ(value("rig.camera.fx_px").text, to_text(scene.rig.camera.fx));
  EXPECT_THAT(value("rig.camera.fx_px").place, HasSubstr("thesis.yaml:"));
  EXPECT_FALSE(value("rig.robot_from_camera.rotation_deg.0").changeable);
  // Each can be changed by its path.
  for (const SceneValue& listed : values) {
    if (listed.changeable) {
      EXPECT_NO_THROW(with({{listed.path, listed.text}})) << listed.path;
    }
  }
}

TEST_F(SceneVariant, ObjectsKnowTheLineOfTheirEntry) {
  const Scene scene = load_scene(file());
  EXPECT_EQ(scene.objects[1].place, (temp_ / "scene.yaml").string() + ":7");
}

TEST_F(SceneVariant, PlacesOfAnIncludedFileReplaceThoseOfTheScene) {
  write_text(temp_ / "placed.yaml",
             "placed:\n  objects.1.pose.translation_m: [0.1, 0.2, 0.3]\n  trajectory.start.translation_m: [1, 2, 3]\n");
  const Scene scene = load_scene(file("", "include: placed.yaml\n"));
  EXPECT_EQ(scene.objects[1].world_from_object.translation, Eigen::Vector3d(0.1, 0.2, 0.3));
  EXPECT_EQ(scene.objects[1].path, "objects.1");
  EXPECT_EQ(scene.trajectory[0].world_from_robot.translation, Eigen::Vector3d(1, 2, 3));
  // The resolved scene has them in place.
  write_text(temp_ / "resolved.yaml", scene.resolved);
  EXPECT_EQ(load_scene(temp_ / "resolved.yaml").objects[1].world_from_object.translation,
            Eigen::Vector3d(0.1, 0.2, 0.3));
  // Changes by option come after them.
  SceneLoadOptions reading;
  reading.changes = {{"objects.1.pose.translation_m", "[0, 0, 0]"}};
  EXPECT_EQ(load_scene(temp_ / "scene.yaml", reading).objects[1].world_from_object.translation,
            Eigen::Vector3d::Zero());
}

// Errors name the line in `placed`, not that of the value that is replaced.
TEST_F(SceneVariant, WrongPlacesAreReportedWhereTheyAreGiven) {
  (void)file("", "include: placed.yaml\n");
  for (const auto& [line, error] : std::initializer_list<std::pair<const char*, const char*>>{
           {"objects.7.pose.translation_m: [0.1, 0.2, 0.3]", "objects is a list of 2"},
           {"light.ambiant_lux: 3", "unknown key 'ambiant_lux'; did you mean 'ambient_lux'?"},
           {"light.ambient_lux: dim", "'ambient_lux' must be a number"},
           {"light.ambient_lux: -5", "'ambient_lux'"},
           {"light: {ambient_lux: dim}", "'ambient_lux' must be a number"},
           {"objects.1.pose: {translation_mm: [0, 0, high]}", "'translation_mm'"},
           {"objects.1.pose.translation_mm: [0, 0, high]", "'translation_mm'"},
           {"light.ambient_lux: {uniform: [1, x]}", "'ambient_lux' must be a number"},
           {"objects: [{shape: plane, size_m: [1, high]}]", "'size_m'"},
           {"lamps.first.ambient_lux: 3", "unknown key 'lamps'"}}) {
    write_text(temp_ / "placed.yaml", std::string("placed:\n  name: placed\n  ") + line + "\n");
    EXPECT_THAT(error_of([&] { load_scene(temp_ / "scene.yaml"); }),
                AllOf(StartsWith((temp_ / "placed.yaml").string() + ":3: "), HasSubstr(error)))
        << line;
  }
  // A change by option replaces the value of the file.
  write_text(temp_ / "placed.yaml", "placed:\n  light: {ambient_lux: 3}\n");
  SceneLoadOptions reading;
  reading.changes = {{"light.ambient_lux", "dim"}};
  EXPECT_THAT(error_of([&] { load_scene(temp_ / "scene.yaml", reading); }),
              AllOf(StartsWith((temp_ / "scene.yaml").string() + ": "), HasSubstr("'ambient_lux' must be a number")));
}

// The same text in any folder; a relative path would mean another file there.
TEST_F(SceneVariant, ResolvedForTheRootFolderItHasAbsolutePaths) {
  write_text(temp_ / "mesh.obj", "v 0 0 0\nv 0.3 0 0\nv 0 0.2 0\nf 1 2 3\n");
  write_text(temp_ / "trajectory.tum", "0 0.1 0 0 0 0 0 1\n0.5 0.2 0 0 0 0 0 1\n");
  write_text(temp_ / "more.yaml", "objects: [{shape: mesh, file: mesh.obj, unit_m: 1, up: z}]\n");
  const std::filesystem::path path = file("", "include: more.yaml\n");
  SceneLoadOptions reading;
  reading.changes = {{"trajectory", "{file: trajectory.tum}"}};
  const Scene near_by = load_scene(path, reading);
  EXPECT_THAT(near_by.resolved, testing::Not(HasSubstr(temp_.path().string())));
  reading.resolved_for = "/";
  const Scene scene = load_scene(path, reading);
  for (const char* name : {"mesh.obj", "trajectory.tum"})
    EXPECT_THAT(scene.resolved, HasSubstr(": " + (temp_ / name).string() + "\n"));
  std::filesystem::create_directories(temp_ / "far/away");
  write_text(temp_ / "far/away/trajectory.tum", "0 9 0 0 0 0 0 1\n");
  write_text(temp_ / "far/away/scene.yaml", scene.resolved);
  const Scene again = load_scene(temp_ / "far/away/scene.yaml");
  ASSERT_EQ(again.trajectory.size(), 2u);
  EXPECT_EQ(again.trajectory[1].world_from_robot.translation.x(), 0.2);
  EXPECT_EQ(again.objects.back().mesh->vertices, scene.objects.back().mesh->vertices);
}

TEST_F(SceneVariant, ARigInsteadOfTheScenesIsResolvedAndListed) {
  RigModel other = load_scene(file()).rig;
  other.camera.fx = 777;
  write_text(temp_ / "other.yaml", to_yaml(other));
  std::vector<std::filesystem::path> files;
  SceneLoadOptions reading;
  reading.rig_file = temp_ / "other.yaml";
  reading.files = &files;
  const Scene scene = load_scene(file(", near_m: 0.9"), reading);
  EXPECT_EQ(scene.rig.camera.fx, 777);
  EXPECT_THAT(files, testing::UnorderedElementsAre(temp_ / "scene.yaml", temp_ / "other.yaml"));
  write_text(temp_ / "resolved.yaml", scene.resolved);
  EXPECT_EQ(to_yaml(load_scene(temp_ / "resolved.yaml").rig), to_yaml(scene.rig));
}

// As for sections: those of the including file precede those of included files, and earlier includes later ones.
TEST_F(SceneVariant, OfSeveralPlacesThoseOfTheIncludingFileCount) {
  const auto lux = [&](const std::string& own, const std::string& first, const std::string& second) {
    const auto placed = [](const std::string& value) {
      return value.empty() ? "description: none\n" : "placed: {light.ambient_lux: " + value + "}\n";
    };
    write_text(temp_ / "first.yaml", placed(first));
    write_text(temp_ / "second.yaml", placed(second));
    return load_scene(file("", "include: [first.yaml, second.yaml]\n" + placed(own))).ambient_lux;
  };
  EXPECT_EQ(lux("1", "2", "3"), 1);
  EXPECT_EQ(lux("", "2", "3"), 2);
  EXPECT_EQ(lux("", "", "3"), 3);
}

// A scene with its own objects that includes another one, whose objects were moved.
TEST_F(SceneVariant, PlacesReferToTheObjectsOfTheFileThatIncludesThem) {
  write_text(temp_ / "base.yaml",
             "include: base_placed.yaml\nobjects:\n"
             "  - {shape: box, size_m: [0.1, 0.1, 0.1], material: a}\n"
             "  - {shape: box, size_m: [0.2, 0.2, 0.2], material: a}\n");
  write_text(temp_ / "base_placed.yaml", "placed: {objects.1.pose.translation_m: [1, 2, 3], rig.near_m: 0.8}\n");
  const auto places = [](const Scene& scene) {
    std::vector<Eigen::Vector3d> all;
    for (const Object& object : scene.objects) all.push_back(object.world_from_object.translation);
    return all;
  };
  const Eigen::Vector3d none = Eigen::Vector3d::Zero(), moved(1, 2, 3);
  const Scene scene = load_scene(file("", "include: base.yaml\n"));
  EXPECT_THAT(places(scene), testing::ElementsAre(none, none, none, moved));
  // Sections that only a file further out has are reached as well.
  EXPECT_EQ(scene.rig.near_m, 0.8);
  write_text(temp_ / "placed.yaml", "placed: {objects.0.pose.translation_m: [1, 2, 3]}\n");
  EXPECT_THAT(places(load_scene(file("", "include: [base.yaml, placed.yaml]\n"))),
              testing::ElementsAre(moved, none, none, moved));
}

}  // namespace
}  // namespace fringeslam::sim
