// SPDX-License-Identifier: Apache-2.0
// fringeslam import: converts images and calibrations of other rigs with any names, formats and conventions to an
// equivalent dataset; inconsistent input is refused with the file's name.
#include "core/import/import.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <cstdlib>
#include <functional>
#include <nlohmann/json.hpp>
#include <numbers>
#include <opencv2/core/persistence.hpp>

#include "core/decode/decode.h"
#include "core/import/opencv_calibration.h"
#include "core/rig/dataset.h"
#include "core/score/truth_files.h"
#include "tests/support/image_file.h"
#include "tests/tools/child.h"

namespace fringeslam {
namespace {

namespace fs = std::filesystem;

using test::message_of;
using test::write_image;
using testing::HasSubstr;
using testing::StartsWith;

constexpr double kTwoPi = 2 * std::numbers::pi;

cv::Mat1d matrix_of(const Pinhole& p) { return (cv::Mat1d(3, 3) << p.fx, 0, p.cx, 0, p.fy, p.cy, 0, 0, 1); }

cv::Mat1d distortion_of(const Pinhole& p, int terms = 5) {
  const Distortion& d = p.distortion;
  cv::Mat1d row(1, terms, 0.0);
  const std::vector<double> known = {d.k1, d.k2, d.p1, d.p2, d.k3};
  for (int i = 0; i < std::min(terms, 5); ++i) row(i) = known[static_cast<size_t>(i)];
  return row;
}

cv::Mat1d rotation_of(const Pose& pose, bool as_vector) {
  const Eigen::Matrix3d& r = pose.rotation;
  const Eigen::Vector3d v = rotation_log(r);
  if (as_vector) return (cv::Mat1d(3, 1) << v.x(), v.y(), v.z());
  return (cv::Mat1d(3, 3) << r(0, 0), r(0, 1), r(0, 2), r(1, 0), r(1, 1), r(1, 2), r(2, 0), r(2, 1), r(2, 2));
}

cv::Mat1d millimetres(const Eigen::Vector3d& t) { return (cv::Mat1d(3, 1) << 1e3 * t.x(), 1e3 * t.y(), 1e3 * t.z()); }

void write_calibration(const fs::path& file, const RigModel& rig, bool inverse = false, bool as_vector = false,
                       int terms = 5) {
  fs::create_directories(file.parent_path());
  const Pose pose = inverse ? rig.projector_from_camera.inverse() : rig.projector_from_camera;
  cv::FileStorage storage(file.string(), cv::FileStorage::WRITE);
  storage << "cam_K" << matrix_of(rig.camera) << "cam_kc" << distortion_of(rig.camera, terms);
  storage << "proj_K" << matrix_of(rig.projector) << "proj_kc" << distortion_of(rig.projector, terms);
  storage << "R" << rotation_of(pose, as_vector) << "T" << millimetres(pose.translation);
}

void expect_near(const Pinhole& a, const Pinhole& b) {
  EXPECT_EQ(a.width, b.width);
  EXPECT_EQ(a.height, b.height);
  const Distortion &c = a.distortion, &d = b.distortion;
  const std::vector<double> expected = {b.fx, b.fy, b.cx, b.cy, d.k1, d.k2, d.p1, d.p2, d.k3};
  EXPECT_THAT((std::vector{a.fx, a.fy, a.cx, a.cy, c.k1, c.k2, c.p1, c.p2, c.k3}),
              testing::Pointwise(testing::DoubleNear(1e-9), expected));
}

void expect_near(const RigModel& a, const RigModel& b) {
  expect_near(a.camera, b.camera);
  expect_near(a.projector, b.projector);
  const Vector6d off = difference(a.projector_from_camera, b.projector_from_camera);
  EXPECT_LT(off.norm(), 1e-9);
}

struct Format {
  int type = CV_8UC1;
  std::string extension;
};

class ImportFormats : public testing::TestWithParam<Format> {};

TEST_P(ImportFormats, AnotherRigsFilesAreTheSameDataset) {
  const auto& [type, extension] = GetParam();
  const test::TempFolder temp;
  const RigModel rig = test::tiny_rig();
  const std::vector<FringeStack> stacks = test::noise_stacks(type);
  // These folders sort differently by letters and by number.
  for (const auto& [folder, stack] : {std::pair("pose9", &stacks[0]), std::pair("pose10", &stacks[1])}) {
    fs::create_directories(temp / "in" / folder);
    for (size_t i = 0; i < 6; ++i)
      write_image(temp / "in" / folder / ("cam_" + std::to_string(5 + i) + extension), stack->images[i]);
  }
  write_calibration(temp / "in/calibration.xml", rig);
  test::write_bytes(temp / "in/import.yaml",
                    "name: \"rig: 2\"\nnear_m: 0.7\nfar_m: 1.4\nstacks: pose*\ninterval_s: 0.5\n"
                    "projector: {width_px: 1024, height_px: 768}\n"
                    "calibration: {file: calibration.xml, unit_m: 0.001}\n" +
                        std::string(type == CV_32FC1 ? "camera: {bits: 12}\n" : "") +
                        "patterns:\n"
                        "  - {files: \"cam_{}" +
                        extension +
                        "\", first: 5, fringe: {axis: columns, period_px: 1040, "
                        "shift_deg: [-120, 0, 120], coordinate_origin: pixel_edge}}\n"
                        "  - {files: \"cam_%d" +
                        extension +
                        "\", first: 8, fringe: {axis: columns, period_px: 131, "
                        "steps: 3, phase_offset_deg: -120, coordinate_origin: pixel_edge}}\n");
  const test::Finished done =
      test::run_successfully({"import", (temp / "in").string(), "--out", (temp / "out").string(), "--json"});
  EXPECT_EQ(nlohmann::json::parse(done.out).at("stacks"), 2);

  ReplayRig replay(temp / "out");
  EXPECT_EQ(replay.info().name, "rig: 2");
  expect_near(replay.model(), rig);
  EXPECT_EQ(replay.model().sensor.bits, type == CV_8UC1 ? 8 : type == CV_16UC1 ? 16 : 12);
  const PatternSequence expected = test::short_sequence(), found = replay.sequence();
  ASSERT_EQ(found.patterns.size(), expected.patterns.size());
  for (size_t i = 0; i < expected.patterns.size(); ++i) {
    EXPECT_NEAR(found.patterns[i].shift_rad, expected.patterns[i].shift_rad, 1e-12);
    Pattern same = found.patterns[i];
    same.shift_rad = expected.patterns[i].shift_rad;
    EXPECT_TRUE(same == expected.patterns[i]) << i;
  }
  for (const FringeStack& original : stacks) {
    const auto stack = replay.capture(found);
    ASSERT_TRUE(stack);
    EXPECT_EQ(stack->timestamp_s, 0.5 * original.index);
    for (size_t i = 0; i < original.images.size(); ++i) {
      ASSERT_EQ(stack->images[i].type(), type);
      EXPECT_EQ(cv::countNonZero(stack->images[i] != original.images[i]), 0);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Formats, ImportFormats,
                         testing::Values(Format{CV_8UC1, ".png"}, Format{CV_8UC1, ".bmp"}, Format{CV_8UC1, ".tif"},
                                         Format{CV_16UC1, ".png"}, Format{CV_16UC1, ".tif"}, Format{CV_32FC1, ".exr"}),
                         [](const auto& test) {
                           return std::to_string(test.param.type) + "_" + test.param.extension.substr(1);
                         });

// The same scene as a rendered dataset and as imported images must give the same depth.
TEST(Import, ARunOfImportedImagesIsARunOfTheirDataset) {
  const test::TempFolder temp;
  test::write_small_scene(temp / "scene");
  const std::string data = (temp / "data").string(), out = (temp / "imported").string();
  test::run_successfully(
      {"render", (temp / "scene").string(), "--out", data, "--quiet", "--set", "render.samples_per_pixel=1"});
  const RigModel rig = read_rig(temp / "data/rig.yaml");
  write_calibration(temp / "calibration.yml", rig, true, true);
  test::write_bytes(temp / "import.yaml",
                    "name: small\nnear_m: 0.7\nfar_m: 1.4\nstacks: [\"000000\", \"000001\"]\n"
                    "projector: {width_px: 1024, height_px: 768}\n"
                    "camera: {gain_dn_per_electron: " +
                        to_text(rig.sensor.gain_dn_per_electron) + ", dark_noise_electrons: " +
                        to_text(rig.sensor.dark_noise_electrons) + ", offset_dn: " + to_text(rig.sensor.offset_dn) +
                        "}\n"
                        "calibration: {file: calibration.yml, direction: camera_from_projector, unit_m: 0.001}\n"
                        "patterns:\n"
                        "  - {files: \"%02d.png\", fringe: {axis: columns, period_px: 1040, shift_deg: [-120, 0, 120], "
                        "coordinate_origin: pixel_edge}}\n"
                        "  - {files: \"%02d.png\", first: 3, fringe: {axis: columns, period_px: 131, shift_deg: [-120, "
                        "0, 120], coordinate_origin: pixel_edge}}\n"
                        "  - {files: \"%02d.png\", first: 6, fringe: {axis: columns, period_px: 16.5, shift_deg: "
                        "[-120, 0, 120], coordinate_origin: pixel_edge}}\n");
  test::run_successfully({"import", (temp / "data/stacks").string(), "--config", (temp / "import.yaml").string(),
                          "--out", out, "--quiet"});
  // An import has no lens, which the correction for texture takes into account.
  for (const std::string& source : {data, out})
    test::run_successfully(
        {"run", source, "--out", source + "-run", "--quiet", "--mesh", "--set", "depth.texture_correction=false"});
  for (const std::string frame : {"000000", "000001"}) {
    const fs::path name = fs::path("frames") / frame;
    const cv::Mat1f ours = read_depth_estimate(fs::path(data + "-run") / name / "depth.exr").depth_m;
    const cv::Mat1f theirs = read_depth_estimate(fs::path(out + "-run") / name / "depth.exr").depth_m;
    const int valid = cv::countNonZero(ours == ours);
    ASSERT_GT(valid, ours.rows * ours.cols / 4);
    EXPECT_NEAR(cv::countNonZero(theirs == theirs), valid, 1e-3 * valid);
    cv::Mat1f off;
    cv::absdiff(ours, theirs, off);
    EXPECT_GT(cv::countNonZero(off < 1e-6F), 0.999 * valid);
    EXPECT_THAT(test::read_bytes(fs::path(out + "-run") / name / "mesh.ply").substr(0, 300), HasSubstr("element face"));
  }
}

// --- conventions ---

struct Convention {
  std::string yaml;                  // further keys of the fringe entry
  double (*wave)(double) = nullptr;  // function of the rig's own phase, rad
  double origin = 0;                 // u' - u, px
  double offset_deg = 0, shift_deg = 0;
  int direction = 1;  // -1: the phase decreases with u
};

class ImportConventions : public testing::TestWithParam<Convention> {};

constexpr int kLength = 1920, kPeriod = 60, kSteps = 5, kBits = 6;

// Returns the intensity that the rig's own formula gives at projector coordinate u.
float shown(const Convention& rig, double u, int step) {
  const double phase =
      rig.direction * kTwoPi * (u + rig.origin) / kPeriod + (rig.offset_deg + step * rig.shift_deg) * kTwoPi / 360;
  return static_cast<float>(120 + 80 * rig.wave(phase));
}

TEST_P(ImportConventions, DecodeToTheTrueCoordinate) {
  const test::TempFolder temp;
  fs::create_directories(temp / "in");
  const int width = 640;
  const auto coordinate = [](int col) { return 3 * col + 1; };  // integers: pixel centres, where codes are unambiguous
  const auto write = [&](int image, const auto& grey) {
    cv::Mat1f pixels(4, width);
    for (int row = 0; row < 4; ++row) {
      for (int col = 0; col < width; ++col) pixels(row, col) = grey(coordinate(col));
    }
    write_image(temp / ("in/" + std::to_string(image) + ".exr"), pixels);
  };
  for (int step = 0; step < kSteps; ++step) write(step, [&](int u) { return shown(GetParam(), u, step); });
  for (int bit = 0; bit < kBits; ++bit) {  // Gray code of half periods, most significant bit first
    write(kSteps + bit, [&](int u) {
      const int cell = u / (kPeriod / 2), code = cell ^ (cell >> 1);
      return (code >> (kBits - 1 - bit)) & 1 ? 200.0F : 40.0F;
    });
  }
  test::write_bytes(
      temp / "import.yaml",
      "name: waves\ncamera: {bits: 8}\nprojector: {width_px: 1920, height_px: 1080}\npatterns:\n"
      "  - {files: \"{}.exr\", fringe: {axis: columns, period_px: 60, " +
          GetParam().yaml +
          "}}\n"
          "  - {files: \"{}.exr\", first: 5, gray: {axis: columns, number_of_periods: 32, complementary: true}}\n");
  ImportedRig rig(read_import(temp / "import.yaml", temp / "in"));
  EXPECT_FALSE(rig.model().calibrated);
  const auto stack = rig.capture(rig.sequence());
  const DecodedStack decoded = decode(*stack, rig.model(), {.unwrapping = Unwrapping::gray});
  int valid = 0;
  for (int col = 0; col < width; ++col) {
    const float found = decoded.coordinate_px(1, col);
    valid += found == found;
    if (found == found) {
      ASSERT_NEAR(found, coordinate(col), 2e-3) << "column " << col;
    }
  }
  EXPECT_GT(valid, 0.95 * width);
}

double cosine(double phase) { return std::cos(phase); }
double sine(double phase) { return std::sin(phase); }

INSTANTIATE_TEST_SUITE_P(
    Waves, ImportConventions,
    testing::Values(Convention{"steps: 5", cosine, 0, 0, 72}, Convention{"steps: 5, shift_sign: -1", cosine, 0, 0, -72},
                    Convention{"steps: 5, coordinate_origin: pixel_edge", cosine, 0.5, 0, 72},
                    Convention{"steps: 5, phase_offset_deg: -180", cosine, 0, -180, 72},
                    Convention{"steps: 5, phase_offset_deg: 33, wave: sin, shift_sign: -1", sine, 0, 33, -72},
                    Convention{"steps: 5, wave: sin, coordinate_origin: pixel_edge", sine, 0.5, 0, 72},
                    Convention{"steps: 5, shift_step_deg: 90", cosine, 0, 0, 90},
                    Convention{"shift_deg: [0, 60, 120, 180, 240]", cosine, 0, 0, 60},
                    Convention{"steps: 5, phase_offset_deg: -40, shift_sign: -1", cosine, 0, 40, 72, -1}));

TEST(Import, SingleFilesAndRangesSayTheSame) {
  const test::TempFolder temp;
  const auto plan = [&](const std::string& patterns) {
    test::write_bytes(temp / "import.yaml",
                      "name: x\nprojector: {width_px: 64, height_px: 32}\npatterns:\n" + patterns);
    return read_import(temp / "import.yaml", temp.path()).sequence;
  };
  for (int i = 0; i < 9; ++i) write_image(temp / (std::to_string(i) + ".png"), cv::Mat1b(4, 4, uchar{0}));
  const PatternSequence range = plan(
      "  - {files: \"%d.png\", fringe: {axis: rows, number_of_periods: 4, steps: 3, wave: sin}}\n"
      "  - {files: \"%d.png\", first: 3, gray: {axis: rows, period_px: 8, order: lsb_first, inverse: after_each}}\n"
      "  - {files: [\"7.png\", \"8.png\"], flat: [1, 0]}\n");
  const PatternSequence single = plan(
      "  - {file: 0.png, fringe: {axis: rows, period_px: 8, step: 0, of: 3, wave: sin}}\n"
      "  - {file: 1.png, fringe: {axis: rows, period_px: 8, shift_deg: 120, wave: sin}}\n"
      "  - {file: 2.png, fringe: {axis: rows, period_px: 8, step: 2, of: 3, wave: sin}}\n"
      "  - {file: 3.png, gray: {axis: rows, period_px: 8, bit: 0}}\n"
      "  - {file: 4.png, gray: {axis: rows, period_px: 8, bit: 0, bright_is_one: false}}\n"
      "  - {file: 5.png, gray: {axis: rows, period_px: 8, bit: 1}}\n"
      "  - {file: 6.png, gray: {axis: rows, period_px: 8, bit: 1, bright_is_one: false}}\n"
      "  - {file: 7.png, white: true}\n  - {file: 8.png, black: true}\n");
  EXPECT_EQ(to_yaml(range), to_yaml(single));
  EXPECT_EQ(range.patterns[5].period_px, 16);
  EXPECT_TRUE(range.patterns[6].inverted);
}

// A projector's response, and what was done to the patterns to compensate it.
TEST(Import, ResponsesAndPreDistortionsAreCombined) {
  const test::TempFolder temp;
  for (int i = 0; i < 6; ++i) write_image(temp / (std::to_string(i) + ".png"), cv::Mat1b(4, 4, uchar{0}));
  const auto plan = [&](const std::string& projector) {
    test::write_bytes(temp / "import.yaml",
                      "name: x\nprojector: {width_px: 64, height_px: 32" + projector +
                          "}\npatterns:\n"
                          "  - {files: \"%d.png\", fringe: {axis: columns, period_px: 64, steps: 3}}\n"
                          "  - {files: \"%d.png\", first: 3, fringe: {axis: columns, period_px: 8, steps: 3}}\n");
    return read_import(temp / "import.yaml", temp.path());
  };
  EXPECT_TRUE(plan("").rig.phase_correction.offset_rad.empty());
  const ImportPlan plain = plan(", gamma: 2.2");
  EXPECT_EQ(plain.rig.phase_correction.steps, 3);
  EXPECT_NEAR(plain.rig.phase_correction.offset_rad[30], -0.29, 0.02);
  EXPECT_TRUE(plain.sequence.inverse_response.empty());
  const ImportPlan compensated = plan(", gamma: 2.2, pre_distortion: {gamma: 2.2}");
  EXPECT_TRUE(compensated.rig.phase_correction.offset_rad.empty());
  EXPECT_FALSE(compensated.sequence.inverse_response.empty());
  EXPECT_NEAR(compensated.rig.projector_response[128], std::pow(0.5, 2.2), 1e-9);
  const ImportPlan half = plan(", gamma: 2.2, pre_distortion: {gamma: 1.5}");
  EXPECT_LT(half.rig.phase_correction.offset_rad[30], -0.05);
  EXPECT_GT(half.rig.phase_correction.offset_rad[30], -0.2);
  // Exposures are combined before phases are computed.
  write_image(temp / "white.png", cv::Mat1b(4, 4, uchar{0}));
  test::write_bytes(temp / "import.yaml",
                    "name: x\nprojector: {width_px: 64, height_px: 32, gamma: 2.2}\npatterns:\n"
                    "  - {file: white.png, white: true}\n"
                    "  - {files: \"%d.png\", fringe: {axis: columns, period_px: 64, steps: 3}, exposures: [0.5, 8]}\n");
  EXPECT_EQ(read_import(temp / "import.yaml", temp.path()).rig.phase_correction.steps, 3);
  fs::remove(temp / "white.png");
  EXPECT_TRUE(plan(", pre_distortion: {table: [0, 0.7, 1]}").rig.phase_correction.offset_rad.empty());
  EXPECT_THAT(message_of([&] { plan(", pre_distortion: {table: [0, 0.7, 0.6]}"); }),
              HasSubstr("the table must increase strictly; entry 3 does not"));
  EXPECT_THAT(message_of([&] { plan(", gamma: 2, response: [0, 1]"); }), HasSubstr("specify gamma or response"));
}

// Images of the patterns written by `fringeslam patterns` are imported with its patterns.yaml.
TEST(Import, OurOwnPatternsAreImportedByTheirFile) {
  const test::TempFolder temp;
  test::run_successfully({"patterns", "--size", "64x32", "--periods", "16", "--gray", "complementary", "--white-black",
                          "--ramp-levels", "3", "--out", (temp / "shown").string(), "--quiet"});
  const auto config = [&](const std::string& width) {
    test::write_bytes(temp / "import.yaml", "name: x\nprojector: {width_px: " + width +
                                                ", height_px: 32}\npatterns:\n" +
                                                "  - {files: \"%03d.png\", sequence: shown/patterns.yaml}\n");
    return temp / "import.yaml";
  };
  const ImportPlan plan = read_import(config("64"), temp / "shown");
  EXPECT_TRUE(plan.sequence == read_patterns(temp / "shown/patterns.yaml"));
  EXPECT_EQ(plan.stacks[0].back().filename(), "010.png");
  EXPECT_THAT(message_of([&] { read_import(config("63"), temp / "shown"); }),
              HasSubstr("import.yaml:4: shown/patterns.yaml is for a projector of 64x32 px, but this one has 63x32"));
}

// --- patterns given as images ---

// The import described by what was projected is that described by numbers.
TEST(Import, ARenderedStackDescribedByItsProjectedImagesHasTheSamePatterns) {
  const test::TempFolder temp;
  test::write_small_scene(temp / "scene");
  test::run_successfully({"render", (temp / "scene").string(), "--out", (temp / "data").string(), "--quiet", "--set",
                          "render.samples_per_pixel=1", "--with",
                          "patterns={steps: 3, periods_px: [1040, 131, 16.5], gray: plain, white_black: true, "
                          "extra_periods_px: [21.1, 20.3]}"});
  fs::create_directories(temp / "shown");
  const PatternSequence shown = read_patterns(temp / "data/patterns.yaml");
  for (size_t i = 0; i < shown.patterns.size(); ++i)
    write_image(temp / "shown" / (std::to_string(i) + ".png"), pattern_image(shown.patterns[i], shown));
  const auto imported = [&](const std::string& name, const std::string& patterns) {
    test::write_bytes(temp / (name + ".yaml"),
                      "name: small\nnear_m: 0.7\nfar_m: 1.4\nstacks: [\"000000\", \"000001\"]\n"
                      "projector: {width_px: 1024, height_px: 768}\npatterns:\n" +
                          patterns);
    test::run_successfully({"import", (temp / "data/stacks").string(), "--config", (temp / (name + ".yaml")).string(),
                            "--out", (temp / name).string(), "--quiet"});
    return test::read_bytes(temp / name / "patterns.yaml");
  };
  const std::string fringes = "fringe: {axis: columns, shift_deg: [-120, 0, 120], coordinate_origin: pixel_edge, ";
  const std::string described =
      imported("described", "  - {files: \"%02d.png\", " + fringes + "period_px: 1040}}\n" +
                                "  - {files: \"%02d.png\", first: 3, " + fringes + "period_px: 131}}\n" +
                                "  - {files: \"%02d.png\", first: 6, " + fringes + "period_px: 16.5}}\n" +
                                "  - {files: \"%02d.png\", first: 9, gray: {axis: columns, period_px: 16.5}}\n" +
                                "  - {files: [15.png, 16.png], extra: {axis: columns, periods_px: [21.1, 20.3], "
                                "coordinate_origin: pixel_edge}}\n"
                                "  - {file: 17.png, white: true}\n  - {file: 18.png, black: true}\n");
  EXPECT_EQ(imported("by_folder", "  - {files: \"%02d.png\", projected: shown}\n"), described);
  EXPECT_EQ(imported("by_number", "  - {files: \"%02d.png\", projected: \"shown/%d.png\"}\n"), described);
  // Entries of one sequence may mix both.
  EXPECT_EQ(imported("mixed", "  - {files: \"%02d.png\", " + fringes + "period_px: 1040}}\n" +
                                  "  - {file: 03.png, projected: shown/3.png}\n" +
                                  "  - {files: [04.png, 05.png], projected: [shown/4.png, shown/5.png]}\n" +
                                  "  - {files: \"%02d.png\", first: 6, projected: \"shown/{}.png\"}\n"),
            described);
}

class ImportProjected : public testing::Test {
 protected:
  static constexpr const char* kYaml =
      "name: x\nprojector: {width_px: 256, height_px: 16}\npatterns:\n"
      "  - {files: \"c%d.png\", projected: \"p%d.png\"}\n";
  void SetUp() override {
    for (int k = 0; k < 3; ++k) {
      capture(k);
      show(k, {Axis::columns, 32, kTwoPi * k / 3});
    }
  }
  void capture(int k) const { write_image(temp_ / ("c" + std::to_string(k) + ".png"), cv::Mat1b(6, 8, uchar{9})); }
  void show(int k, const Pattern& pattern) const {
    write_image(temp_ / ("p" + std::to_string(k) + ".png"), pattern_image(pattern, {256, 16, {}}));
  }
  PatternSequence sequence(const std::string& yaml = kYaml) const {
    test::write_bytes(temp_ / "import.yaml", yaml);
    return read_import(temp_ / "import.yaml", temp_.path()).sequence;
  }
  std::string error(const std::string& yaml = kYaml) const {
    return message_of([&] { sequence(yaml); });
  }
  std::string at(const std::string& name) const { return (temp_ / name).string(); }

  test::TempFolder temp_;
};

TEST_F(ImportProjected, ImagesMayLieAmongTheCaptures) {
  const PatternSequence found = sequence();
  ASSERT_EQ(found.patterns.size(), 3U);
  EXPECT_EQ(fringe_groups(found, Axis::columns).at(0).period_px, 32);
  for (int k = 0; k < 3; ++k)
    EXPECT_NEAR(std::remainder(found.patterns[static_cast<size_t>(k)].shift_rad - kTwoPi * k / 3, kTwoPi), 0, 1e-12);
}

TEST_F(ImportProjected, PeriodsOfFewerThanThreeImagesAreExtra) {
  capture(3);
  show(3, {Axis::columns, 21.1, 0});
  EXPECT_EQ(sequence().patterns[3], (Pattern{Axis::columns, 21.1, 0, 8, Coding::extra}));
}

TEST_F(ImportProjected, OneUsedChannelIsThePattern) {
  const cv::Mat pattern = read_grey(temp_ / "p1.png"), dark = cv::Mat1b(pattern.size(), uchar{0});
  cv::Mat blue;
  cv::merge(std::vector<cv::Mat>{dark, dark, pattern}, blue);
  write_image(temp_ / "p1.png", blue);
  EXPECT_EQ(fringe_groups(sequence(), Axis::columns).at(0).images.size(), 3U);
  cv::Mat packed;
  cv::merge(std::vector<cv::Mat>{read_grey(temp_ / "p0.png"), pattern, read_grey(temp_ / "p2.png")}, packed);
  write_image(temp_ / "p1.png", packed);
  EXPECT_EQ(error(), at("import.yaml") + ":4: " + at("p1.png") +
                         ": its colour channels differ; store the pattern of each channel as a grey image and list "
                         "these");
}

TEST_F(ImportProjected, UnrecognizedImagesAreReportedWithTheirFile) {
  write_image(temp_ / "p1.png", cv::Mat1b(16, 128, uchar{0}));
  EXPECT_THAT(error(), StartsWith(at("import.yaml") + ":4: " + at("p1.png") +
                                  ": is 128x16 px but the projector has 256x16 px; "));
  PatternSequence gamma{256, 16, {}};
  for (int i = 0; i <= 256; ++i) gamma.inverse_response.push_back(std::pow(i / 256.0, 1 / 2.2));
  write_image(temp_ / "p1.png", pattern_image({Axis::columns, 32, 0.3}, gamma));
  EXPECT_THAT(error(), HasSubstr(at("p1.png") + ": is not a cosine (the best one leaves "));
  EXPECT_THAT(error(), HasSubstr("a monotone function of one along columns, of period 3"));
  Pattern product{Axis::columns, 64, 0.3, 8, Coding::product};
  product.carrier_px = 12;
  show(1, product);
  EXPECT_THAT(error(), HasSubstr(at("p1.png") + ": is neither flat nor a Gray code bit nor a cosine"));
}

TEST_F(ImportProjected, EntriesThatDoNotFitAreRefused) {
  const auto with = [&](const std::string& from, const std::string& to) {
    return error(test::replaced(kYaml, from, to));
  };
  EXPECT_THAT(with("p%d.png", "q%d.png"), HasSubstr(":4: q0.png is not an image next to this file or in "));
  EXPECT_THAT(with("\"p%d.png\"", "[p0.png, p1.png]"),
              HasSubstr("no entry uses: c2.png, p2.png; describe them, or add `ignore"));
  EXPECT_THAT(with("\"c%d.png\"", "[c0.png, c1.png]"), HasSubstr("lists 2 images, but the entry describes 3 patterns"));
  EXPECT_THAT(with("files: \"c%d.png\"", "file: c0.png"),
              HasSubstr("'file' is one image, but the entry describes 3 patterns; use `files`"));
  EXPECT_THAT(with("projected:", "white: true, projected:"),
              HasSubstr(":4: 'projected' gives the patterns of this entry; remove it or 'white'"));
  show(1, {Axis::columns, 32, 0});
  EXPECT_THAT(error(), HasSubstr(":4: this pattern is a duplicate of an earlier one"));
}

// --- codings that import does not recognize ---

TEST(Import, ExtraImagesAndProductsAreDescribed) {
  const test::TempFolder temp;
  for (int i = 0; i < 10; ++i) write_image(temp / (std::to_string(i) + ".png"), cv::Mat1b(4, 4, uchar{0}));
  const auto patterns = [&](const std::string& entries, int count) {
    std::string ignored = "ignore: [none";
    for (int i = count; i < 10; ++i) ignored += ", " + std::to_string(i) + ".png";
    test::write_bytes(temp / "import.yaml",
                      "name: x\nprojector: {width_px: 64, height_px: 32}\n" + ignored + "]\npatterns:\n" + entries);
    return read_import(temp / "import.yaml", temp.path()).sequence.patterns;
  };
  const auto extra = patterns(
      "  - {file: 0.png, extra: {axis: rows, number_of_periods: 4, shift_deg: 90, coordinate_origin: pixel_edge}}\n"
      "  - {files: \"%d.png\", first: 1, extra: {axis: columns, periods_px: [10, 12], wave: sin}}\n",
      3);
  EXPECT_EQ(extra[0].axis, Axis::rows);
  EXPECT_EQ(extra[0].period_px, 8);
  EXPECT_NEAR(extra[0].shift_rad, kTwoPi / 4, 1e-14);
  EXPECT_EQ(extra[2].coding, Coding::extra);
  for (double u = 0; u < 64; ++u)
    EXPECT_NEAR(ideal_intensity(extra[2], u), 0.5 + 0.5 * std::sin(kTwoPi * u / 12), 1e-13);

  const auto bits = patterns(
      "  - {files: \"%d.png\", gray: {axis: columns, period_px: 4, long_runs: true, inverse: after_each}}\n"
      "  - {file: 8.png, gray: {axis: rows, period_px: 8, long_runs: true, bit: 1, bright_is_one: false}}\n",
      9);
  ASSERT_EQ(bits.size(), 9U);
  EXPECT_EQ(bits[4], (Pattern{.period_px = 4, .coding = Coding::gray, .code_bits = 4, .code_bit = 2}));
  EXPECT_EQ(bits[5],
            (Pattern{.period_px = 4, .coding = Coding::gray, .inverted = true, .code_bits = 4, .code_bit = 2}));
  EXPECT_EQ(bits[8], (Pattern{.axis = Axis::rows,
                              .period_px = 8,
                              .coding = Coding::gray,
                              .inverted = true,
                              .code_bits = 2,
                              .code_bit = 1}));

  const auto shown = [](double u, double shift_deg, double carrier_deg) {
    return 0.5 + 0.5 * std::cos(kTwoPi * (u / 16 + shift_deg / 360)) * std::cos(kTwoPi * (u / 5 + carrier_deg / 360));
  };
  const auto steps = patterns(
      "  - {files: \"%d.png\", product: {axis: columns, period_px: 16, carrier_px: 5, steps: 3, carrier_steps: 2, "
      "phase_offset_deg: 10, carrier_offset_deg: 20}}\n",
      6);
  for (int i = 0; i < 6; ++i) {
    for (double u = 0; u < 64; ++u)
      EXPECT_NEAR(ideal_intensity(steps[static_cast<size_t>(i)], u), shown(u, 10 + 120 * (i / 2), 20 + 180 * (i % 2)),
                  1e-13);
  }
  const auto listed = patterns(
      "  - {files: \"%d.png\", product: {axis: columns, period_px: 16, carrier_px: 5, shift_deg: [0, 30], "
      "carrier_shift_deg: [90, 45], shift_sign: -1}}\n"
      "  - {file: 2.png, product: {axis: columns, period_px: 16, carrier_px: 5, carrier_shift_deg: 7}}\n",
      3);
  for (double u = 0; u < 64; ++u) {
    EXPECT_NEAR(ideal_intensity(listed[1], u), shown(u, -30, -45), 1e-13);
    EXPECT_NEAR(ideal_intensity(listed[2], u), shown(u, 0, 7), 1e-13);
  }
  EXPECT_THAT(message_of([&] {
                patterns(
                    "  - {files: \"%d.png\", product: {axis: columns, period_px: 16, carrier_px: 5, "
                    "shift_deg: [0, 30], carrier_shift_deg: [90, 45, 0]}}\n",
                    2);
              }),
              HasSubstr("'shift_deg' lists 2 shifts and 'carrier_shift_deg' 3; list one of each per image"));
}

// Such images can be imported; decoding says what is missing.
// The left half is saturated at eight times the exposure, the right half too dark at the single one.
TEST(Import, SeveralExposuresAreCombined) {
  const test::TempFolder temp;
  constexpr int kRows = 40, kCols = 200;
  const PatternSequence sequence = phase_shift_sequence(1024, 768, {1040, 131, 16.5}, 3, Axis::columns, 8);
  const auto coordinate = [](int col) { return 100 + 4.1 * col; };
  fs::create_directories(temp / "in");
  cv::RNG random(5);
  int number = 0;
  for (const Pattern& pattern : sequence.patterns) {
    for (const double exposure : {1.0, 8.0}) {
      cv::Mat1b image(kRows, kCols);
      for (int row = 0; row < kRows; ++row) {
        for (int col = 0; col < kCols; ++col) {
          const double light = ideal_intensity(pattern, coordinate(col)) * (col < kCols / 2 ? 160.0 : 6.0);
          image(row, col) = cv::saturate_cast<uchar>(exposure * light + random.gaussian(0.7));
        }
      }
      char name[32];
      std::snprintf(name, sizeof name, "in/%02d.png", number++);
      write_image(temp / name, image);
    }
  }
  const auto described = [&](const std::string& exposures) {
    const auto entry = [&](double period_px, int first) {
      return "  - {files: \"%02d.png\", first: " + std::to_string(first) +
             ", fringe: {axis: columns, period_px: " + std::to_string(period_px) +
             ", steps: 3, phase_offset_deg: -120, coordinate_origin: pixel_edge}, " + exposures + "}\n";
    };
    test::write_bytes(temp / "in/import.yaml",
                      "name: x\nprojector: {width_px: 1024, height_px: 768}\ncamera: {noise: default}\nexposure_s: "
                      "0.004\npatterns:\n" +
                          entry(1040, 0) + entry(131, 6) + entry(16.5, 12));
  };
  described("exposures: [1, 8]");
  test::run_successfully({"import", (temp / "in").string(), "--out", (temp / "data").string()});
  ReplayRig replay(temp / "data");
  const FringeStack stack = *replay.capture(replay.sequence());
  ASSERT_EQ(stack.images.size(), 18U);
  EXPECT_NEAR(stack.exposure_s[5], 0.032, 1e-9);
  const auto right = [&](const DecodedStack& decoded) {
    int count = 0;
    for (int row = 0; row < kRows; ++row) {
      for (int col = 0; col < kCols; ++col) count += std::abs(decoded.coordinate_px(row, col) - coordinate(col)) < 0.5;
    }
    return static_cast<double>(count) / (kRows * kCols);
  };
  EXPECT_GT(right(decode(stack, replay.model(), {})), 0.99);
  for (const double exposure : {1.0, 8.0}) {
    FringeStack one = stack;
    one.patterns.patterns.clear(), one.images.clear(), one.exposure_s.clear(), one.exposure_time_s.clear();
    for (size_t i = 0; i < stack.images.size(); ++i) {
      if (stack.patterns.patterns[i].exposure != exposure) continue;
      one.patterns.patterns.push_back(sequence.patterns[one.images.size()]);
      one.images.push_back(stack.images[i]);
      one.exposure_s.push_back(stack.exposure_s[i]);
      one.exposure_time_s.push_back(stack.exposure_time_s[i]);
    }
    EXPECT_LT(right(decode(one, replay.model(), {})), 0.7) << exposure;
  }
  described("exposures: [1, 1]");
  const test::Finished twice =
      test::run_program({"import", (temp / "in").string(), "--out", (temp / "twice").string()});
  EXPECT_EQ(twice.exit_code, 2);
  EXPECT_THAT(twice.err, HasSubstr("import.yaml:6: patterns: exposures must be positive and differ"));
}

TEST(Import, StacksWithoutADecoderAreNotDecoded) {
  const test::TempFolder temp;
  fs::create_directories(temp / "in");
  for (int i = 0; i < 3; ++i) {
    cv::Mat1b noise(48, 64);
    cv::RNG(static_cast<uint64_t>(i)).fill(noise, cv::RNG::UNIFORM, 0, 200);
    write_image(temp / ("in/" + std::to_string(i) + ".png"), noise);
  }
  test::write_bytes(temp / "in/import.yaml",
                    "name: x\nprojector: {width_px: 64, height_px: 32}\npatterns:\n  - {files: \"%d.png\", extra: "
                    "{axis: columns, periods_px: [10, 11, 12]}}\n");
  const std::string data = (temp / "data").string();
  EXPECT_THAT(test::run_successfully({"import", (temp / "in").string(), "--out", data}).err,
              HasSubstr("warning: the described conventions were not checked: patterns: columns are coded only by"));
  const test::Finished decoded = test::run_program({"decode", data, "--out", (temp / "out").string()});
  EXPECT_EQ(decoded.exit_code, 2);
  EXPECT_EQ(decoded.err, "fringeslam: " + data +
                             ": patterns: columns are coded only by `extra` images, which determine no phase by "
                             "themselves; add `fringe` images with three or more phase shifts of a period, or a `gray` "
                             "code\n");
}

// --- images ---

TEST(ReadAsGrey, EqualChannelsAreThemselvesOthersByTheRule) {
  const test::TempFolder temp;
  cv::Mat1b grey(8, 9);
  cv::RNG(3).fill(grey, cv::RNG::UNIFORM, 0, 256);
  cv::Mat rgb;
  cv::merge(std::vector<cv::Mat>{grey, grey, grey, cv::Mat1b(grey.size(), 77)}, rgb);
  write_image(temp / "equal.png", rgb);
  EXPECT_EQ(cv::norm(read_as_grey(temp / "equal.png", GreyFrom::luminance), grey, cv::NORM_INF), 0);
  const cv::Mat3b colour(2, 2, cv::Vec3b(200, 100, 10));  // R, G, B in the file
  write_image(temp / "colour.tif", colour);
  const auto value = [&](GreyFrom from) { return read_as_grey(temp / "colour.tif", from).at<uchar>(1, 1); };
  EXPECT_EQ(value(GreyFrom::red), 200);
  EXPECT_EQ(value(GreyFrom::green), 100);
  EXPECT_EQ(value(GreyFrom::blue), 10);
  EXPECT_EQ(value(GreyFrom::luminance), 120);  // 59.8 + 58.7 + 1.14 = 119.64
}

// A channel that clips flattens the fringes, however dark the luminance is.
TEST(ReadAsGrey, ALuminanceIsAtFullScaleWhereAChannelClips) {
  const test::TempFolder temp;
  cv::Mat3b colour(1, 3, cv::Vec3b(249, 150, 120));
  colour(0, 1) = {250, 150, 120};  // 98 % of 255 are 249.9
  colour(0, 2) = {10, 20, 255};
  write_image(temp / "colour.png", colour);
  const auto read = [&](GreyFrom from, std::optional<double> full_scale) {
    const cv::Mat1b grey = read_as_grey(temp / "colour.png", from, full_scale);
    return std::vector<int>{grey(0), grey(1), grey(2)};
  };
  EXPECT_EQ(read(GreyFrom::luminance, 255), (std::vector{176, 255, 255}));  // 74.451 + 88.05 + 13.68 = 176.181
  EXPECT_EQ(read(GreyFrom::luminance, {}), (std::vector{176, 176, 44}));
  EXPECT_EQ(read(GreyFrom::green, 255), (std::vector{150, 150, 20}));
}

TEST(ReadAsGrey, TruncatedFilesOfEveryFormatAreRefused) {
  const test::TempFolder temp;
  cv::Mat1b noise(256, 64);
  cv::RNG(5).fill(noise, cv::RNG::UNIFORM, 0, 256);
  for (const std::string extension : {".png", ".bmp", ".tif", ".jpg"}) {
    const fs::path file = temp / ("image" + extension);
    write_image(file, noise);
    EXPECT_EQ(read_as_grey(file, GreyFrom::luminance).size(), noise.size());
    for (const double share : {0.0, 0.01, 0.5, 0.9}) {
      write_image(file, noise);
      test::truncate_file(file, share);
      EXPECT_THAT(message_of([&] { read_as_grey(file, GreyFrom::luminance); }), StartsWith(file.string() + ": "))
          << share;
    }
  }
}

// --- refused input ---

constexpr const char* kGood = R"(name: small
projector: {width_px: 64, height_px: 8}
calibration: {file: calibration.yml, unit_m: 0.001}
patterns:
  - {files: "f%02d.png", fringe: {axis: columns, period_px: 16, steps: 3}}
  - {files: [g1.png, g0.png], gray: {axis: columns, period_px: 16}}
  - {file: white.png, white: true}
board: {kind: circles, columns: 7, rows: 5, spacing_m: 0.02}
)";

RigModel toy_rig() {
  RigModel rig;
  rig.camera = {8, 6, 20, 21, 3.5, 2.5, {0.01, 0, 0, 0, 0}};
  rig.projector = {64, 8, 100, 101, 31.5, 3.5, {}};
  rig.projector_from_camera = {rotation_exp({0.01, 0.1, -0.02}), {-0.1, 0.003, 0.02}};
  return rig;
}

class ImportErrors : public testing::Test {
 protected:
  void SetUp() override {
    write_calibration(temp_ / "in/calibration.yml", toy_rig());
    for (const char* name : {"f00", "f01", "f02", "g0", "g1", "white"}) put(name, cv::Mat1b(6, 8, uchar{9}));
  }
  void put(const std::string& name, const cv::Mat& image) const { write_image(temp_ / ("in/" + name + ".png"), image); }
  // Returns the library's error message; the program prints the same.
  std::string import(const std::string& yaml) const {
    test::write_bytes(temp_ / "in/import.yaml", yaml);
    return message_of([&] {
      ImportedRig rig(read_import(temp_ / "in/import.yaml", temp_ / "in"));
      while (rig.capture(rig.sequence())) continue;
    });
  }
  // Replaces `from` by `to` in the valid file, which must be refused at the line of `to`.
  void expect_refused(const std::string& from, const std::string& to, const std::string& says) const {
    const std::string text = test::replaced(kGood, from, to);
    const std::string message = import(text);
    EXPECT_THAT(message, HasSubstr(says));
    EXPECT_THAT(message,
                StartsWith((temp_ / "in/import.yaml").string() + ":" + std::to_string(test::line_of(text, to)) + ": "));
  }
  std::string calibrated(const std::function<void(cv::FileStorage&)>& write) const {
    {
      cv::FileStorage storage((temp_ / "in/calibration.yml").string(), cv::FileStorage::WRITE);
      write(storage);
    }
    return import(kGood);
  }

  test::TempFolder temp_;
};

TEST_F(ImportErrors, TheGoodFileIsGood) {
  test::write_bytes(temp_ / "in/import.yaml", kGood);
  test::run_successfully({"import", (temp_ / "in").string(), "--out", (temp_ / "out").string()});
  EXPECT_EQ(test::read_bytes(temp_ / "out/board.yaml"), "kind: circles\ncolumns: 7\nrows: 5\nspacing_m: 0.02\n");
  ReplayRig replay(temp_ / "out");
  expect_near(replay.model(), toy_rig());
  EXPECT_NEAR(replay.model().sensor.gain_dn_per_electron, 255 / 38250.0, 1e-15);
}

TEST_F(ImportErrors, KeysAndValues) {
  expect_refused("steps: 3", "stesp: 3", "'steps' is missing; is 'stesp' a misspelling of it?");
  expect_refused("unit_m: 0.001", "unit: 0.001", "'unit_m' is missing");
  expect_refused("white: true", "white: true, flat: 1", "an entry of patterns must have exactly one of");
  expect_refused("{file: white.png,", "{file: white.png, files: a%d.png,", "or `files` for several, not both");
  expect_refused("axis: columns, period_px: 16, steps", "axis: column, period_px: 16, steps",
                 "did you mean 'columns'?");
  expect_refused("period_px: 16, steps", "period_px: 16, number_of_periods: 4, steps", "not both");
  expect_refused("steps: 3", "steps: 2", "'steps' is 2");
  expect_refused("steps: 3", "steps: 3, wave: tan", "'wave: tan' is not one of cos, sin");
  expect_refused("steps: 3", "steps: 3, shift_sign: 0.5", "'shift_sign' is 1 or -1");
  expect_refused("\"f%02d.png\"", "\"f.png\"", "or use a name with a number field such as %02d");
  expect_refused("\"f%02d.png\"", "\"f%s.png\"", "must contain one number field");
  expect_refused("[g1.png, g0.png]", "[g1.png, g0.png, white.png]", "lists 3 images, but the entry describes 2");
  expect_refused("kind: circles", "kind: dots", "'kind: dots' is not one of checkerboard");
  // The limits are those of board.yaml.
  expect_refused("columns: 7", "columns: 2", "'columns' is 2");
  expect_refused("kind: circles", "kind: circles, diameter_m: 0.03", "diameter_m must be less than spacing_m");
  expect_refused("kind: circles", "kind: checkerboard, diameter_m: 0.01", "unknown key 'diameter_m'");
  expect_refused("kind: circles", "kind: charuco, marker_m: 0.01, markers: 77", "50, 100, 250 or 1000");
}

TEST_F(ImportErrors, ThreeStepsOfThreeShifts) {
  const std::string text = test::replaced(kGood, "steps: 3", "shift_deg: [0, 120, 480]");
  EXPECT_THAT(import(text), HasSubstr("fewer than three distinct phase shifts"));
  EXPECT_THAT(import(test::replaced(kGood, "steps: 3", "shift_deg: [0, 120, 120]")),
              HasSubstr("this pattern is a duplicate of an earlier one"));
}

TEST_F(ImportErrors, Files) {
  expect_refused("{file: white.png", "{file: wite.png", "in/wite.png is missing");
  expect_refused("\"f%02d.png\"", "\"f%02d.png\", first: 1", "in/f03.png is missing");
  expect_refused("{file: white.png", "{file: g0.png", "g0.png is used twice");
  expect_refused("{file: white.png", "{file: ./g0.png", "g0.png is used twice");
  expect_refused("calibration.yml", "no.yml", "no.yml is neither next to this file nor in");
  expect_refused("name: small", "stacks: pose*\nname: small", "has no folder that matches 'pose*'");
}

TEST_F(ImportErrors, UnusedImages) {
  for (const char* name : {"extra10", "extra9"}) put(name, cv::Mat1b(6, 8, uchar{9}));
  EXPECT_THAT(import(kGood), HasSubstr("has images that no entry uses: extra9.png, extra10.png; "));
  test::write_bytes(temp_ / "in/import.yaml", std::string(kGood) + "ignore: [\"extra*\"]\n");
  EXPECT_EQ(read_import(temp_ / "in/import.yaml", temp_ / "in").stacks.size(), 1U);
}

TEST_F(ImportErrors, Images) {
  put("g0", cv::Mat1b(6, 9, uchar{9}));
  EXPECT_THAT(import(kGood), HasSubstr("in/g0.png: is 9x6 but " + (temp_ / "in/f00.png").string() + " is 8x6"));
  put("g0", cv::Mat1w(6, 8, uint16_t{9}));
  EXPECT_THAT(import(kGood), HasSubstr("in/g0.png: has a different pixel type"));
  put("g0", cv::Mat1b(6, 8, uchar{9}));
  test::truncate_file(temp_ / "in/g0.png", 0.6);
  EXPECT_THAT(import(kGood), HasSubstr("in/g0.png: is truncated or damaged"));
}

TEST_F(ImportErrors, BitsOfTheCamera) {
  const std::string twelve = std::string(kGood) + "camera: {bits: 12}\n";
  EXPECT_THAT(import(twelve), HasSubstr("f00.png: has 8 bits per pixel, but camera.bits is 12"));
  for (const char* name : {"f00", "f01", "f02", "g0", "g1", "white"}) put(name, cv::Mat1w(6, 8, uint16_t{0xABCA}));
  EXPECT_THAT(import(twelve), HasSubstr("has a grey value of 43978, which exceeds camera.bits: 12"));
  test::write_bytes(temp_ / "in/import.yaml", std::string(kGood) + "camera: {bits: 12, msb_aligned: true}\n");
  ImportedRig rig(read_import(temp_ / "in/import.yaml", temp_ / "in"));
  EXPECT_EQ(rig.capture(rig.sequence())->images[0].at<uint16_t>(0, 0), 0xABC);
}

// Saturation at 4095 would go unnoticed if the values were taken for 16 bits.
TEST_F(ImportErrors, TwelveBitsInSixteenAreNotGuessed) {
  for (const char* name : {"f00", "f01", "f02", "g0", "g1", "white"}) put(name, cv::Mat1w(6, 8, uint16_t{4095}));
  const auto imported = [&](const std::string& camera) {
    test::write_bytes(temp_ / "in/import.yaml", std::string(kGood) + camera);
    return test::run_program(
        {"import", (temp_ / "in").string(), "--out", (temp_ / ("out" + camera.substr(0, 20))).string()});
  };
  const test::Finished refused = imported("");
  EXPECT_EQ(refused.exit_code, 2);
  EXPECT_THAT(refused.err,
              HasSubstr("no gray value of the first stack exceeds 4095 of 65535; add `camera: {bits: N}`"));
  // Other conventions do not matter for that.
  const test::Finished unchecked =
      test::run_program({"import", (temp_ / "in").string(), "--out", (temp_ / "unchecked").string(), "--no-check"});
  EXPECT_EQ(unchecked.exit_code, 2);
  EXPECT_EQ(unchecked.err, refused.err);
  EXPECT_EQ(imported("camera: {bits: 12}\n").exit_code, 0);
}

// Full scale is that of camera.bits, in the lowest or in the highest bits of the file.
TEST_F(ImportErrors, AClippedChannelIsAtTheFullScaleOfTheBits) {
  const auto first_pixels = [&](int scale, const std::string& camera) {
    cv::Mat3w colour(6, 8, cv::Vec3w(3000, 1500, 1200));
    colour(0, 0)[0] = 4095;
    for (const char* name : {"f00", "f01", "f02", "g0", "g1", "white"}) put(name, colour * scale);
    test::write_bytes(temp_ / "in/import.yaml", std::string(kGood) + camera);
    ImportedRig rig(read_import(temp_ / "in/import.yaml", temp_ / "in"));
    const cv::Mat1w image = rig.capture(rig.sequence())->images[0];
    return std::vector<int>{image(0, 0), image(0, 1)};
  };
  const std::vector<int> expected = {4095, 1914};  // 897 + 880.5 + 136.8 = 1914.3
  EXPECT_EQ(first_pixels(1, "camera: {bits: 12}\n"), expected);
  EXPECT_EQ(first_pixels(16, "camera: {bits: 12, msb_aligned: true}\n"), expected);
}

TEST_F(ImportErrors, TimesOfImages) {
  const std::string yaml = std::string(kGood) + "stacks: [a, b]\nimage_times: times.txt\n";
  const auto write = [&](const std::string& times, const std::string& more_times) {
    for (const char* stack : {"a", "b"}) {
      fs::create_directories(temp_ / "in" / stack);
      for (const char* name : {"f00", "f01", "f02", "g0", "g1", "white"})
        put(std::string(stack) + "/" + name, cv::Mat1b(6, 8, uchar{9}));
    }
    test::write_bytes(temp_ / "in/a/times.txt", times);
    test::write_bytes(temp_ / "in/b/times.txt", more_times);
    for (const char* name : {"f00", "f01", "f02", "g0", "g1", "white"})
      fs::remove(temp_ / "in" / (std::string(name) + ".png"));
    test::write_bytes(temp_ / "in/import.yaml", yaml);
  };
  const auto message = [&](const std::string& times, const std::string& more_times) {
    write(times, more_times);
    return import(yaml);
  };
  write("1 1.004 1.008 1.012 1.016 1.020", "2 2.1 2.2 2.3 2.4 2.5");
  EXPECT_NEAR(read_import(temp_ / "in/import.yaml", temp_ / "in").rig.timing.camera_rate_hz, 250, 1e-6);
  EXPECT_THAT(message("0 1 2 3 4 5", "0 1 2 3 4 5"), HasSubstr("b/times.txt: is not later than the stack before it"));
  EXPECT_THAT(message("0 1 2 3 4 5", "5 6 7 8 9 10"), HasSubstr("b/times.txt: is not later than the stack before it"));
  EXPECT_THAT(message("-1 1 2 3 4 5", "6 7 8 9 10 11"), HasSubstr("a/times.txt: '-1' is no time from 0 to 1e12 s"));
  EXPECT_THAT(message("1.7e18 1 2 3 4 5", "6 7 8 9 10 11"), HasSubstr("'1.7e18' is no time"));
  EXPECT_THAT(message("1 1 2 3 4 5", "6 7 8 9 10 11"), HasSubstr("a/times.txt: two images have the same time"));
  EXPECT_THAT(message("0 1 2 3 4 5", "6 7 8 9 9 11"), HasSubstr("b/times.txt: two images have the same time"));
  EXPECT_THAT(message("0 1000 2000 3000 4000 5000", "6000 7000 8000 9000 10000 11000"),
              HasSubstr("a/times.txt: the median time between images is 1000 s, more than 100 s"));
}

TEST_F(ImportErrors, FastCameras) {
  test::write_bytes(temp_ / "in/import.yaml", std::string(kGood) + "image_interval_s: 0.0002\n");
  const ImportedRig rig(read_import(temp_ / "in/import.yaml", temp_ / "in"));
  EXPECT_NEAR(rig.model().timing.camera_rate_hz, 5000, 1e-6);
}

// One camera takes one image after another.
TEST_F(ImportErrors, IntervalsThatContradictEachOther) {
  EXPECT_THAT(import(std::string(kGood) + "image_interval_s: 0.2\ninterval_s: 1\n"),
              HasSubstr("the stacks overlap: 6 images at image_interval_s take 1.2"));
  EXPECT_THAT(import(std::string(kGood) + "image_interval_s: 0.01\nexposure_s: 0.02\n"),
              HasSubstr("exposure_s exceeds image_interval_s"));
  test::write_bytes(temp_ / "in/import.yaml", std::string(kGood) + "image_interval_s: 0.2\n");
  EXPECT_NEAR(read_import(temp_ / "in/import.yaml", temp_ / "in").interval_s, 1.2, 1e-9);
}

TEST_F(ImportErrors, ProgramLeavesNothingBehind) {
  test::write_bytes(temp_ / "in/import.yaml", test::replaced(kGood, "steps: 3", "steps: 4"));
  test::fs::create_directory(temp_ / "results");
  const test::Finished finished =
      test::run_program({"import", (temp_ / "in").string(), "--out", (temp_ / "results/out").string()});
  EXPECT_EQ(finished.exit_code, 2);
  EXPECT_EQ(std::count(finished.err.begin(), finished.err.end(), '\n'), 1) << finished.err;
  EXPECT_EQ(test::listing(temp_ / "results"), std::set<std::string>{});
  EXPECT_THAT(test::run_program({"import", (temp_ / "no").string(), "--out", (temp_ / "o").string()}).err,
              HasSubstr("is not a folder"));
}

// Such a dataset can be used for calibration but not for measuring.
TEST_F(ImportErrors, WithoutCalibrationThereIsNoRun) {
  test::write_bytes(temp_ / "in/import.yaml",
                    test::replaced(kGood, "calibration: {file: calibration.yml, unit_m: 0.001}\n", ""));
  const std::string out = (temp_ / "out").string();
  test::run_successfully({"import", (temp_ / "in").string(), "--out", out});
  EXPECT_FALSE(ReplayRig(out).model().calibrated);
  const test::Finished finished = test::run_program({"run", out, "--out", (temp_ / "run").string()});
  EXPECT_EQ(finished.exit_code, 2);
  EXPECT_THAT(finished.err, HasSubstr("not calibrated"));
  EXPECT_FALSE(fs::exists(temp_ / "run"));
}

// --- calibration files ---

class OpenCvCalibration : public testing::TestWithParam<std::string> {};

TEST_P(OpenCvCalibration, EitherDirectionAndFormOfTheRotationIsTheSameRig) {
  const test::TempFolder temp;
  const RigModel rig = test::thesis_rig();
  for (const bool inverse : {false, true}) {
    for (const bool as_vector : {false, true}) {
      for (const int terms : {5, 8, 14}) {
        const fs::path file = temp / ("calibration" + GetParam());
        write_calibration(file, rig, inverse, as_vector, terms);
        const RigCalibration read = read_opencv_calibration({{file}, {}, !inverse, 1e-3});
        RigModel found = rig;
        found.projector_from_camera = read.projector_from_camera;
        found.camera = read.camera, found.projector = read.projector;
        EXPECT_EQ(found.camera.width, 0);
        found.camera.width = rig.camera.width, found.camera.height = rig.camera.height;
        found.projector.width = rig.projector.width, found.projector.height = rig.projector.height;
        expect_near(found, rig);
      }
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Files, OpenCvCalibration, testing::Values(".yml", ".xml", ".json"),
                         [](const auto& test) { return test.param.substr(1); });

TEST(OpenCvFiles, SeveralFilesWithOneNameAreDistinguished) {
  const test::TempFolder temp;
  const RigModel rig = test::thesis_rig();
  const auto intrinsics = [&](const std::string& name, const Pinhole& device) {
    cv::FileStorage s((temp / name).string(), cv::FileStorage::WRITE);
    s << "camera_matrix" << matrix_of(device) << "distortion_coefficients" << distortion_of(device, 4);
    s << "image_size" << cv::Size(device.width, device.height);
  };
  intrinsics("camera.yml", rig.camera);
  intrinsics("projector.yml", rig.projector);
  {
    const Eigen::Vector3d& t = rig.projector_from_camera.translation;
    cv::FileStorage s((temp / "extrinsics.yml").string(), cv::FileStorage::WRITE);
    s << "R" << rotation_of(rig.projector_from_camera, false) << "T" << (std::vector<double>{t.x(), t.y(), t.z()});
  }
  CalibrationFiles source{{temp / "camera.yml", temp / "projector.yml", temp / "extrinsics.yml"}, {}, true, 1};
  EXPECT_THAT(message_of([&] { read_opencv_calibration(source); }), HasSubstr("also exists in another file"));
  source.names = {"camera.yml:camera_matrix",
                  "camera.yml:distortion_coefficients",
                  "projector.yml:camera_matrix",
                  "projector.yml:distortion_coefficients",
                  "",
                  "",
                  "camera.yml:image_size",
                  "projector.yml:image_size"};
  const RigCalibration read = read_opencv_calibration(source);
  EXPECT_EQ(read.camera.width, rig.camera.width);
  EXPECT_EQ(read.projector.height, rig.projector.height);
  EXPECT_NEAR(read.projector.cx, rig.projector.cx, 1e-9);
  EXPECT_LT(difference(read.projector_from_camera, rig.projector_from_camera).norm(), 1e-9);
}

// OpenCV's parser recurses without limit and allocates what a matrix declares.
TEST(OpenCvFiles, HostileOnesAreRefused) {
  const test::TempFolder temp;
  const auto repeated = [](const std::string& part, int count) {
    std::string text;
    for (int i = 0; i < count; ++i) text += part;
    return text;
  };
  const std::string huge =
      "M1: !!opencv-matrix {rows: true, cols: 3, dt: d, data: [800, 0, 320, 0, 800, 240, 0, 0, 1]}\n";
  for (const auto& [name, text] :
       {std::pair<std::string, std::string>{"deep.json", "{\"M1\": " + repeated("[", 300000)},
        {"deep.yml", "%YAML:1.0\n---\nM1: " + repeated("[", 300000)},
        {"deep.xml", "<?xml version=\"1.0\"?><opencv_storage>" + repeated("<a>", 300000)},
        {"huge.yml", "%YAML:1.0\n---\n" + huge},
        {"list.yml", "%YAML:1.0\n---\n- 1\n- 2\n"},
        {"long.yml", "%YAML:1.0\n---\nM1: " + repeated("1", 17 << 20)}}) {
    test::write_bytes(temp / name, text);
    EXPECT_THAT(message_of([&] {
                  read_opencv_calibration({{temp / name}, {}});
                }),
                testing::StartsWith((temp / name).string()))
        << name;
  }
  EXPECT_THAT(message_of([&] { read_opencv_calibration({{temp / "none.yml"}, {}}); }), HasSubstr("none.yml"));
}

// Only the restricted process parses the files; these numbers reach this one, which has to check them.
TEST(OpenCvFiles, NumbersOfTheParserAreChecked) {
  const test::TempFolder temp;
  for (const auto& [entry, replacement, message] :
       {std::array<std::string, 3>{"camera_size", "[1e30, 480]", "must be a width and a height in px"},
        {"camera_size", "[640.5, 480]", "must be a width and a height in px"},
        {"M1", "[.Nan, 0, 320, 0, 800, 240, 0, 0, 1]", "contains a non-finite number"},
        {"M1", "[800, 0, 320, 0, 800, 240, 0, 0]", "must be a 3x3 camera matrix"},
        {"T", "words", "is not a matrix or list of numbers"},
        {"D1", "{rows: 1, cols: 5}", "is not a matrix or list of numbers"}}) {
    std::map<std::string, std::string> entries = {{"M1", "[800, 0, 320, 0, 800, 240, 0, 0, 1]"},
                                                  {"D1", "[0, 0, 0, 0, 0]"},
                                                  {"M2", "[900, 0, 400, 0, 900, 300, 0, 0, 1]"},
                                                  {"D2", "[0, 0, 0, 0]"},
                                                  {"R", "[0, 0, 0]"},
                                                  {"T", "[100, 0, 0]"},
                                                  {"camera_size", "[640, 480]"}};
    entries[entry] = replacement;
    std::string text = "%YAML:1.0\n---\n";
    for (const auto& [name, value] : entries) text += name + ": " + value + "\n";
    test::write_bytes(temp / "calibration.yml", text);
    EXPECT_THAT(message_of([&] {
                  read_opencv_calibration({{temp / "calibration.yml"}, {}});
                }),
                testing::AllOf(HasSubstr("calibration.yml: " + entry), HasSubstr(message)))
        << text;
  }
}

TEST(OpenCvFiles, EntriesOfSeveralDocumentsAreFound) {
  const test::TempFolder temp;
  test::write_bytes(temp / "calibration.yml",
                    "%YAML:1.0\n---\nM1: [800, 0, 320, 0, 800, 240, 0, 0, 1]\nD1: [0, 0, 0, 0]\n...\n---\n"
                    "M2: [900, 0, 400, 0, 900, 300, 0, 0, 1]\nD2: [0, 0, 0, 0]\nR: [0, 0, 0]\nT: [100, 0, 0]\n");
  const RigCalibration read = read_opencv_calibration({{temp / "calibration.yml"}, {}});
  EXPECT_EQ(read.camera.fx, 800);
  EXPECT_EQ(read.projector.fx, 900);
}

TEST(OpenCvFiles, RoundedRotationsBecomeRotations) {
  const test::TempFolder temp;
  RigModel rig = test::thesis_rig();
  rig.projector_from_camera.rotation = (rig.projector_from_camera.rotation * 1e5).array().round() / 1e5;
  write_calibration(temp / "calibration.yml", rig);
  const Eigen::Matrix3d r =
      read_opencv_calibration({{temp / "calibration.yml"}, {}, true, 1e-3}).projector_from_camera.rotation;
  EXPECT_LT((r.transpose() * r - Eigen::Matrix3d::Identity()).norm(), 1e-14);
  EXPECT_LT((r - rig.projector_from_camera.rotation).norm(), 2e-5);
}

TEST_F(ImportErrors, MessagesNameTheWayOut) {
  expect_refused("files: [g1.png, g0.png]", "files: [g1.png]",
                 "'files' lists 1 image, but the entry describes 2 patterns; list one image per pattern");
  const std::string missing = calibrated([](cv::FileStorage& storage) {
    storage << "cam_K" << matrix_of(toy_rig().camera) << "proj_K" << matrix_of(toy_rig().projector);
  });
  EXPECT_THAT(missing, HasSubstr("for the camera distortion (or `camera_distortion: none`)"));
}

TEST_F(ImportErrors, GrayCellsOfOnePixelAreAccepted) {
  test::write_bytes(temp_ / "in/import.yaml", test::replaced(kGood, "gray: {axis: columns, period_px: 16}",
                                                             "gray: {axis: columns, period_px: 1, bits: 2}"));
  EXPECT_EQ(gray_bits(read_import(temp_ / "in/import.yaml", temp_ / "in").sequence, Axis::columns).back().cell_px, 1);
  expect_refused("gray: {axis: columns, period_px: 16}", "gray: {axis: columns, period_px: 0.5}", "period_px");
}

TEST_F(ImportErrors, RigFilesReplaceTheCalibration) {
  RigModel calibrated = toy_rig();
  calibrated.name = "calibrated";
  calibrated.camera.fx = 23;
  calibrated.projector_from_camera.translation = {-0.12, 0.003, 0.02};
  calibrated.sensor.gain_dn_per_electron = 0.5;
  write_text(temp_ / "calibrated.yaml", to_yaml(calibrated));
  test::write_bytes(temp_ / "in/import.yaml", kGood);
  test::run_successfully({"import", (temp_ / "in").string(), "--out", (temp_ / "out").string(), "--rig",
                          (temp_ / "calibrated.yaml").string()});
  const RigModel imported = ReplayRig(temp_ / "out").model();
  expect_near(imported, calibrated);
  EXPECT_NE(imported.sensor.gain_dn_per_electron, 0.5);
  EXPECT_NE(imported.name, "calibrated");
  calibrated.projector.width = 128;
  write_text(temp_ / "calibrated.yaml", to_yaml(calibrated));
  const auto refused = test::run_program({"import", (temp_ / "in").string(), "--out", (temp_ / "out2").string(),
                                          "--rig", (temp_ / "calibrated.yaml").string()});
  EXPECT_EQ(refused.exit_code, 2);
  EXPECT_THAT(refused.err, HasSubstr("the calibration is for a projector of 128x8 px, but this one has 64x8 px"));
}

TEST_F(ImportErrors, SizesInTheCalibrationMustMatch) {
  const std::string message = calibrated([](cv::FileStorage& storage) {
    const RigModel rig = toy_rig();
    storage << "cam_K" << matrix_of(rig.camera) << "cam_kc" << distortion_of(rig.camera) << "proj_K"
            << matrix_of(rig.projector) << "proj_kc" << distortion_of(rig.projector) << "R"
            << rotation_of(rig.projector_from_camera, false) << "T"
            << millimetres(rig.projector_from_camera.translation) << "screenResX" << 128 << "screenResY" << 8;
  });
  EXPECT_THAT(message, HasSubstr("the calibration is for a projector of 128x8 px"));
}

TEST_F(ImportErrors, SourcesOfTheNoise) {
  expect_refused("projector: {width", "camera: {noise: none.yaml}\nprojector: {width",
                 "'noise' must be measured, default or a rig.yaml file; none.yaml is neither next to this file nor in");
  expect_refused("projector: {width", "camera: {noise: measured, gain_dn_per_electron: 1}\nprojector: {width",
                 "specify either gain_dn_per_electron and dark_noise_electrons or `noise: measured`, not both");
  const auto import_with = [&](const std::string& camera) {
    test::write_bytes(temp_ / "in/import.yaml", camera + kGood);
    return test::run_program({"import", (temp_ / "in").string(), "--out", (temp_ / "out").string(), "--no-check"});
  };
  const auto gain = [&] { return ReplayRig(temp_ / "out").model().sensor.gain_dn_per_electron; };
  EXPECT_THAT(import_with("").err, HasSubstr("warning: the camera's noise is unknown"));
  EXPECT_THAT(import_with("camera: {noise: default}\n").err, testing::Not(HasSubstr("warning")));
  const auto measured = import_with("camera: {noise: measured}\n");
  EXPECT_EQ(measured.exit_code, 2);
  EXPECT_THAT(measured.err, HasSubstr("import.yaml: camera.noise: measured: the images contain no redundancy"));
  RigModel rig = toy_rig();
  rig.name = "other";
  rig.sensor.gain_dn_per_electron = 0.02;
  write_text(temp_ / "in/other.yaml", to_yaml(rig));
  EXPECT_EQ(import_with("camera: {noise: other.yaml}\n").exit_code, 0);
  EXPECT_EQ(gain(), 0.02);
  rig.sensor.bits = 12;
  write_text(temp_ / "in/other.yaml", to_yaml(rig));
  EXPECT_THAT(import_with("camera: {noise: other.yaml}\n").err, HasSubstr("for a camera with 12"));
}

// --- a real capture, if available ---

TEST(Captures, ReliefIsMeasured) {
  const char* captures = std::getenv("FRINGESLAM_CAPTURES");
  if (!captures || !fs::is_directory(fs::path(captures) / "relief"))
    GTEST_SKIP() << "set FRINGESLAM_CAPTURES to the folder that contains relief/ (see core/rig/README.md)";
  const test::TempFolder temp;
  test::write_bytes(temp / "import.yaml", R"(name: relief
near_m: 0.6
far_m: 0.9
projector: {width_px: 1920, height_px: 1080}
calibration:
  {file: calibration.yml, camera_matrix: M1, camera_distortion: D1, camera_size: S, projector_matrix: M4,
   projector_distortion: D4, rotation: Rlp, translation: Tlp, direction: projector_from_camera, unit_m: 0.001}
patterns:
  - {files: "%02d.png", first: 0, fringe: {axis: columns, period_px: 60, steps: 12, phase_offset_deg: 180}}
  - {files: "%02d.png", first: 12, gray: {axis: columns, period_px: 60, bits: 5, complementary: true}}
)");
  const std::string data = (temp / "data").string(), run = (temp / "run").string();
  test::run_successfully({"import", (fs::path(captures) / "relief").string(), "--config",
                          (temp / "import.yaml").string(), "--out", data, "--quiet"});
  test::run_successfully({"run", data, "--out", run, "--quiet", "--set", "decode.unwrapping=gray"});
  const cv::Mat1f depth = read_depth_estimate(run + "/frames/000000/depth.exr").depth_m;
  std::vector<float> found;
  for (const float z : depth) {
    if (z == z) found.push_back(z);
  }
  // Another decoder's result for the same images: 213,524 points, 695 to 775 mm (1 to 99 %), median 728 mm.
  EXPECT_NEAR(static_cast<double>(found.size()), 213524, 0.05 * 213524);
  std::sort(found.begin(), found.end());
  const auto quantile = [&](double share) {
    return found[static_cast<size_t>(share * static_cast<double>(found.size()))];
  };
  EXPECT_NEAR(quantile(0.5), 0.728, 0.002);
  EXPECT_NEAR(quantile(0.02), 0.697, 0.006);
  EXPECT_NEAR(quantile(0.97), 0.771, 0.006);
}

// Micro phase shifting: three steps of one period and one image of each of four others.
TEST(Captures, WaxbowlIsDecoded) {
  const char* captures = std::getenv("FRINGESLAM_CAPTURES");
  const fs::path waxbowl = captures ? fs::path(captures) / "waxbowl" : fs::path();
  if (waxbowl.empty() || !fs::is_directory(waxbowl))
    GTEST_SKIP() << "set FRINGESLAM_CAPTURES to the folder that contains waxbowl/ (see core/rig/README.md)";
  const test::TempFolder temp;
  test::write_bytes(temp / "import.yaml", R"(name: waxbowl
projector: {width_px: 1024, height_px: 768}
ignore: [column_x16.png]
patterns:
  - {files: "%d.png", fringe: {axis: columns, period_px: 21.489, steps: 3}}
  - {files: "%d.png", first: 3, extra: {axis: columns, periods_px: [21.123, 20.266, 21.822, 22.047]}}
)");
  const std::string data = (temp / "data").string();
  test::run_successfully(
      {"import", waxbowl.string(), "--config", (temp / "import.yaml").string(), "--out", data, "--quiet"});
  const PatternSequence sequence = read_patterns(temp / "data/patterns.yaml");
  ASSERT_EQ(sequence.patterns.size(), 7U);
  EXPECT_EQ(fringe_groups(sequence, Axis::columns).at(0).images.size(), 3U);
  for (size_t i = 3; i < 7; ++i) EXPECT_EQ(sequence.patterns[i].coding, Coding::extra);
  // The other periods determine the fringe orders.
  test::run_successfully({"decode", data, "--out", (temp / "out").string(), "--format", "npy", "--quiet"});
  EXPECT_TRUE(fs::exists(temp / "out/000000/column.npy"));
  EXPECT_FALSE(fs::exists(temp / "out/000000/relative_phase.npy"));
}

TEST(Captures, SkullIsImportedWithItsNoiseAndMapped) {
  const char* captures = std::getenv("FRINGESLAM_CAPTURES");
  const fs::path skull = captures ? fs::path(captures) / "skull" : fs::path();
  if (skull.empty() || !fs::is_directory(skull))
    GTEST_SKIP() << "set FRINGESLAM_CAPTURES to the folder that contains skull/ (see bench/accuracy/README.md)";
  const test::TempFolder temp;
  const fs::path config = fs::path(FRINGESLAM_SOURCE_DIR) / "bench/accuracy/captures/skull_2x3.yaml";
  const auto import = [&](const std::string& from, const std::string& to, const std::string& out) {
    test::write_bytes(temp / "import.yaml", test::replaced(test::read_bytes(config), from, to));
    return test::run_program({"import", (skull / "skull_2x3").string(), "--config", (temp / "import.yaml").string(),
                              "--out", (temp / out).string(), "--quiet"});
  };
  const auto good = import("skull_2x3", "skull", "good");
  EXPECT_EQ(good.exit_code, 0) << good.err;
  EXPECT_EQ(good.err, "");
  // Measured independently from two captures of the same patterns: 0.0325 DN/e-.
  EXPECT_NEAR(ReplayRig(temp / "good").model().sensor.gain_dn_per_electron, 0.0325, 0.002);
  test::run_successfully({"run", (temp / "good").string(), "--out", (temp / "run").string(), "--quiet"});
  const nlohmann::json frames = nlohmann::json::parse(test::read_bytes(temp / "run/frames.json"));
  EXPECT_EQ(frames[0]["tracking"], "first");
  EXPECT_GT(frames[0]["valid_pixels"], 330000);

  const auto wrong = import("number_of_periods: 16", "number_of_periods: 15", "wrong");
  EXPECT_EQ(wrong.exit_code, 2);
  EXPECT_THAT(wrong.err, HasSubstr("`number_of_periods: 16 instead of 15` fits better"));
  EXPECT_FALSE(fs::exists(temp / "wrong"));
}

}  // namespace
}  // namespace fringeslam
