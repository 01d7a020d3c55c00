// SPDX-License-Identifier: Apache-2.0
#include "core/depth/plane_fit.h"

#include <gtest/gtest.h>

#include <Eigen/QR>
#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

#include "core/depth/normal_propagation.h"
#include "tests/support/random.h"

namespace fringeslam {
namespace {

constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();
constexpr int kWidth = 43, kHeight = 31;  // not a multiple of any number of lanes
constexpr double kFocal = 600;

struct Cloud {
  cv::Mat3f points;
  cv::Mat1f sigma;
  PixelRays rays;

  // Plane n.P = d with Gaussian depth noise.
  Cloud(const Eigen::Vector3d& n, double d, double noise, uint64_t seed = 1)
      : points(kHeight, kWidth), sigma(kHeight, kWidth, 1e-4f), rays(kHeight, kWidth) {
    support::Random random(seed);
    for (int row = 0; row < kHeight; ++row) {
      for (int col = 0; col < kWidth; ++col) {
        const double x = (col - 21) / kFocal, y = (row - 15) / kFocal;
        rays(row, col) = {static_cast<float>(x), static_cast<float>(y)};
        const auto z = static_cast<float>(d / n.dot(Eigen::Vector3d(x, y, 1)) + noise * random.normal());
        points(row, col) = {static_cast<float>(x) * z, static_cast<float>(y) * z, z};
      }
    }
  }
};

cv::Mat3f of_row(const NormalImages& normals, int row) {
  cv::Mat3f result(1, kWidth);
  for (int col = 0; col < kWidth; ++col) {
    const cv::Vec3f normal(normals.x[row][col], normals.y[row][col], normals.z[row][col]);
    result(col) = normal == cv::Vec3f() ? cv::Vec3f::all(kNaN) : normal;
  }
  return result;
}

PaddedImage<int32_t> everywhere(const FitImage& image) {
  PaddedImage<int32_t> wanted(image.size, image.margin);
  for (int row = 0; row < kHeight; ++row) std::fill(wanted[row], wanted[row] + kWidth, -1);
  return wanted;
}

cv::Mat3f fitted(const Cloud& cloud, const PlaneFit& fit, InstructionSet set = widest_instruction_set()) {
  const FitImage image(cloud.points, cloud.rays, cloud.sigma, fit.radius);
  const PaddedImage<int32_t> all = everywhere(image);
  NormalImages normals(image);
  cv::Mat3f result(cloud.points.size());
  for (int row = 0; row < kHeight; ++row) {
    fit_planes(image, row, fit, all[row], normals, set);
    of_row(normals, row).copyTo(result.row(row));
  }
  return result;
}

Eigen::Vector3d at(const cv::Mat3f& image, int row, int col) {
  return {image(row, col)[0], image(row, col)[1], image(row, col)[2]};
}

// Reference fit of the same window by a QR decomposition in double precision.
Eigen::Vector3d least_squares(const Cloud& cloud, int row, int col, const PlaneFit& fit) {
  const auto depth = [&](int r, int c) {
    return r < 0 || c < 0 || r >= kHeight || c >= kWidth ? kNaN : cloud.points(r, c)[2];
  };
  const double z0 = depth(row, col), step = static_cast<double>(fit.per_depth) * z0 + 6 * 1e-4;
  Eigen::MatrixX3d design(0, 3);
  Eigen::VectorXd inverse(0);
  for (int dr = -fit.radius; dr <= fit.radius; ++dr) {
    for (int dc = -fit.radius; dc <= fit.radius; ++dc) {
      const double reach = step * std::max(std::abs(dr), std::abs(dc));
      if (!(std::abs(depth(row + dr, col + dc) - z0) <= reach) || !(std::abs(depth(row - dr, col - dc) - z0) <= reach))
        continue;
      design.conservativeResize(design.rows() + 1, 3);
      inverse.conservativeResize(design.rows());
      const cv::Vec2f ray = cloud.rays(row + dr, col + dc);
      design.bottomRows(1) << ray[0], ray[1], 1;
      inverse[design.rows() - 1] = 1.0 / depth(row + dr, col + dc);
    }
  }
  return -design.colPivHouseholderQr().solve(inverse).normalized();
}

TEST(PlaneFit, PlanesAreExactUpToGrazingAngles) {
  for (const double slope_deg : {0.0, 30.0, 60.0, 80.0, 86.0}) {
    for (const double turn_deg : {0.0, 45.0, 90.0, 200.0}) {
      const double slope = slope_deg * std::numbers::pi / 180, turn = turn_deg * std::numbers::pi / 180;
      const Eigen::Vector3d n(std::sin(slope) * std::cos(turn), std::sin(slope) * std::sin(turn), -std::cos(slope));
      const Cloud cloud(n, n.z(), 0);
      const cv::Mat3f normals = fitted(cloud, {5, 0.06f, 2.5f});
      int count = 0;
      for (int row = 5; row < kHeight - 5; ++row) {
        for (int col = 5; col < kWidth - 5; ++col) {
          ASSERT_LT((at(normals, row, col) - n).norm(), 2e-5) << slope_deg << " " << turn_deg;
          ++count;
        }
      }
      EXPECT_EQ(count, (kHeight - 10) * (kWidth - 10));
    }
  }
}

TEST(PlaneFit, EqualsLeastSquaresInDoublePrecision) {
  const PlaneFit fit{5, 0.01f, 100};
  Cloud cloud(Eigen::Vector3d(0.6, -0.3, -0.74).normalized(), -0.9, 1e-4, 7);
  support::Random random(3);
  for (cv::Vec3f& point : cloud.points) {
    if (random.uniform(0, 1) < 0.1) point = cv::Vec3f::all(kNaN);
  }
  const cv::Mat3f normals = fitted(cloud, fit);
  int compared = 0;
  for (int row = 0; row < kHeight; ++row) {
    for (int col = 0; col < kWidth; ++col) {
      if (std::isnan(normals(row, col)[2])) continue;
      ASSERT_LT((at(normals, row, col) - least_squares(cloud, row, col, fit)).norm(), 2e-5) << row << " " << col;
      ++compared;
    }
  }
  EXPECT_GT(compared, kHeight * kWidth / 2);
}

TEST(PlaneFit, GivesTheSameBitsOnEveryInstructionSet) {
  const Cloud cloud(Eigen::Vector3d(0.5, 0.4, -0.8).normalized(), -0.8, 2e-4);
  const cv::Mat3f expected = fitted(cloud, {4, 0.01f, 3}, InstructionSet::portable);
  for (const InstructionSet set : {InstructionSet::avx2, InstructionSet::avx512}) {
    if (static_cast<int>(set) > static_cast<int>(widest_instruction_set())) continue;
    const cv::Mat3f got = fitted(cloud, {4, 0.01f, 3}, set);
    for (int row = 0; row < kHeight; ++row) {
      for (int col = 0; col < kWidth; ++col) {
        if (std::isnan(expected(row, col)[2]))
          EXPECT_TRUE(std::isnan(got(row, col)[2])) << row << " " << col;
        else
          EXPECT_EQ(got(row, col), expected(row, col)) << row << " " << col;
      }
    }
  }
}

TEST(PlaneFit, NoNormalWhereHalfTheWindowIsMissingNorWhereItIsNoPlane) {
  Cloud cloud(Eigen::Vector3d(0, 0, -1), -1, 0);
  for (int row = 0; row < kHeight; ++row) {
    for (int col = 0; col < 21; ++col) cloud.points(row, col) = cv::Vec3f::all(kNaN);
  }
  cv::Mat3f normals = fitted(cloud, {5, 0.01f, 2.5f});
  EXPECT_TRUE(std::isnan(normals(15, 20)[2])) << "no measurement";
  EXPECT_TRUE(std::isnan(normals(15, 23)[2])) << "5 of 11 columns have a symmetric counterpart";
  EXPECT_FALSE(std::isnan(normals(15, 24)[2])) << "7 of 11 columns have a symmetric counterpart";

  // A roof with 30 degree slopes: each side is a plane, the ridge is not.
  Cloud roof(Eigen::Vector3d(0, 0, -1), -1, 0);
  for (int row = 0; row < kHeight; ++row) {
    for (int col = 0; col < kWidth; ++col) {
      const auto z = static_cast<float>(1 + 0.577 * std::abs(col - 21) / kFocal);
      roof.points(row, col) = {roof.rays(row, col)[0] * z, roof.rays(row, col)[1] * z, z};
    }
  }
  normals = fitted(roof, {5, 0.01f, 2.5f});
  EXPECT_TRUE(std::isnan(normals(15, 21)[2]));
  EXPECT_FALSE(std::isnan(normals(15, 10)[2]));
}

TEST(PlaneFit, FitsOnlyWhatIsWanted) {
  const Cloud cloud(Eigen::Vector3d(0, 0, -1), -1, 0);
  const FitImage image(cloud.points, cloud.rays, cloud.sigma, 5);
  PaddedImage<int32_t> wanted(image.size, image.margin);
  wanted[15][17] = -1;
  NormalImages normals(image);
  fit_planes(image, 15, {}, wanted[15], normals);
  const cv::Mat3f row = of_row(normals, 15);
  for (int col = 0; col < kWidth; ++col) EXPECT_EQ(std::isnan(row(col)[2]), col != 17) << col;
}

// Two planes separated by a step of 1 cm at column 21; windows of the left plane were fitted up to column 15.
struct Step {
  Step() : cloud(Eigen::Vector3d(0.3, 0, -1).normalized(), -0.95, 1e-4) {
    for (int row = 0; row < kHeight; ++row) {
      for (int col = 21; col < kWidth; ++col) cloud.points(row, col) *= 1 + 0.01f / cloud.points(row, col)[2];
    }
  }
  cv::Mat3f adopted(InstructionSet set) const {
    const FitImage image(cloud.points, cloud.rays, cloud.sigma, 5);
    PaddedImage<int32_t> left(image.size, 5), right(image.size, 5);
    for (int row = 0; row < kHeight; ++row) {
      for (int col = 0; col < kWidth; ++col) (col <= 15 ? left : right)[row][col] = -1;
    }
    NormalImages normals(image), beside(image);
    cv::Mat3f result(cloud.points.size());
    for (int row = 0; row < kHeight; ++row) fit_planes(image, row, {5, 0.01f, 2.5f}, left[row], normals, set);
    for (int row = 0; row < kHeight; ++row) {
      propagate_normals(image, normals, row, 5, right[row], beside, set);
      of_row(beside, row).copyTo(result.row(row));
      for (int col = 16; col < kWidth; ++col) EXPECT_EQ(right[row][col] == 0, !std::isnan(result(row, col)[2]));
    }
    return result;
  }
  Cloud cloud;
};

TEST(PlaneAdoption, TakesTheNormalOfThePlaneThatHoldsThePixelAndItsNeighboursAndNoOther) {
  const cv::Mat3f adopted = Step().adopted(widest_instruction_set());
  const Eigen::Vector3d n = Eigen::Vector3d(0.3, 0, -1).normalized();
  int on_plane = 0;
  for (int row = 5; row < kHeight - 5; ++row) {
    for (int col = 0; col < kWidth; ++col) {
      const bool has = !std::isnan(adopted(row, col)[2]);
      if (col <= 15) {
        EXPECT_FALSE(has) << "not wanted: " << row << " " << col;
      }
      if (col >= 20) {
        EXPECT_FALSE(has) << "at or behind the step, or no neighbouring window: " << col;
      }
      if (has) {
        EXPECT_LT((at(adopted, row, col) - n).norm(), 0.03) << row << " " << col;
      }
      on_plane += col > 15 && col < 20 && has;
    }
  }
  EXPECT_GT(on_plane, 4 * (kHeight - 10) * 9 / 10);
}

TEST(PlaneAdoption, GivesTheSameBitsOnEveryInstructionSet) {
  const Step step;
  const cv::Mat3f expected = step.adopted(InstructionSet::portable);
  for (const InstructionSet set : {InstructionSet::avx2, InstructionSet::avx512}) {
    if (static_cast<int>(set) > static_cast<int>(widest_instruction_set())) continue;
    const cv::Mat3f got = step.adopted(set);
    EXPECT_EQ(cv::countNonZero(cv::Mat(got.reshape(1) != expected.reshape(1)) &
                               cv::Mat(expected.reshape(1) == expected.reshape(1))),
              0);
    EXPECT_EQ(cv::countNonZero(got.reshape(1) == got.reshape(1)),
              cv::countNonZero(expected.reshape(1) == expected.reshape(1)));
  }
}

}  // namespace
}  // namespace fringeslam
