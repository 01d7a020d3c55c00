// SPDX-License-Identifier: Apache-2.0
// All methods of absolute phase unwrapping, on fringes generated directly from their equation.
#include <gmock/gmock.h>

#include <cmath>

#include "core/base/constants.h"
#include "core/decode/decode.h"
#include "core/decode/spatial.h"
#include "core/decode/unwrapping_levels.h"
#include "core/patterns/design.h"
#include "core/patterns/micro_code.h"
#include "core/patterns/waveform.h"
#include "tests/support/fringes.h"
#include "tests/support/matchers.h"

namespace fringeslam {
namespace {

using support::error_of;
using support::fringe_stack;
using support::Random;
using support::stack_of;
using testing::HasSubstr;

SequenceDesign design_of(std::vector<double> periods, GrayCode gray = GrayCode::none) {
  SequenceDesign design;
  design.width = 1024;
  design.height = 768;
  design.periods_px = std::move(periods);
  design.gray = gray;
  return design;
}

SequenceDesign micro_design(double period_px, int images) {
  SequenceDesign design = design_of({});
  design.micro_period_px = period_px;
  design.micro_images = images;
  return design;
}

SequenceDesign modulated_design(double period_px, int steps) {
  SequenceDesign design = design_of({});
  design.modulated_period_px = period_px;
  design.steps = steps;
  return design;
}

SequenceDesign products_design(double carrier_px, std::vector<double> periods_px) {
  SequenceDesign design = design_of({});
  design.carrier_px = carrier_px;
  design.product_periods_px = std::move(periods_px);
  return design;
}

// Several Gray codes, one with long runs, or this one alone.
SequenceDesign codes_design(std::vector<double> stripes_px) {
  SequenceDesign design = design_of({16.5}, GrayCode::complementary);
  design.gray_xor_px = std::move(stripes_px);
  design.gray_long_runs = true;
  return design;
}

// A Gray code alone, followed by its inverted images.
PatternSequence gray_with_inverses(double cell_px, int bits) {
  PatternSequence sequence{1024, 768, gray_patterns(Axis::columns, cell_px, 1024, bits)};
  for (Pattern pattern : gray_patterns(Axis::columns, cell_px, 1024, bits)) {
    pattern.inverted = true;
    sequence.patterns.push_back(pattern);
  }
  return sequence;
}

// Returns the intensity of a pattern, averaged over a width.
double blurred_intensity(const Pattern& pattern, double coordinate_px, double width_px) {
  constexpr int kSamples = 16;
  double light = 0;
  for (int s = 0; s < kSamples; ++s)
    light += ideal_intensity(pattern, coordinate_px + width_px * ((s + 0.5) / kSamples - 0.5)) / kSamples;
  return light;
}

RigModel plain_rig() {
  RigModel rig;
  rig.camera = {64, 48, 200, 200, 31.5, 23.5, {}};
  rig.projector = {1024, 768, 2600, 2600, 511.5, 383.5, {}};
  rig.projector_from_camera.translation = {-0.25, 0, 0};
  rig.sensor.gain_dn_per_electron = 0.0068;
  return rig;
}

DecodeOptions by(Unwrapping unwrapping) {
  DecodeOptions options;
  options.unwrapping = unwrapping;
  return options;
}

struct Method {
  Unwrapping unwrapping;
  SequenceDesign design;
};
void PrintTo(const Method& method, std::ostream* out) { *out << to_string(method.unwrapping); }

class AbsoluteMethods : public testing::TestWithParam<Method> {
 protected:
  // Smooth coordinates over the whole projector, with no pixel centre on a code edge.
  static cv::Mat1d coordinates() {
    cv::Mat1d u(48, 64);
    for (int row = 0; row < u.rows; ++row) {
      for (int col = 0; col < u.cols; ++col) u(row, col) = 3 + 15.87 * col + 0.21 * row;
    }
    return u;
  }
};
INSTANTIATE_TEST_SUITE_P(Unwrapping, AbsoluteMethods,
                         testing::Values(Method{Unwrapping::multifrequency, design_of({1040, 131, 16.5})},
                                         Method{Unwrapping::heterodyne, design_of({19.3, 18.0, 16.9})},
                                         Method{Unwrapping::heterodyne, design_of({66, 62.5})},
                                         Method{Unwrapping::gray, design_of({16.5}, GrayCode::complementary)},
                                         Method{Unwrapping::gray, design_of({30}, GrayCode::plain)},
                                         Method{Unwrapping::micro, micro_design(20, 7)},
                                         Method{Unwrapping::micro, micro_design(16.5, 10)},
                                         Method{Unwrapping::gray, codes_design({})},
                                         Method{Unwrapping::ensemble, codes_design({0, 16.5, 33})},
                                         Method{Unwrapping::modulated, modulated_design(20, 3)},
                                         Method{Unwrapping::modulated, modulated_design(16.5, 4)},
                                         Method{Unwrapping::modulated, products_design(18, {2080, 280})}),
                         [](const auto& test) {
                           return to_string(test.param.unwrapping) + std::to_string(test.index);
                         });

TEST_P(AbsoluteMethods, RecoverTheCoordinateUnderNoise) {
  const PatternSequence sequence = design_sequence(GetParam().design);
  const RigModel rig = plain_rig();
  const cv::Mat1d truth = coordinates();
  Random random(3);
  const auto stack = fringe_stack(truth, sequence, {}, CV_8UC1, rig.sensor, &random);
  const DecodedStack decoded = decode(stack, rig, by(GetParam().unwrapping));
  EXPECT_EQ(decoded.unwrapping, GetParam().unwrapping);
  int valid = 0;
  double squares = 0;
  for (int row = 0; row < truth.rows; ++row) {
    for (int col = 0; col < truth.cols; ++col) {
      if (decoded.fringe_order(row, col) < 0) continue;
      ++valid;
      const double sigmas = (decoded.coordinate_px(row, col) - truth(row, col)) / decoded.sigma_px(row, col);
      EXPECT_LT(std::abs(sigmas), 5) << row << ", " << col;
      EXPECT_GE(decoded.confidence(row, col), 1 - DecodeOptions().max_order_failure - 1e-6);
      squares += sigmas * sigmas;
    }
  }
  EXPECT_GT(valid, 0.8 * static_cast<double>(truth.total()));
  EXPECT_NEAR(squares / valid, 1, 0.15);  // the predicted sigmas match the errors
}

TEST_P(AbsoluteMethods, AutoFindsAMethodThatServes) {
  const PatternSequence sequence = design_sequence(GetParam().design);
  EXPECT_EQ(resolve_unwrapping(sequence, plain_rig(), {}), GetParam().unwrapping);
}

TEST_P(AbsoluteMethods, EveryInstructionSetGivesTheSameBits) {
  const PatternSequence sequence = design_sequence(GetParam().design);
  const RigModel rig = plain_rig();
  Random random(4);
  const auto stack = fringe_stack(coordinates(), sequence, {}, CV_8UC1, rig.sensor, &random);
  const auto with = [&](InstructionSet set) {
    return decode(stack, rig, by(GetParam().unwrapping), {Axis::columns, nullptr, set});
  };
  const DecodedStack portable = with(InstructionSet::portable), widest = with(widest_instruction_set());
  const auto same = [](const cv::Mat& a, const cv::Mat& b) {
    return std::memcmp(a.data, b.data, a.total() * a.elemSize()) == 0;
  };
  EXPECT_TRUE(same(portable.wrapped_phase, widest.wrapped_phase));
  EXPECT_TRUE(same(portable.coordinate_px, widest.coordinate_px));
  EXPECT_TRUE(same(portable.sigma_px, widest.sigma_px));
  EXPECT_TRUE(same(portable.confidence, widest.confidence));
  EXPECT_TRUE(same(portable.fringe_order, widest.fringe_order));
}

TEST(WrappedPhase, IsTheDoublePrecisionFormulaToAMicroradian) {
  const PatternSequence sequence = phase_shift_sequence(1024, 768, {1040}, 3, Axis::columns, 8);
  Random random(5);
  std::vector<cv::Mat> images;
  for (int k = 0; k < 3; ++k) {
    cv::Mat1f image(40, 531);  // width that is not a multiple of any vector length
    for (float& grey : image) grey = static_cast<float>(random.uniform(0, 250));
    images.push_back(image);
  }
  DecodeOptions options;
  options.min_modulation_dn = options.min_data_modulation = 0;
  const auto decoded = decode(stack_of(sequence, images), plain_rig(), options);
  for (int row = 0; row < 40; ++row) {
    for (int col = 0; col < 531; ++col) {
      const auto grey = [&](int k) { return static_cast<double>(images[k].at<float>(row, col)); };
      const double phase = std::atan2(std::sqrt(3.0) * (grey(0) - grey(2)), 2 * grey(1) - grey(0) - grey(2));
      const double measured = decoded.wrapped_phase(row, col);
      if (std::isnan(measured)) continue;
      EXPECT_LT(std::abs(std::remainder(measured - phase, kTwoPi)), 1e-6);
    }
  }
}

TEST(Heterodyne, BeatsHaveTheirClosedForm) {
  const auto groups = [](const std::vector<double>& periods) {
    return fringe_groups(phase_shift_sequence(1024, 768, periods, 3, Axis::columns, 8), Axis::columns);
  };
  const auto two = heterodyne_levels(groups({66, 62}), 1000);
  ASSERT_EQ(two.size(), 2U);
  EXPECT_NEAR(two[0].period_px, 66 * 62 / 4.0, 1e-9);
  EXPECT_EQ(two[1].period_px, 62);
  for (const UnwrappingLevel& rung : heterodyne_levels(groups({19.3, 18.0, 16.9}), 1024)) {
    const double frequency = rung.multiples[0] / 19.3 + rung.multiples[1] / 18.0 + rung.multiples[2] / 16.9;
    EXPECT_NEAR(1 / rung.period_px, frequency, 1e-12);
  }
  EXPECT_THAT(error_of([&] { heterodyne_levels(groups({66, 62}), 1024); }), HasSubstr("the longest is 1023"));
}

// The periods 16 and 16.25 px beat at 1040 px, 16 and 18.29 px at 128 px. The second beat as an intermediate level reduces the
// noise of the order from about 65 sqrt(2) to 11 phase sigmas.
TEST(Heterodyne, LevelsTolerateAsMuchNoiseAsPossible) {
  const PatternSequence sequence = phase_shift_sequence(1024, 768, {128 / 7.0, 16.25, 16}, 3, Axis::columns, 8);
  const auto levels = heterodyne_levels(fringe_groups(sequence, Axis::columns), 1024);
  ASSERT_EQ(levels.size(), 3U);
  EXPECT_NEAR(levels[0].period_px, 1040, 1e-6);
  EXPECT_NEAR(levels[1].period_px, 128, 1e-6);
  EXPECT_NEAR(levels[2].period_px, 16, 1e-9);
  EXPECT_THAT(levels[1].multiples, testing::ElementsAre(-1, 0, 1));
}

TEST(Geometric, OrderFollowsFromTheDepthRange) {
  const RigModel rig = plain_rig();
  const PixelRays rays = pixel_rays(rig.camera);
  const PatternSequence sequence = phase_shift_sequence(1024, 768, {480}, 3, Axis::columns, 8);
  Random random(6);
  for (const double depth : {0.75, 0.9, 1.1, 1.35}) {
    const auto seen =
        predict_coordinate(rig, rays, cv::Mat1f(48, 64, static_cast<float>(depth)), cv::Mat1f(48, 64, 0.0f));
    cv::Mat1d truth;
    seen.coordinate_px.convertTo(truth, CV_64F);
    const auto stack = fringe_stack(truth, sequence, {}, CV_8UC1, rig.sensor, &random);
    const DecodedStack decoded = decode(stack, rig, by(Unwrapping::geometric));
    int valid = 0, in_beam = 0;
    for (int row = 0; row < 48; ++row) {
      for (int col = 0; col < 64; ++col) {
        in_beam += truth(row, col) > 0 && truth(row, col) < 1023;
        if (decoded.fringe_order(row, col) < 0) continue;
        ++valid;
        EXPECT_LT(std::abs(decoded.coordinate_px(row, col) - truth(row, col)), 6 * decoded.sigma_px(row, col));
      }
    }
    EXPECT_GT(valid, 0.9 * in_beam) << depth << " m";
  }
  const PatternSequence fine = phase_shift_sequence(1024, 768, {16.5}, 3, Axis::columns, 8);
  EXPECT_THAT(error_of([&] { resolve_unwrapping(fine, rig, by(Unwrapping::geometric)); }),
              HasSubstr("more than a period of 16.5 px"));
}

TEST(Predicted, RoundsToTheExpectedOrderAndRefusesWhatDoesNotFit) {
  const RigModel rig = plain_rig();
  const PatternSequence sequence = phase_shift_sequence(1024, 768, {16}, 3, Axis::columns, 8);
  Random random(7);
  const cv::Mat1d truth = support::ramp(100, 900, 2000);
  const auto stack = fringe_stack(truth, sequence, {}, CV_8UC1, rig.sensor, &random);
  CoordinatePrior expected{cv::Mat1f(1, 2000), cv::Mat1f(1, 2000, 0.0f), cv::Mat1f(1, 2000, 1.5f)};
  const auto decode_with = [&](double error_px) {
    for (int i = 0; i < 2000; ++i) expected.coordinate_px(i) = static_cast<float>(truth(i) + error_px);
    return decode(stack, rig, by(Unwrapping::predicted), {Axis::columns, &expected});
  };
  for (const double error : {0.0, 2.0, -3.0}) {
    const auto decoded = decode_with(error);
    EXPECT_EQ(cv::countNonZero(decoded.fringe_order >= 0), 2000);
    for (int i = 0; i < 2000; ++i) EXPECT_NEAR(decoded.coordinate_px(i), truth(i), 0.5);
  }
  // Near half a period both orders are equally likely.
  EXPECT_EQ(cv::countNonZero(decode_with(7.7).fringe_order >= 0), 0);
  expected.coordinate_px(5) = std::numeric_limits<float>::quiet_NaN();
  EXPECT_EQ(decode(stack, rig, by(Unwrapping::predicted), {Axis::columns, &expected}).fringe_order(5), -1);
  EXPECT_THAT(error_of([&] { decode(stack, rig, by(Unwrapping::predicted)); }), HasSubstr("no map to predict from"));
}

TEST(Predicted, LooksAtTheFinestPeriodAlone) {
  const RigModel rig = plain_rig();
  const PatternSequence all = design_sequence(design_of({1040, 131, 16})),
                        fine = phase_shift_sequence(1024, 768, {16}, 3, Axis::columns, 8);
  const cv::Mat1d truth = support::ramp(100, 900, 500);
  FringeStack stack = fringe_stack(truth, all, {}, CV_8UC1);
  for (size_t i = 0; i < 6; ++i) stack.images[i].setTo(255);  // the coarser periods
  const FringeStack last = stack_of(fine, {stack.images.begin() + 6, stack.images.end()});
  CoordinatePrior expected{cv::Mat1f(1, 500), cv::Mat1f(1, 500, 0.0f), cv::Mat1f(1, 500, 1.0f)};
  truth.convertTo(expected.coordinate_px, CV_32F);
  const DecodedStack by_all = decode(stack, rig, by(Unwrapping::predicted), {Axis::columns, &expected}),
                     by_fine = decode(last, rig, by(Unwrapping::predicted), {Axis::columns, &expected});
  EXPECT_EQ(cv::countNonZero(by_fine.fringe_order >= 0), 500);
  EXPECT_EQ(cv::norm(by_all.coordinate_px, by_fine.coordinate_px, cv::NORM_INF), 0);
  EXPECT_EQ(cv::norm(by_all.mean, by_fine.mean, cv::NORM_INF), 0);
}

TEST(Gray, AloneGivesItsCells) {
  const PatternSequence sequence = gray_with_inverses(4, 8);
  const RigModel rig = plain_rig();
  std::vector<cv::Mat> images;
  const cv::Mat1d truth = support::ramp(1.2, 1021, 600);
  for (const Pattern& pattern : sequence.patterns) {
    cv::Mat1b image(1, 600);
    for (int i = 0; i < 600; ++i) image(i) = static_cast<uchar>(30 + 150 * ideal_intensity(pattern, truth(i)));
    images.push_back(image);
  }
  const DecodedStack decoded = decode(stack_of(sequence, images), rig, {});
  for (int i = 0; i < 600; ++i) {
    EXPECT_LE(std::abs(decoded.coordinate_px(i) - truth(i)), 2 + 1e-4);
    EXPECT_NEAR(decoded.sigma_px(i), 4 / std::sqrt(12.0), 1e-6);
  }
}

// A lens spreads the edges between cells over two projector pixels, where noise often flips the bit that differs.
TEST(Gray, AloneHasTheSigmaOfItsErrors) {
  constexpr int kWidth = 20000;
  constexpr double kBlur_px = 2;
  const PatternSequence sequence = gray_with_inverses(2, 9);
  for (const double gain : {0.05, 0.5}) {
    RigModel rig = plain_rig();
    rig.sensor.gain_dn_per_electron = gain;
    rig.sensor.dark_noise_electrons = 0;
    Random random(7);
    const cv::Mat1d truth = support::ramp(2, 1020, kWidth);
    std::vector<cv::Mat> images;
    for (const Pattern& pattern : sequence.patterns) {
      cv::Mat1b image(1, kWidth);
      for (int i = 0; i < kWidth; ++i) {
        const double level = 30 + 150 * blurred_intensity(pattern, truth(i), kBlur_px);
        image(i) = cv::saturate_cast<uchar>(level + std::sqrt(level * gain) * random.normal());
      }
      images.push_back(image);
    }
    const DecodedStack decoded = decode(stack_of(sequence, images), rig, {});
    double squares = 0;
    int valid = 0;
    for (int i = 0; i < kWidth; ++i) {
      if (std::isnan(decoded.sigma_px(i))) continue;
      const double sigmas = (decoded.coordinate_px(i) - truth(i)) / static_cast<double>(decoded.sigma_px(i));
      squares += sigmas * sigmas;
      ++valid;
    }
    EXPECT_GT(valid, 0.99 * kWidth);
    EXPECT_NEAR(squares / valid, 1, 0.1) << "gain " << gain;
  }
}

TEST(Gray, AloneHasAnyCells) {
  SequenceDesign design = design_of({});
  design.gray_cell_px = 1;
  design.white_black = true;
  const PatternSequence sequence = design_sequence(design);
  EXPECT_EQ(sequence.patterns.size(), 12U);  // 10 bits number 1024 columns
  const RigModel rig = plain_rig();
  std::vector<cv::Mat> images;
  const cv::Mat1d truth = support::ramp(1.2, 1021, 600);
  for (const Pattern& pattern : sequence.patterns) {
    cv::Mat1b image(1, 600);
    for (int i = 0; i < 600; ++i) image(i) = static_cast<uchar>(30 + 150 * ideal_intensity(pattern, truth(i)));
    images.push_back(image);
  }
  const DecodedStack decoded = decode(stack_of(sequence, images), rig, {});
  for (int i = 0; i < 600; ++i) EXPECT_LE(std::abs(decoded.coordinate_px(i) - truth(i)), 0.5 + 1e-4);
}

TEST(Gray, NumbersACoarserPeriodThanTheFinest) {
  // Gray code of the 128 px period; 128 px unwraps 32 px, which unwraps 8 px.
  PatternSequence sequence = phase_shift_sequence(1024, 768, {128, 32, 8}, 4, Axis::columns, 8);
  for (const Pattern& bit : gray_patterns(Axis::columns, 64, 1024, 8)) sequence.patterns.push_back(bit);
  const RigModel rig = plain_rig();
  Random random(4);
  const cv::Mat1d truth = support::ramp(1.2, 1021, 3000);
  const FringeStack stack = fringe_stack(truth, sequence, {}, CV_8UC1, rig.sensor, &random);
  ASSERT_EQ(resolve_unwrapping(sequence, rig, {}), Unwrapping::gray);
  const DecodedStack decoded = decode(stack, rig, {});
  EXPECT_EQ(decoded.unwrapping, Unwrapping::gray);
  EXPECT_EQ(decoded.finest_period_px, 8);
  int valid = 0;
  for (int i = 0; i < 3000; ++i) {
    if (std::isnan(decoded.coordinate_px(i))) continue;
    ++valid;
    EXPECT_NEAR(decoded.coordinate_px(i), truth(i), 0.3);
  }
  EXPECT_GT(valid, 2900);
  PatternSequence coarse{1024, 768, {}};
  coarse.patterns = phase_shift_sequence(1024, 768, {32, 8}, 4, Axis::columns, 8).patterns;
  for (const Pattern& bit : gray_patterns(Axis::columns, 64, 1024, 8)) coarse.patterns.push_back(bit);
  EXPECT_THAT(error_of([&] { resolve_unwrapping(coarse, rig, by(Unwrapping::gray)); }),
              HasSubstr("wider than the longest period, 32 px"));
}

TEST(Gray, BitsCombinedByXorNumberThePeriods) {
  for (const double stripe_px : {16.0, 32.0}) {
    SequenceDesign design = design_of({16}, GrayCode::complementary);
    design.gray_xor_px = {stripe_px};
    const PatternSequence sequence = design_sequence(design);
    const RigModel rig = plain_rig();
    Random random(5);
    constexpr int kPixels = 4000;
    constexpr double kBlur_px = 2;
    const cv::Mat1d truth = support::ramp(1.2, 1021, kPixels);
    std::vector<cv::Mat> images;
    for (const Pattern& pattern : sequence.patterns) {
      cv::Mat1b image(1, kPixels);
      for (int i = 0; i < kPixels; ++i) {
        const double light = blurred_intensity(pattern, truth(i), kBlur_px);
        image(i) = cv::saturate_cast<uchar>(30 + 150 * light + random.normal());
      }
      images.push_back(image);
    }
    const DecodedStack decoded = decode(stack_of(sequence, images), rig, by(Unwrapping::gray));
    int valid = 0;
    for (int i = 0; i < kPixels; ++i) {
      if (std::isnan(decoded.coordinate_px(i))) continue;
      ++valid;
      EXPECT_NEAR(decoded.coordinate_px(i), truth(i), 0.5);
    }
    // Near the carrier's edges, noise decides all bits.
    EXPECT_GT(valid, 0.97 * kPixels) << stripe_px;
  }
}

// A second, brighter reflection of another part of the projector's image, out of focus, reverses bits with wide stripes;
// narrow stripes average to a constant.
TEST(Gray, NarrowStripesWithstandLightFromElsewhere) {
  const RigModel rig = plain_rig();
  const cv::Mat1d truth = support::ramp(1.2, 1021, 2000);
  constexpr double kHalf_px = 120;
  const auto wrong_share = [&](std::vector<double> stripes_px, bool long_runs) {
    SequenceDesign design = design_of({}, GrayCode::none);
    design.gray_cell_px = 8;
    design.gray_xor_px = std::move(stripes_px);
    design.gray_long_runs = long_runs;
    design.white_black = true;
    const PatternSequence sequence = design_sequence(design);
    std::vector<cv::Mat> images;
    for (const Pattern& pattern : sequence.patterns) {
      cv::Mat1f image(1, truth.cols);
      for (int i = 0; i < truth.cols; ++i) {
        double elsewhere = 0;
        constexpr int kSamples = 60;
        for (int s = 0; s < kSamples; ++s) {
          const double at = 1023 - truth(i) + kHalf_px * (2 * (s + 0.5) / kSamples - 1);
          elsewhere += ideal_intensity(pattern, std::abs(at)) / kSamples;
        }
        image(i) = static_cast<float>(20 + 70 * ideal_intensity(pattern, truth(i)) + 120 * elsewhere);
      }
      images.push_back(image);
    }
    const DecodedStack decoded = decode(stack_of(sequence, images), rig, {});
    EXPECT_EQ(decoded.unwrapping, Unwrapping::gray);
    int wrong = 0;
    for (int i = 0; i < truth.cols; ++i) wrong += !(std::abs(decoded.coordinate_px(i) - truth(i)) < 16);
    return static_cast<double>(wrong) / truth.cols;
  };
  EXPECT_GT(wrong_share({}, false), 0.4);
  EXPECT_LT(wrong_share({}, true), 0.1);
  EXPECT_LT(wrong_share({32}, false), 0.1);
}

TEST(Gray, ALongRunCodeNeedsAllItsBits) {
  PatternSequence sequence = design_sequence(codes_design({}));
  const auto refused = [&] {
    return error_of([&] { resolve_unwrapping(sequence, plain_rig(), by(Unwrapping::gray)); });
  };
  std::erase_if(sequence.patterns, [](const Pattern& p) { return p.code_bits > 0 && p.code_bit == 2; });
  EXPECT_THAT(refused(), HasSubstr("the Gray code has no bit 2 of 7 (code_bit); add it"));
  sequence = design_sequence(codes_design({}));
  for (Pattern& pattern : sequence.patterns) {
    if (pattern.coding == Coding::gray) pattern.period_px = 4;
  }
  EXPECT_THAT(refused(), HasSubstr("the Gray code distinguishes only 512 px of the projector's 1024 px"));
}

TEST(Ensemble, KeepsWhatTwoCodesAgreeOn) {
  const PatternSequence sequence = design_sequence(codes_design({0, 16.5}));
  const RigModel rig = plain_rig();
  const cv::Mat1d truth = support::ramp(20.3, 1000.8, 300);
  const FringeStack clean = fringe_stack(truth, sequence, {}, CV_8UC1);
  const auto replaced = [&](auto&& wrong_bits) {
    FringeStack stack = clean;
    for (size_t k = 0; k < stack.images.size(); ++k) {
      cv::Mat image = clean.images[k].clone();
      if (wrong_bits(sequence.patterns[k])) image = 200 - image;
      stack.images[k] = image;
    }
    return decode(stack, rig, {});
  };
  const DecodedStack all = replaced([](const Pattern&) { return false; });
  ASSERT_EQ(all.unwrapping, Unwrapping::ensemble);
  EXPECT_GT(cv::countNonZero(all.fringe_order >= 0), 280);
  const auto is_plain = [](const Pattern& p) {
    return p.coding == Coding::gray && p.code_bits == 0 && p.carrier_px == 0;
  };
  // One wrong code: the others outvote it. The coarsest bit of the plain code does not belong to the XOR code.
  const DecodedStack outvoted = replaced([&](const Pattern& p) { return is_plain(p) && p.period_px > 500; });
  int valid = 0;
  for (int i = 0; i < truth.cols; ++i) {
    if (outvoted.fringe_order(i) < 0) continue;
    ++valid;
    EXPECT_NEAR(outvoted.coordinate_px(i), truth(i), 0.5) << i;
  }
  EXPECT_GT(valid, 270);
  // Three codes, each with an opinion of its own: none is believed.
  const DecodedStack none = replaced(
      [&](const Pattern& p) { return (is_plain(p) && p.period_px > 500) || (p.code_bits > 0 && p.code_bit < 3); });
  EXPECT_LT(cv::countNonZero(none.fringe_order >= 0), 15);
}

TEST(Ensemble, NeedsTwoCodings) {
  EXPECT_THAT(error_of([&] {
                resolve_unwrapping(design_sequence(design_of({16.5}, GrayCode::complementary)), plain_rig(),
                                   by(Unwrapping::ensemble));
              }),
              HasSubstr("decode.unwrapping=ensemble: an ensemble needs two codings that give fringe orders"));
  // Fringes of several periods and a Gray code are two, if asked for.
  const PatternSequence two = design_sequence(design_of({1040, 131, 16.5}, GrayCode::complementary));
  EXPECT_EQ(resolve_unwrapping(two, plain_rig(), by(Unwrapping::ensemble)), Unwrapping::ensemble);
  EXPECT_EQ(resolve_unwrapping(two, plain_rig(), {}), Unwrapping::multifrequency);
}

TEST(Gray, ABitCombinedByXorNeedsItsCarrier) {
  PatternSequence sequence = design_sequence(design_of({16}, GrayCode::complementary));
  for (Pattern& pattern : sequence.patterns) {
    if (pattern.coding == Coding::gray) pattern.carrier_px = 4;
  }
  const FringeStack stack = fringe_stack(cv::Mat1d(1, 1, 203.0), sequence, {}, CV_8UC1);
  EXPECT_THAT(error_of([&] { decode(stack, plain_rig(), by(Unwrapping::gray)); }),
              HasSubstr("combined with one of 4 px, which the sequence does not contain"));
}

TEST(Gray, AFlatBitBetweenTwoFarCellsIsNotBelieved) {
  const PatternSequence sequence = design_sequence(design_of({32}, GrayCode::complementary));
  const RigModel rig = plain_rig();
  auto stack = fringe_stack(cv::Mat1d(1, 1, 203.0), sequence, {}, CV_8UC1);
  ASSERT_EQ(decode(stack, rig, by(Unwrapping::gray)).fringe_order(0), 6);
  stack.images[4].at<uchar>(0) = 120;  // second coarsest bit at its threshold: the candidate cells are far apart
  EXPECT_EQ(decode(stack, rig, by(Unwrapping::gray)).fringe_order(0), -1);
}

// Images of extra frequencies and products of cosines, before and after each image of a sequence.
PatternSequence with_others(const PatternSequence& sequence) {
  PatternSequence more{sequence.width, sequence.height, {}};
  Pattern product{Axis::columns, 64, 0, 8, Coding::product};
  product.carrier_px = 16;
  for (const Pattern& pattern : sequence.patterns) {
    const double period_px = pattern.coding == Coding::fringe ? pattern.period_px : 50;
    more.patterns.push_back({Axis::columns, period_px, 0.4 + pattern.shift_rad, 8, Coding::extra});
    more.patterns.push_back(pattern);
    product.shift_rad += 1;
    more.patterns.push_back(product);
  }
  return more;
}

TEST(ImagesWithoutADecoder, AreIgnored) {
  SequenceDesign bits_alone = design_of({}, GrayCode::none);
  bits_alone.gray_cell_px = 8;
  bits_alone.white_black = true;
  const RigModel rig = plain_rig();
  const cv::Mat1d truth = support::ramp(1.2, 1021, 600);
  for (const SequenceDesign& design :
       {design_of({1040, 131, 16.5}), design_of({66, 62.5}), design_of({30}, GrayCode::complementary), bits_alone}) {
    const PatternSequence alone = design_sequence(design), together = with_others(alone);
    const DecodedStack expected = decode(fringe_stack(truth, alone, {}, CV_8UC1), rig, {}),
                       found = decode(fringe_stack(truth, together, {}, CV_8UC1), rig, {});
    EXPECT_EQ(found.unwrapping, expected.unwrapping);
    for (const auto image : {&DecodedStack::mean, &DecodedStack::modulation, &DecodedStack::wrapped_phase,
                             &DecodedStack::coordinate_px, &DecodedStack::sigma_px, &DecodedStack::confidence}) {
      const cv::Mat1f &a = expected.*image, &b = found.*image;
      for (int i = 0; i < 600; ++i) ASSERT_TRUE(a(i) == b(i) || (std::isnan(a(i)) && std::isnan(b(i)))) << i;
    }
    EXPECT_EQ(cv::countNonZero(found.fringe_order != expected.fringe_order), 0);
  }
}

TEST(ImagesWithoutADecoder, AloneAreAnErrorThatNamesTheUsableCodings) {
  SequenceDesign design = design_of({});
  design.extra_periods_px = {21.1, 20.3, 22.4};
  design.white_black = true;
  const std::string says =
      "patterns: columns are coded only by `extra` images, which determine no phase by themselves; add `fringe` images "
      "with three or more phase shifts of a period, or a `gray` code";
  for (const Unwrapping method : {Unwrapping::automatic, Unwrapping::gray, Unwrapping::spatial})
    EXPECT_EQ(error_of([&] { resolve_unwrapping(design_sequence(design), plain_rig(), by(method)); }), says);
  const PatternSequence sequence = design_sequence(design);
  EXPECT_EQ(error_of([&] { decode(fringe_stack(support::ramp(1, 1000, 50), sequence, {}, CV_8UC1), plain_rig(), {}); }),
            says);
}

// Light from a wide part of the projector's image reaches each pixel as well. It changes the phase of long fringes, which
// then contradict each other; products of a short carrier average to a constant.
TEST(Modulated, LightFromAWidePartOfTheProjectorChangesNothing) {
  const cv::Mat1d truth = support::ramp(0.3, 1022.8, 3000);
  const RigModel rig = plain_rig();
  constexpr double kHalf_px = 160;  // of the part, eight to nine carriers: their mean is 2 % of their amplitude
  const auto decoded_of = [&](const PatternSequence& sequence) {
    std::vector<cv::Mat> images;
    for (const Pattern& pattern : sequence.patterns) {
      std::vector<double> sum = {0};  // of the intensities up to each half pixel
      for (int i = -800; i < 2848; ++i) sum.push_back(sum.back() + ideal_intensity(pattern, 0.5 * i));
      cv::Mat1f image(1, truth.cols);
      for (int i = 0; i < truth.cols; ++i) {
        const auto at = static_cast<size_t>(std::lround(2 * (truth(i) + 100 + 400)));
        const double indirect = (sum[at + 320] - sum[at - 320]) / (4 * kHalf_px);
        image(i) = static_cast<float>(30 + 90 * ideal_intensity(pattern, truth(i)) + 80 * indirect);
      }
      images.push_back(image);
    }
    return decode(stack_of(sequence, images), rig, {});
  };
  const auto share_within = [&](const DecodedStack& decoded, double error_px) {
    int within = 0;
    for (int i = 0; i < truth.cols; ++i) within += std::abs(decoded.coordinate_px(i) - truth(i)) < error_px;
    return static_cast<double>(within) / truth.cols;
  };
  const DecodedStack modulated = decoded_of(design_sequence(modulated_design(20, 3)));
  EXPECT_EQ(modulated.unwrapping, Unwrapping::modulated);
  EXPECT_GT(share_within(modulated, 0.1), 0.95);
  EXPECT_LT(share_within(decoded_of(design_sequence(design_of({1040, 160, 20}))), 0.1), 0.3);
}

TEST(Modulated, NamesWhatIsMissing) {
  const auto refused = [](PatternSequence sequence) {
    return error_of([&] { resolve_unwrapping(sequence, plain_rig(), by(Unwrapping::modulated)); });
  };
  PatternSequence sequence = design_sequence(products_design(18, {2080}));
  EXPECT_THAT(refused(design_sequence(design_of({16}))),
              HasSubstr("no products of cosines; add `modulated_period_px`"));
  EXPECT_THAT(refused(design_sequence(products_design(18, {1200}))),
              HasSubstr("no product covers the projector's 1024 px (the longest period is 1200 px, of which half is"));
  EXPECT_THAT(refused(design_sequence(products_design(18, {2080, 30}))),
              HasSubstr("periods of 30 and 18 px have no high-frequency carrier; it must be shorter than half"));
  sequence.patterns.back().carrier_px = 20;
  EXPECT_THAT(refused(sequence), HasSubstr("carriers of 18 and 20 px; use one"));
  sequence.patterns.pop_back();
  EXPECT_THAT(refused(sequence), HasSubstr("do not separate their two fringes; use all combinations"));
  EXPECT_THAT(refused(design_sequence(products_design(18, {2080, 1500, 1100, 800, 600, 450, 330, 250, 190}))),
              HasSubstr("9 products have 18 fringes, more than 16"));
  SequenceDesign many = products_design(18, {2080});
  many.steps = 9;
  EXPECT_THAT(refused(design_sequence(many)), HasSubstr("more than 64 images of one product"));
}

// Weights that differ by image mix the two fringes of a product.
TEST(Modulated, SeveralExposuresAreRefused) {
  SequenceDesign design = products_design(18, {2080});
  design.exposures = {1, 4};
  EXPECT_THAT(error_of([&] { resolve_unwrapping(design_sequence(design), plain_rig(), by(Unwrapping::modulated)); }),
              HasSubstr("several exposures"));
  EXPECT_NE(error_of([&] { resolve_unwrapping(design_sequence(design), plain_rig(), {}); }), "");
}

// In motion, a pixel may be outside the image of a bit.
TEST(Gray, PixelsThatABitDoesNotShowAreNotDecoded) {
  const PatternSequence sequence = design_sequence(design_of({16.5}, GrayCode::complementary));
  const cv::Mat1d truth = support::ramp(0.3, 1022.8, 500);
  const FringeStack stack = fringe_stack(truth, sequence, {128, 90}, CV_32FC1);
  AlignedStack aligned;
  for (const cv::Mat& image : stack.images) {
    aligned.images.push_back(image);
    aligned.drift_px.emplace_back(image.size(), 0.0f);
  }
  DecodeContext context;
  context.aligned = &aligned;
  const DecodedStack whole = decode(stack, plain_rig(), by(Unwrapping::gray), context);
  const auto bit = std::find_if(sequence.patterns.begin(), sequence.patterns.end(),
                                [](const Pattern& p) { return p.coding == Coding::gray; });
  const auto number = static_cast<size_t>(bit - sequence.patterns.begin());
  constexpr int kHidden = 100;
  aligned.images[number] = aligned.images[number].clone();
  aligned.images[number].colRange(0, kHidden).setTo(0);
  aligned.drift_px[number].colRange(0, kHidden).setTo(std::numeric_limits<float>::quiet_NaN());
  const DecodedStack part = decode(stack, plain_rig(), by(Unwrapping::gray), context);
  EXPECT_GT(cv::countNonZero(whole.coordinate_px == whole.coordinate_px), 490);
  for (int i = 0; i < truth.cols; ++i) {
    const float expected = i < kHidden ? std::numeric_limits<float>::quiet_NaN() : whole.coordinate_px(0, i);
    EXPECT_EQ(std::isnan(part.coordinate_px(0, i)), std::isnan(expected)) << i;
    if (!std::isnan(expected)) {
      EXPECT_EQ(part.coordinate_px(0, i), expected) << i;
    }
  }
}

// Indirect light adds the same constant to all images of short periods.
TEST(Micro, ConstantLightChangesNeitherOrdersNorPhases) {
  const PatternSequence sequence = design_sequence(micro_design(16.5, 7));
  const cv::Mat1d truth = support::ramp(0.3, 1022.8, 4000);
  for (const double mean : {100.0, 160.0}) {
    const DecodedStack found = decode(fringe_stack(truth, sequence, {mean, 60}, CV_32FC1), plain_rig(), {});
    EXPECT_EQ(found.unwrapping, Unwrapping::micro);
    int decided = 0;
    for (int i = 0; i < truth.cols; ++i) {
      // Where two orders predict nearly the same images, the pixel remains undecided.
      if (found.fringe_order(0, i) < 0) continue;
      ++decided;
      ASSERT_NEAR(found.coordinate_px(0, i), truth(0, i), 2e-3) << i;
      ASSERT_EQ(found.fringe_order(0, i), static_cast<int>(std::floor((found.coordinate_px(0, i) + 0.5) / 16.5 + 0.5)))
          << i;
    }
    EXPECT_GT(decided, 3000) << mean;
  }
}

// The other images would move a corrected phase by the projector's error once more.
TEST(Micro, CorrectionsOfAProjectorAreKept) {
  constexpr double kGamma = 1.1;
  const PatternSequence sequence = design_sequence(micro_design(16.5, 7));
  const cv::Mat1d truth = support::ramp(0.3, 1022.8, 4000);
  std::vector<cv::Mat> images;
  for (const Pattern& pattern : sequence.patterns) {
    cv::Mat1f image(truth.size());
    for (int i = 0; i < truth.cols; ++i)
      image(0, i) = static_cast<float>(60 + 120 * std::pow(ideal_intensity(pattern, truth(0, i)), kGamma));
    images.push_back(image);
  }
  RigModel rig = plain_rig();
  rig.phase_correction = phase_correction_of(gamma_table(kGamma), 3);
  const DecodedStack found = decode(stack_of(sequence, images), rig, {});
  double largest_px = 0;
  int decided = 0;
  for (int i = 0; i < truth.cols; ++i) {
    if (found.fringe_order(0, i) < 0) continue;
    ++decided;
    largest_px = std::max(largest_px, std::abs(static_cast<double>(found.coordinate_px(0, i)) - truth(0, i)));
  }
  EXPECT_GT(decided, 3000);
  EXPECT_LT(largest_px, 0.01);
}

// Seven images know the phase better than the three phase steps alone do.
TEST(Micro, AllImagesContributeToThePhase) {
  const RigModel rig = plain_rig();
  const PatternSequence seven = design_sequence(micro_design(16.5, 7)), three = finest_patterns(seven, Axis::columns);
  const cv::Mat1d truth = support::ramp(0.3, 1022.8, 4000);
  cv::Mat1f near;
  truth.convertTo(near, CV_32F);
  const CoordinatePrior prior{near, cv::Mat1f(near.size(), 0.f), cv::Mat1f(near.size(), 0.5f)};
  Random random(5);
  const auto rms = [&](const DecodedStack& decoded) {
    double squares = 0;
    int count = 0;
    for (int i = 0; i < truth.cols; ++i) {
      if (decoded.fringe_order(0, i) < 0) continue;
      squares += std::pow(static_cast<double>(decoded.coordinate_px(0, i)) - truth(0, i), 2);
      ++count;
    }
    EXPECT_GT(count, 3600);
    return std::sqrt(squares / count);
  };
  const double by_seven = rms(decode(fringe_stack(truth, seven, {}, CV_8UC1, rig.sensor, &random), rig, {})),
               by_three = rms(decode(fringe_stack(truth, three, {}, CV_8UC1, rig.sensor, &random), rig,
                                     by(Unwrapping::predicted), {Axis::columns, &prior}));
  EXPECT_LT(by_seven, 0.85 * by_three);
}

// Pixels that see two surfaces fit no single order.
TEST(Micro, MixedPixelsAreRejectedOrRight) {
  const RigModel rig = plain_rig();
  const PatternSequence sequence = design_sequence(micro_design(16.5, 8));
  const cv::Mat1d left = support::ramp(50, 400, 3000), right = support::ramp(600, 933, 3000);
  Random random(6);
  FringeStack stack = fringe_stack(left, sequence, {60, 45}, CV_8UC1, rig.sensor, &random);
  const FringeStack other = fringe_stack(right, sequence, {60, 45}, CV_8UC1, rig.sensor, &random);
  for (size_t k = 0; k < stack.images.size(); ++k) stack.images[k] += other.images[k];
  const DecodedStack found = decode(stack, rig, {});
  int wrong = 0;
  for (int i = 0; i < left.cols; ++i) {
    const double at = found.coordinate_px(0, i);
    wrong += !std::isnan(at) && std::abs(at - left(0, i)) > 8 && std::abs(at - right(0, i)) > 8;
  }
  EXPECT_LT(wrong, 0.01 * left.cols);
}

TEST(MicroCode, DistanceIsThatOfTheImages) {
  const double period = 16.5;
  const std::vector<double> others = {15.3, 17.1, 17.9};
  const int length = 200, orders = micro_orders(period, length);
  const MicroCodeDistance found = micro_code_distance(period, others, length);
  double least = 1e9;
  for (int k = 0; k < orders; ++k) {
    for (int m = 0; m < k; ++m) {
      for (int phase = 0; phase < 8; ++phase) {
        double sum = 0;
        for (const double p : others) {
          const auto cosine = [&](int order) { return std::cos(kTwoPi * period / p * (order + phase / 8.0)); };
          sum += std::pow(cosine(k) - cosine(m), 2);
        }
        least = std::min(least, std::sqrt(sum));
      }
    }
  }
  EXPECT_NEAR(found.distance, least, 0.02 * least);
  for (const int count : {3, 4, 6})
    EXPECT_GT(micro_code_distance(period, micro_periods(period, count, 1024), 1024).distance, 0.03 * count);
  EXPECT_THROW(micro_periods(2, 4, 2000), Error);  // a thousand orders
}

TEST(MicroCode, ErrorsNameTheRemedy) {
  SequenceDesign similar = design_of({16.5});
  similar.extra_periods_px = {16.51, 16.52};
  EXPECT_THAT(error_of([&] { resolve_unwrapping(design_sequence(similar), plain_rig(), by(Unwrapping::micro)); }),
              testing::AllOf(HasSubstr("do not distinguish projector coordinates"), HasSubstr("patterns --micro")));
  EXPECT_THAT(
      error_of([&] { resolve_unwrapping(design_sequence(design_of({16.5})), plain_rig(), by(Unwrapping::micro)); }),
      HasSubstr("needs two or more `extra` images"));
  EXPECT_THAT(error_of([&] { design_sequence(micro_design(16.5, 4)); }), HasSubstr("needs at least 5 images"));
  EXPECT_THAT(error_of([&] { design_sequence(micro_design(3, 5)); }), HasSubstr("use more images or a longer period"));
}

TEST(Errors, SayWhatTheSequenceLacks) {
  const RigModel rig = plain_rig();
  const auto error = [&](Unwrapping method, const SequenceDesign& design) {
    return error_of([&] { resolve_unwrapping(design_sequence(design), rig, by(method)); });
  };
  EXPECT_THAT(error(Unwrapping::multifrequency, design_of({131, 16})),
              HasSubstr("no fringe period covers the projector's 1024 px"));
  EXPECT_THAT(error(Unwrapping::heterodyne, design_of({1040})), HasSubstr("a beat needs two fringe periods"));
  EXPECT_THAT(error(Unwrapping::gray, design_of({1040})), HasSubstr("the sequence has no Gray code"));
  EXPECT_THAT(error(Unwrapping::automatic, design_of({16})), HasSubstr("no fringe period covers"));
  PatternSequence gap = design_sequence(design_of({32}, GrayCode::plain));
  gap.patterns.erase(gap.patterns.begin() + 5);
  EXPECT_THAT(error_of([&] { resolve_unwrapping(gap, rig, by(Unwrapping::gray)); }),
              HasSubstr("no bit between cells of"));
  DecodeOptions options;
  options.steps = 5;
  SequenceDesign twelve = design_of({1040});
  twelve.steps = 12;
  EXPECT_THAT(error_of([&] { resolve_unwrapping(design_sequence(twelve), rig, options); }),
              HasSubstr("do not include 5 equally spaced ones"));
}

TEST(Steps, AFewOfManyGiveTheSamePhase) {
  SequenceDesign design = design_of({1040, 100});
  design.steps = 12;
  design.bits = 0;
  const PatternSequence sequence = design_sequence(design);
  const auto stack = fringe_stack(support::ramp(20, 1000, 300), sequence, {}, CV_32FC1);
  const DecodedStack all = decode(stack, plain_rig(), {});
  for (const int steps : {3, 4, 6}) {
    DecodeOptions options;
    options.steps = steps;
    const DecodedStack few = decode(stack, plain_rig(), options);
    EXPECT_LT(cv::norm(few.coordinate_px, all.coordinate_px, cv::NORM_INF), 1e-3);
    EXPECT_NEAR(cv::norm(few.sigma_px) / cv::norm(all.sigma_px), std::sqrt(12.0 / steps), 0.01);
  }
}

// Phase error (measured minus true) of three centred steps of a sinusoid raised to gamma, from the phase equation.
double gamma_offset(double gamma, double phase) {
  double sine = 0, cosine = 0;
  for (const double shift : {-kTwoPi / 3, 0.0, kTwoPi / 3}) {
    const double grey = std::pow(0.5 + 0.5 * std::cos(phase + shift), gamma);
    sine -= grey * std::sin(shift);
    cosine += grey * std::cos(shift);
  }
  return std::remainder(std::atan2(sine, cosine) - phase, kTwoPi);
}

TEST(PhaseCorrectionTable, UndoesWhatAGammaDoesToThreeSteps) {
  constexpr double kGamma = 2.2;
  RigModel rig = plain_rig();
  rig.phase_correction.steps = 3;
  for (int i = 0; i < 256; ++i) rig.phase_correction.offset_rad.push_back(gamma_offset(kGamma, kTwoPi * i / 256));
  // Shifts with arbitrary start: the phase error depends on the start.
  for (const double first : {-kTwoPi / 3, 0.0, 1.1}) {
    PatternSequence sequence = phase_shift_sequence(1024, 768, {1040}, 3, Axis::columns, 0);
    for (size_t k = 0; k < 3; ++k) sequence.patterns[k].shift_rad = first + kTwoPi * static_cast<double>(k) / 3;
    const cv::Mat1d truth = support::ramp(50, 970, 500);
    std::vector<cv::Mat> images;
    for (const Pattern& pattern : sequence.patterns) {
      cv::Mat1f image(1, 500);
      for (int i = 0; i < 500; ++i)
        image(i) = static_cast<float>(20 + 200 * std::pow(ideal_intensity(pattern, truth(i)), kGamma));
      images.push_back(image);
    }
    const FringeStack stack = stack_of(sequence, images);
    const auto rms = [&](const RigModel& with) {
      cv::Mat1d measured;
      decode(stack, with, {}).coordinate_px.convertTo(measured, CV_64F);
      return cv::norm(measured, truth) / std::sqrt(500.0) * kTwoPi / 1040;
    };
    RigModel bare = rig;
    bare.phase_correction = {};
    // docs/method.md, section 3.3: about 0.29 rad sin 3 phi.
    EXPECT_NEAR(rms(bare), 0.29 / std::sqrt(2.0), 0.02) << first;
    EXPECT_LT(rms(rig), 0.002 * rms(bare)) << first;
  }
}

// --- spatial unwrapping ---

using Unwrap = SpatialOrders (*)(const cv::Mat1f&);
SpatialOrders quality(const cv::Mat1f& phase) { return unwrap_by_quality(phase, cv::Mat1f(phase.size(), 0.1f), 1.6); }
SpatialOrders reliability(const cv::Mat1f& phase) { return unwrap_by_reliability(phase, 1.6); }

class Spatial : public testing::TestWithParam<Unwrap> {
 protected:
  static cv::Mat1f wrapped(const cv::Mat1d& phase) {
    cv::Mat1f result(phase.size());
    for (int i = 0; i < static_cast<int>(phase.total()); ++i)
      result(i / phase.cols, i % phase.cols) =
          static_cast<float>(std::remainder(phase(i / phase.cols, i % phase.cols), kTwoPi));
    return result;
  }
  // Maximum error of the unwrapped phase, up to a common offset per component.
  static double worst(const SpatialOrders& orders, const cv::Mat1f& phase, const cv::Mat1d& truth) {
    std::vector<double> shift(static_cast<size_t>(orders.components), NAN);
    double worst = 0;
    for (int row = 0; row < truth.rows; ++row) {
      for (int col = 0; col < truth.cols; ++col) {
        if (orders.component(row, col) < 0) continue;
        double& own = shift[static_cast<size_t>(orders.component(row, col))];
        const double off = phase(row, col) + kTwoPi * orders.order(row, col) - truth(row, col);
        if (std::isnan(own)) own = std::round(off / (kTwoPi)) * kTwoPi;
        worst = std::max(worst, std::abs(off - own));
      }
    }
    return worst;
  }
};
INSTANTIATE_TEST_SUITE_P(Orders, Spatial, testing::Values(&quality, &reliability));

TEST_P(Spatial, FollowsASmoothSurfaceWithAHole) {
  cv::Mat1d truth(120, 160);
  for (int row = 0; row < truth.rows; ++row) {
    for (int col = 0; col < truth.cols; ++col)
      truth(row, col) = 0.9 * col - 0.4 * row + 6 * std::sin(row * col / 2000.0);
  }
  cv::Mat1f phase = wrapped(truth);
  phase(cv::Rect(40, 30, 50, 40)) = std::numeric_limits<float>::quiet_NaN();
  const SpatialOrders orders = GetParam()(phase);
  EXPECT_EQ(orders.components, 1);
  EXPECT_LT(worst(orders, phase, truth), 1e-4);
  EXPECT_EQ(orders.component(50, 60), -1);
}

TEST_P(Spatial, PartsThatDoNotTouchAreComponents) {
  cv::Mat1d truth(40, 90);
  for (int row = 0; row < 40; ++row) {
    for (int col = 0; col < 90; ++col) truth(row, col) = 0.7 * col + (col > 60 ? 2.4 : 0);  // a step of 2.4 rad at 60
  }
  cv::Mat1f phase = wrapped(truth);
  phase.col(30) = std::numeric_limits<float>::quiet_NaN();
  const SpatialOrders orders = GetParam()(phase);
  EXPECT_EQ(orders.components, 3);
  EXPECT_EQ(orders.component(0, 0), 0);
  EXPECT_EQ(orders.component(39, 31), 1);
  EXPECT_EQ(orders.component(20, 61), 2);
  EXPECT_LT(worst(orders, phase, truth), 1e-4);
}

TEST_P(Spatial, NoiseThatStaysBelowTheLimitDoesNoHarm) {
  Random random(8);
  cv::Mat1d truth(100, 100), noisy(100, 100);
  for (int row = 0; row < 100; ++row) {
    for (int col = 0; col < 100; ++col) {
      truth(row, col) = 0.5 * col + 0.3 * row;
      noisy(row, col) = truth(row, col) + 0.1 * random.normal();
    }
  }
  const cv::Mat1f phase = wrapped(noisy);
  EXPECT_LT(worst(GetParam()(phase), phase, truth), 0.6);
}

TEST(Vote, TakesTheCommonestOrderAndLeavesTheRestRelative) {
  SpatialOrders orders{cv::Mat1i(1, 12), cv::Mat1i(1, 12), 3};
  cv::Mat1i reference(1, 12, -1);
  for (int i = 0; i < 12; ++i) {
    orders.order(i) = i % 4;
    orders.component(i) = i / 4;
  }
  for (int i = 0; i < 4; ++i) reference(i) = i + 5;      // four votes for 5
  reference(4) = 2, reference(5) = 3, reference(6) = 0;  // two for 2, one for -2
  const auto result = vote(orders, reference, 0.9);
  EXPECT_TRUE(result[0].summary.absolute);
  EXPECT_EQ(result[0].shift, 5);
  EXPECT_FALSE(result[1].summary.absolute);
  EXPECT_EQ(result[1].shift, 2);
  EXPECT_NEAR(result[1].summary.agreement, 2.0 / 3, 1e-12);
  EXPECT_EQ(result[2].summary.votes, 0);
  EXPECT_FALSE(result[2].summary.absolute);
}

TEST(SpatialDecoding, ComponentsTakeTheirOrderFromTheReference) {
  // Two plates side by side, separated by 7.4 periods.
  cv::Mat1d truth(60, 80);
  for (int row = 0; row < 60; ++row) {
    for (int col = 0; col < 80; ++col) truth(row, col) = 200 + 2.0 * col + (col >= 40 ? 7.4 * 16 : 0);
  }
  RigModel rig = plain_rig();
  SequenceDesign design = design_of({1040, 130, 16});
  const PatternSequence sequence = design_sequence(design);
  Random random(9);
  const auto stack = fringe_stack(truth, sequence, {}, CV_8UC1, rig.sensor, &random);
  for (const SpatialOrdering order : choice_values<SpatialOrdering>()) {
    DecodeOptions options = by(Unwrapping::spatial);
    options.spatial_order = order;
    const DecodedStack decoded = decode(stack, rig, options);
    ASSERT_EQ(decoded.components.size(), 2U);
    EXPECT_TRUE(decoded.components[0].absolute && decoded.components[1].absolute);
    for (int row = 0; row < 60; ++row) {
      for (int col = 0; col < 80; ++col) EXPECT_NEAR(decoded.coordinate_px(row, col), truth(row, col), 0.5);
    }
    options.spatial_reference = SpatialReference::multifrequency;
    EXPECT_EQ(cv::norm(decode(stack, rig, options).coordinate_px, decoded.coordinate_px, cv::NORM_INF), 0);
    options.spatial_reference = SpatialReference::gray;
    EXPECT_THAT(error_of([&] { decode(stack, rig, options); }), HasSubstr("decode.spatial_reference=gray: "));
    options.spatial_reference = SpatialReference::none;
    const DecodedStack relative = decode(stack, rig, options);
    EXPECT_FALSE(relative.components[0].absolute);
    EXPECT_TRUE(std::isnan(relative.coordinate_px(3, 3)));
    const double step = relative.relative_phase(3, 30) - relative.relative_phase(3, 3);
    EXPECT_NEAR(step, 27 * 2.0 / 16 * kTwoPi, 0.2);
  }
}

// The cells of the Gray code number the coarse period only, but it is the fine one that is unwrapped.
TEST(SpatialDecoding, FollowsTheFinestPeriodBeyondAGrayCode) {
  cv::Mat1d truth(60, 80);
  for (int row = 0; row < 60; ++row) {
    for (int col = 0; col < 80; ++col) truth(row, col) = 200 + 2.0 * col + (col >= 40 ? 7.4 * 16 : 0);
  }
  const RigModel rig = plain_rig();
  SequenceDesign design = design_of({128, 16});
  design.gray_cell_px = 64;
  Random random(10);
  const auto stack = fringe_stack(truth, design_sequence(design), {}, CV_8UC1, rig.sensor, &random);
  const DecodedStack decoded = decode(stack, rig, by(Unwrapping::spatial)),
                     reference = decode(stack, rig, by(Unwrapping::gray));
  EXPECT_EQ(reference.unwrapping, Unwrapping::gray);
  EXPECT_TRUE(reference.components.empty());
  EXPECT_EQ(decoded.unwrapping, Unwrapping::spatial);
  EXPECT_EQ(decoded.finest_period_px, 16);
  ASSERT_EQ(decoded.components.size(), 2U);
  EXPECT_TRUE(decoded.components[0].absolute && decoded.components[1].absolute);
  for (int row = 0; row < 60; ++row) {
    for (int col = 0; col < 80; ++col) {
      EXPECT_NEAR(decoded.coordinate_px(row, col), truth(row, col), 0.5);
      EXPECT_NEAR(decoded.relative_phase(row, col), (truth(row, col) + 0.5) / 16 * kTwoPi, 0.2);
    }
  }
}

}  // namespace
}  // namespace fringeslam
