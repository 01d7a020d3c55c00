// SPDX-License-Identifier: Apache-2.0
// Covariances of registrations whose cameras are apart.
#include <gtest/gtest.h>

#include <optional>

#include "core/mapper/view_registration.h"

namespace fringeslam {
namespace {

double factor(double baseline_m, double distance_m, std::optional<double> corrected_spread_px2 = {}) {
  const Matrix6d covariance = 1e-10 * Matrix6d::Identity();
  const Pose a_from_b{Eigen::Matrix3d::Identity(), {0, baseline_m, 0}};
  return with_parallax(covariance, a_from_b, distance_m, corrected_spread_px2)(3, 3) / 1e-10;
}

constexpr double kSharp_px2 = 1.0 / 12 + 0.09 * 0.09, kBlurred_px2 = 1.0 / 12 + 0.3 * 0.3;

TEST(Parallax, DoesNotConcernViewsFromNearlyTheSamePlace) {
  EXPECT_EQ(factor(0, 1), 1);
  EXPECT_EQ(factor(0.06, 1), 1);
  EXPECT_EQ(factor(0, 1, kSharp_px2), 1);
  EXPECT_EQ(factor(0, 1, kBlurred_px2), 1);
}

TEST(Parallax, GrowsWithTheDistanceOfTheCamerasRelativeToThatOfTheSurfaces) {
  EXPECT_NEAR(factor(0.5, 1), 2.4, 1e-9);
  EXPECT_NEAR(factor(0.25, 0.5), 2.4, 1e-9);
  for (double baseline_m = 0; baseline_m < 1; baseline_m += 0.01) {
    EXPECT_LE(factor(baseline_m, 1), factor(baseline_m + 0.01, 1));
    EXPECT_LE(factor(baseline_m, 1, kBlurred_px2), factor(baseline_m + 0.01, 1, kBlurred_px2));
  }
}

TEST(Parallax, CountsLessForCorrectedPoints) {
  EXPECT_LT(factor(0.5, 1, kSharp_px2), factor(0.5, 1));
  EXPECT_LT(factor(0.5, 1, kSharp_px2), factor(0.5, 1, kBlurred_px2));
}

}  // namespace
}  // namespace fringeslam
