// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <functional>
#include <limits>

#include "core/motion/ego_motion.h"
#include "tests/support/matchers.h"
#include "tests/support/random.h"

namespace fringeslam {
namespace {

using support::MatrixNear;
using support::PoseNear;
using support::Random;

// 99.99th percentile of the chi-square distribution with 6 degrees of freedom.
constexpr double kChi2Of6 = 27.86;
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinite = std::numeric_limits<double>::infinity();

const Pose kMotion = pose_from({{30, 10, -15}, {15, -4, 7}});

Eigen::Vector3d random_point(Random& random) {
  return {random.uniform(-0.13, 0.13), random.uniform(-0.12, 0.12), random.uniform(0.8, 1.2)};
}

// 0.15 mm laterally, 0.05 mm along the viewing ray.
Eigen::Matrix3d sensor_covariance(const Eigen::Vector3d& point) {
  const Eigen::Vector3d ray = point.normalized();
  const Eigen::Matrix3d along = ray * ray.transpose();
  return 0.05e-3 * 0.05e-3 * along + 0.15e-3 * 0.15e-3 * (Eigen::Matrix3d::Identity() - along);
}

PointPair pair_of(const Eigen::Vector3d& previous, const Eigen::Vector3d& current) {
  return {previous, current, sensor_covariance(previous), sensor_covariance(current)};
}

PointPair exact_pair(const Eigen::Vector3d& current) { return pair_of(kMotion * current, current); }

PointPair noisy_pair(const Eigen::Vector3d& current, Random& random) {
  PointPair pair = exact_pair(current);
  pair.previous += random.gaussian<3>(pair.previous_covariance);
  pair.current += random.gaussian<3>(pair.current_covariance);
  return pair;
}

PointPair false_pair(Random& random) { return pair_of(random_point(random), random_point(random)); }

// Normalised estimation error squared: chi-square with 6 degrees of freedom if the covariance is consistent.
double nees(const MotionEstimate& estimate) {
  const Vector6d error = difference(estimate.previous_from_current, kMotion);
  return error.dot(estimate.covariance.inverse() * error);
}

TEST(Motion, ExactPairsGiveTheExactMotion) {
  for (const int count : {8, 50, 400}) {
    Random random(1);
    std::vector<PointPair> pairs;
    for (int i = 0; i < count; ++i) pairs.push_back(exact_pair(random_point(random)));
    const MotionEstimate estimate = estimate_motion(pairs, {});
    EXPECT_EQ(estimate.status, MotionStatus::determined);
    EXPECT_THAT(estimate.previous_from_current, PoseNear(kMotion, 1e-9, 1e-9));
    EXPECT_EQ(estimate.inliers, count);
    EXPECT_EQ(estimate.pairs, count);
    EXPECT_EQ(estimate.rank, 1);
  }
}

TEST(Motion, ThreePairsAreEnoughWhenAllowed) {
  const std::vector<PointPair> pairs = {exact_pair({-0.1, -0.1, 0.9}), exact_pair({0.1, -0.05, 1.1}),
                                        exact_pair({0, 0.12, 1})};
  const MotionEstimate estimate = estimate_motion(pairs, {.min_inliers = 3});
  EXPECT_EQ(estimate.status, MotionStatus::determined);
  EXPECT_THAT(estimate.previous_from_current, PoseNear(kMotion, 1e-9, 1e-9));
}

// A pair consistent with another motion, e.g. of a second body or a repetitive surface.
PointPair consistent_false_pair(const Pose& motion, Random& random) {
  const Eigen::Vector3d current = random_point(random);
  PointPair pair = pair_of(motion * current, current);
  pair.previous += random.gaussian<3>(pair.previous_covariance);
  pair.current += random.gaussian<3>(pair.current_covariance);
  return pair;
}

// Every fifth pair is correct. With `rivals`, there are three pairs of another common motion for every four correct
// ones.
std::vector<PointPair> mostly_false_pairs(int count, bool rivals, Random& random) {
  const Pose other = {rotation_exp(random.uniform(0.05, 0.5) * random.direction()), 0.05 * random.direction()};
  std::vector<PointPair> pairs;
  for (int i = 0; i < count; ++i) {
    if (i % 5 == 0)
      pairs.push_back(noisy_pair(random_point(random), random));
    else if (rivals && i % 5 == 1 && i / 5 % 4 < 3)
      pairs.push_back(consistent_false_pair(other, random));
    else
      pairs.push_back(false_pair(random));
  }
  return pairs;
}

class FalseMatches : public testing::TestWithParam<int> {
 protected:
  int seed() const { return GetParam(); }
  int count() const { return 40 + 5 * (seed() * 32 / 59); }  // 40 to 200

  void expect_true_motion(const std::vector<PointPair>& pairs) const {
    const MotionEstimate estimate = estimate_motion(pairs, {.min_inliers = 6, .seed = seed()});
    ASSERT_EQ(estimate.status, MotionStatus::determined);
    EXPECT_LT(nees(estimate), kChi2Of6);
    EXPECT_NEAR(estimate.inliers, count() / 5, 2);  // one correct pair in 900 lies beyond 4 sigma
    EXPECT_NEAR(estimate.rank, estimate.inliers / static_cast<double>(count()), 1e-12);
    int right = 0;
    for (size_t i = 0; i < pairs.size(); i += 5) right += estimate.is_inlier[i];
    EXPECT_GE(right, count() / 5 - 2);
  }
};
INSTANTIATE_TEST_SUITE_P(Seeds, FalseMatches, testing::Range(0, 60));

TEST_P(FalseMatches, FourInFiveDoNotMatter) {
  Random random(1000 + seed());
  expect_true_motion(mostly_false_pairs(count(), false, random));
}

TEST_P(FalseMatches, ThatAgreeOnAnotherMotionDoNotMatterWhileTheyAreFewer) {
  Random random(3000 + seed());
  expect_true_motion(mostly_false_pairs(count(), true, random));
}

// With too few correct pairs the motion may be undetermined, but a determined one must be correct.
TEST_P(FalseMatches, NoConfidentWrongAnswer) {
  Random random(5000 + seed());
  const int right = 3 + seed() % 10;
  std::vector<PointPair> pairs;
  for (int i = 0; i < count(); ++i)
    pairs.push_back(i < right ? noisy_pair(random_point(random), random) : false_pair(random));
  const MotionEstimate estimate = estimate_motion(pairs, {.min_rank = 0, .seed = seed()});
  if (estimate.status == MotionStatus::determined) {
    EXPECT_GE(right, 7);
    EXPECT_LT(nees(estimate), kChi2Of6);
  }
}

TEST(Motion, CovarianceIsHonest) {
  constexpr int kDraws = 400;
  Random random(2);
  double sum = 0;
  for (int draw = 0; draw < kDraws; ++draw) {
    std::vector<PointPair> pairs;
    for (int i = 0; i < 40; ++i) pairs.push_back(noisy_pair(random_point(random), random));
    const MotionEstimate estimate = estimate_motion(pairs, {});
    ASSERT_EQ(estimate.status, MotionStatus::determined);
    EXPECT_THAT(estimate.covariance, MatrixNear(estimate.covariance.transpose(), 1e-15));
    sum += nees(estimate);
  }
  // The mean of n draws of chi-square(6) has the standard deviation sqrt(12 / n).
  EXPECT_NEAR(sum / kDraws, 6, 1.96 * std::sqrt(12.0 / kDraws));
}

TEST(Motion, CovarianceIsHonestAmongFalseMatches) {
  constexpr int kDraws = 300;
  double sum = 0;
  for (int draw = 0; draw < kDraws; ++draw) {
    Random random(7000 + draw);
    const MotionEstimate estimate = estimate_motion(mostly_false_pairs(100, true, random), {.seed = draw});
    ASSERT_EQ(estimate.status, MotionStatus::determined) << draw;
    sum += nees(estimate);
  }
  EXPECT_NEAR(sum / kDraws, 6, 1.96 * std::sqrt(12.0 / kDraws));
  RecordProperty("nees", std::to_string(sum / kDraws));
}

TEST(Motion, IdenticalViewsDidNotMove) {
  Random random(12);
  std::vector<PointPair> pairs;
  for (int i = 0; i < 60; ++i) {
    const Eigen::Vector3d point = random_point(random);
    pairs.push_back(pair_of(point, point));
  }
  const MotionEstimate estimate = estimate_motion(pairs, {});
  EXPECT_EQ(estimate.status, MotionStatus::determined);
  EXPECT_THAT(estimate.previous_from_current, PoseNear(Pose{}, 1e-12, 1e-12));
  EXPECT_EQ(estimate.inliers, 60);
}

TEST(Motion, CoplanarPointsAreEnough) {
  Random random(13);
  std::vector<PointPair> pairs;
  for (int i = 0; i < 60; ++i)
    pairs.push_back(noisy_pair({random.uniform(-0.1, 0.1), random.uniform(-0.1, 0.1), 0.9}, random));
  const MotionEstimate estimate = estimate_motion(pairs, {});
  EXPECT_EQ(estimate.status, MotionStatus::determined);
  EXPECT_LT(nees(estimate), kChi2Of6);
  EXPECT_THAT(estimate.undetermined, testing::IsEmpty());
}

TEST(Motion, PairsThatAreNotFiniteDoNotCount) {
  const std::vector<std::function<void(PointPair&)>> spoilers = {
      [](PointPair& pair) { pair.previous.z() = kNaN; },
      [](PointPair& pair) { pair.current.setConstant(kNaN); },
      [](PointPair& pair) { pair.current.x() = kInfinite; },
      [](PointPair& pair) { pair.previous_covariance(1, 1) = kNaN; },
      [](PointPair& pair) { pair.current_covariance(0, 2) = kInfinite; },
      [](PointPair& pair) { pair.previous_covariance = pair.current_covariance.setZero(); }};
  for (size_t kind = 0; kind < spoilers.size(); ++kind) {
    Random random(14);
    std::vector<PointPair> pairs, rest;
    for (int i = 0; i < 90; ++i) {
      pairs.push_back(noisy_pair(random_point(random), random));
      if (i % 3 == 0)
        spoilers[kind](pairs.back());
      else
        rest.push_back(pairs.back());
    }
    const MotionEstimate estimate = estimate_motion(pairs, {}), expected = estimate_motion(rest, {});
    EXPECT_EQ(estimate.status, MotionStatus::determined) << kind;
    EXPECT_EQ(estimate.pairs, 60) << kind;
    EXPECT_EQ(estimate.rank, expected.rank) << kind;
    EXPECT_EQ(estimate.previous_from_current.rotation, expected.previous_from_current.rotation) << kind;
    EXPECT_EQ(estimate.covariance, expected.covariance) << kind;
    ASSERT_EQ(estimate.is_inlier.size(), 90U) << kind;
    for (size_t i = 0; i < 90; i += 3) EXPECT_FALSE(estimate.is_inlier[i]) << kind;

    for (PointPair& pair : pairs) spoilers[kind](pair);
    const MotionEstimate none = estimate_motion(pairs, {});
    EXPECT_EQ(none.status, MotionStatus::too_few_pairs) << kind;
    EXPECT_EQ(none.is_inlier, std::vector<char>(90, 0)) << kind;
  }
}

// The first hypotheses have a handful of inliers in thousands, which requires a practically unlimited number of
// trials.
TEST(Motion, FewRightPairsAmongThousands) {
  Random random(15);
  std::vector<PointPair> pairs;
  for (int i = 0; i < 3000; ++i)
    pairs.push_back(i % 10 == 0 ? noisy_pair(random_point(random), random) : false_pair(random));
  const MotionEstimate estimate = estimate_motion(pairs, {.min_rank = 0.05});
  EXPECT_EQ(estimate.status, MotionStatus::determined);
  EXPECT_LT(nees(estimate), kChi2Of6);
}

TEST(Motion, TooFewPairs) {
  std::vector<PointPair> pairs;
  EXPECT_EQ(estimate_motion(pairs, {}).status, MotionStatus::too_few_pairs);
  Random random(3);
  for (int i = 0; i < 7; ++i) pairs.push_back(exact_pair(random_point(random)));
  const MotionEstimate estimate = estimate_motion(pairs, {});
  EXPECT_EQ(estimate.status, MotionStatus::too_few_pairs);
  EXPECT_EQ(estimate.is_inlier.size(), 7U);
  pairs.resize(2);
  EXPECT_EQ(estimate_motion(pairs, {.min_inliers = 3}).status, MotionStatus::too_few_pairs);
}

TEST(Motion, CollinearPointsLeaveATurnFree) {
  for (const bool noisy : {false, true}) {
    Random random(4);
    std::vector<PointPair> pairs;
    for (int i = 0; i < 40; ++i) {
      const Eigen::Vector3d point = Eigen::Vector3d(-0.1, 0.05, 0.9) + i / 200.0 * Eigen::Vector3d(1, -0.5, 1);
      pairs.push_back(noisy ? noisy_pair(point, random) : exact_pair(point));
    }
    EXPECT_EQ(estimate_motion(pairs, {}).status, MotionStatus::degenerate) << (noisy ? "noisy" : "exact");
  }
}

TEST(Motion, TheRotationThatCollinearPointsLeaveFreeIsReported) {
  const Eigen::Vector3d end(-0.1, 0.05, 0.9), along(1, -0.5, 1);
  for (const bool noisy : {false, true}) {
    Random random(4);
    std::vector<PointPair> pairs;
    for (int i = 0; i < 40; ++i) {
      const Eigen::Vector3d point = end + i / 200.0 * along;
      pairs.push_back(noisy ? noisy_pair(point, random) : exact_pair(point));
    }
    const MotionEstimate estimate = estimate_motion(pairs, {});
    ASSERT_EQ(estimate.undetermined.size(), 1U) << (noisy ? "noisy" : "exact");
    const UnobservableDirection& free = estimate.undetermined[0];
    EXPECT_EQ(free.kind, FreeKind::rotation);
    EXPECT_GT(std::abs(free.axis.dot(kMotion.rotation * along.normalized())), 0.9999);
    EXPECT_LT(free.axis.cross(kMotion * end - free.point_m).norm(), 1e-3);
  }
}

TEST(Motion, ImpreciseMotionsNameWhatIsImprecise) {
  Random random(11);
  std::vector<PointPair> pairs;
  for (int i = 0; i < 50; ++i) pairs.push_back(noisy_pair(random_point(random), random));
  EXPECT_THAT(estimate_motion(pairs, {}).undetermined, testing::IsEmpty());
  EXPECT_THAT(estimate_motion(pairs, {.max_rotation_sigma_deg = 1e-4}).undetermined, testing::Not(testing::IsEmpty()));
  // The scene's position is known to 30 um, the camera's, a metre away, only to ten times that.
  const MotionOptions strict{.max_translation_sigma_m = 1e-4};
  EXPECT_EQ(estimate_motion(pairs, strict).status, MotionStatus::degenerate);
  EXPECT_THAT(estimate_motion(pairs, strict).undetermined, testing::Not(testing::IsEmpty()));
}

TEST(Motion, PointsAtOnePlaceGiveNoMotion) {
  Random random(5);
  std::vector<PointPair> pairs;
  for (int i = 0; i < 40; ++i) pairs.push_back(noisy_pair({0.02, 0.03, 1}, random));
  EXPECT_NE(estimate_motion(pairs, {}).status, MotionStatus::determined);
}

TEST(Motion, RandomPairsHaveNoConsensus) {
  for (int seed = 0; seed < 10; ++seed) {
    Random random(seed);
    std::vector<PointPair> pairs;
    for (int i = 0; i < 60; ++i) pairs.push_back(false_pair(random));
    EXPECT_EQ(estimate_motion(pairs, {.seed = seed}).status, MotionStatus::no_consensus) << seed;
  }
}

TEST(Motion, RankMustExceedItsLimit) {
  const auto status_with = [](int right) {
    Random random(6);
    std::vector<PointPair> pairs;
    for (int i = 0; i < 100; ++i) pairs.push_back(i < right ? exact_pair(random_point(random)) : false_pair(random));
    return estimate_motion(pairs, {.min_rank = 0.2}).status;
  };
  EXPECT_EQ(status_with(20), MotionStatus::no_consensus);
  EXPECT_EQ(status_with(21), MotionStatus::determined);
}

TEST(Motion, ImpreciseMotionIsNotDetermined) {
  Random random(7);
  std::vector<PointPair> pairs;
  for (int i = 0; i < 50; ++i) pairs.push_back(noisy_pair(random_point(random), random));
  const MotionEstimate estimate = estimate_motion(pairs, {});
  ASSERT_EQ(estimate.status, MotionStatus::determined);
  EXPECT_EQ(estimate_motion(pairs, {.max_rotation_sigma_deg = 1e-4}).status, MotionStatus::degenerate);
  EXPECT_EQ(estimate_motion(pairs, {.max_translation_sigma_m = 1e-6}).status, MotionStatus::degenerate);
}

TEST(Motion, TheSameResultOnEveryCall) {
  Random random(8);
  std::vector<PointPair> pairs;
  for (int i = 0; i < 100; ++i) pairs.push_back(i % 2 ? noisy_pair(random_point(random), random) : false_pair(random));
  const MotionEstimate first = estimate_motion(pairs, {});
  for (int call = 0; call < 3; ++call) {
    const MotionEstimate again = estimate_motion(pairs, {});
    EXPECT_EQ(first.previous_from_current.rotation, again.previous_from_current.rotation);
    EXPECT_EQ(first.previous_from_current.translation, again.previous_from_current.translation);
    EXPECT_EQ(first.covariance, again.covariance);
    EXPECT_EQ(first.is_inlier, again.is_inlier);
  }
}

}  // namespace
}  // namespace fringeslam
