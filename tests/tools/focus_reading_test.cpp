// SPDX-License-Identifier: Apache-2.0
#include "tools/focus_reading.h"

#include <gmock/gmock.h>

#include <cmath>
#include <numbers>
#include <opencv2/imgproc.hpp>

#include "tests/support/fringes.h"
#include "tests/support/matchers.h"
#include "tests/tools/fake_rig.h"

namespace fringeslam {
namespace {

using support::error_of;
using testing::DoubleNear;
using testing::HasSubstr;
using tools::focus_sequence;
using tools::FocusReading;
using tools::read_focus;

constexpr double kTwoPi = 2 * std::numbers::pi;
constexpr int kWidth = 480, kHeight = 240;
constexpr double kPeriod = 16;

// Renders white, black and fringes with the given contrast per pixel, unrounded; camera and projector pixels coincide.
struct Board {
  std::function<double(int, int)> contrast = [](int, int) { return 1; };
  std::function<double(int, int)> white_dn = [](int, int) { return 200; };
  double black_dn = 20;

  FringeStack seen(const PatternSequence& sequence) const {
    std::vector<cv::Mat> images;
    for (const Pattern& pattern : sequence.patterns) {
      cv::Mat1f image(kHeight, kWidth);
      for (int row = 0; row < kHeight; ++row) {
        for (int col = 0; col < kWidth; ++col) {
          double level = ideal_intensity(pattern, col);
          if (pattern.coding == Coding::fringe) level = 0.5 + contrast(row, col) * (level - 0.5);
          image(row, col) = static_cast<float>(black_dn + (white_dn(row, col) - black_dn) * level);
        }
      }
      images.push_back(image);
    }
    return support::stack_of(sequence, images);
  }
};

FocusReading reading_of(const Board& board) {
  const PatternSequence sequence = focus_sequence(test::thesis_rig(), kPeriod);
  return read_focus(board.seen(sequence), test::thesis_rig());
}

TEST(FocusReading, ContrastIsThatOfTheFringes) {
  for (const double contrast : {1.0, 0.61, 0.05}) {
    Board board;
    board.contrast = [=](int, int) { return contrast; };
    const FocusReading reading = reading_of(board);
    EXPECT_NEAR(reading.fringes, contrast, 1e-5);
    EXPECT_NEAR(reading.centre, contrast, 1e-5);
    EXPECT_NEAR(reading.corners, contrast, 1e-5);
    EXPECT_EQ(reading.measured, 1);
  }
}

TEST(FocusReading, LightThatIsAlwaysThereAndTheScenesOwnTextureDoNotCount) {
  Board board;
  board.contrast = [](int, int) { return 0.5; };
  board.black_dn = 90;
  board.white_dn = [](int row, int col) { return 190 + 30 * std::sin(0.3 * row) * std::cos(0.2 * col); };
  EXPECT_NEAR(reading_of(board).fringes, 0.5, 1e-5);
}

TEST(FocusReading, BlurTakesContrastByTheGaussiansTransferFunction) {
  const PatternSequence sequence = focus_sequence(test::thesis_rig(), kPeriod);
  const FringeStack sharp = Board().seen(sequence);
  double last = 1;
  for (const double sigma_px : {1.0, 2.0, 4.0, 5.0}) {
    FringeStack blurred = sharp;
    for (cv::Mat& image : blurred.images) {
      cv::Mat smooth;
      cv::GaussianBlur(image, smooth, {0, 0}, sigma_px, sigma_px, cv::BORDER_REFLECT);
      image = smooth;
    }
    const double expected = std::exp(-0.5 * std::pow(kTwoPi * sigma_px / kPeriod, 2));
    // The centre is unaffected by the mirrored border.
    EXPECT_THAT(read_focus(blurred, test::thesis_rig()).centre, DoubleNear(expected, 2e-3)) << sigma_px;
    EXPECT_LT(expected, 0.95 * last);
    last = expected;
  }
}

TEST(FocusReading, RegionsAreTheMiddleAndTheCorners) {
  Board board;
  const auto third = [](int at, int length) { return at * 3 / length; };
  board.contrast = [&](int row, int col) {
    const int y = third(row, kHeight), x = third(col, kWidth);
    if (y == 1 && x == 1) return 0.9;
    if (y == 1 || x == 1) return 0.1;
    return 0.2 + 0.1 * y + 0.05 * x;  // 0.2, 0.3, 0.4, 0.5
  };
  const FocusReading reading = reading_of(board);
  EXPECT_NEAR(reading.centre, 0.9, 1e-5);
  EXPECT_NEAR(reading.corners, 0.35, 1e-5);
  EXPECT_NEAR(reading.fringes, (0.9 + 4 * 0.1 + 4 * 0.35) / 9, 1e-5);
}

TEST(FocusReading, PixelsThatCannotTellAreLeftOut) {
  Board board;
  board.contrast = [](int, int col) { return col < kWidth / 3 ? 0 : 0.7; };
  // The left third saturates or, in its lower half, lies in shadow; its corner cells are ignored as well.
  board.white_dn = [](int row, int col) { return col >= kWidth / 3 ? 200 : row < kHeight / 2 ? 255 : 25; };
  const FocusReading reading = reading_of(board);
  EXPECT_NEAR(reading.fringes, 0.7, 1e-5);
  EXPECT_NEAR(reading.corners, 0.7, 1e-5);
  EXPECT_NEAR(reading.measured, 2.0 / 3, 1e-9);
}

TEST(FocusReading, NothingInTheBeamHasNoContrast) {
  Board board;
  board.white_dn = [](int, int) { return 25; };
  const FocusReading reading = reading_of(board);
  EXPECT_TRUE(std::isnan(reading.fringes));
  EXPECT_TRUE(std::isnan(reading.centre));
  EXPECT_TRUE(std::isnan(reading.corners));
  EXPECT_EQ(reading.measured, 0);
}

// Central differences of A + B sin(2 pi y / p) have the amplitude B sin(2 pi / p); the mean of the fringe images is
// A = (white + black) / 2.
TEST(FocusReading, SharpnessIsTheGradientOfTheTexture) {
  for (const double amplitude : {10.0, 20.0}) {
    Board board;
    board.black_dn = 0;
    board.white_dn = [=](int row, int) { return 200 + amplitude * std::sin(kTwoPi * (row + 0.5) / 12); };
    const double expected = amplitude * std::sin(kTwoPi / 12) / std::sqrt(2.0) / 200;
    EXPECT_NEAR(reading_of(board).sharpness, expected, 0.01 * expected);
  }
}

TEST(FocusReading, SequencesThatCannotTellAreRefused) {
  const PatternSequence sequence = focus_sequence(test::thesis_rig(), kPeriod);
  const FringeStack stack = Board().seen(sequence);
  FringeStack part = stack;
  part.images.pop_back();
  EXPECT_THAT(error_of([&] { read_focus(part, test::thesis_rig()); }), HasSubstr("has 5 images"));
  PatternSequence without = sequence;
  without.patterns.pop_back();
  part = support::stack_of(without, part.images);
  EXPECT_THAT(error_of([&] { read_focus(part, test::thesis_rig()); }), HasSubstr("no black"));
}

}  // namespace
}  // namespace fringeslam
