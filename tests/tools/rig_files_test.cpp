// SPDX-License-Identifier: Apache-2.0
// rig.yaml and patterns.yaml: written values read back exactly, and impossible values are refused.
#include <gmock/gmock.h>

#include <numbers>

#include "core/io/yaml.h"
#include "core/rig/rig_file.h"
#include "core/types/frame.h"
#include "tests/support/temp_folder.h"
#include "tests/tools/fake_rig.h"

namespace fringeslam {
namespace {

using test::message_of;
using testing::HasSubstr;
using testing::StartsWith;

void expect_equal(const Pinhole& a, const Pinhole& b) {
  EXPECT_EQ(a.width, b.width);
  EXPECT_EQ(a.height, b.height);
  const Distortion &c = a.distortion, &d = b.distortion;
  EXPECT_EQ((std::vector{a.fx, a.fy, a.cx, a.cy, c.k1, c.k2, c.p1, c.p2, c.k3}),
            (std::vector{b.fx, b.fy, b.cx, b.cy, d.k1, d.k2, d.p1, d.p2, d.k3}));
}

void expect_equal(const Pose& a, const Pose& b) {
  EXPECT_EQ(a.rotation, b.rotation);
  EXPECT_EQ(a.translation, b.translation);
}

// Returns the values that only the simulator reads.
std::vector<double> numbers_of_light(const RigModel& rig) {
  const CameraLens& c = rig.camera_lens;
  const ProjectorLens& p = rig.projector_lens;
  const SensorModel& s = rig.sensor;
  return {c.pixel_m,
          c.f_number,
          c.focus_m,
          c.transmission,
          c.blur_px,
          c.vignetting,
          p.aperture_m,
          p.focus_m,
          p.blur_px,
          p.pixel_fill,
          p.vignetting,
          p.flux_lm,
          p.efficacy_lm_w,
          p.wavelength_m,
          rig.timing.pattern_rate_hz,
          rig.timing.camera_rate_hz,
          rig.timing.exposure_s,
          s.quantum_efficiency,
          s.dark_current_electrons_s,
          s.dsnu_electrons,
          s.prnu};
}

void expect_equal(const RigModel& a, const RigModel& b) {
  EXPECT_EQ(a.name, b.name);
  expect_equal(a.camera, b.camera);
  expect_equal(a.projector, b.projector);
  expect_equal(a.projector_from_camera, b.projector_from_camera);
  expect_equal(a.robot_from_camera, b.robot_from_camera);
  EXPECT_EQ(a.sensor.bits, b.sensor.bits);
  EXPECT_EQ((std::vector{a.sensor.gain_dn_per_electron, a.sensor.dark_noise_electrons, a.sensor.full_well_electrons,
                         a.sensor.offset_dn, a.projector_black_level, a.near_m, a.far_m}),
            (std::vector{b.sensor.gain_dn_per_electron, b.sensor.dark_noise_electrons, b.sensor.full_well_electrons,
                         b.sensor.offset_dn, b.projector_black_level, b.near_m, b.far_m}));
  EXPECT_EQ(numbers_of_light(a), numbers_of_light(b));
  ASSERT_EQ(a.thermal.has_value(), b.thermal.has_value());
  if (!a.thermal) return;
  expect_equal(a.thermal->lens, b.thermal->lens);
  expect_equal(a.thermal->thermal_from_camera, b.thermal->thermal_from_camera);
  EXPECT_EQ((std::vector{a.thermal->netd_k, a.thermal->blur_px, a.thermal->coldest_c, a.thermal->hottest_c}),
            (std::vector{b.thermal->netd_k, b.thermal->blur_px, b.thermal->coldest_c, b.thermal->hottest_c}));
}

RigModel read_back(const RigModel& rig) {
  const test::TempFolder temp;
  test::write_bytes(temp / "rig.yaml", to_yaml(rig));
  return read_rig(temp / "rig.yaml");
}

// Returns a rig without default values and without numbers of short decimal form.
RigModel odd_rig() {
  RigModel rig = test::thesis_rig();
  const double pi = std::numbers::pi;
  rig.name = "odd";
  rig.near_m = 0.7 + 1e-15, rig.far_m = 1.0 + 1 / 3.0;
  rig.camera = {
      533, 501, 2046 + pi, 2045 + 1 / 7.0, 265 + 0.1, 249 + 0.2, {-0.1 / 3, 0.1 / 7, 1e-4 / 3, -1e-4 / 7, 1e-3 / 3}};
  rig.projector.fx += 1 / 3.0, rig.projector.distortion.k3 = -1e-3 / 7;
  rig.sensor = {12, 0.1 / 3, 25 + pi, 40000.0 / 3, 2 + 1 / 7.0, 1 / 3.0, 10 / 7.0, 20 / 3.0, 0.01 / 3};
  rig.camera_lens = {1e-5 / 3, 8 / 3.0, 1 / 3.0, 0.5 / 3, 1 / 7.0, 4 / 3.0};
  rig.projector_lens = {0.01 / 3, 1 / 3.0, 1 / 7.0, 2 / 3.0, 10 / 3.0, 1e4 / 3, 1e3 / 3, 5e-7 / 3 + 4e-7};
  rig.timing = {1000 / 3.0, 100 / 3.0, 0.001 / 3};
  rig.projector_black_level = 0.001 / 3;
  rig.projector_from_camera = retract(rig.projector_from_camera, Vector6d::Constant(1e-3 / 3));
  rig.robot_from_camera = retract(rig.robot_from_camera, Vector6d::Constant(0.1 / 7));
  rig.thermal = {
      {161, 121, 130 + 1 / 3.0, 131 / 3.0, 79 + pi, 59 - pi, {-0.1 / 3, 0.01 / 7, 1e-4 / 3, 1e-4 / 7, 1e-5 / 3}},
      retract(Pose{}, Vector6d::Constant(0.1 / 3)),
      0.1 / 3,
      1 / 7.0,
      -40 / 3.0,
      1000 / 3.0};
  return rig;
}

TEST(RigFile, ReadsBackToTheLastBit) { expect_equal(read_back(odd_rig()), odd_rig()); }

TEST(RigFile, ShippedRigsReadBackToTheLastBit) {
  for (const auto& entry : test::fs::directory_iterator(test::fs::path(FRINGESLAM_SOURCE_DIR) / "scenes/rigs")) {
    if (entry.path().extension() != ".yaml") continue;
    const RigModel rig = read_rig(entry.path());
    expect_equal(read_back(rig), rig);
  }
}

// A rig's name is free text; a quoted YAML string may contain anything.
TEST(RigFile, AnyNameReadsBack) {
  for (const std::string name : {"lab: camera 2", "rig #2", "\"quoted\"", "it's", "- dash", "[1, 2]", "~", "null",
                                 "ünï", "a\\b", "two\nlines", " spaces "}) {
    RigModel rig = test::thesis_rig();
    rig.name = name;
    try {
      EXPECT_EQ(read_back(rig).name, name);
    } catch (const Error& error) {
      ADD_FAILURE() << "name " << testing::PrintToString(name) << ": " << error.what();
    }
  }
}

std::string error_of(const std::string& from, const std::string& to, int* line = nullptr) {
  const std::string text =
      test::replaced(test::read_bytes(test::fs::path(FRINGESLAM_SOURCE_DIR) / "scenes/rigs/thesis.yaml"), from, to);
  if (line) *line = test::line_of(text, to);
  return message_of([&] { read_rig(YamlMap::parse(text, "rig.yaml")); });
}

void expect_error_at(const std::string& from, const std::string& to, const std::string& says) {
  int line = 0;
  const std::string message = error_of(from, to, &line);
  EXPECT_THAT(message, StartsWith("rig.yaml:" + std::to_string(line) + ": "));
  EXPECT_THAT(message, HasSubstr(says));
}

TEST(RigFile, RefusesTheImpossible) {
  expect_error_at("far_m: 1.4", "far_m: 0.7", "far_m must be larger");
  expect_error_at("width_px: 532", "width_px: 0", "'width_px' is 0");
  expect_error_at("fx_px: 2046", "fx_px: -2046", "'fx_px' is -2046");
  expect_error_at("bits: 8", "bits: 17", "'bits' is 17");
  expect_error_at("full_well_electrons: 40000", "full_well_electrons: .nan", "is nan");
  // r (1 - 9 r^2) has its maximum 0.128 at r = 0.192, but the corners lie at 0.178.
  expect_error_at("[-0.12, 0.1, 0.0003, -0.0002, 0]", "[-9, 0, 0, 0, 0]", "cannot be inverted");
}

TEST(RigFile, RefusesAThermalCameraThatIsImpossible) {
  const std::string whole = test::read_bytes(test::fs::path(FRINGESLAM_SOURCE_DIR) / "scenes/rigs/rescue.yaml");
  const auto expect_error = [&](const std::string& from, const std::string& to, const std::string& says) {
    const std::string text = test::replaced(whole, from, to);
    const std::string message = message_of([&] {
      const YamlMap map = YamlMap::parse(text, "rig.yaml");
      read_rig(map);
      map.finish();
    });
    EXPECT_THAT(message, StartsWith("rig.yaml:" + std::to_string(test::line_of(text, to)) + ": "));
    EXPECT_THAT(message, HasSubstr(says));
  };
  expect_error("width_px: 160", "width_px: 0", "'width_px' is 0");
  expect_error("netd_k: 0.05", "netd_k: -1", "'netd_k' is -1");
  expect_error("netd_k: 0.05", "netdk: 0.05", "did you mean 'netd_k'");
  expect_error("range_c: [-40, 330]", "range_c: [330, -40]", "the second must be larger");
  expect_error("range_c: [-40, 330]", "range_c: [-40, 500]", "500");  // exceeds 16 bits of centikelvin
  expect_error("thermal_from_camera: {translation_m: [0.05, 0, 0],", "thermal_from_camera: {translation_m: [0.05, 0],",
               "translation_m");
}

// r (1 - 5.25 r^2) has its maximum 0.168 at r = 0.252, but the corners lie at 0.178: only pixels in the corners have
// no ray.
TEST(RigFile, ALensMayFoldInTheExtremeCorners) {
  const std::string text =
      test::replaced(test::read_bytes(test::fs::path(FRINGESLAM_SOURCE_DIR) / "scenes/rigs/thesis.yaml"),
                     "[-0.12, 0.1, 0.0003, -0.0002, 0]", "[-5.25, 0, 0, 0, 0]");
  const RigModel rig = read_rig(YamlMap::parse(text, "rig.yaml"));
  const PixelRays rays = pixel_rays(rig.camera);
  int without_ray = 0;
  for (int row = 0; row < rays.rows; ++row) {
    for (int col = 0; col < rays.cols; ++col) {
      const double x = (col - rig.camera.cx) / rig.camera.fx, y = (row - rig.camera.cy) / rig.camera.fy;
      const bool has_ray = rays(row, col)[0] == rays(row, col)[0];
      if (std::abs(std::hypot(x, y) - 0.168) > 1e-3) {
        ASSERT_EQ(has_ray, std::hypot(x, y) < 0.168) << row << ", " << col;
      }
      without_ray += !has_ray;
    }
  }
  EXPECT_GT(without_ray, 100);
  EXPECT_LT(without_ray, 0.05 * static_cast<double>(rays.total()));
}

TEST(RigFile, RefusesARigThatCanMeasureNothing) {
  EXPECT_THAT(error_of("rotation_deg: [0, 14.03624347, 0]", "rotation_deg: [0, 194, 0]"),
              HasSubstr("illuminates nothing in the camera's view"));
  EXPECT_THAT(error_of("rotation_deg: [0, 14.03624347, 0]", "rotation_deg: [0, -50, 0]"),
              HasSubstr("illuminates nothing in the camera's view"));
  EXPECT_THAT(error_of("[-0.24253563, 0, 0.06063391]", "[0, 0, 0]"), HasSubstr("have the same position"));
}

TEST(RigFile, BeamMeetsViewOnlyInTheWorkingRange) {
  RigModel rig = test::thesis_rig();
  EXPECT_TRUE(fields_overlap(rig));
  // At 0.2 m the beam is still 0.15 m beside the view, which is 0.03 m wide to each side.
  rig.near_m = 0.05, rig.far_m = 0.2;
  EXPECT_FALSE(fields_overlap(rig));
}

TEST(PatternsFile, ReadsBackToTheLastBit) {
  PatternSequence sequence = phase_shift_sequence(1024, 768, {1040, 131, 100 / 6.0}, 5, Axis::columns, 8);
  for (const Pattern& rows : phase_shift_sequence(1024, 768, {800, 33.3}, 3, Axis::rows, 0).patterns)
    sequence.patterns.push_back(rows);
  const test::TempFolder temp;
  test::write_bytes(temp / "patterns.yaml", to_yaml(sequence));
  EXPECT_TRUE(read_patterns(temp / "patterns.yaml") == sequence);
}

TEST(PatternsFile, EveryCodingReadsBack) {
  PatternSequence sequence{1024, 768, {}};
  sequence.patterns.push_back({Axis::rows, 21.1, 1 / 3.0, 8, Coding::extra});
  Pattern product{Axis::columns, 1024 / 7.0, -0.1, 10, Coding::product};
  product.carrier_px = 50 / 3.0;
  product.carrier_shift_rad = 2 / 7.0;
  sequence.patterns.push_back(product);
  sequence.patterns.push_back({.axis = Axis::rows, .period_px = 3.7, .coding = Coding::gray, .inverted = true});
  Pattern long_run{.axis = Axis::rows, .period_px = 8, .coding = Coding::gray};
  long_run.code_bits = 7;
  long_run.code_bit = 3;
  sequence.patterns.push_back(long_run);
  sequence.patterns.push_back({.coding = Coding::flat, .level = 1 / 3.0});
  const test::TempFolder temp;
  const std::string text = to_yaml(sequence);
  test::write_bytes(temp / "patterns.yaml", text);
  EXPECT_TRUE(read_patterns(temp / "patterns.yaml") == sequence);
  test::write_bytes(temp / "patterns.yaml", test::replaced(text, "carrier_px", "carrier"));
  EXPECT_THAT(message_of([&] { read_patterns(temp / "patterns.yaml"); }),
              HasSubstr("patterns.yaml:5: 'carrier_px' is missing"));
}

TEST(PatternsFile, ErrorsSayFileAndLine) {
  const test::TempFolder temp;
  const std::string good = to_yaml(phase_shift_sequence(1024, 768, {1040}, 3, Axis::columns, 8));
  const std::string file = (temp / "patterns.yaml").string();
  const auto error = [&](const std::string& text) {
    test::write_bytes(file, text);
    return message_of([&] { read_patterns(file); });
  };
  EXPECT_THAT(error(test::replaced(good, "period_px: 1040", "period_px: -3")), StartsWith(file + ":4: 'period_px'"));
  EXPECT_THAT(error(test::replaced(good, "axis: columns", "axis: column")), HasSubstr("did you mean 'columns'"));
  EXPECT_THAT(error(test::replaced(good, "bits: 8", "bit: 8")), StartsWith(file + ":4: "));
  EXPECT_THAT(error("width_px: 1024\nheight_px: 768\npatterns: []\n"), StartsWith(file + ":3: "));
}

}  // namespace
}  // namespace fringeslam
