// SPDX-License-Identifier: Apache-2.0
// Runs `fringeslam calibrate` on boards and ramps that the program rendered with a known rig.
#include <gmock/gmock.h>

#include <nlohmann/json.hpp>

#include "core/rig/rig_file.h"
#include "tests/tools/child.h"

namespace fringeslam {
namespace {

using nlohmann::json;
using test::run_program;
using test::run_successfully;
using testing::HasSubstr;

// The thesis rig with a quarter of its pixels.
constexpr const char* kRig = R"(name: small
near_m: 0.7
far_m: 1.4
camera:
  {width_px: 266, height_px: 250, fx_px: 1023, fy_px: 1023, cx_px: 132.5, cy_px: 124.5, distortion: [-0.12, 0, 0, 0, 0],
   lens: {f_number: 14},
   sensor: {bits: 8, gain_dn_per_electron: 0.0068, dark_noise_electrons: 25, full_well_electrons: 40000, offset_dn: 2}}
projector:
  {width_px: 1024, height_px: 768, fx_px: 2600, fy_px: 2600, cx_px: 511.5, cy_px: 383.5, lens: {flux_lm: 2500},
   black_level: 0.002, gamma: GAMMA}
projector_from_camera: {translation_m: [-0.24253563, 0, 0.06063391], rotation_deg: [0, 14.03624347, 0]}
robot_from_camera: {translation_m: [0.1, 0, 1], rotation_deg: [180, 0, 0]}
)";

class Calibrate : public testing::Test {
 protected:
  // Writes a scene with one plane and its rig, and renders it to a dataset.
  std::string rendered(const std::string& name, const std::string& patterns, const std::string& material,
                       const std::string& trajectory, const std::string& gamma = "1") const {
    const test::fs::path folder = temp_ / (name + "_scene");
    test::fs::create_directories(folder);
    std::string rig = kRig;
    rig.replace(rig.find("GAMMA"), 5, gamma);
    test::write_bytes(folder / "rig.yaml", rig);
    test::write_bytes(folder / "scene.yaml",
                      "name: " + name + "\nrig: {file: rig.yaml}\nlight: {ambient_lux: 290}\npatterns: " + patterns +
                          "\nmaterials:\n  board: " + material +
                          "\nobjects:\n  - {shape: plane, size_m: [0.2, 0.2], material: board}\n" +
                          "trajectory: " + trajectory + "\n");
    if (!board_.empty()) test::write_bytes(folder / "board.yaml", board_);
    const std::string out = (temp_ / name).string();
    run_successfully({"render", folder.string(), "--out", out, "--quiet", "--set", "render.samples_per_pixel=9"});
    return out;
  }
  std::string at(const std::string& name) const { return (temp_ / name).string(); }

  test::TempFolder temp_;
  std::string board_;
  const std::string both_ = "{axis: both, steps: 3, periods_px: [1040, 131, 16.5]}";
  const std::string views_ =
      "{board_views: {count: 7, distance_m: [0.75, 1.1], max_tilt_deg: 40, extent_m: [0.13, 0.13]}}";
};

TEST_F(Calibrate, RigFromBothKindsOfBoards) {
  struct Kind {
    std::string name, board, material;
  };
  for (const Kind& kind :
       {Kind{"checkers", "kind: checkerboard\ncolumns: 7\nrows: 6\nspacing_m: 0.016\n",
             "{grain: checkerboard, columns: 7, rows: 6, spacing_m: 0.016, albedo: 0.75, print_albedo: 0.2}"},
        Kind{"circles", "kind: circles\ncolumns: 7\nrows: 6\nspacing_m: 0.018\ndiameter_m: 0.009\n",
             "{grain: circles, columns: 7, rows: 6, spacing_m: 0.018, diameter_m: 0.009, albedo: 0.75, print_albedo: "
             "0.2}"}}) {
    board_ = kind.board;
    const std::string dataset = rendered(kind.name, both_, kind.material, views_);
    const auto result = run_program({"calibrate", "rig", dataset, "--out", at(kind.name + "_rig"), "--json", "--set",
                                     "calibration.radial_terms=1", "--set", "calibration.tangential=false"});
    ASSERT_EQ(result.exit_code, 0) << result.err;
    const json printed = json::parse(result.out);
    EXPECT_LT(printed.at("camera").at("rms_px"), 0.15) << kind.name;
    const RigModel rig = read_rig(temp_ / (kind.name + "_rig/rig.yaml"));
    EXPECT_NEAR(rig.camera.fx, 1023, 5 * static_cast<double>(printed["camera"]["sigma_px"][0])) << kind.name;
    EXPECT_NEAR(rig.projector_from_camera.translation.x(), -0.24253563,
                5e-3 * static_cast<double>(printed["projector_from_camera"]["sigma_translation_mm"][0]))
        << kind.name;
    EXPECT_EQ(rig.sensor.dark_noise_electrons, 25);  // parameters that are not calibrated are kept
    EXPECT_TRUE(test::fs::exists(temp_ / (kind.name + "_rig/coverage.png")));
    EXPECT_TRUE(test::fs::exists(temp_ / (kind.name + "_rig/calibration.html")));
    EXPECT_TRUE(test::fs::exists(temp_ / (kind.name + "_rig/views/000000.png")));
    EXPECT_EQ(json::parse(test::read_bytes(temp_ / (kind.name + "_rig/calibration.json"))), printed);
  }
  // The same as text, without a view that does not show the board.
  const std::string nothing = rendered("nothing", both_, "{grain: plain, albedo: 0.5}", "{}");
  test::fs::copy(test::fs::path(nothing) / "stacks/000000", temp_ / "circles/stacks/000000",
                 test::fs::copy_options::recursive | test::fs::copy_options::overwrite_existing);
  const std::string table = run_successfully({"calibrate", "rig", at("circles"), "--out", at("table")}).out;
  EXPECT_THAT(table,
              testing::AllOf(HasSubstr("not used: "), HasSubstr("(RMS reprojection)"), HasSubstr("projector  fx ")));
}

TEST_F(Calibrate, RigSaysWhatIsMissing) {
  const std::string material = "{grain: checkerboard, columns: 7, rows: 6, spacing_m: 0.016, albedo: 0.75}";
  const std::string one_axis =
      rendered("one_axis", "{steps: 3, periods_px: [1040, 131]}", material,
               "{board_views: {count: 2, distance_m: [0.8, 1], max_tilt_deg: 30, extent_m: [0.13, 0.13]}}");
  const auto error = [&](const std::vector<std::string>& more) {
    std::vector<std::string> words = {"calibrate", "rig", one_axis, "--out", at("refused")};
    words.insert(words.end(), more.begin(), more.end());
    const auto result = run_program(words);
    EXPECT_EQ(result.exit_code, 2);
    EXPECT_FALSE(test::fs::exists(temp_ / "refused"));
    return result.err;
  };
  EXPECT_THAT(error({}), HasSubstr("one_axis/board.yaml: is missing; describe the board there"));
  test::write_bytes(temp_ / "board.yaml", "kind: checkerboard\ncolumns: 7\nrows: 6\nspacing: 0.016\n");
  EXPECT_THAT(error({"--board", at("board.yaml")}),
              HasSubstr("'spacing_m' is missing; is 'spacing' a misspelling of it?"));
  test::write_bytes(temp_ / "board.yaml", "kind: chessboard\ncolumns: 7\nrows: 6\nspacing_m: 0.016\n");
  EXPECT_THAT(error({"--board", at("board.yaml")}), HasSubstr("board.yaml:1: "));
  test::write_bytes(temp_ / "board.yaml", "kind: checkerboard\ncolumns: 7\nrows: 6\nspacing_m: 0.016\n");
  EXPECT_THAT(error({"--board", at("board.yaml")}), HasSubstr("rig calibration needs patterns in both axes"));
}

TEST_F(Calibrate, ResponseOfAGamma) {
  const std::string dataset =
      rendered("ramp", "{steps: 12, periods_px: [64], ramp_levels: 17}", "{grain: plain, albedo: 0.75}", "{}", "2.2");
  const json printed =
      json::parse(run_program({"calibrate", "response", dataset, "--out", at("response"), "--json"}).out);
  EXPECT_NEAR(printed.at("gamma"), 2.2, 0.02);
  const RigModel rig = read_rig(temp_ / "response/rig.yaml");
  ASSERT_EQ(rig.projector_response.size(), 257U);
  EXPECT_NEAR(rig.projector_response[128], std::pow(0.5, 2.2), 0.01);
  EXPECT_EQ(rig.phase_correction.steps, 3);
  // The measured response can be inverted in patterns.
  run_successfully({"patterns", "--rig", at("response/rig.yaml"), "--linearise", "--periods", "1040,131,16.5", "--out",
                    at("patterns"), "--quiet"});
  EXPECT_EQ(read_patterns(temp_ / "patterns/patterns.yaml").inverse_response.empty(), false);
  const std::string plain = rendered("plain", "{steps: 3, periods_px: [1040]}", "{grain: plain, albedo: 0.75}", "{}");
  const auto refused = run_program({"calibrate", "response", plain, "--out", at("none")});
  EXPECT_EQ(refused.exit_code, 2);
  EXPECT_THAT(refused.err, HasSubstr("neither a gray ramp of 5 levels or more nor 8 or more steps"));
}

// Images of several exposures look like more phase steps, which any response fits.
TEST_F(Calibrate, ResponseRefusesSeveralExposures) {
  const std::string dataset =
      rendered("bracketed", "{axis: columns, steps: 3, periods_px: [1040, 131, 16.5], exposures: [0.25, 0.5, 1]}",
               "{grain: plain, albedo: 0.5}", "{}", "2.2");
  const auto refused = run_program({"calibrate", "response", dataset, "--out", at("none")});
  EXPECT_EQ(refused.exit_code, 2);
  EXPECT_THAT(refused.err, HasSubstr("its patterns have several exposures, which look like phase steps"));
  EXPECT_FALSE(test::fs::exists(temp_ / "none"));
  // Without their exposures, they are three shifts shown three times.
  PatternSequence sequence = read_patterns(temp_ / "bracketed/patterns.yaml");
  for (Pattern& pattern : sequence.patterns) pattern.exposure = 1;
  test::write_bytes(temp_ / "bracketed/patterns.yaml", to_yaml(sequence));
  const auto uneven = run_program({"calibrate", "response", dataset, "--out", at("none")});
  EXPECT_EQ(uneven.exit_code, 2);
  EXPECT_THAT(uneven.err, HasSubstr("steps of several periods, all equally spaced"));
}

// The usual sequence shows the response, too. Without it, the images seem to be of a moving camera; with it, they are mapped.
TEST_F(Calibrate, ResponseOfSeveralPeriods) {
  const std::string dataset =
      rendered("bent", "{steps: 3, periods_px: [1040, 131, 16.5]}", "{grain: plain, albedo: 0.75}", "{}", "2.2");
  const json printed =
      json::parse(run_program({"calibrate", "response", dataset, "--out", at("response"), "--json"}).out);
  EXPECT_NEAR(printed.at("gamma"), 2.2, 0.06);
  EXPECT_EQ(read_rig(temp_ / "response/rig.yaml").phase_correction.steps, 3);
  const auto lost = run_program({"run", dataset, "--out", at("lost"), "--quiet", "--no-report"});
  EXPECT_EQ(lost.exit_code, 1);
  EXPECT_THAT(lost.err, HasSubstr("calibrate response"));
  const auto mapped =
      run_program({"run", dataset, "--rig", at("response/rig.yaml"), "--out", at("mapped"), "--quiet", "--no-report"});
  EXPECT_EQ(mapped.exit_code, 0) << mapped.err;
}

TEST_F(Calibrate, NoiseOfTheCamera) {
  const std::string material =
      "{grain: checkerboard, columns: 9, rows: 9, spacing_m: 0.02, albedo: 0.8, print_albedo: 0.1}";
  const std::string dataset = rendered("noise", "{steps: 12, periods_px: [64]}", material, "{}");
  const auto measured = run_program({"calibrate", "noise", dataset, "--out", at("measured"), "--json"});
  ASSERT_EQ(measured.exit_code, 0) << measured.err;
  const json printed = json::parse(measured.out);
  EXPECT_NEAR(printed.at("gain_dn_per_electron").at("value"), 0.0068, 0.05 * 0.0068);
  const RigModel rig = read_rig(temp_ / "measured/rig.yaml");
  for (const double grey : {40.0, 120.0, 200.0}) {
    const double truth = 0.0068 * (grey - 2) + std::pow(0.0068 * 25, 2) + 1.0 / 12;
    EXPECT_NEAR(rig.sensor.variance_dn2(grey) / truth, 1, 0.05) << grey;
  }
  EXPECT_TRUE(test::fs::exists(temp_ / "measured/noise.png"));
  const std::string table = run_successfully({"calibrate", "noise", dataset, "--out", at("table")}).out;
  EXPECT_THAT(table,
              AllOf(HasSubstr("gain, DN/electron"), HasSubstr("dark noise, electrons"), HasSubstr("saturation, DN")));
  const std::string plain = rendered("plain", "{steps: 3, periods_px: [1040]}", material, "{}");
  const auto refused = run_program({"calibrate", "noise", plain, "--out", at("none")});
  EXPECT_EQ(refused.exit_code, 2);
  EXPECT_THAT(refused.err, HasSubstr("the images contain no redundancy that shows noise"));
  EXPECT_FALSE(test::fs::exists(temp_ / "none"));
}

TEST_F(Calibrate, StageFromCommandedMotions) {
  board_ = "kind: checkerboard\ncolumns: 7\nrows: 6\nspacing_m: 0.016\n";
  const std::string material =
      "{grain: checkerboard, columns: 7, rows: 6, spacing_m: 0.016, albedo: 0.75, print_albedo: 0.3}";
  const std::string trajectory = R"(
  commanded: true
  start: {translation_m: [-0.1, 0, 0]}
  motions:
    - {translation_mm: [15, 0, 10], rotation_deg: [8, 0, 0]}
    - {translation_mm: [0, 20, 0], rotation_deg: [0, 9, 0]}
    - {translation_mm: [-15, -10, 20], rotation_deg: [-8, 0, 10]}
    - {translation_mm: [0, -10, 0], rotation_deg: [0, -9, 8]})";
  const std::string dataset = rendered("stage", "{steps: 3, periods_px: [1040, 131, 16.5]}", material, trajectory);
  run_successfully({"calibrate", "stage", dataset, "--out", at("mount"), "--quiet"});
  const RigModel rig = read_rig(temp_ / "mount/rig.yaml");
  EXPECT_NEAR(rig.robot_from_camera.translation.x(), 0.1, 2e-4);
  EXPECT_NEAR(rig.robot_from_camera.translation.z(), 1, 2e-4);
  EXPECT_NEAR(rig.robot_from_camera.rotation(2, 2), -1, 1e-6);
  test::fs::remove(temp_ / "stage/stage.tum");
  const auto refused = run_program({"calibrate", "stage", dataset, "--out", at("none")});
  EXPECT_EQ(refused.exit_code, 2);
  EXPECT_THAT(refused.err, HasSubstr("give the commanded poses"));
}

// Without a choice of one exposure, equal patterns at several exposures count as steps of one sinusoid.
TEST_F(Calibrate, NoiseOfTheCameraFromSeveralExposures) {
  const std::string material =
      "{grain: checkerboard, columns: 9, rows: 9, spacing_m: 0.02, albedo: 0.8, print_albedo: 0.1}";
  const std::string dataset =
      rendered("exposures", "{steps: 12, periods_px: [64], exposures: [0.25, 0.5, 1]}", material, "{}");
  const auto measured = run_program({"calibrate", "noise", dataset, "--out", at("measured"), "--json"});
  ASSERT_EQ(measured.exit_code, 0) << measured.err;
  const json gain = json::parse(measured.out).at("gain_dn_per_electron");
  EXPECT_LE(gain.at("low"), 0.0068);
  EXPECT_GE(gain.at("high"), 0.0068);
  EXPECT_NEAR(gain.at("value"), 0.0068, 0.05 * 0.0068);
}

}  // namespace
}  // namespace fringeslam
