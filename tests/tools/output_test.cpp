// SPDX-License-Identifier: Apache-2.0
// No command replaces its own input, nor what it did not write.
#include <gmock/gmock.h>

#include "core/io/files.h"
#include "tests/tools/child.h"

namespace fringeslam {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;
using Words = std::vector<std::string>;

class Output : public testing::Test {
 protected:
  void SetUp() override { test::write_small_scene(temp_ / "scene"); }
  std::string at(const std::string& name) const { return (temp_ / name).string(); }

  // Expects one line that contains `message`, and that nothing changes.
  void expect_refused(const Words& arguments, const std::string& message) const {
    const auto before = contents();
    const test::Finished refused = test::run_program(arguments);
    EXPECT_EQ(refused.exit_code, 2) << arguments[0];
    EXPECT_THAT(refused.err, HasSubstr(message));
    EXPECT_EQ(std::count(refused.err.begin(), refused.err.end(), '\n'), 1) << refused.err;
    EXPECT_EQ(contents(), before) << arguments[0];
  }
  std::map<std::string, std::string> contents() const {
    std::map<std::string, std::string> files;
    for (const std::string& name : test::listing(temp_.path())) {
      if (fs::is_regular_file(temp_ / name)) files[name] = test::read_bytes(temp_ / name);
    }
    return files;
  }

  test::TempFolder temp_;
};

TEST_F(Output, IsNotTheInput) {
  test::run_successfully({"render", at("scene"), "--out", at("data"), "--set", "render.samples_per_pixel=1"});
  expect_refused({"render", at("data"), "--out", at("data")}, "is the input, which would be replaced");
  expect_refused({"render", at("data"), "--out", at("scene/../data/")}, "is the input, which would be replaced");
  test::write_bytes(
      temp_ / "import.yaml",
      "name: x\nstacks: [stacks/000000]\nignore: [stack.yaml]\npatterns:\n  - {files: \"%02d.png\", sequence: " +
          at("data/patterns.yaml") + "}\nprojector: {width_px: 1024, height_px: 768}\n");
  expect_refused(
      {"import", at("data"), "--config", at("import.yaml"), "--rig", at("data/rig.yaml"), "--out", at("data")},
      "is the input, which would be replaced");
  test::run_successfully({"scene", "export", at("scene"), "--out", at("scene/mesh.obj")});
  test::write_bytes(temp_ / "scene/scene.yaml",
                    "name: x\nseed: 1\nrig: {file: rig.yaml}\npatterns: {axis: columns, steps: 3, periods_px: [1040, "
                    "131, 16.5]}\nlight: {ambient_lux: "
                    "290}\nmaterials: {a: {grain: plain, albedo: 0.5}}\nobjects: [{shape: mesh, file: mesh.obj, "
                    "unit_m: 1, up: z, material: a}]\ntrajectory: {}\n");
  expect_refused({"scene", "export", at("scene"), "--out", at("scene/mesh.obj")},
                 "is the input, which would be replaced");
}

// A result folder is replaced as a whole, but for what the program did not write.
TEST_F(Output, IsNotAroundTheInput) {
  test::run_successfully({"render", at("scene"), "--out", at("data"), "--set", "render.samples_per_pixel=1"});
  fs::copy(temp_ / "data/stacks", temp_ / "images", fs::copy_options::recursive);
  const auto describe = [&](const std::string& file, const std::string& patterns) {
    test::write_bytes(
        temp_ / file,
        "name: x\nstacks: [\"000000\"]\nignore: [stack.yaml]\npatterns:\n  - {files: \"%02d.png\", sequence: \"" +
            at(patterns) + "\"}\nprojector: {width_px: 1024, height_px: 768}\n");
  };
  fs::copy_file(temp_ / "data/patterns.yaml", temp_ / "patterns.yaml");
  describe("good.yaml", "patterns.yaml");
  describe("bad.yaml", "data/patterns.yaml");
  const auto contains = [&](const std::string& input) {
    return at("data") + ": contains the input " + at(input) + ", which would be replaced";
  };
  const auto import = [&](const std::string& images, const std::string& description, const Words& more) {
    Words words = {"import", at(images), "--config", at(description), "--out", at("data"), "--quiet", "--no-check"};
    words.insert(words.end(), more.begin(), more.end());
    return words;
  };
  expect_refused(import("data/stacks", "good.yaml", {}), contains("data/stacks"));
  expect_refused(import("images", "good.yaml", {"--rig", at("data/rig.yaml")}), contains("data/rig.yaml"));
  expect_refused(import("images", "bad.yaml", {}), contains("data/patterns.yaml"));
  describe("data/mine.yaml", "patterns.yaml");
  const std::string mine = test::read_bytes(temp_ / "data/mine.yaml");
  test::run_successfully(import("images", "data/mine.yaml", {}));
  EXPECT_EQ(test::read_bytes(temp_ / "data/mine.yaml"), mine);
}

TEST_F(Output, OfGeneratedScenesIsNotAroundTheInput) {
  const auto generate = [&](const std::string& from) {
    return Words{"scene", "generate", at(from), "--count", "2", "--seed", "010", "--out", at("many"), "--quiet"};
  };
  test::run_successfully(generate("scene"));
  expect_refused(generate("many/000010"), "contains the input " + at("many/000010/scene.yaml"));
  test::write_small_scene(temp_ / "many/mine");
  test::run_successfully(generate("many/mine"));
  EXPECT_EQ(test::read_bytes(temp_ / "many/mine/scene.yaml"), test::kSmallScene);
  EXPECT_EQ(test::listing(temp_ / "many").count("000011/scene.yaml"), 1u);
}

TEST_F(Output, IsNoFileOfTheScene) {
  write_png(temp_ / "scene/wall.png", cv::Mat1b(4, 4, uchar{90}));
  test::write_bytes(temp_ / "scene/scene.yaml",
                    test::replaced(test::kSmallScene, "{grain: wood, albedo: 0.4, contrast: 0.35, grain_m: 0.012}",
                                   "{texture: wall.png}"));
  for (const Words& verb : {Words{"scene", "preview", at("scene"), "--size", "320"}, Words{"effects", at("scene")}}) {
    Words words = verb;
    words.insert(words.end(), {"--out", at("scene/wall.png")});
    expect_refused(words, at("scene/wall.png") + ": is the input, which would be replaced");
  }
}

// Files beside an exported mesh have names that the user did not choose.
TEST_F(Output, ReplacesOnlyCompanionsOfAnEarlierExport) {
  const auto exported = [&](const std::string& file) {
    return Words{"scene", "export", at("scene"), "--out", at(file)};
  };
  test::write_bytes(temp_ / "a/f.mtl", "mine");
  expect_refused(exported("a/f.obj"), at("a/f.mtl") + ": exists and was not written with f.obj");
  test::write_bytes(temp_ / "a/h.bin", "mine");
  expect_refused(exported("a/h.gltf"), at("a/h.bin") + ": exists and was not written with h.gltf");
  for (const std::string file : {"b/my f.obj", "b/my f.gltf"}) {
    fs::create_directory(temp_ / "b");
    test::run_successfully(exported(file));
    test::run_successfully(exported(file));
  }
  test::write_bytes(temp_ / "scene/wall.mtl", "newmtl a\nKd 1 1 1\n");
  test::write_bytes(temp_ / "scene/room.obj", "mtllib wall.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl a\nf 1 2 3\n");
  test::write_bytes(temp_ / "scene/wall.obj", "mtllib wall.mtl\n");
  test::write_bytes(temp_ / "scene/scene.yaml",
                    test::replaced(test::kSmallScene, "{shape: plane, size_m: [0.8, 0.8], material: table}",
                                   "{shape: mesh, file: room.obj, unit_m: 1, up: z}"));
  expect_refused(exported("scene/wall.obj"), at("scene/wall.mtl") + ": is an input, which would be replaced");
}

TEST_F(Output, HasTheNameOfItsKind) {
  expect_refused({"scene", "preview", at("scene"), "--out", at("scene/scene.yaml")}, "the name must end in .png");
  expect_refused({"effects", at("scene"), "--out", at("scene/scene.yaml")}, "the name must end in .png");
  expect_refused({"scene", "preview", at("scene"), "--out", ""}, "--out: is empty");
}

// An argument behind a repeatable option is not one more of its values.
TEST_F(Output, SettingsWithoutEffectAreRefused) {
  const test::Finished picture =
      test::run_program({"effects", "--set", "tracking.at_rest=true", at("scene"), "--out", at("effects.png")});
  EXPECT_EQ(picture.exit_code, 2);
  EXPECT_THAT(picture.err, testing::HasSubstr("tracking.at_rest=true: has no effect on this image"));
  test::run_successfully({"render", "--set", "render.samples_per_pixel=1", at("scene"), "--out", at("data")});
  const test::Finished landmarks =
      test::run_program({"landmarks", at("data"), "--set", "render.noise=false", "--out", at("landmarks")});
  EXPECT_EQ(landmarks.exit_code, 2);
  EXPECT_THAT(landmarks.err, testing::HasSubstr("render.* settings have no effect on a recorded dataset"));
}

TEST_F(Output, ReplacesNoRecordingOfOthers) {
  test::write_bytes(temp_ / "mine.bag", "#ROSBAG V2.0\nmine");
  const test::Finished refused =
      test::run_program({"render", at("scene"), "--format", "rosbag", "--out", at("mine.bag")});
  EXPECT_EQ(refused.exit_code, 2);
  EXPECT_EQ(test::read_bytes(temp_ / "mine.bag"), "#ROSBAG V2.0\nmine");
}

TEST_F(Output, ReplacesNoOtherCalibration) {
  test::write_bytes(temp_ / "out/.fringeslam", "calibration\nrig.yaml\n");
  test::write_bytes(temp_ / "out/rig.yaml", "of calibrate rig");
  test::run_successfully({"render", at("scene"), "--out", at("data"), "--set", "render.samples_per_pixel=1"});
  expect_refused({"calibrate", "noise", at("data"), "--out", at("out")},
                 "was not written by fringeslam as a camera noise");
}

TEST_F(Output, OfACopiedSceneLiesOutsideOfIt) {
  expect_refused({"scene", "new", at("scene/copy"), "--from", at("scene")}, "lies in the scene that is copied");
}

TEST_F(Output, NeedsPermissionsBeforeTheWork) {
  if (geteuid() == 0) GTEST_SKIP() << "root may write everywhere";
  fs::create_directories(temp_ / "closed");
  fs::permissions(temp_ / "closed", fs::perms::owner_read | fs::perms::owner_exec);
  expect_refused({"run", at("scene"), "--out", at("closed")}, "is not writable");
}

TEST_F(Output, OptionsThatAreNoNumbersAreRefused) {
  expect_refused({"patterns", "--size", "100x100", "--periods", "nan", "--out", at("p")}, "'nan' is not a number");
  expect_refused({"render", at("scene"), "--format", "tum-rgbd", "--depth-scale", "nan", "--out", at("p")},
                 "'nan' is not a number");
}

TEST_F(Output, AdviceOnADarkSceneIsOneLine) {
  expect_refused({"advise", at("scene"), "--with", "light.ambient_lux=1000000"},
                 "no pixel can be decoded at any exposure");
}

TEST_F(Output, TimesThatGoBackwardsAreRefused) {
  test::run_successfully({"render", at("scene"), "--out", at("data"), "--set", "render.samples_per_pixel=1"});
  const fs::path stack = temp_ / "data/stacks/000000/stack.yaml", about = temp_ / "data/dataset.yaml";
  test::write_bytes(about, test::replaced(test::read_bytes(about), "truth: true", "truth: false"));
  const std::string text = test::read_bytes(stack);
  const std::string without_image_times = text.substr(0, text.find("exposure_time_s"));
  test::write_bytes(stack, test::replaced(without_image_times, text.substr(0, text.find('\n')), "timestamp_s: 9"));
  expect_refused({"run", at("data"), "--out", at("out"), "--quiet"}, "is not later than that of the stack before it");
}

}  // namespace
}  // namespace fringeslam
