// SPDX-License-Identifier: Apache-2.0
#include "core/depth/texture_bias.h"

#include <gmock/gmock.h>

#include <cmath>
#include <limits>
#include <opencv2/core.hpp>
#include <vector>

#include "core/depth/depth.h"
#include "tests/support/scene.h"

namespace fringeslam {
namespace {

using support::plane;
using support::seen_columns;
using support::small_rig;

constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();
constexpr InstructionSet kSets[] = {InstructionSet::portable, InstructionSet::avx2, InstructionSet::avx512};

constexpr float kPhasePerPx = 0.4f;

struct Images {
  cv::Mat1f coordinate_px, modulation_dn;
  float sigma_px = 0.01f;

  // Coordinate 1.5 col - 0.3 row and modulation exp(0.04 col + 0.02 row).
  explicit Images(int rows = 9, int cols = 37) : coordinate_px(rows, cols), modulation_dn(rows, cols) {
    for (int row = 0; row < rows; ++row) {
      for (int col = 0; col < cols; ++col) {
        coordinate_px(row, col) = static_cast<float>(1.5 * col - 0.3 * row);
        modulation_dn(row, col) = static_cast<float>(50 * std::exp(0.04 * col + 0.02 * row));
      }
    }
  }

  struct Result {
    cv::Mat1f gradient, noise;
  };
  Result result(InstructionSet set = InstructionSet::portable) const {
    Result result{cv::Mat1f(coordinate_px.size(), kNaN), cv::Mat1f(coordinate_px.size(), kNaN)};
    const std::vector<float> sigmas(static_cast<size_t>(coordinate_px.cols), sigma_px);
    for (int row = kTextureBorder; row + kTextureBorder < coordinate_px.rows; ++row) {
      const auto rows = [&](const cv::Mat1f& image) {
        return FiveRows{image[row - 2], image[row - 1], image[row], image[row + 1], image[row + 2]};
      };
      texture_gradient_row({rows(coordinate_px), rows(modulation_dn), sigmas.data(), kPhasePerPx}, coordinate_px.cols,
                           result.gradient[row], result.noise[row], set);
    }
    return result;
  }
  cv::Mat1f gradient() const { return result().gradient; }
};

TEST(TextureGradient, IsTheProductOfTheGradients) {
  const cv::Mat1f gradient = Images().gradient();
  for (int col = 2; col + 2 < gradient.cols; ++col) EXPECT_NEAR(gradient(4, col), 1.5 * 0.04 - 0.3 * 0.02, 1e-4) << col;
  for (const int col : {0, 1, gradient.cols - 2, gradient.cols - 1}) EXPECT_EQ(gradient(4, col), 0);
}

TEST(TextureGradient, HasTheSameBitsOnAllInstructionSets) {
  Images images;
  images.coordinate_px(3, 9) = kNaN;
  images.modulation_dn(4, 20) = 5;
  const Images::Result expected = images.result();
  for (const InstructionSet set : kSets) {
    if (set > widest_instruction_set()) continue;
    const Images::Result result = images.result(set);
    for (int row = kTextureBorder; row + kTextureBorder < result.gradient.rows; ++row) {
      for (int col = 0; col < result.gradient.cols; ++col) {
        EXPECT_EQ(result.gradient(row, col), expected.gradient(row, col));
        EXPECT_EQ(result.noise(row, col), expected.noise(row, col));
      }
    }
  }
}

// The differences of u have half of its variance, and those of ln B half of that of the phase.
TEST(TextureGradient, NoiseIsThatOfBothDifferences) {
  const double slopes = 1.5 * 1.5 + 0.3 * 0.3, growths = 0.04 * 0.04 + 0.02 * 0.02;
  const double phase_per_px = kPhasePerPx;
  EXPECT_NEAR(Images().result().noise(4, 10), 0.5 * (phase_per_px * phase_per_px * slopes + growths), 1e-4);
}

// A sawtooth rises slowly and falls steeply; the mean of its differences is 0 nevertheless.
TEST(TextureGradient, HasNoMeanOverATexture) {
  Images images;
  for (int row = 0; row < images.coordinate_px.rows; ++row) {
    for (int col = 0; col < images.coordinate_px.cols; ++col) {
      images.coordinate_px(row, col) = 1.5f * static_cast<float>(col);
      images.modulation_dn(row, col) = 50 + 10 * static_cast<float>(col % 5);
    }
  }
  const cv::Mat1f gradient = images.gradient();
  EXPECT_NEAR(cv::mean(gradient(cv::Rect(10, 4, 20, 1)))[0], 0, 0.01 * std::abs(gradient(4, 12)));
}

// Beside a missing neighbor or a step of the surface, and one pixel farther, only the other axis counts.
TEST(TextureGradient, StopsAtEdgesOfTheSurface) {
  for (const float step_px : {kNaN, 1.0f, -1.0f}) {
    Images images;
    images.coordinate_px(4, 11) += step_px;
    for (const int col : {9, 10}) EXPECT_NEAR(images.gradient()(4, col), -0.3 * 0.02, 1e-4) << step_px << ' ' << col;
    EXPECT_NEAR(images.gradient()(4, 8), 1.5 * 0.04 - 0.3 * 0.02, 1e-4);
  }
}

TEST(TextureGradient, NoiseOfTheCoordinateIsNoEdge) {
  Images images;
  images.coordinate_px(4, 11) += 1;
  images.sigma_px = 0.4f;
  EXPECT_NEAR(images.gradient()(4, 10), 2 * 0.04 - 0.3 * 0.02, 1e-3);
}

TEST(TextureGradient, IsZeroWithoutModulation) {
  Images images;
  images.modulation_dn.setTo(0);
  EXPECT_EQ(cv::countNonZero(images.gradient().rowRange(2, 7)), 0);
}

// A plane whose modulation grows exponentially, decoded at the centroid of a pixel's light, is in its place.
TEST(TextureCorrection, ReturnsAPlaneBesideTexture) {
  RigModel rig = small_rig(false);
  rig.camera_lens = {10e-6, 4, 0.9, 0.9, 0.3, 4};
  const Eigen::Vector3d normal = Eigen::Vector3d(0.4, -0.2, -1).normalized();
  constexpr double kGrowth = 0.15;  // per px
  DecodedStack exact = seen_columns(plane(normal, normal.z()), rig, {}, 0.01);
  exact.finest_period_px = 16;
  exact.modulation.create(exact.coordinate_px.size());
  for (int row = 0; row < exact.modulation.rows; ++row) {
    for (int col = 0; col < exact.modulation.cols; ++col)
      exact.modulation(row, col) = static_cast<float>(0.01 * std::exp(kGrowth * col));
  }
  DepthOptions on, off;
  on.texture_correction = true, off.texture_correction = false;
  const Frame truth = reconstruct(exact, rig, pixel_rays(rig.camera), off);
  // Pupil 1 / (1 / image distance + 1 / focus) / f-number; the variance of a disc is a sixteenth of its squared diameter.
  const double image_m = rig.camera_lens.pixel_m * rig.camera.fx, pupil_m = 1 / (1 / image_m + 1 / 0.9) / 4;
  DecodedStack biased = exact;
  biased.coordinate_px = exact.coordinate_px.clone();
  for (int row = 0; row < exact.modulation.rows; ++row) {
    for (int col = 1; col + 1 < exact.modulation.cols; ++col) {
      const double circle_px =
          pupil_m * rig.camera.fx * (1 / static_cast<double>(truth.points_m(row, col)[2]) - 1 / 0.9);
      const double variance_px2 = 1.0 / 12 + 0.09 + circle_px * circle_px / 16;
      const double slope =
          static_cast<double>(exact.coordinate_px(row, col + 1) - exact.coordinate_px(row, col - 1)) / 2;
      biased.coordinate_px(row, col) += static_cast<float>(variance_px2 * kGrowth * slope);
    }
  }
  const Frame uncorrected = reconstruct(biased, rig, pixel_rays(rig.camera), off),
              corrected = reconstruct(biased, rig, pixel_rays(rig.camera), on);
  int compared = 0;
  for (int row = 2; row + 2 < truth.height(); ++row) {
    for (int col = 2; col + 2 < truth.width(); ++col) {
      const auto error = [&](const Frame& frame) {
        return std::abs(static_cast<double>(frame.points_m(row, col)[2] - truth.points_m(row, col)[2]));
      };
      if (std::isnan(error(uncorrected))) continue;
      ASSERT_LT(error(corrected), 0.05 * error(uncorrected)) << row << ' ' << col;
      ++compared;
    }
  }
  EXPECT_GT(compared, 100);
  // No correction where the modulation does not show texture, and that of the pixel alone without a stated lens.
  const auto depth = [&](const RigModel& of, const DecodedStack& decoded) {
    return reconstruct(decoded, of, pixel_rays(of.camera), on).points_m(60, 60)[2];
  };
  RigModel nonlinear = rig, nominal = rig;
  nonlinear.phase_correction = {3, {0, 0.05, 0, -0.05}};
  EXPECT_EQ(depth(nonlinear, biased), uncorrected.points_m(60, 60)[2]);
  DecodedStack ensemble = biased;
  ensemble.unwrapping = Unwrapping::ensemble;
  EXPECT_EQ(depth(rig, ensemble), uncorrected.points_m(60, 60)[2]);
  nominal.camera_lens = {};
  const float nominal_shift_m = depth(nominal, biased) - uncorrected.points_m(60, 60)[2];
  nominal.camera_lens.blur_px = 0.5;
  EXPECT_NEAR((depth(nominal, biased) - uncorrected.points_m(60, 60)[2]) / nominal_shift_m, 4, 0.02);  // 1/12 + 1/4
}

}  // namespace
}  // namespace fringeslam
