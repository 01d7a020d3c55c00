// SPDX-License-Identifier: Apache-2.0
// Predicted depth and sigma against closed forms: planes, spheres, occlusion, unseen regions.
#include "core/map/expected_view.h"

#include <gmock/gmock.h>

#include <Eigen/LU>
#include <cmath>
#include <cstring>

#include "core/decode/decode.h"
#include "tests/support/matchers.h"
#include "tests/support/scene.h"

namespace fringeslam {
namespace {

using support::error_of;
using support::nearest_of;
using support::observe;
using support::plane;
using support::Random;
using support::small_rig;
using support::Surface;
using support::truth_of;
using testing::HasSubstr;

Surface sphere(const Eigen::Vector3d& centre, double radius) {
  return [=](const Eigen::Vector3d& origin, const Eigen::Vector3d& direction) -> std::optional<support::Hit> {
    const Eigen::Vector3d from = origin - centre;
    const double a = direction.squaredNorm(), b = from.dot(direction), c = from.squaredNorm() - radius * radius;
    if (b * b < a * c) return std::nullopt;
    const double distance = (-b - std::sqrt(b * b - a * c)) / a;
    const Eigen::Vector3d point = origin + distance * direction;
    return support::Hit{distance, point, (point - centre) / radius};
  };
}

// The part of a plane z = depth with low <= x <= high.
Surface strip(double depth, double low, double high) {
  return [=](const Eigen::Vector3d& origin, const Eigen::Vector3d& direction) -> std::optional<support::Hit> {
    const double distance = (depth - origin.z()) / direction.z();
    const Eigen::Vector3d point = origin + distance * direction;
    if (point.x() < low || point.x() > high) return std::nullopt;
    return support::Hit{distance, point, -Eigen::Vector3d::UnitZ()};
  };
}

// A camera that moved by about 5 cm and 4 degrees.
Pose moved_camera() { return {rotation_exp({0.03, -0.05, 0.04}), {0.04, -0.02, -0.03}}; }

Matrix6d covariance_of(double rotation_rad, double translation_m) {
  Vector6d variances;
  variances << Eigen::Vector3d::Constant(rotation_rad * rotation_rad),
      Eigen::Vector3d::Constant(translation_m * translation_m);
  // With correlations between the axes.
  Matrix6d mixing = Matrix6d::Identity();
  mixing(0, 4) = 0.3 * rotation_rad / translation_m;
  mixing(5, 1) = -0.4 * translation_m / rotation_rad;
  return mixing * variances.asDiagonal() * mixing.transpose();
}

struct Expectation {
  Frame known;
  TruthFrame truth;  // of the moved camera
  ExpectedView view;
};

// The view of a moved camera, predicted from a first view of a surface.
Expectation expect(const Surface& surface, const RigModel& rig, const Matrix6d& covariance, double sigma_m = 1e-4) {
  Expectation result{observe(surface, rig, {}, sigma_m), truth_of(surface, rig, moved_camera()), {}};
  result.view =
      expected_view({{&result.known, moved_camera().inverse(), covariance}}, rig.camera, pixel_rays(rig.camera));
  return result;
}

double worst_error(const Expectation& e, int& compared) {
  double worst = 0;
  compared = 0;
  for (int row = 0; row < e.truth.depth_m.rows; ++row) {
    for (int col = 0; col < e.truth.depth_m.cols; ++col) {
      const double off = std::abs(e.view.depth_m(row, col) - e.truth.depth_m(row, col));
      if (std::isnan(off)) continue;
      worst = std::max(worst, off);
      ++compared;
    }
  }
  return worst;
}

class Slopes : public testing::TestWithParam<Eigen::Vector3d> {};
INSTANTIATE_TEST_SUITE_P(Normals, Slopes,
                         testing::Values(Eigen::Vector3d(0, 0, -1), Eigen::Vector3d(0.6, 0, -0.8),
                                         Eigen::Vector3d(-0.5, 0.7, -0.51), Eigen::Vector3d(0.1, -0.9, -0.42)));

TEST_P(Slopes, PlanesComeOutExactly) {
  const Eigen::Vector3d normal = GetParam().normalized();
  for (const bool distorted : {false, true}) {
    const auto e = expect(plane(normal, normal.z()), small_rig(distorted), Matrix6d::Zero());
    int compared = 0;
    EXPECT_LT(worst_error(e, compared), 5e-6);
    EXPECT_GT(compared, 8000);
  }
}

TEST_P(Slopes, SigmaIsThatOfThePoseAndThePoint) {
  const Eigen::Vector3d normal = GetParam().normalized();
  const RigModel rig = small_rig(true);
  const Matrix6d covariance = covariance_of(2e-3, 1e-3);
  const double point_sigma = 4e-4;
  const auto e = expect(plane(normal, normal.z()), rig, covariance, point_sigma);
  const Pose current_from_known = moved_camera().inverse();
  const PixelRays rays = pixel_rays(rig.camera);
  const Eigen::Vector3d n = current_from_known.rotation * normal;
  for (int row = 10; row < 115; row += 8) {
    for (int col = 10; col < 120; col += 8) {
      if (std::isnan(e.view.depth_m(row, col))) continue;
      const Eigen::Vector3d ray(rays(row, col)[0], rays(row, col)[1], 1);
      const Eigen::Vector3d turned = e.truth.depth_m(row, col) * ray - current_from_known.translation;  // R p
      Eigen::Matrix<double, 3, 6> jacobian;
      jacobian << -skew(turned), Eigen::Matrix3d::Identity();
      const double by_pose = n.dot(jacobian * covariance * jacobian.transpose() * n);
      const double along_known_ray = n.dot(turned) / (current_from_known.rotation.transpose() * turned).z();
      const double sigma = std::sqrt(by_pose + std::pow(along_known_ray * point_sigma, 2)) / std::abs(n.dot(ray));
      EXPECT_NEAR(e.view.sigma_m(row, col), sigma, 0.01 * sigma) << row << ", " << col;
    }
  }
}

TEST(ExpectedView, SigmaIsTheScatterOverPosesOfThatCovariance) {
  const RigModel rig = small_rig(true);
  const Eigen::Vector3d normal = Eigen::Vector3d(0.5, -0.3, -0.8).normalized();
  const Matrix6d covariance = covariance_of(1e-3, 1e-3);
  const auto e = expect(plane(normal, normal.z()), rig, covariance, 1e-7);
  Random random(11);
  double squares = 0;
  constexpr int kPoses = 300;
  for (int i = 0; i < kPoses; ++i) {
    const Pose pose = retract(moved_camera().inverse(), random.gaussian<6>(covariance));
    const auto off = expected_view({{&e.known, pose, covariance}}, rig.camera, pixel_rays(rig.camera));
    squares += std::pow((off.depth_m(50, 70) - e.truth.depth_m(50, 70)) / e.view.sigma_m(50, 70), 2);
  }
  EXPECT_NEAR(squares / kPoses, 1, 0.25);  // three standard deviations of the mean square
}

TEST(ExpectedView, RoundSurfacesFollowTheirTangentPlanes) {
  // A pixel is 2 mm here; half a pixel away, a tangent plane of this radius is off by 3 micrometres.
  for (const bool distorted : {false, true}) {
    const auto e = expect(sphere({0, 0, 1.4}, 0.45), small_rig(distorted), Matrix6d::Zero());
    std::vector<double> errors;
    for (int row = 0; row < 125; ++row) {
      for (int col = 0; col < 133; ++col) {
        const double off = std::abs(e.view.depth_m(row, col) - e.truth.depth_m(row, col));
        if (!std::isnan(off)) errors.push_back(off);
      }
    }
    ASSERT_GT(errors.size(), 8000U);
    std::sort(errors.begin(), errors.end());
    EXPECT_LT(errors[errors.size() * 99 / 100], 1e-5);
    EXPECT_LT(errors.back(), 5e-5);  // beyond the rim of the seen part, where the next point is two pixels away
  }
}

TEST(ExpectedView, NearSurfacesOccludeFarOnes) {
  const RigModel rig = small_rig(true);
  const Surface scene = nearest_of({strip(0.85, -0.03, 0.05), plane({0, 0, 1}, 1.1)});
  const auto e = expect(scene, rig, Matrix6d::Zero());
  const PixelRays rays = pixel_rays(rig.camera);
  int near = 0, wrong = 0, unseen = 0, holes = 0;
  for (int row = 2; row < 123; ++row) {
    for (int col = 2; col < 131; ++col) {
      const auto depth = [&](int r, int c) { return e.truth.depth_m(r, c); };
      bool edge = false;
      for (int k = 0; k < 25; ++k) edge |= std::abs(depth(row + k / 5 - 2, col + k % 5 - 2) - depth(row, col)) > 0.1;
      if (edge) continue;  // the near surface's footprint may extend two pixels past its end
      const float expected = e.view.depth_m(row, col), true_depth = depth(row, col);
      const cv::Vec2f& ray = rays(row, col);
      const Eigen::Vector3d point = moved_camera() * (true_depth * Eigen::Vector3d(ray[0], ray[1], 1));
      unseen += std::isnan(expected);
      if (!rig.camera.contains(rig.camera.project(point))) continue;  // outside the first view
      near += true_depth < 1;
      holes += true_depth < 1 && std::isnan(expected);
      wrong += std::abs(expected - true_depth) > 1e-4f;  // false for NaN
    }
  }
  EXPECT_GT(near, 3000);
  EXPECT_EQ(wrong, 0);
  EXPECT_EQ(holes, 0);
  EXPECT_GT(unseen, 200);  // hidden by the strip in the first view
}

TEST(ExpectedView, NearerViewsDoNotLetTheBackgroundThrough) {
  // The distance is almost halved, so projected points are nearly two pixels apart.
  const RigModel rig = small_rig(false);
  const Surface scene = nearest_of({strip(0.9, -0.04, 0.06), plane({0, 0, 1}, 1.2)});
  const Frame known = observe(scene, rig, {}, 1e-4);
  const Pose world_from_camera{rotation_exp({0, 0, 0.2}), {0.01, 0, 0.4}};
  const TruthFrame truth = truth_of(scene, rig, world_from_camera);
  const auto view = expected_view({{&known, world_from_camera.inverse()}}, rig.camera, pixel_rays(rig.camera));
  int near = 0;
  for (int row = 0; row < 125; ++row) {
    for (int col = 0; col < 133; ++col) {
      if (truth.depth_m(row, col) > 0.6) continue;
      ++near;
      EXPECT_NEAR(view.depth_m(row, col), 0.5, 1e-5) << row << ", " << col;
    }
  }
  EXPECT_GT(near, 3000);
}

TEST(ExpectedView, BesideAStepTheSigmaHoldsTheStep) {
  const RigModel rig = small_rig(false);
  const Surface scene = nearest_of({strip(0.9, -1, 0), plane({0, 0, 1}, 1.0)});
  const Frame known = observe(scene, rig, {}, 1e-4);
  // The image shift has a standard deviation of about one pixel.
  const auto view = expected_view({{&known, Pose{}, covariance_of(1e-9, 2e-3)}}, rig.camera, pixel_rays(rig.camera));
  const int edge = 66;
  for (const int col : {edge - 3, edge - 2, edge - 1, edge + 1, edge + 2, edge + 4})
    EXPECT_GT(view.sigma_m(60, col), 0.08) << col;
  for (const int col : {edge - 12, edge + 12}) EXPECT_LT(view.sigma_m(60, col), 0.004) << col;
}

TEST(ExpectedView, PointsWithoutNormalsTakeTheirNeighbours) {
  const RigModel rig = small_rig(true);
  const Eigen::Vector3d normal = Eigen::Vector3d(0.5, -0.3, -0.8).normalized();
  Expectation e = expect(plane(normal, normal.z()), rig, Matrix6d::Zero());
  e.known.normals.setTo(cv::Scalar::all(std::numeric_limits<double>::quiet_NaN()));
  e.view = expected_view({{&e.known, moved_camera().inverse()}}, rig.camera, pixel_rays(rig.camera));
  int compared = 0;
  EXPECT_LT(worst_error(e, compared), 1e-5);
  EXPECT_GT(compared, 8000);
}

TEST(ExpectedView, NothingKnownNothingExpected) {
  const RigModel rig = small_rig(false);
  const PixelRays rays = pixel_rays(rig.camera);
  const auto known_pixels = [](const ExpectedView& view) { return cv::countNonZero(view.depth_m == view.depth_m); };
  EXPECT_EQ(known_pixels(expected_view({}, rig.camera, rays)), 0);
  Frame known = observe(plane({0, 0, 1}, 1), rig, {}, 1e-4);
  const auto at = [&](const Pose& pose) { return known_pixels(expected_view({{&known, pose}}, rig.camera, rays)); };
  EXPECT_EQ(at({}), 125 * 133);
  EXPECT_NEAR(at({Eigen::Matrix3d::Identity(), {0.13, 0, 0}}), 125 * 133 / 2, 125 * 3);
  EXPECT_EQ(at({Eigen::Matrix3d::Identity(), {0.5, 0, 0}}), 0);
  EXPECT_EQ(at({Eigen::Matrix3d::Identity(), {0, 0, -2}}), 0);  // behind the camera
  EXPECT_EQ(at({rotation_exp({0, 3.1, 0}), {0, 0, 2}}), 0);     // from behind
  known.points_m(cv::Rect(40, 40, 30, 20)).setTo(cv::Scalar::all(std::numeric_limits<double>::quiet_NaN()));
  EXPECT_EQ(at({}), 125 * 133 - 29 * 19);  // a hole, except its rim above and to the left
  EXPECT_THAT(error_of([&] { expected_view({}, rig.camera, rays(cv::Rect(0, 0, 9, 9))); }), HasSubstr("camera's size"));
}

TEST(ExpectedView, OfSeveralViewsTheNearestSurfaceCounts) {
  const RigModel rig = small_rig(false);
  const Frame far = observe(plane({0, 0, 1}, 1.2), rig, {}, 1e-4);
  const Frame near = observe(strip(0.9, -0.04, 0.06), rig, {}, 1e-4);
  const auto render = [&](const Frame* first, const Frame* second) {
    return expected_view({{first, Pose{}}, {second, Pose{}}}, rig.camera, pixel_rays(rig.camera));
  };
  const ExpectedView a = render(&far, &near), b = render(&near, &far);
  EXPECT_NEAR(a.depth_m(60, 66), 0.9, 1e-6);
  EXPECT_NEAR(a.depth_m(60, 10), 1.2, 1e-6);
  EXPECT_EQ(std::memcmp(a.depth_m.data, b.depth_m.data, a.depth_m.total() * sizeof(float)), 0);
}

TEST(CoordinatePrior, IsTheProjectionAndItsDerivative) {
  for (const Axis axis : {Axis::columns, Axis::rows}) {
    const RigModel rig = small_rig(true);
    const PixelRays rays = pixel_rays(rig.camera);
    const double depth = 0.93, sigma = 2e-3;
    const auto expected = predict_coordinate(rig, rays, cv::Mat1f(rays.size(), static_cast<float>(depth)),
                                             cv::Mat1f(rays.size(), static_cast<float>(sigma)), axis);
    for (int row = 0; row < rays.rows; row += 9) {
      for (int col = 0; col < rays.cols; col += 7) {
        const auto coordinate = [&](double z) {
          const Eigen::Vector3d point(z * rays(row, col)[0], z * rays(row, col)[1], z);
          return rig.projector.project(rig.projector_from_camera * point)[axis == Axis::columns ? 0 : 1];
        };
        EXPECT_NEAR(expected.coordinate_px(row, col), coordinate(depth), 1e-3);
        const double slope = (coordinate(depth + 1e-4) - coordinate(depth - 1e-4)) / 2e-4;
        EXPECT_NEAR(expected.sigma_px(row, col), std::abs(slope) * sigma, 1e-4);
        EXPECT_EQ(expected.half_width_px(row, col), 0);
      }
    }
  }
}

}  // namespace
}  // namespace fringeslam
