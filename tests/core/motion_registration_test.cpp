// SPDX-License-Identifier: Apache-2.0
#include "core/registration/motion_registration.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <cmath>
#include <numbers>

#include "tests/support/random.h"
#include "tests/support/scene.h"

namespace fringeslam {
namespace {

using support::bumps;
using support::observe;
using support::Random;
using support::small_rig;

constexpr double kSigma_m = 1e-4, kPriorSigma = 1e-3;  // of a depth, and of each parameter of the motion

// Information that the depths hold about each parameter of the motion, relative to that of the prior: for the ripples below,
// and as in a view of `loop` at 0.3 m/s.
constexpr double kRatios[12] = {0.25, 0.2, 0.07, 0.02, 5e-3, 4e-3, 1e-3, 1e-3, 1e-3, 1e-3, 1e-4, 1e-4};

const Pose kTruth = pose_from({{20, -12, 15}, {1, -1.5, 3}});  // target_from_source

struct View {
  Frame frame;
  std::vector<DepthSlope> slopes;
};

void move_along_ray(cv::Vec3f& point, double by_m) { point *= 1 + static_cast<float>(by_m) / point[2]; }

// Copies an exact view and adds noise to its depths.
Frame noisy(const Frame& exact, Random& random) {
  Frame frame = exact;
  frame.points_m = exact.points_m.clone();
  for (cv::Vec3f& point : frame.points_m) move_along_ray(point, kSigma_m * random.normal());
  return frame;
}

// A view whose depth is distorted by a motion that it was not compensated for. Each parameter causes ripples of its own.
View distorted(Frame frame, const Vector12d& motion) {
  constexpr int kStride = 3;
  View view{std::move(frame), {}};
  const cv::Mat3f& points = view.frame.points_m;
  const double count = static_cast<double>(points.total()) / (kStride * kStride);
  for (int row = 0; row < points.rows; ++row) {
    for (int col = 0; col < points.cols; ++col) {
      DepthSlope slope{row, col, {}};
      for (int i = 0; i < 12; ++i) {
        const double ripple = std::cos(2 * std::numbers::pi * ((i + 3) * col + (7 - i) * row) / points.cols);
        slope.by_motion[i] = std::sqrt(kRatios[i] * 2 * (2 * kSigma_m * kSigma_m) / count) / kPriorSigma * ripple;
      }
      move_along_ray(view.frame.points_m(row, col), -slope.by_motion.dot(motion));
      if (row % kStride == 0 && col % kStride == 0) view.slopes.push_back(slope);
    }
  }
  return view;
}

class MotionRegistrationTest : public testing::Test {
 protected:
  MotionRegistration registered(const Vector12d& motion, uint64_t seed) const {
    Random random(seed);
    const Frame target = noisy(target_, random);
    const View view = distorted(noisy(source_, random), motion);
    const MotionPrior prior{{}, kPriorSigma * kPriorSigma * Matrix12d::Identity()};
    return register_motion(target, view.frame, rig_.camera, kTruth, view.slopes, {}, prior);
  }

  const RigModel rig_ = small_rig(false);
  const Frame target_ = observe(bumps(1, 0.01, 0.15), rig_, {}, kSigma_m),
              source_ = observe(bumps(1, 0.01, 0.15), rig_, kTruth, kSigma_m);
};

TEST_F(MotionRegistrationTest, APriorThatIsRightIsTrustedAndItsCovarianceIsHonest) {
  constexpr int kSeeds = 200;
  Random random(7);
  double nees = 0;
  int doubted = 0;
  for (int seed = 1; seed <= kSeeds; ++seed) {
    const Vector12d motion = kPriorSigma * random.normals<12>();
    const MotionRegistration found = registered(motion, static_cast<uint64_t>(seed));
    ASSERT_TRUE(found.valid);
    const Vector12d error = found.step - motion;
    nees += error.dot(found.motion_covariance.llt().solve(error)) / kSeeds;
    doubted += found.prior_scale > 2;
  }
  EXPECT_EQ(doubted, 0);
  EXPECT_NEAR(nees, 12, 2.6 * std::sqrt(24.0 / kSeeds));
}

TEST_F(MotionRegistrationTest, DepthsThatContradictThePriorPrevail) {
  for (const double sigmas : {30, 100}) {
    for (uint64_t seed = 1; seed <= 10; ++seed) {
      Vector12d motion = Vector12d::Zero();
      motion[0] = sigmas * kPriorSigma;
      const MotionRegistration found = registered(motion, seed);
      ASSERT_TRUE(found.valid);
      EXPECT_GT(found.prior_scale, 10) << sigmas << " sigmas, seed " << seed;
      EXPECT_NEAR(found.step[0], motion[0], 4 * std::sqrt(found.motion_covariance(0, 0)))
          << sigmas << " sigmas, seed " << seed;
    }
  }
}

}  // namespace
}  // namespace fringeslam
