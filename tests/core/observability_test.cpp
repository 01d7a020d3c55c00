// SPDX-License-Identifier: Apache-2.0
#include "core/motion/observability.h"

#include <gmock/gmock.h>

#include <Eigen/Geometry>
#include <cmath>
#include <functional>
#include <limits>
#include <numbers>

#include "tests/support/matchers.h"
#include "tests/support/random.h"

namespace fringeslam {
namespace {

using Eigen::Vector3d;
using support::MatrixNear;
using support::Random;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;

constexpr double kSigma_m = 1e-4;
const Pose kPose = pose_from({{40, -20, 15}, {12, -7, 25}});

// Points of a scene in the target's frame, each constrained along its normal, or fully if the normal is zero.
struct Scene {
  std::vector<Vector3d> points, normals;

  Vector3d centre() const {
    Vector3d sum = Vector3d::Zero();
    for (const Vector3d& point : points) sum += point;
    return sum / static_cast<double>(points.size());
  }
  double spread() const {
    double sum = 0;
    for (const Vector3d& point : points) sum += (point - centre()).squaredNorm();
    return std::sqrt(sum / static_cast<double>(points.size()));
  }
  // In the tangent of retract() at kPose: x moves by omega x R p + v with R p = x - t.
  Matrix6d information() const {
    Matrix6d sum = Matrix6d::Zero();
    for (size_t i = 0; i < points.size(); ++i) {
      Eigen::Matrix<double, 3, 6> moves;
      moves << -skew(points[i] - kPose.translation), Eigen::Matrix3d::Identity();
      const bool along_normal = normals[i].norm() > 0;
      if (along_normal) moves = normals[i] * (normals[i].transpose() * moves);
      sum += moves.transpose() * moves / (kSigma_m * kSigma_m);
    }
    return sum;
  }
  std::vector<UnobservableDirection> free() const {
    return unobservable_directions(information(), kPose, centre(), spread(), {});
  }
};

Scene scene_of(int count, const std::function<std::pair<Vector3d, Vector3d>()>& draw) {
  Scene scene;
  for (int i = 0; i < count; ++i) {
    const auto [point, normal] = draw();
    scene.points.push_back(point);
    scene.normals.push_back(normal);
  }
  return scene;
}

Scene plane(const Vector3d& middle, const Vector3d& normal, uint64_t seed) {
  Random random(seed);
  const Vector3d a = normal.unitOrthogonal(), b = normal.cross(a);
  return scene_of(300, [&] {
    return std::pair(Vector3d(middle + random.uniform(-0.1, 0.1) * a + random.uniform(-0.1, 0.1) * b), normal);
  });
}

Scene sphere(const Vector3d& middle, double radius, double cap, uint64_t seed) {
  Random random(seed);
  return scene_of(2000, [&] {
    Vector3d normal;
    do {
      normal = random.direction();
    } while (normal.z() > -cap);  // the side that a camera sees
    return std::pair(Vector3d(middle + radius * normal), normal);
  });
}

Scene points_at(const std::vector<Vector3d>& points) {
  return {points, std::vector<Vector3d>(points.size(), Vector3d::Zero())};
}

void append(Scene& scene, const Scene& more) {
  scene.points.insert(scene.points.end(), more.points.begin(), more.points.end());
  scene.normals.insert(scene.normals.end(), more.normals.begin(), more.normals.end());
}

double distance_to_axis(const Vector3d& point, const UnobservableDirection& direction) {
  return direction.axis.cross(point - direction.point_m).norm();
}

// Expects that a small motion along the direction keeps every point in its surface.
void expect_no_residual(const Scene& scene, const UnobservableDirection& direction) {
  for (size_t i = 0; i < scene.points.size(); ++i) {
    const Vector3d shift =
        direction.kind == FreeKind::translation
            ? direction.axis
            : Vector3d(direction.axis.cross(scene.points[i] - direction.point_m) + direction.pitch_m * direction.axis);
    const double off = scene.normals[i].norm() > 0 ? std::abs(scene.normals[i].dot(shift)) : shift.norm();
    EXPECT_LT(off, 1e-6) << to_string(direction);
  }
}

TEST(Observability, ABarePlaneSlidesTwiceAndTurnsOnce) {
  const Vector3d tilted = Vector3d(0.2, -0.4, -1).normalized();
  for (const Vector3d& normal : {Vector3d(0, 0, -1), tilted}) {
    const Scene scene = plane({0.05, -0.02, 0.9}, normal, 1);
    const std::vector<UnobservableDirection> free = scene.free();
    ASSERT_THAT(free, SizeIs(3));
    for (const int i : {0, 1}) {
      EXPECT_EQ(free[i].kind, FreeKind::translation);
      EXPECT_NEAR(free[i].axis.dot(normal), 0, 1e-9);
    }
    EXPECT_NEAR(free[0].axis.dot(free[1].axis), 0, 1e-9);
    EXPECT_EQ(free[2].kind, FreeKind::rotation);
    EXPECT_NEAR(std::abs(free[2].axis.dot(normal)), 1, 1e-9);
    for (const UnobservableDirection& direction : free) {
      EXPECT_TRUE(std::isinf(direction.sigma));
      expect_no_residual(scene, direction);
    }
  }
  EXPECT_EQ(to_string(plane({0, 0, 0.9}, {0, 0, -1}, 1).free()[1]), "slides along (0.00, 1.00, 0.00)");
}

TEST(Observability, ASphereTurnsAboutItsCentre) {
  const Vector3d middle(0.03, 0.05, 0.85);
  for (const double cap : {-1.0, 0.0, 0.5}) {
    const Scene scene = sphere(middle, 0.2, cap, 2);
    const std::vector<UnobservableDirection> free = scene.free();
    ASSERT_THAT(free, SizeIs(3));
    for (const UnobservableDirection& direction : free) {
      EXPECT_EQ(direction.kind, FreeKind::rotation);
      EXPECT_LT((direction.point_m - middle).norm(), 1e-6) << cap;
      EXPECT_TRUE(std::isinf(direction.sigma));
      expect_no_residual(scene, direction);
    }
    for (int i = 0; i < 3; ++i) EXPECT_THAT(free[i].axis, MatrixNear(free[i].axis.cwiseAbs(), 1e-9));
  }
}

TEST(Observability, ACylinderSlidesAlongItsAxisAndTurnsAboutIt) {
  const Vector3d axis = Vector3d(0.3, 1, 0.2).normalized(), middle(0.02, 0.01, 0.9);
  Random random(3);
  const Vector3d a = axis.unitOrthogonal(), b = axis.cross(a);
  const Scene scene = scene_of(500, [&] {
    const double angle = random.uniform(0, std::numbers::pi);
    const Vector3d normal = std::cos(angle) * a + std::sin(angle) * b;
    return std::pair(Vector3d(middle + 0.05 * normal + random.uniform(-0.15, 0.15) * axis), normal);
  });
  const std::vector<UnobservableDirection> free = scene.free();
  ASSERT_THAT(free, SizeIs(2));
  EXPECT_EQ(free[0].kind, FreeKind::translation);
  EXPECT_THAT(free[0].axis, MatrixNear(axis, 1e-9));
  EXPECT_EQ(free[1].kind, FreeKind::rotation);
  EXPECT_THAT(free[1].axis, MatrixNear(axis, 1e-9));
  EXPECT_LT(distance_to_axis(middle, free[1]), 1e-6);
}

TEST(Observability, AHelixScrews) {
  const Vector3d middle(0, 0, 0.9);
  constexpr double kPitch_m = 0.08;
  Random random(4);
  const Scene scene = scene_of(500, [&] {
    const double angle = random.uniform(-2, 2), radius = random.uniform(0.05, 0.15);
    const Vector3d out(std::cos(angle), std::sin(angle), 0), round(-out.y(), out.x(), 0);
    const Vector3d normal = out.cross(radius * round + kPitch_m * Vector3d::UnitZ()).normalized();
    return std::pair(Vector3d(middle + radius * out + kPitch_m * angle * Vector3d::UnitZ()), normal);
  });
  const std::vector<UnobservableDirection> free = scene.free();
  ASSERT_THAT(free, SizeIs(1));
  EXPECT_EQ(free[0].kind, FreeKind::screw);
  EXPECT_THAT(free[0].axis, MatrixNear(Vector3d(0, 0, 1), 1e-9));
  EXPECT_NEAR(free[0].pitch_m, kPitch_m, 1e-9);
  EXPECT_LT(distance_to_axis(middle, free[0]), 1e-9);
  EXPECT_EQ(to_string(free[0]).substr(0, 31), "turns about (0.00, 0.00, 1.00) ");
  EXPECT_THAT(to_string(free[0]), HasSubstr("advancing 80.0 mm per radian"));
}

TEST(Observability, ACornerOfThreePlanesIsHeld) {
  Scene scene = plane({0.1, 0, 0.9}, {1, 0, 0}, 5);
  EXPECT_THAT(scene.free(), SizeIs(3));
  append(scene, plane({0, 0.1, 0.9}, {0, 1, 0}, 6));
  const std::vector<UnobservableDirection> edge = scene.free();  // two planes: free along their edge
  ASSERT_THAT(edge, SizeIs(1));
  EXPECT_EQ(to_string(edge[0]), "slides along (0.00, 0.00, 1.00)");
  append(scene, plane({0, 0, 1}, {0, 0, -1}, 7));
  EXPECT_THAT(scene.free(), IsEmpty());
}

TEST(Observability, FewPoints) {
  const Vector3d a(0.1, 0, 0.8), b(-0.05, 0.1, 0.9), c(0, -0.1, 1);
  EXPECT_THAT(points_at({a, b, c}).free(), IsEmpty());

  const std::vector<UnobservableDirection> two = points_at({a, b}).free();
  ASSERT_THAT(two, SizeIs(1));
  EXPECT_EQ(two[0].kind, FreeKind::rotation);
  EXPECT_NEAR(std::abs(two[0].axis.dot((b - a).normalized())), 1, 1e-9);
  EXPECT_LT(distance_to_axis(a, two[0]), 1e-9);
  EXPECT_LT(distance_to_axis(b, two[0]), 1e-9);

  const std::vector<UnobservableDirection> one = points_at({a}).free();
  ASSERT_THAT(one, SizeIs(3));
  for (const UnobservableDirection& direction : one) {
    EXPECT_EQ(direction.kind, FreeKind::rotation);
    EXPECT_LT(distance_to_axis(a, direction), 1e-9);
  }
  EXPECT_EQ(to_string(one[0]), "turns about (1.00, 0.00, 0.00) through (0.100, 0.000, 0.800) m");
}

TEST(Observability, NothingKnownIsThreeSlidesAndThreeTurns) {
  const std::vector<UnobservableDirection> free =
      unobservable_directions(Matrix6d::Zero(), kPose, {0, 0, 0.9}, 0.1, {});
  std::vector<std::string> texts;
  for (const UnobservableDirection& direction : free) texts.push_back(to_string(direction));
  EXPECT_THAT(texts, ElementsAre("slides along (1.00, 0.00, 0.00)", "slides along (0.00, 1.00, 0.00)",
                                 "slides along (0.00, 0.00, 1.00)",
                                 "turns about (1.00, 0.00, 0.00) through (0.000, 0.000, 0.900) m",
                                 "turns about (0.00, 1.00, 0.00) through (0.000, 0.000, 0.900) m",
                                 "turns about (0.00, 0.00, 1.00) through (0.000, 0.000, 0.900) m"));
}

// Springs of known stiffness: the sigmas must match, and the limit must decide at them.
TEST(Observability, SigmasAreThoseOfTheInformation) {
  const Vector3d centre(0.1, -0.2, 0.9);
  constexpr double kSpread = 0.12;
  Matrix6d at_centre = Matrix6d::Zero();
  at_centre.diagonal() << 1 / (0.3 * 0.3), 1e8, 1e8, 1e10, 1 / (0.02 * 0.02), 1e10;
  Matrix6d centre_from_tangent = Matrix6d::Identity();
  centre_from_tangent.bottomLeftCorner<3, 3>() = -skew(centre - kPose.translation);
  const Matrix6d information = centre_from_tangent.transpose() * at_centre * centre_from_tangent;
  const std::vector<UnobservableDirection> free = unobservable_directions(information, kPose, centre, kSpread, {});
  ASSERT_THAT(free, SizeIs(2));
  EXPECT_EQ(to_string(free[0]), "slides along (0.00, 1.00, 0.00)");
  EXPECT_NEAR(free[0].sigma, 0.02, 1e-8);
  EXPECT_EQ(to_string(free[1]), "turns about (1.00, 0.00, 0.00) through (0.100, -0.200, 0.900) m");
  EXPECT_NEAR(free[1].sigma, 0.3, 1e-7);
  EXPECT_THAT(unobservable_directions(information, kPose, centre, kSpread, {0.0201}), SizeIs(1));
  EXPECT_THAT(unobservable_directions(information, kPose, centre, kSpread, {0.0361}), IsEmpty());  // 0.3 rad at 0.12 m
}

// Millimetre-sized roughness constrains a plane weakly: the directions stay the same, with finite sigmas.
TEST(Observability, ANearlyBarePlane) {
  Scene scene = plane({0.05, -0.02, 0.9}, {0, 0, -1}, 8);
  Random random(9);
  for (Vector3d& normal : scene.normals) normal = (normal + 1e-3 * random.normals<3>()).normalized();
  const std::vector<UnobservableDirection> free = unobservable_directions(
      scene.information(), kPose, scene.centre(), scene.spread(), {.max_displacement_sigma_m = 1e-3});
  ASSERT_THAT(free, SizeIs(3));
  EXPECT_EQ(free[0].kind, FreeKind::translation);
  EXPECT_EQ(free[1].kind, FreeKind::translation);
  EXPECT_EQ(free[2].kind, FreeKind::rotation);
  EXPECT_GT(std::abs(free[2].axis.z()), 0.999);
  // 300 normals tilted by 1e-3.
  for (const int i : {0, 1}) EXPECT_NEAR(free[i].sigma, kSigma_m / (1e-3 * std::sqrt(300)), 0.2 * free[i].sigma);
}

TEST(Observability, NonFiniteValuesAreRefused) {
  const Matrix6d nan = Matrix6d::Constant(std::numeric_limits<double>::quiet_NaN());
  EXPECT_THAT(support::error_of([&] { unobservable_directions(nan, kPose, {0, 0, 1}, 0.1, {}); }), HasSubstr("finite"));
  EXPECT_THAT(support::error_of([&] {
                unobservable_directions(Matrix6d::Zero(), kPose, {0, 0, 1}, nan(0, 0), {});
              }),
              HasSubstr("finite"));
  EXPECT_THAT(support::error_of([&] {
                unobservable_directions(Matrix6d::Zero(), kPose, {0, 0, 1}, 0.1, {0});
              }),
              HasSubstr("observability.max_displacement_sigma_m"));
}

}  // namespace
}  // namespace fringeslam
