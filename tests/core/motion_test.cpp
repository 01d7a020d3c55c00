// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>

#include <Eigen/LU>

#include "core/motion/ego_motion.h"
#include "tests/support/matchers.h"
#include "tests/support/random.h"

namespace fringeslam {
namespace {

using support::MatrixNear;
using support::PoseNear;
using support::Random;

// 99.99 % of a chi-square distribution of 6 degrees of freedom.
constexpr double kChi2Of6 = 27.86;

const Pose kMotion = pose_from({{30, 10, -15}, {15, -4, 7}});

Eigen::Vector3d random_point(Random& random) {
  return {random.uniform(-0.13, 0.13), random.uniform(-0.12, 0.12), random.uniform(0.8, 1.2)};
}

// Lateral 0.15 mm, depth 0.05 mm, along the viewing ray.
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

// Normalised estimation error squared: chi-square of 6 when the covariance is honest.
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

class FalseMatches : public testing::TestWithParam<int> {};
INSTANTIATE_TEST_SUITE_P(Seeds, FalseMatches, testing::Range(0, 20));

TEST_P(FalseMatches, FourInFiveDoNotMatter) {
  Random random(1000 + GetParam());
  std::vector<PointPair> pairs;
  for (int i = 0; i < 150; ++i)
    pairs.push_back(i % 5 == 0 ? noisy_pair(random_point(random), random) : false_pair(random));
  const MotionEstimate estimate = estimate_motion(pairs, {.seed = GetParam()});
  ASSERT_EQ(estimate.status, MotionStatus::determined);
  EXPECT_LT(nees(estimate), kChi2Of6);
  EXPECT_NEAR(estimate.inliers, 30, 2);  // beyond 4 sigma lies one right pair in 900
  EXPECT_NEAR(estimate.rank, estimate.inliers / 150.0, 1e-12);
  int right = 0;
  for (size_t i = 0; i < pairs.size(); i += 5) right += estimate.is_inlier[i];
  EXPECT_GE(right, 28);
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
