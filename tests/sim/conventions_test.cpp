// SPDX-License-Identifier: Apache-2.0
// Conventions of a rig, checked on rendered stacks: the true description fits, common mistakes are found and named.
#include "core/check/conventions.h"

#include <gmock/gmock.h>

#include <functional>
#include <numbers>

#include "core/patterns/patterns.h"
#include "sim/virtual_rig.h"

namespace fringeslam::sim {
namespace {

using testing::HasSubstr;
using Verdict = ConventionReport::Verdict;

FringeStack rendered(const std::string& scene_name, uint64_t seed, RigModel& rig,
                     const PatternSequence* patterns = nullptr) {
  SceneLoadOptions reading;
  reading.seed = seed;
  const Scene scene = load_scene(std::string(FRINGESLAM_SOURCE_DIR) + "/scenes/" + scene_name + "/scene.yaml", reading);
  VirtualRig virtual_rig(scene, {});
  rig = scene.rig;
  return virtual_rig.simulate(patterns ? *patterns : scene.patterns)->stack;
}

// Step 0 of our own sequences has no offset.
std::vector<double> no_offsets(const FringeStack& stack) { return std::vector<double>(stack.images.size(), 0); }

PatternSequence both_axes(const RigModel& rig) {
  const int width = rig.projector.width, height = rig.projector.height;
  PatternSequence both =
      phase_shift_sequence(width, height, {1.0 * width, width / 8.0, width / 48.0}, 3, Axis::columns, 8);
  const PatternSequence rows =
      phase_shift_sequence(width, height, {1.0 * height, height / 8.0, height / 48.0}, 3, Axis::rows, 8);
  both.patterns.insert(both.patterns.end(), rows.patterns.begin(), rows.patterns.end());
  return both;
}

PatternSequence fringes_and_gray(const RigModel& rig) {
  const int width = rig.projector.width, height = rig.projector.height;
  PatternSequence sequence = phase_shift_sequence(width, height, {width / 32.0}, 4, Axis::columns, 8);
  for (const Pattern& bit : gray_patterns(Axis::columns, width / 64.0, width, 8)) sequence.patterns.push_back(bit);
  return sequence;
}

TEST(Conventions, TrueDescriptionsFit) {
  for (const std::string scene : {"loop", "paper_boxes"}) {
    for (uint64_t seed = 1; seed <= 3; ++seed) {
      RigModel rig;
      for (const auto& patterns : std::vector<std::function<PatternSequence()>>{
               nullptr, [&] { return both_axes(rig); }, [&] { return fringes_and_gray(rig); }}) {
        if (patterns) rendered(scene, seed, rig);
        const PatternSequence chosen = patterns ? patterns() : PatternSequence();
        const FringeStack stack = rendered(scene, seed, rig, patterns ? &chosen : nullptr);
        const ConventionReport report = check_conventions(stack, rig, no_offsets(stack));
        EXPECT_EQ(report.verdict, Verdict::fits) << scene << " " << seed << ": " << report.message;
        EXPECT_EQ(report.message, "");
      }
    }
  }
}

TEST(Conventions, TurnedImagesAreRecognized) {
  for (const std::string scene : {"loop", "boxes_and_foam", "groove_90"}) {
    RigModel rig;
    const FringeStack stack = rendered(scene, 1, rig);
    const auto flipped = [&](int axis) {
      FringeStack turned = stack;
      for (cv::Mat& image : turned.images) {
        image = image.clone();
        cv::flip(image, image, axis);
      }
      return turned;
    };
    constexpr int kLeftToRight = 1, kTopToBottom = 0, kHalfTurn = -1;
    EXPECT_EQ(reason_for_turned_images(stack, rig), "") << scene;
    EXPECT_THAT(reason_for_turned_images(flipped(kLeftToRight), rig), HasSubstr("face away")) << scene;
    EXPECT_THAT(reason_for_turned_images(flipped(kHalfTurn), rig), HasSubstr("face away")) << scene;
    // A mirrored world, which no column pattern distinguishes.
    EXPECT_EQ(reason_for_turned_images(flipped(kTopToBottom), rig), "") << scene;
    rig.calibrated = false;
    EXPECT_EQ(reason_for_turned_images(flipped(kHalfTurn), rig), "") << scene;
  }
}

// Most pixels saturate at the longer of two exposures.
TEST(Conventions, TurnedImagesOfSeveralExposuresAreRecognized) {
  RigModel rig;
  FringeStack stack = rendered("boxes_and_foam", 1, rig);
  for (size_t i = 0, count = stack.images.size(); i < count; ++i) {
    stack.patterns.patterns.push_back(stack.patterns.patterns[i]);
    stack.patterns.patterns.back().exposure = 64;
    stack.images.push_back(64 * stack.images[i]);
    stack.exposure_s.push_back(64 * stack.exposure_s[i]);
    stack.exposure_time_s.push_back(stack.exposure_time_s.back() + 0.01);
  }
  EXPECT_EQ(reason_for_turned_images(stack, rig), "");
  for (cv::Mat& image : stack.images) {
    image = image.clone();
    cv::flip(image, image, 1);
  }
  EXPECT_THAT(reason_for_turned_images(stack, rig), HasSubstr("face away"));
}

class Mistakes : public testing::Test {
 protected:
  // Applies a mistake to the true description and expects that its correction is found.
  void expect_found(const std::string& correction, const std::function<void(PatternSequence&, RigModel&)>& mistake) {
    FringeStack described = stack_;
    RigModel rig = rig_;
    mistake(described.patterns, rig);
    const ConventionReport report = check_conventions(described, rig, no_offsets(described));
    EXPECT_NE(report.verdict, Verdict::fits) << correction;
    EXPECT_THAT(report.message, HasSubstr(correction));
    EXPECT_GT(report.best.plausible, report.stated.plausible - 0.02);
  }
  static void for_fringes(PatternSequence& sequence, const std::function<void(Pattern&)>& change) {
    for (Pattern& p : sequence.patterns) {
      if (p.coding == Coding::fringe) change(p);
    }
  }
  void render(const std::function<PatternSequence(const RigModel&)>& patterns) {
    rendered("loop", 1, rig_);
    const PatternSequence sequence = patterns(rig_);
    stack_ = rendered("loop", 1, rig_, &sequence);
  }

  RigModel rig_;
  FringeStack stack_;
};

constexpr double kDegree = std::numbers::pi / 180;

TEST_F(Mistakes, OfSeveralPeriods) {
  stack_ = rendered("loop", 1, rig_);
  expect_found("shift_sign: 1",
               [](PatternSequence& s, RigModel&) { for_fringes(s, [](Pattern& p) { p.shift_rad = -p.shift_rad; }); });
  for (const int degrees : {30, 45, 90, 150}) {
    expect_found("phase_offset_deg -" + std::to_string(degrees), [&](PatternSequence& s, RigModel&) {
      for_fringes(s, [&](Pattern& p) { p.shift_rad += degrees * kDegree; });
    });
  }
  const double finest = fringe_groups(stack_.patterns, Axis::columns).back().period_px;
  const double count = stack_.patterns.width / finest;
  expect_found(" instead of ", [&](PatternSequence& s, RigModel&) {
    for_fringes(s, [&](Pattern& p) {
      if (p.period_px == finest) p.period_px = s.width / (count - 1);
    });
  });
  expect_found("the opposite calibration direction", [](PatternSequence&, RigModel& rig) {
    rig.projector_from_camera = rig.projector_from_camera.inverse();
  });
  expect_found("unit_m 1000 times as large",
               [](PatternSequence&, RigModel& rig) { rig.projector_from_camera.translation *= 1e-3; });
  expect_found("axis: columns",
               [](PatternSequence& s, RigModel&) { for_fringes(s, [](Pattern& p) { p.axis = Axis::rows; }); });
  expect_found("near_m", [](PatternSequence&, RigModel& rig) { rig.near_m = 3, rig.far_m = 9; });
  expect_found("periods exchanged", [&](PatternSequence& s, RigModel&) {
    const double coarsest = fringe_groups(s, Axis::columns).front().period_px;
    for_fringes(s, [&](Pattern& p) {
      p.period_px = p.period_px == finest ? coarsest : p.period_px == coarsest ? finest : p.period_px;
    });
  });
}

TEST_F(Mistakes, OfBothAxes) {
  render(both_axes);
  expect_found("shift_sign: 1 (rows)", [](PatternSequence& s, RigModel&) {
    for_fringes(s, [](Pattern& p) { p.shift_rad *= p.axis == Axis::rows ? -1 : 1; });
  });
  expect_found("projector width_px: " + std::to_string(rig_.projector.width), [](PatternSequence& s, RigModel& rig) {
    rig.projector.width /= 2;
    s.width /= 2;
    for_fringes(s, [](Pattern& p) { p.period_px *= p.axis == Axis::columns ? 0.5 : 1; });
  });
  rig_.calibrated = false;
  expect_found("shift_sign: 1 (columns)", [](PatternSequence& s, RigModel&) {
    for_fringes(s, [](Pattern& p) { p.shift_rad *= p.axis == Axis::columns ? -1 : 1; });
  });
}

TEST_F(Mistakes, OfGrayCodes) {
  render(fringes_and_gray);
  const auto for_bits = [](PatternSequence& s, const std::function<void(Pattern&)>& change) {
    for (Pattern& p : s.patterns) {
      if (p.coding == Coding::gray) change(p);
    }
  };
  expect_found("the opposite bright_is_one",
               [&](PatternSequence& s, RigModel&) { for_bits(s, [](Pattern& p) { p.inverted = true; }); });
  expect_found("the opposite order of the Gray code bits", [&](PatternSequence& s, RigModel&) {
    std::vector<double> cells;
    for_bits(s, [&](Pattern& p) { cells.push_back(p.period_px); });
    for_bits(s, [&](Pattern& p) {
      p.period_px = cells.back();
      cells.pop_back();
    });
  });
  expect_found("phase_offset_deg -30",
               [](PatternSequence& s, RigModel&) { for_fringes(s, [](Pattern& p) { p.shift_rad += 30 * kDegree; }); });
}

TEST(ConventionCheck, ReportsFlatsInTheWrongOrderAndMissingPatterns) {
  RigModel rig;
  rendered("loop", 1, rig);
  PatternSequence sequence = fringes_and_gray(rig);
  for (const double level : {1.0, 0.0}) {
    Pattern flat;
    flat.coding = Coding::flat;
    flat.level = level;
    sequence.patterns.push_back(flat);
  }
  FringeStack stack = rendered("loop", 1, rig, &sequence);
  std::swap(stack.images.back(), stack.images[stack.images.size() - 2]);
  const ConventionReport report = check_conventions(stack, rig, no_offsets(stack));
  EXPECT_EQ(report.verdict, Verdict::wrong);
  EXPECT_THAT(report.message, HasSubstr("exchange white and black"));
  for (cv::Mat& image : stack.images) image.setTo(7);
  EXPECT_THAT(check_conventions(stack, rig, no_offsets(stack)).message, HasSubstr("too few to check"));
}

}  // namespace
}  // namespace fringeslam::sim
