// SPDX-License-Identifier: Apache-2.0
// Covariances of registrations whose cameras are apart.
#include <gtest/gtest.h>

#include "core/mapper/view_registration.h"

namespace fringeslam {
namespace {

double factor(double baseline_m, double distance_m) {
  const Matrix6d covariance = 1e-10 * Matrix6d::Identity();
  const Pose a_from_b{Eigen::Matrix3d::Identity(), {0, baseline_m, 0}};
  return with_parallax(covariance, a_from_b, distance_m)(3, 3) / 1e-10;
}

TEST(Parallax, DoesNotConcernViewsFromNearlyTheSamePlace) {
  EXPECT_EQ(factor(0, 1), 1);
  EXPECT_EQ(factor(0.06, 1), 1);
}

TEST(Parallax, GrowsWithTheDistanceOfTheCamerasRelativeToThatOfTheSurfaces) {
  EXPECT_NEAR(factor(0.5, 1), 2.4, 1e-9);
  EXPECT_NEAR(factor(0.25, 0.5), 2.4, 1e-9);
  for (double baseline_m = 0; baseline_m < 1; baseline_m += 0.01)
    EXPECT_LE(factor(baseline_m, 1), factor(baseline_m + 0.01, 1));
}

}  // namespace
}  // namespace fringeslam
