// SPDX-License-Identifier: Apache-2.0
#include "core/depth/indirect_light.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "core/depth/depth.h"
#include "core/types/error.h"

namespace fringeslam {
namespace {

constexpr int kSize = 81;
constexpr double kFocal_px = 500, kPeriod_px = 16.5, kAlbedo = 0.6;

RigModel rig_of(double focal_px) {
  RigModel rig;
  rig.camera.width = rig.camera.height = kSize;
  rig.camera.fx = rig.camera.fy = focal_px;
  rig.camera.cx = rig.camera.cy = 0.5 * (kSize - 1);
  rig.projector = rig.camera;
  return rig;
}

// Two walls that meet in a crease along the columns, 1 m away, each at 45 degrees to the view and `half_width_m` wide.
// `sign` 1: a groove, -1: a ridge. All pixels have the same coordinate, so that no light averages out.
struct Walls {
  RigModel rig = rig_of(kFocal_px);
  Frame frame;
  DecodedStack decoded;

  explicit Walls(double half_width_m, float sign) {
    frame.points_m = cv::Mat3f(kSize, kSize, cv::Vec3f::all(std::nanf("")));
    frame.normals = frame.points_m.clone();
    decoded.coordinate_px = cv::Mat1f(kSize, kSize, 100.f);
    decoded.modulation = cv::Mat1f(kSize, kSize, 50.f);
    decoded.finest_period_px = kPeriod_px;
    const auto leaning = static_cast<float>(std::numbers::sqrt2 / 2);
    for (int row = 0; row < kSize; ++row) {
      for (int col = 0; col < kSize; ++col) {
        const double x = (col - rig.camera.cx) / kFocal_px, y = (row - rig.camera.cy) / kFocal_px;
        const double z = 1 / (1 + static_cast<double>(sign) * std::abs(x));  // z = 1 - sign |x z|
        if (std::abs(x * z) > half_width_m) continue;
        frame.points_m(row, col) = cv::Vec3f(x * z, y * z, z);
        const float side = x < 0 ? 1.f : -1.f;
        if (x != 0) frame.normals(row, col) = cv::Vec3f(side * sign * leaning, 0, -leaning);
      }
    }
  }
};

// A point of one wall at the distance d from the crease sees the other wall, of height h, under the form factor
// (1 - d / sqrt(d^2 + h^2)) / 2.
TEST(IndirectLight, OfAGrooveHasTheFormFactorOfItsWalls) {
  constexpr double kHalfWidth_m = 0.04;
  constexpr double kSampled = 0.12;  // samples of the surroundings cover 80 to 100 % of the walls
  const Walls walls(kHalfWidth_m, 1);
  const cv::Mat1f sigma_px = indirect_sigma_px(walls.frame, walls.decoded, walls.rig, kAlbedo);
  constexpr int kMiddle = kSize / 2;
  for (const int distance_px : {5, 6, 8}) {
    // The estimate spreads by two pixels.
    const cv::Vec3f& there = walls.frame.points_m(kMiddle, kMiddle + distance_px - 2);
    const double d = std::numbers::sqrt2 * static_cast<double>(there[0]), h = std::numbers::sqrt2 * kHalfWidth_m;
    const double seen = (1 - d / std::hypot(d, h)) / 2;
    const double expected = kPeriod_px / (2 * std::numbers::pi) / 4 * kAlbedo * seen / (1 - kAlbedo * seen);
    EXPECT_NEAR(static_cast<double>(sigma_px(kMiddle, kMiddle + distance_px)) / expected, 0.88, kSampled)
        << distance_px;
    EXPECT_NEAR(static_cast<double>(sigma_px(kMiddle, kMiddle - distance_px)) / expected, 0.88, kSampled)
        << distance_px;
  }
}

TEST(IndirectLight, SurfacesThatDoNotSeeEachOtherReflectNone) {
  const Walls ridge(0.024, -1);
  EXPECT_EQ(cv::countNonZero(indirect_sigma_px(ridge.frame, ridge.decoded, ridge.rig, kAlbedo)), 0);
}

// Light that comes from all phases of the fringes cancels.
TEST(IndirectLight, AveragesOutOverTheFringes) {
  Walls walls(0.06, 1);
  const cv::Mat1f in_phase = indirect_sigma_px(walls.frame, walls.decoded, walls.rig, kAlbedo);
  for (int row = 0; row < kSize; ++row) {
    for (int col = 0; col < kSize; ++col) walls.decoded.coordinate_px(row, col) = 100 + 1.5f * static_cast<float>(col);
  }
  const cv::Mat1f fringes = indirect_sigma_px(walls.frame, walls.decoded, walls.rig, kAlbedo);
  constexpr int kMiddle = kSize / 2;
  EXPECT_LT(fringes(kMiddle, kMiddle + 22), 0.3f * in_phase(kMiddle, kMiddle + 22));
}

TEST(IndirectLight, BlackSurfacesReflectNone) {
  const Walls walls(0.024, 1);
  EXPECT_EQ(cv::countNonZero(indirect_sigma_px(walls.frame, walls.decoded, walls.rig, 0)), 0);
}

TEST(IndirectLight, NeedsTheModulationOfAllPixels) {
  Walls walls(0.024, 1);
  walls.decoded.modulation = walls.decoded.modulation.rowRange(0, 10).clone();
  EXPECT_THROW(indirect_sigma_px(walls.frame, walls.decoded, walls.rig, kAlbedo), Error);
}

}  // namespace
}  // namespace fringeslam
