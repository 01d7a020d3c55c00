// SPDX-License-Identifier: Apache-2.0
#include "core/depth/triangulation.h"

#include <gmock/gmock.h>

#include <cmath>
#include <cstring>

#include "tests/support/random.h"
#include "tests/support/scene.h"

namespace fringeslam {
namespace {

using support::Random;
using support::small_rig;

// Exact solution: projector coordinate of a point at a known depth; NaN where the projector does not light it.
double coordinate_of(const RigModel& rig, double largest_r2, const cv::Vec2f& ray, double depth, Axis axis) {
  const Eigen::Vector3d point = rig.projector_from_camera * (depth * Eigen::Vector3d(ray[0], ray[1], 1));
  Eigen::Vector2d pixel;
  if (!rig.projector.shows(point, largest_r2, pixel)) return std::nan("");
  return axis == Axis::columns ? pixel.x() : pixel.y();
}

struct Deviation {
  double relative = 0, sigmas = 0;  // greatest
  int checked = 0, missing = 0;
};

Deviation greatest_deviation(const RigModel& rig, Axis axis, double near_m, double far_m) {
  const PixelRays rays = pixel_rays(rig.camera);
  const Triangulation triangulation(rig, rays, near_m, far_m, axis);
  const int width = rays.cols;
  const double largest_r2 = rig.projector.largest_r2();
  std::vector<float> coordinate(width), sigma_px(width, 1e-3f), depth(width), sigma(width);
  Deviation result;
  for (int step = 0; step <= 20; ++step) {
    const double truth = near_m + (far_m - near_m) * (step + 0.5) / 21;
    for (int row = 0; row < rays.rows; row += 7) {
      for (int col = 0; col < width; ++col)
        coordinate[col] = static_cast<float>(coordinate_of(rig, largest_r2, rays(row, col), truth, axis));
      triangulation.row(row, coordinate.data(), sigma_px.data(), 1, depth.data(), sigma.data(),
                        widest_instruction_set());
      for (int col = 0; col < width; ++col) {
        if (std::isnan(coordinate[col])) continue;
        ++result.checked;
        if (std::isnan(depth[col])) {
          ++result.missing;
          continue;
        }
        const double error = std::abs(depth[col] - truth);
        result.relative = std::max(result.relative, error / truth);
        result.sigmas = std::max(result.sigmas, error / static_cast<double>(sigma[col]));
      }
    }
  }
  EXPECT_GT(result.checked, 5000);
  return result;
}

double worst_relative_error(const RigModel& rig, Axis axis, double near_m, double far_m) {
  const Deviation deviation = greatest_deviation(rig, axis, near_m, far_m);
  EXPECT_EQ(deviation.missing, 0) << "of " << deviation.checked;
  return deviation.relative;
}

TEST(Triangulation, PolynomialIsTheExactSolution) {
  for (const bool distorted : {false, true})
    EXPECT_LT(worst_relative_error(small_rig(distorted), Axis::columns, 0.4, 2.5), 1e-6);
}

TEST(Triangulation, StrongLensesAndTurnedProjectors) {
  RigModel rig = small_rig(true);
  rig.projector.distortion = {-0.2, 0.1, 0.004, -0.003, 0.05};
  EXPECT_LT(worst_relative_error(rig, Axis::columns, 0.5, 2), 1e-6);
  SixDof turned;
  turned.angles_deg = {8, -12, 25};
  rig.projector_from_camera.rotation = pose_from(turned).rotation * rig.projector_from_camera.rotation;
  rig.projector_from_camera.translation = {-0.2, 0.09, 0.1};
  EXPECT_LT(worst_relative_error(rig, Axis::columns, 0.5, 2), 1e-6);
}

// Outside their image, these polynomials fold: points far off the axis would appear in it again.
TEST(Triangulation, LensesThatFoldOutsideTheirImage) {
  for (const Distortion& folding :
       {Distortion{-0.1, 1, 0, 0, -8}, Distortion{0, 0, 0, 0, -8}, Distortion{-0.2, 1.5, 0, 0, -10}}) {
    RigModel rig = small_rig(false);
    rig.camera.fx = rig.camera.fy = 200;
    rig.projector = {1024, 768, 1500, 1500, 511.5, 383.5, folding};
    const Deviation deviation = greatest_deviation(rig, Axis::columns, 0.4, 2.5);
    EXPECT_LT(deviation.sigmas, 1.2) << folding.k3;
    EXPECT_LT(deviation.missing, 0.1 * deviation.checked) << folding.k3;
  }
}

TEST(Triangulation, RowsOfAProjectorAboveTheCamera) {
  RigModel rig = small_rig(false);
  SixDof tilted;
  tilted.angles_deg = {14, 0, 0};
  rig.projector_from_camera = pose_from(tilted);
  rig.projector_from_camera.translation = {0, 0.25, 0.06};
  EXPECT_LT(worst_relative_error(rig, Axis::rows, 0.6, 1.6), 1e-6);
}

// The near end of the rays lies behind the projector, which stands 0.6 m in front of the camera.
TEST(Triangulation, CamerasBehindTheProjector) {
  for (const double aside_m : {0.15, 0.25}) {
    for (const double far_m : {1.4, 2.5}) {
      RigModel rig = small_rig(false);
      rig.projector.fx = rig.projector.fy = aside_m < 0.2 ? 2600 : 1500;
      const Eigen::Matrix3d turned = rotation_exp({0, std::atan(aside_m / 0.4), 0});  // the axes meet at 1 m
      rig.projector_from_camera = {turned, turned * Eigen::Vector3d(-aside_m, 0, -0.6)};
      const Deviation deviation = greatest_deviation(rig, Axis::columns, 0.4, far_m);
      EXPECT_EQ(deviation.missing, 0) << aside_m << ' ' << far_m << " of " << deviation.checked;
      EXPECT_LT(deviation.relative, 1e-4) << aside_m << ' ' << far_m;
      EXPECT_LT(deviation.sigmas, 1.5) << aside_m << ' ' << far_m;
    }
  }
}

TEST(Triangulation, DepthsOutsideTheRangeAndNaNAreNone) {
  const RigModel rig = small_rig(false);
  const PixelRays rays = pixel_rays(rig.camera);
  const Triangulation triangulation(rig, rays, 0.7, 1.4);
  const int width = rays.cols, row = rays.rows / 2, middle = width / 2;
  std::vector<float> coordinate(width, std::nanf("")), sigma_px(width, 0.02f), depth(width), sigma(width);
  const auto depth_at = [&](double truth) {
    coordinate[middle] =
        static_cast<float>(coordinate_of(rig, rig.projector.largest_r2(), rays(row, middle), truth, Axis::columns));
    triangulation.row(row, coordinate.data(), sigma_px.data(), 0.01f, depth.data(), sigma.data(),
                      InstructionSet::portable);
    return depth[middle];
  };
  EXPECT_NEAR(depth_at(0.71), 0.71, 1e-6);
  EXPECT_NEAR(depth_at(1.39), 1.39, 1e-6);
  for (const double outside : {0.3, 0.6999, 1.401, 3.0}) EXPECT_TRUE(std::isnan(depth_at(outside))) << outside;
  EXPECT_TRUE(std::isnan(depth[middle - 1]) && std::isnan(sigma[middle - 1]));
}

TEST(Triangulation, EveryInstructionSetGivesTheSameBits) {
  const RigModel rig = small_rig(true);
  const PixelRays rays = pixel_rays(rig.camera);
  const Triangulation triangulation(rig, rays, 0.4, 2.5);
  Random random(2);
  const int width = rays.cols;
  std::vector<float> coordinate(width), sigma_px(width, 0.02f);
  for (float& u : coordinate) u = static_cast<float>(random.uniform(-20, 1040));
  const auto with = [&](InstructionSet set) {
    std::vector<float> depth(width), sigma(width);
    triangulation.row(60, coordinate.data(), sigma_px.data(), 0.01f, depth.data(), sigma.data(), set);
    depth.insert(depth.end(), sigma.begin(), sigma.end());
    return depth;
  };
  const auto portable = with(InstructionSet::portable), widest = with(widest_instruction_set());
  EXPECT_EQ(std::memcmp(portable.data(), widest.data(), portable.size() * sizeof(float)), 0);
}

}  // namespace
}  // namespace fringeslam
