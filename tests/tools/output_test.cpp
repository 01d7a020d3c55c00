// SPDX-License-Identifier: Apache-2.0
// No command replaces its own input, nor what it did not write.
#include <gmock/gmock.h>

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

TEST_F(Output, HasTheNameOfItsKind) {
  expect_refused({"scene", "preview", at("scene"), "--out", at("scene/scene.yaml")}, "the name must end in .png");
  expect_refused({"effects", at("scene"), "--out", at("scene/scene.yaml")}, "the name must end in .png");
  test::write_bytes(temp_ / "run/frames.json", "{}");
  expect_refused({"report", at("run"), "--out", at("run/frames.json")}, "the name must end in .html");
  expect_refused({"scene", "preview", at("scene"), "--out", ""}, "the name must end in .png");
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
  test::write_bytes(stack, test::replaced(text, text.substr(0, text.find('\n')), "timestamp_s: 9"));
  expect_refused({"run", at("data"), "--out", at("out"), "--quiet"}, "is not later than that of the stack before it");
}

}  // namespace
}  // namespace fringeslam
