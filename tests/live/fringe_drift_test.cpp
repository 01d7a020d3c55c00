// SPDX-License-Identifier: Apache-2.0
// Does the robot move too fast for its fringes?
#include "tools/live/fringe_drift.h"

#include <gmock/gmock.h>

#include <algorithm>

#include "tests/support/scene.h"

namespace fringeslam {
namespace {

using support::observe;
using tools::fringe_drift;
using tools::kFastestDrift;
using tools::mean_twist;

constexpr double kPeriodPx = 16.5, kRateHz = 90;

class DriftOnAPlane : public testing::Test {
 protected:
  DriftOnAPlane() { rig_.timing.camera_rate_hz = kRateHz; }

  // Reference: projects what the centre pixel sees at two nearby times; the plane is z = 1 m before the motion.
  double true_drift(const CameraTwist& twist) const {
    const double step_s = 1 / kRateHz;
    const Pose motion{rotation_exp(step_s * twist.angular_rad_s), step_s * twist.velocity_m_s};
    std::vector<double> drifts;
    for (int row = 0; row < rig_.camera.height; row += 8) {
      for (int col = 0; col < rig_.camera.width; col += 8) {
        const Eigen::Vector2d ray = rig_.camera.undistort(Eigen::Vector2d(col, row));
        const Eigen::Vector3d d(ray.x(), ray.y(), 1);
        const auto column_at = [&](const Pose& world_from_camera) {
          const Eigen::Vector3d along = world_from_camera.rotation * d;
          const double depth = (1 - world_from_camera.translation.z()) / along.z();
          return rig_.projector.project(rig_.projector_from_camera * Eigen::Vector3d(depth * d)).x();
        };
        drifts.push_back(std::abs(column_at(motion) - column_at({})));
      }
    }
    std::nth_element(drifts.begin(), drifts.begin() + static_cast<long>(drifts.size() / 2), drifts.end());
    return drifts[drifts.size() / 2] / kPeriodPx;
  }
  double drift(const CameraTwist& twist, double period_px = kPeriodPx) const {
    return fringe_drift(view_, pixel_rays(rig_.camera), rig_, twist, period_px).value();
  }

  RigModel rig_ = support::small_rig(true);
  const Frame view_ = observe(support::plane(Eigen::Vector3d::UnitZ(), 1), rig_, {}, 0);
};

TEST_F(DriftOnAPlane, IsThatOfTheProjectedPoints) {
  for (const CameraTwist& twist :
       {CameraTwist{{0, 0, 0}, {0, 0, 0.02}}, CameraTwist{{0, 0, 0}, {0, 0, -0.05}},
        CameraTwist{{0.01, 0.02, 0}, {0.03, 0, 0.01}}, CameraTwist{{0, 0.05, 0.1}, {0, 0, 0}}})
    EXPECT_NEAR(drift(twist), true_drift(twist), 0.02 * true_drift(twist) + 1e-5);
  // Motion along the surface and rotation about its normal cause no drift.
  EXPECT_NEAR(drift({{0, 0, 0.3}, {0.2, 0.1, 0}}), 0, 1e-6);
  EXPECT_EQ(drift({}), 0);
}

TEST_F(DriftOnAPlane, GrowsWithSpeedAndWithFinerFringes) {
  const CameraTwist slow{{0, 0, 0}, {0, 0, 0.02}}, fast{{0, 0, 0}, {0, 0, 0.06}};
  EXPECT_NEAR(drift(fast), 3 * drift(slow), 1e-9);
  EXPECT_NEAR(drift(slow, kPeriodPx / 2), 2 * drift(slow), 1e-9);
}

TEST_F(DriftOnAPlane, NoneIsKnownWithoutPointsOrFringes) {
  EXPECT_FALSE(fringe_drift(view_, pixel_rays(rig_.camera), rig_, {}, 0));
  Frame empty = view_;
  empty.points_m = cv::Mat3f(view_.points_m.size(), cv::Vec3f::all(std::nanf("")));
  EXPECT_FALSE(fringe_drift(empty, pixel_rays(rig_.camera), rig_, {}, kPeriodPx));
}

TEST(FringeDrift, IsSaidAboveTheLimitWithWhatToDo) {
  EXPECT_THAT(tools::drift_warnings(std::nullopt), testing::IsEmpty());
  EXPECT_THAT(tools::drift_warnings(0), testing::IsEmpty());
  EXPECT_THAT(tools::drift_warnings(kFastestDrift), testing::IsEmpty());
  EXPECT_THAT(
      tools::drift_warnings(0.2),
      testing::ElementsAre("Moving too fast: from image to image fringes drift by 20 % of their period. Slow down "
                           "to 25 % of this speed."));
}

TEST(FringeDrift, TheTwistIsTheMotionASecond) {
  const Pose motion{rotation_exp({0, 0, 0.2}), {0.1, 0, 0}};
  const CameraTwist twist = mean_twist(motion, 0.5);
  EXPECT_NEAR((twist.angular_rad_s - Eigen::Vector3d(0, 0, 0.4)).norm(), 0, 1e-12);
  EXPECT_NEAR((twist.velocity_m_s - Eigen::Vector3d(0.2, 0, 0)).norm(), 0, 1e-12);
  EXPECT_EQ(mean_twist(motion, 0).velocity_m_s.norm(), 0);
}

}  // namespace
}  // namespace fringeslam
