// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <limits>
#include <numbers>
#include <optional>
#include <thread>
#include <vector>

#include "core/base/last_result.h"
#include "core/base/parallel.h"
#include "core/types/linear_algebra.h"
#include "core/types/options.h"
#include "core/types/pinhole.h"
#include "core/types/pose.h"
#include "tests/support/matchers.h"
#include "tests/support/random.h"

namespace fringeslam {
namespace {

using support::error_of;
using support::MatrixNear;
using support::PoseNear;
using support::Random;
using testing::HasSubstr;

constexpr double kPi = std::numbers::pi;

// Both sides of the switch from series to closed form (1e-4), and both ends of the range.
class RotationAngle : public testing::TestWithParam<double> {};
INSTANTIATE_TEST_SUITE_P(NearZeroToNearPi, RotationAngle,
                         testing::Values(0.0, 1e-15, 1e-12, 1e-9, 1e-8, 9.9e-5, 1.01e-4, 1e-3, 0.1, 1.0, 2.0, 3.0,
                                         kPi - 1e-3, kPi - 1e-6, kPi - 1e-9));

TEST_P(RotationAngle, LogUndoesExp) {
  Random random(1);
  for (int i = 0; i < 50; ++i) {
    const Eigen::Vector3d omega = GetParam() * random.direction();
    EXPECT_THAT(rotation_log(rotation_exp(omega)), MatrixNear(omega, 1e-15 + 1e-12 * GetParam()));
  }
}

TEST_P(RotationAngle, ExpIsARotationAboutItsAxis) {
  Random random(2);
  const double c = std::cos(GetParam()), s = std::sin(GetParam());
  Eigen::Matrix3d about_z;
  about_z << c, -s, 0, s, c, 0, 0, 0, 1;
  EXPECT_THAT(rotation_exp({0, 0, GetParam()}), MatrixNear(about_z, 1e-15));
  const Eigen::Matrix3d r = rotation_exp(GetParam() * random.direction());
  EXPECT_THAT(r * r.transpose(), MatrixNear(Eigen::Matrix3d::Identity(), 1e-14));
  EXPECT_NEAR(r.determinant(), 1, 1e-14);
}

TEST_P(RotationAngle, DifferenceUndoesRetract) {
  Random random(3);
  const Pose pose{rotation_exp(2 * random.direction()), random.normals<3>()};
  Vector6d tangent;
  tangent << GetParam() * random.direction(), random.normals<3>();
  EXPECT_THAT(difference(retract(pose, tangent), pose), MatrixNear(tangent, 2e-15 + 1e-12 * GetParam()));
}

TEST(Pose, LogOfAHalfTurnIsPiAboutTheAxisEitherWay) {
  Random random(4);
  for (int i = 0; i < 50; ++i) {
    const Eigen::Matrix3d half_turn = rotation_exp(kPi * random.direction());
    const Eigen::Vector3d omega = rotation_log(half_turn);
    EXPECT_NEAR(omega.norm(), kPi, 1e-12);
    EXPECT_THAT(rotation_exp(omega), MatrixNear(half_turn, 1e-12));
  }
}

TEST(Pose, RetractTurnsAndShiftsFromTheLeft) {
  const Pose pose{rotation_exp({0, 0, 0.3}), {1, 2, 3}};
  Vector6d tangent;
  tangent << 0, 0, 0.4, 0.1, 0.2, 0.3;
  EXPECT_THAT(retract(pose, tangent), PoseNear(Pose{rotation_exp({0, 0, 0.7}), {1.1, 2.2, 3.3}}, 1e-15, 1e-15));
}

TEST(Pose, CovarianceOfTheInverseIsThatOfItsTangents) {
  Random random(12);
  const Pose pose{rotation_exp(1.1 * random.direction()), {0.4, -0.7, 1.3}};
  // For a covariance with a single direction, the tangent of the inverse is its square root.
  for (int axis = 0; axis < 6; ++axis) {
    const Vector6d tangent = 1e-6 * Vector6d::Unit(axis);
    const Vector6d moved = difference(retract(pose, tangent).inverse(), pose.inverse());
    EXPECT_THAT(covariance_of_inverse(pose, tangent * tangent.transpose()),
                MatrixNear(Matrix6d(moved * moved.transpose()), 1e-17));
  }
}

// A thermal lens whose polynomial folds beyond its image: at a tangent of 0.8 it maps points to 0.38, inside the image.
TEST(Pinhole, PointsBeyondTheFoldAreNotShown) {
  Pinhole lens{160, 120, 200, 200, 79.5, 59.5, {-0.3, 0.8, 0, 0, -2.5}};
  const double largest_r2 = lens.largest_r2();
  EXPECT_TRUE(lens.contains(lens.project({0.5 * 0.8, 0, 0.5})));
  Eigen::Vector2d pixel;
  EXPECT_FALSE(lens.shows({0.5 * 0.8, 0, 0.5}, largest_r2, pixel));
  EXPECT_FALSE(lens.shows({0, 0, -1}, largest_r2, pixel));
  for (int v = 0; v < lens.height; v += 7) {
    for (int u = 0; u < lens.width; u += 7) {
      const Eigen::Vector3d point = 1.3 * lens.undistort({u, v}).homogeneous();
      EXPECT_TRUE(lens.shows(point, largest_r2, pixel)) << u << ' ' << v;
      EXPECT_NEAR((pixel - Eigen::Vector2d(u, v)).norm(), 0, 1e-9);
    }
  }
  lens.distortion = {};
  EXPECT_TRUE(lens.shows({0.39, 0.29, 1}, lens.largest_r2(), pixel));
}

TEST(Pose, TangentsOfAProductAreLinearInThoseOfItsFactors) {
  Random random(13);
  const Pose a{rotation_exp(1.1 * random.direction()), {0.4, -0.7, 1.3}},
      b{rotation_exp(0.8 * random.direction()), {-0.2, 0.9, 0.5}};
  for (int axis = 0; axis < 6; ++axis) {
    const Vector6d tangent = 1e-6 * Vector6d::Unit(axis);
    EXPECT_THAT(difference(retract(a, tangent) * b, a * b),
                MatrixNear(Vector6d(tangent_of_product(a.rotation * b.translation) * tangent), 1e-11));
    const Vector6d moved = difference(a * retract(b, tangent), a * b);
    EXPECT_THAT(rotated_covariance(a.rotation, tangent * tangent.transpose()),
                MatrixNear(Matrix6d(moved * moved.transpose()), 1e-17));
  }
}

TEST(Pose, SixDofIsRzRyRxInMillimetresAndDegrees) {
  // Hand-computed: with beta = gamma = 90 degrees, x maps to -z (Ry), which Rz leaves unchanged.
  const Pose pose = pose_from({{30, 10, -15}, {0, 90, 90}});
  EXPECT_THAT(pose * Eigen::Vector3d(1, 0, 0), MatrixNear(Eigen::Vector3d(0.03, 0.01, -1.015), 1e-15));
  EXPECT_THAT(pose * Eigen::Vector3d(0, 1, 0), MatrixNear(Eigen::Vector3d(-0.97, 0.01, -0.015), 1e-15));
  const Pose roll = pose_from({{0, 0, 0}, {15, 0, 0}});
  EXPECT_THAT(roll * Eigen::Vector3d(0, 1, 0),
              MatrixNear(Eigen::Vector3d(0, std::cos(kPi / 12), std::sin(kPi / 12)), 1e-15));
}

TEST(Pose, SixDofRoundTrip) {
  Random random(5);
  for (int i = 0; i < 200; ++i) {
    const SixDof six{1e3 * random.normals<3>(),
                     {random.uniform(-180, 180), random.uniform(-89.9, 89.9), random.uniform(-180, 180)}};
    const SixDof back = six_dof(pose_from(six));
    EXPECT_THAT(back.translation_mm, MatrixNear(six.translation_mm, 1e-9));
    EXPECT_THAT(back.angles_deg, MatrixNear(six.angles_deg, 1e-9));
  }
}

TEST(Pose, SixDofDescribesAPoseInGimbalLock) {
  // At beta = 90 degrees alpha and gamma are not separable; any split that gives the same rotation is correct.
  for (const double beta : {90.0, -90.0}) {
    const Pose pose = pose_from({{1, 2, 3}, {20, beta, -35}});
    EXPECT_THAT(pose_from(six_dof(pose)), PoseNear(pose, 1e-12, 1e-7)) << "beta " << beta;
  }
}

TEST(Pose, QuaternionsOfTumFiles) {
  EXPECT_THAT(quaternion_xyzw(rotation_exp({0, 0, kPi / 2})),
              MatrixNear(Eigen::Vector4d(0, 0, std::sqrt(0.5), std::sqrt(0.5)), 1e-15));
  Random random(6);
  for (int i = 0; i < 100; ++i) {
    const Eigen::Matrix3d rotation = rotation_exp(random.uniform(0, kPi) * random.direction());
    const Eigen::Vector4d q = quaternion_xyzw(rotation);
    EXPECT_GE(q.w(), 0);
    EXPECT_THAT(rotation_from_quaternion(q), MatrixNear(rotation, 1e-14));
  }
}

TEST(Pose, OrthonormalisedRemovesDriftAndNothingElse) {
  const Pose pose{rotation_exp({0.4, -0.5, 0.6}), {1, 2, 3}};
  const Eigen::Vector3d stretch(1 + 1e-6, 1 - 2e-6, 1 + 3e-6);  // symmetric: its nearest rotation is the identity
  const Pose drifted{pose.rotation * stretch.asDiagonal(), pose.translation};
  EXPECT_THAT(orthonormalised(drifted).rotation, MatrixNear(pose.rotation, 1e-15));
  EXPECT_EQ(orthonormalised(drifted).translation, pose.translation);
}

std::vector<Eigen::Vector3d> random_points(Random& random, int count, const Eigen::Vector3d& size) {
  std::vector<Eigen::Vector3d> points;
  for (int i = 0; i < count; ++i) points.emplace_back(size.cwiseProduct(random.normals<3>()));
  return points;
}

std::vector<Eigen::Vector3d> transformed(const Pose& pose, std::vector<Eigen::Vector3d> points) {
  for (Eigen::Vector3d& p : points) p = pose * p;
  return points;
}

TEST(AlignPoints, ExactPairsGiveTheExactTransform) {
  Random random(7);
  const Pose truth{rotation_exp({2, 1, -1.5}), {5, -6, 7}};
  // Points in general position, in a plane (where the reflection fits as well), and only three points.
  for (const auto& [count, size] :
       {std::pair{20, Eigen::Vector3d(1, 2, 3)}, {20, Eigen::Vector3d(1, 2, 0)}, {3, Eigen::Vector3d(1, 1, 1)}}) {
    const auto from = random_points(random, count, size);
    EXPECT_THAT(align_points(transformed(truth, from), from), PoseNear(truth, 1e-13, 1e-13));
  }
  const auto one = random_points(random, 1, {1, 1, 1});
  EXPECT_THAT(align_points(transformed(truth, one), one) * one[0], MatrixNear(truth * one[0], 1e-14));
}

double squared_distances(const Pose& pose, const std::vector<Eigen::Vector3d>& to,
                         const std::vector<Eigen::Vector3d>& from) {
  double sum = 0;
  for (size_t i = 0; i < to.size(); ++i) sum += (to[i] - pose * from[i]).squaredNorm();
  return sum;
}

TEST(AlignPoints, MirroredPointsGiveTheBestRotationNotAMirror) {
  Random random(8);
  const auto from = random_points(random, 30, {1, 2, 3});
  auto to = from;
  for (Eigen::Vector3d& p : to) p.z() = -p.z();  // the longest axis: the best rotation flips another one
  const Pose best = align_points(to, from);
  EXPECT_NEAR(best.rotation.determinant(), 1, 1e-14);
  const double cost = squared_distances(best, to, from);
  for (int i = 0; i < 500; ++i) {
    const double size = random.uniform(0, 1) < 0.5 ? 0.01 : 3;
    EXPECT_GE(squared_distances(retract(best, size * random.normals<6>()), to, from), cost);
  }
}

TEST(AlignPoints, VariancesWeightThePairs) {
  Random random(9);
  const auto from = random_points(random, 12, {1, 2, 3});
  auto to = transformed({rotation_exp({0.5, -1, 2}), {1, 2, 3}}, from);
  std::vector<double> variances;
  for (Eigen::Vector3d& p : to) {
    variances.push_back(random.uniform(0.01, 1));
    p += std::sqrt(variances.back()) * random.normals<3>();
  }
  const auto cost = [&](const Pose& pose) {
    double sum = 0;
    for (size_t i = 0; i < to.size(); ++i) sum += (to[i] - pose * from[i]).squaredNorm() / variances[i];
    return sum;
  };
  const Pose best = align_points(to, from, variances);
  EXPECT_LT(cost(best), cost(align_points(to, from)));
  for (int i = 0; i < 500; ++i) EXPECT_GE(cost(retract(best, 0.01 * random.normals<6>())), cost(best));
  EXPECT_EQ(align_points(to, from, std::vector<double>(12, 1.0)).rotation, align_points(to, from).rotation);
}

TEST(NearestRotation, IsTheOrthogonalFactorOfAPolarDecomposition) {
  const Eigen::Matrix3d rotation = rotation_exp({0.3, -2, 1});
  Eigen::Matrix3d stretch;
  stretch << 3, 0.5, 0.2, 0.5, 2, -0.3, 0.2, -0.3, 1;  // positive definite
  EXPECT_THAT(nearest_rotation(rotation * stretch), MatrixNear(rotation, 1e-14));
  // A reflection is not a rotation: the shortest axis flips back.
  const Eigen::Vector3d reflection(3, 2, -1);
  EXPECT_THAT(nearest_rotation(rotation * reflection.asDiagonal()), MatrixNear(rotation, 1e-14));
}

Pinhole projector_like() { return {1024, 768, 2600, 2500, 511.5, 383.5, {}}; }

TEST(Pinhole, ProjectionClosedForm) {
  Pinhole pinhole = projector_like();
  const Eigen::Vector3d point(0.2, -0.1, 2);  // x = 0.1, y = -0.05, r2 = 0.0125
  const auto expect = [&](const Distortion& distortion, double x, double y) {
    pinhole.distortion = distortion;
    EXPECT_THAT(pinhole.project(point), MatrixNear(Eigen::Vector2d(2600 * x + 511.5, 2500 * y + 383.5), 1e-10));
  };
  expect({}, 0.1, -0.05);
  expect({.k1 = 0.4}, 0.1 * 1.005, -0.05 * 1.005);
  expect({.k2 = 0.64}, 0.1 * 1.0001, -0.05 * 1.0001);
  expect({.p1 = 0.02}, 0.1 - 0.0002, -0.05 + 0.02 * 0.0175);
  expect({.p2 = 0.02}, 0.1 + 0.02 * 0.0325, -0.05 - 0.0002);
  expect({.k3 = 5.12}, 0.1 * 1.00001, -0.05 * 1.00001);
}

TEST(Pinhole, UndistortUndoesProject) {
  Pinhole pinhole = projector_like();
  for (const Distortion& distortion : {Distortion{}, Distortion{-0.12, 0.1, 0.0003, -0.0002, 0.02},
                                       Distortion{0.3, -0.2, -0.005, 0.004, 0.1}, Distortion{.k1 = -0.5}}) {
    pinhole.distortion = distortion;
    for (int row = 0; row < pinhole.height; row += 59) {
      for (int col = 0; col < pinhole.width; col += 93) {
        const Eigen::Vector2d pixel(col, row);
        const Eigen::Vector3d ray = pinhole.undistort(pixel).homogeneous();
        EXPECT_THAT(pinhole.project(3.7 * ray), MatrixNear(pixel, 1e-8));
      }
    }
  }
}

TEST(Pinhole, NoRayWhereTheLensFoldsTheImage) {
  Pinhole pinhole = projector_like();
  // x (1 - 20 x^2) has its maximum of 0.086 at x = 0.129, 224 px from the centre; no ray is imaged farther out.
  pinhole.distortion.k1 = -20;
  EXPECT_TRUE(pinhole.undistort({511.5 + 200, 383.5}).allFinite());
  EXPECT_TRUE(pinhole.undistort({511.5 + 300, 383.5}).hasNaN());
}

TEST(Pinhole, ContainsHalfAPixelAroundTheCentres) {
  const Pinhole pinhole = projector_like();
  EXPECT_TRUE(pinhole.contains({-0.5, -0.5}));
  EXPECT_TRUE(pinhole.contains({1023.49, 767.49}));
  EXPECT_FALSE(pinhole.contains({1023.5, 100}));
  EXPECT_FALSE(pinhole.contains({100, -0.51}));
  EXPECT_FALSE(pinhole.contains({std::numeric_limits<double>::quiet_NaN(), 100}));
}

TEST(LastResult, ComputesOnlyForAnotherCamera) {
  LastResult<Pinhole, double> last;
  int computed = 0;
  const auto focal_length = [&](const Pinhole& camera) {
    return last.get(camera, [&] {
      ++computed;
      return camera.fx;
    });
  };
  const Pinhole one = projector_like();
  Pinhole other = one;
  other.fx = 2601;
  EXPECT_EQ(focal_length(one), 2600);
  EXPECT_EQ(focal_length(one), 2600);
  EXPECT_EQ(computed, 1);
  EXPECT_EQ(focal_length(other), 2601);
  EXPECT_EQ(focal_length(one), 2600);
  EXPECT_EQ(computed, 3);
  other = one;
  other.distortion.k3 = 1e-9;  // any number makes another camera
  (void)focal_length(other);
  EXPECT_EQ(computed, 4);
}

TEST(Options, NearestName) {
  const std::vector<std::string> known = {"max_range_m", "min_range_m", "saturation"};
  EXPECT_EQ(nearest_name("max_rang_m", known), "max_range_m");
  EXPECT_EQ(nearest_name("saturatoin", known), "saturation");
  EXPECT_EQ(nearest_name("qqqqqqqqqq", known), "");
  EXPECT_EQ(nearest_name("x", {}), "");
}

enum class Mode { exact, fast };

// Listed in another order than declared.
constexpr auto choices(Mode) { return std::to_array<Choice<Mode>>({{Mode::fast, "fast"}, {Mode::exact, "exact"}}); }

struct Sample {
  double range_m = 1;
  Mode mode = Mode::fast;
  template <class Visitor>
  void describe(Visitor& v) {
    v.field("range_m", range_m, {0.5, 2}, "");
    v.field("mode", mode, "");
  }
};

TEST(Options, CheckNamesFieldValueAndLimits) {
  EXPECT_NO_THROW(check_options(Sample{}, "sample"));
  EXPECT_NO_THROW(check_options(Sample{.range_m = 0.5}, "sample"));
  EXPECT_EQ(error_of([] { check_options(Sample{.range_m = 2.25}, "sample"); }),
            "sample.range_m is 2.25; it must lie in [0.5, 2]");
  EXPECT_THAT(error_of([] { check_options(Sample{.range_m = std::nan("")}, "sample"); }), HasSubstr("range_m"));
}

TEST(Options, EnumsHaveNames) {
  static_assert(NamedEnum<Mode> && !NamedEnum<int>);
  EXPECT_STREQ(to_string(Mode::fast), "fast");
  EXPECT_STREQ(to_string(Mode::exact), "exact");
  EXPECT_EQ(choice_names<Mode>(), (std::vector<std::string>{"fast", "exact"}));
  EXPECT_EQ(choice_values<Mode>(), (std::vector<Mode>{Mode::fast, Mode::exact}));
  EXPECT_NO_THROW(check_options(Sample{.mode = Mode::exact}, "sample"));
}

TEST(Parallel, EveryRowOnceAndInOneThreadWhereThatIsWanted) {
  constexpr int kRows = 1000;
  for (const bool alone : {false, true}) {
    std::optional<SerialLoops> serial;
    if (alone) serial.emplace();
    std::vector<int> visits(kRows, 0), elsewhere(kRows, 0);
    const auto here = std::this_thread::get_id();
    for_each_row(kRows, [&](int row) {
      ++visits[static_cast<size_t>(row)];
      elsewhere[static_cast<size_t>(row)] = std::this_thread::get_id() != here;
    });
    EXPECT_EQ(visits, std::vector<int>(kRows, 1));
    if (alone) {
      EXPECT_EQ(elsewhere, std::vector<int>(kRows, 0));
    }
    // The setting does not affect other threads.
    bool wanted = true;
    std::thread([&] { wanted = SerialLoops::wanted(); }).join();
    EXPECT_FALSE(wanted);
    EXPECT_EQ(SerialLoops::wanted(), alone);
  }
  EXPECT_FALSE(SerialLoops::wanted());
}

}  // namespace
}  // namespace fringeslam
