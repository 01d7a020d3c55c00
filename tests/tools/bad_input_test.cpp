// SPDX-License-Identifier: Apache-2.0
// Bad input: exit code 2, a one-line message with the file (and line), and no output files.
#include <gmock/gmock.h>

#include <algorithm>

#include "tests/tools/child.h"

namespace fringeslam {
namespace {

using test::run_program;
using testing::HasSubstr;
using testing::StartsWith;

void expect_refused(const test::Finished& finished, const std::vector<std::string>& says) {
  EXPECT_EQ(finished.exit_code, 2);
  EXPECT_EQ(finished.out, "");
  EXPECT_EQ(std::count(finished.err.begin(), finished.err.end(), '\n'), 1) << finished.err;
  EXPECT_THAT(finished.err, StartsWith("fringeslam: "));
  EXPECT_TRUE(finished.err.ends_with("\n"));
  for (const std::string& part : says) EXPECT_THAT(finished.err, HasSubstr(part));
}

class BadInput : public testing::Test {
 protected:
  void SetUp() override {
    test::write_small_scene(scene_);
    test::fs::create_directory(temp_ / "results");
  }
  std::string out() const { return (temp_ / "results/out").string(); }
  void expect_nothing_left() const { EXPECT_EQ(test::listing(temp_ / "results"), std::set<std::string>{}); }
  void expect_refused_by(const std::string& verb, const test::fs::path& source, const std::vector<std::string>& says,
                         const std::vector<std::string>& more = {}) const {
    SCOPED_TRACE(verb);
    std::vector<std::string> words = {verb, source.string(), "--out", out()};
    words.insert(words.end(), more.begin(), more.end());
    expect_refused(run_program(words), says);
    expect_nothing_left();
  }
  // Replaces `from` by `to` in the small scene; `run` and `render` must refuse it at the line of `to`.
  void expect_scene_refused(const std::string& from, const std::string& to, const std::string& says) const {
    const std::string text = test::replaced(test::kSmallScene, from, to);
    test::write_bytes(scene_ / "scene.yaml", text);
    const std::string place = (scene_ / "scene.yaml").string() + ":" + std::to_string(test::line_of(text, to)) + ": ";
    for (const std::string verb : {"run", "render"}) expect_refused_by(verb, scene_, {place, says});
  }

  test::TempFolder temp_;
  test::fs::path scene_ = temp_ / "scene";
};

TEST_F(BadInput, MissingFile) {
  for (const std::string verb : {"run", "render"}) {
    expect_refused_by(verb, temp_ / "none", {(temp_ / "none").string() + ": does not exist"});
    expect_refused_by(verb, temp_ / "results", {(temp_ / "results").string() + ": contains neither"});
  }
}

TEST_F(BadInput, BrokenYaml) { expect_scene_refused("  bits: 8", "  bits: 8: 9", "not valid YAML"); }
TEST_F(BadInput, UnknownKey) { expect_scene_refused("seed: 3", "sede: 3", "'sede'; did you mean 'seed'?"); }
TEST_F(BadInput, UnknownKeyOfAnObject) {
  expect_scene_refused("shape: plane, size_m: [0.8, 0.8]", "posse: {}, shape: plane, size_m: [0.8, 0.8]",
                       "'posse'; did you mean 'pose'?");
}
TEST_F(BadInput, NanSize) { expect_scene_refused("size_m: [0.8, 0.8]", "size_m: [0.8, .nan]", "'size_m' is nan"); }
TEST_F(BadInput, NegativeSize) { expect_scene_refused("size_m: [0.8, 0.8]", "size_m: [-1, 0.8]", "'size_m' is -1"); }
TEST_F(BadInput, SwappedSizes) { expect_scene_refused("[0.09, 0.08, 0.08]", "[0.03, 0.08, 0.08]", "size_max_m"); }
TEST_F(BadInput, NoSuchMaterial) {
  expect_scene_refused("0.8], material: table", "0.8], material: tabel", "did you mean 'table'?");
}
TEST_F(BadInput, NoSuchShape) { expect_scene_refused("shape: plane", "shape: plan", "did you mean 'plane'?"); }
TEST_F(BadInput, MissingRigFile) { expect_scene_refused("file: rig.yaml", "file: no.yaml", "no.yaml does not exist"); }
TEST_F(BadInput, TooFewSteps) { expect_scene_refused("steps: 3", "steps: 2", "'steps' is 2"); }
TEST_F(BadInput, NanMotion) { expect_scene_refused("[10, 5, -5]", "[10, .nan, -5]", "'translation_mm' is nan"); }

TEST_F(BadInput, InvalidLight) {
  const std::string ambient = "  ambient_lux: 290";
  expect_scene_refused(ambient, "  ambient_lux: -1", "'ambient_lux' is -1");
  expect_scene_refused(ambient, "  bounces: -2", "'bounces' is -2");
  expect_scene_refused(ambient, "  exposure_s: 1", "'exposure_s' is 1");
  expect_scene_refused("patterns:\n", "air: {extinction_per_m: -0.1}\npatterns:\n", "'extinction_per_m' is -0.1");
  expect_scene_refused("patterns:\n", "air: {density: 1}\npatterns:\n", "'extinction_per_m' is missing");
  expect_scene_refused("patterns:\n", "dust: {cover: 2}\npatterns:\n", "'cover' is 2");
  expect_scene_refused("patterns:\n", "dust: {cover: 1, up: [0, 0, 0]}\npatterns:\n", "'up' has no direction");
}

TEST_F(BadInput, InvalidMaterial) {
  const std::string table = "grain: wood, albedo: 0.4,";
  expect_scene_refused(table, "grain: wood, albedo: 1.4,", "'albedo' is 1.4");
  expect_scene_refused(table, "grain: wood, albedo: 0.4, roughness: 0,", "'roughness' is 0");
  expect_scene_refused(table, "grain: wood, albedo: 0.4, metal: true, reflectance: 0.5,",
                       "the reflectance of a metal is its albedo");
  expect_scene_refused(table, "grain: wood, albedo: 0.4, mean_free_path_m: -0.001,", "'mean_free_path_m' is -0.001");
  expect_scene_refused(table, "grain: wood, albedo: 0.4, mean_free_path_m: 2,", "'mean_free_path_m' is 2");
  expect_scene_refused(table, "grain: wood, albedo: 0.4, metal: true, mean_free_path_m: 0.001,",
                       "a metal is opaque; omit mean_free_path_m");
  expect_scene_refused(table, "grain: wood, albedo: 0.4, texture: no.png,", "give grain or texture, not both");
  expect_scene_refused("{grain: wood, albedo: 0.4, contrast: 0.35, grain_m: 0.012}", "{texture: no.png}",
                       "no.png does not exist");
}

TEST_F(BadInput, InvalidMesh) {
  const std::string plane = "{shape: plane, size_m: [0.8, 0.8], material: table}";
  expect_scene_refused(plane, "{shape: mesh, file: no.obj}", "no.obj does not exist");
  test::write_bytes(scene_ / "junk.obj", "v 0 0 0\nf 1 2 3\n");
  expect_scene_refused(plane, "{shape: mesh, file: junk.obj}", "junk.obj: ");
  test::write_bytes(scene_ / "good.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
  expect_scene_refused(plane, "{shape: mesh, file: good.obj, unit_m: 0}", "'unit_m' is 0");
  expect_scene_refused(plane, "{shape: mesh, file: good.obj, up: w}", "'up: w' is not one of");
}

TEST_F(BadInput, InvalidRig) {
  const std::string good = test::read_bytes(scene_ / "rig.yaml");
  const auto refused = [&](const std::string& from, const std::string& to, const std::string& says) {
    const size_t at = good.find(from);
    ASSERT_NE(at, std::string::npos) << from;
    std::string text = good;
    text.replace(at, text.find('\n', at) - at, to);
    test::write_bytes(scene_ / "rig.yaml", text);
    const std::string place = (scene_ / "rig.yaml").string() + ":" + std::to_string(test::line_of(text, to)) + ": ";
    for (const std::string verb : {"run", "render"}) expect_refused_by(verb, scene_, {place, says});
  };
  refused("bits: 8", "bits: 17", "'bits' is 17");
  refused("gain_dn_per_electron:", "gain_dn_per_electron: 0", "'gain_dn_per_electron' is 0");
  refused("quantum_efficiency:", "quantum_efficiency: 1.2", "'quantum_efficiency' is 1.2");
  refused("prnu:", "prnu: -0.1", "'prnu' is -0.1");
  refused("f_number:", "f_number: 0", "'f_number' is 0");
  refused("flux_lm:", "flux_lm: -5", "'flux_lm' is -5");
  refused("pixel_fill:", "pixel_fill: 0", "'pixel_fill' is 0");
  refused("camera_rate_hz:", "camera_rate_hz: 500", "camera_rate_hz exceeds pattern_rate_hz");
  refused("exposure_s:", "exposure_s: 0.5", "exposure_s exceeds the display time of a pattern");
}

// Without a period that covers the projector there is no absolute phase.
TEST_F(BadInput, NoPeriodCoversTheProjector) {
  test::write_bytes(scene_ / "scene.yaml", test::replaced(test::kSmallScene, "[1040, 131, 16.5]", "[131, 16.5]"));
  expect_refused_by("run", scene_, {"period covers the projector"});
}

TEST_F(BadInput, EmptyScene) {
  const std::string text(test::kSmallScene);
  const size_t begin = text.find("objects:"), end = text.find("trajectory:");
  test::write_bytes(scene_ / "scene.yaml", text.substr(0, begin) + "objects: []\n" + text.substr(end));
  const std::string line = std::to_string(test::line_of(text, "objects:"));
  for (const std::string verb : {"run", "render"})
    expect_refused_by(verb, scene_, {(scene_ / "scene.yaml").string() + ":" + line + ": ", "no object"});
}

TEST_F(BadInput, ProjectorThatPointsAway) {
  RigModel rig = test::thesis_rig_reduced(2);
  rig.projector_from_camera = pose_from({{0, 0, 0}, {0, 180, 0}}) * rig.projector_from_camera;
  const std::string text = to_yaml(rig), file = (scene_ / "rig.yaml").string();
  test::write_bytes(file, text);
  const std::string line = std::to_string(test::line_of(text, "projector_from_camera:"));
  for (const std::string verb : {"run", "render", "info"}) {
    SCOPED_TRACE(verb);
    if (verb == "info")
      expect_refused(run_program({verb, file}),
                     {file + ":" + line + ": ", "the projector illuminates nothing in the camera's view"});
    else
      expect_refused_by(verb, scene_,
                        {file + ":" + line + ": ", "the projector illuminates nothing in the camera's view"});
  }
}

TEST_F(BadInput, DatasetWithAMissingImage) {
  test::record(temp_ / "data", test::noise_stacks(CV_8UC1));
  const test::fs::path image = temp_ / "data/stacks/000001/03.png";
  test::fs::remove(image);
  expect_refused_by("run", temp_ / "data", {image.string() + ": is missing"});
  expect_refused(run_program({"info", (temp_ / "data").string()}), {image.string() + ": is missing"});
}

TEST_F(BadInput, DatasetWithATruncatedImage) {
  for (const int type : {CV_8UC1, CV_16UC1, CV_32FC1}) {
    const test::fs::path folder = temp_ / ("data" + std::to_string(type));
    test::record(folder, test::noise_stacks(type));
    const test::fs::path image = folder / (type == CV_32FC1 ? "stacks/000001/03.exr" : "stacks/000001/03.png");
    test::truncate_file(image, 0.5);
    expect_refused_by("run", folder, {image.string() + ": "}, {"--quiet"});
  }
}

TEST_F(BadInput, DatasetWithoutItsTruth) {
  test::record(temp_ / "data", test::noise_stacks(CV_8UC1));
  const test::fs::path file = temp_ / "data/dataset.yaml";
  test::write_bytes(file, test::replaced(test::read_bytes(file), "truth: false", "truth: true"));
  expect_refused_by("run", temp_ / "data", {(temp_ / "data/truth/truth.tum").string() + ": is missing"});
}

TEST_F(BadInput, SettingThatDoesNotExist) {
  expect_refused_by("run", scene_, {"decode.min_modulation=4", "did you mean 'min_modulation_dn'?"},
                    {"--set", "decode.min_modulation=4"});
  expect_refused_by("run", scene_, {"decoed.saturation=0.9", "did you mean 'decode'?"},
                    {"--set", "decoed.saturation=0.9"});
  expect_refused_by("run", scene_, {"must look like stage.key=value"}, {"--set", "saturation"});
}

TEST_F(BadInput, SettingOutOfRange) {
  expect_refused_by("run", scene_, {"decode.saturation=7", "[0.1, 1]"}, {"--set", "decode.saturation=7"});
  expect_refused_by("run", scene_, {"decode.saturation=nan"}, {"--set", "decode.saturation=nan"});
  expect_refused_by("run", scene_, {"decode.saturation=.nan"}, {"--set", "decode.saturation=.nan"});
  for (const std::string verb : {"run", "render"})
    expect_refused_by(verb, scene_, {"samples_per_pixel", "square number"}, {"--set", "render.samples_per_pixel=3"});
}

TEST_F(BadInput, MeshSettingWithoutAMesh) {
  expect_refused_by("run", scene_, {"mesh.* settings have no effect without --mesh"}, {"--set", "mesh.max_step_m=0.1"});
}

TEST_F(BadInput, InvalidSeed) {
  expect_refused_by("run", scene_, {"--seed"}, {"--seed", "-1"});
  expect_refused_by("run", scene_, {"--seed"}, {"--seed", "1.5"});
}

TEST_F(BadInput, OutputThatIsNotOurs) {
  test::write_bytes(temp_ / "results/out/thesis.txt", "precious");
  for (const std::string verb : {"run", "render"}) {
    expect_refused(run_program({verb, scene_.string(), "--out", out()}), {out() + ": exists and was not written by"});
    EXPECT_EQ(test::listing(temp_ / "results"), (std::set<std::string>{"out", "out/thesis.txt"}));
    EXPECT_EQ(test::read_bytes(temp_ / "results/out/thesis.txt"), "precious");
  }
}

// Many programs write a config.yaml or dataset.yaml, so the file name alone does not mark a folder as FringeSLAM's.
TEST_F(BadInput, OutputThatHappensToHoldAFileOfOurName) {
  for (const auto& [verb, name] : {std::pair("run", "config.yaml"), std::pair("render", "dataset.yaml")}) {
    SCOPED_TRACE(verb);
    test::fs::remove_all(temp_ / "results/out");
    test::write_bytes(temp_ / "results/out" / name, "train: images\n");
    test::write_bytes(temp_ / "results/out/thesis.txt", "precious");
    expect_refused(run_program({verb, scene_.string(), "--out", out(), "--set", "render.samples_per_pixel=1"}),
                   {out()});
    EXPECT_TRUE(test::fs::exists(temp_ / "results/out/thesis.txt")) << "another program's folder was replaced";
  }
}

TEST_F(BadInput, UnknownVerbAndMissingArguments) {
  expect_refused(run_program({"rnu", scene_.string()}), {"rnu"});
  expect_refused(run_program({}), {"--help"});
  expect_refused(run_program({"run"}), {"source"});
  expect_refused(run_program({"render", scene_.string()}), {"--out"});
  expect_refused(run_program({"run", scene_.string(), "--oops", "1", "--out", out()}), {"--oops"});
  expect_nothing_left();
}

TEST_F(BadInput, UnscorableResults) {
  expect_refused(run_program({"score", scene_.string()}), {scene_.string() + ": "});
  const std::string none = (temp_ / "none.tum").string(), good = (temp_ / "good.tum").string();
  const std::string bad = (temp_ / "bad.tum").string();
  test::write_bytes(good, "0 0 0 0 0 0 0 1\n0.5 0 0 0 0 0 0 1\n");
  test::write_bytes(bad, "0 0 0 0 0 0 0 1\n0.5 0 0 0 0 0 0 nan\n");
  expect_refused(run_program({"score", good}), {"--truth"});
  expect_refused(run_program({"score", none, "--truth", good}), {none + ": "});
  expect_refused(run_program({"score", good, "--truth", none}), {none + ": "});
  expect_refused(run_program({"score", bad, "--truth", good}), {bad + ":2: "});
  expect_refused(run_program({"info", none}), {none + ": does not exist"});
}

}  // namespace
}  // namespace fringeslam
