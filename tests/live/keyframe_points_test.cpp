// SPDX-License-Identifier: Apache-2.0
// Encoded keyframe points, parsed as the live page's script parses them.
#include "tools/live/keyframe_points.h"

#include <gmock/gmock.h>

#include <cstring>

#include "tests/support/scene.h"

namespace fringeslam {
namespace {

using support::observe;
using tools::keyframe_points;

struct Points {
  uint32_t count = 0;
  float step_m = 0, sigma_step_m = 0;
  std::vector<int16_t> positions;
  std::vector<uint8_t> grey, sigma;

  Eigen::Vector3d position_m(size_t i) const {
    return static_cast<double>(step_m) * Eigen::Vector3d(positions[3 * i], positions[3 * i + 1], positions[3 * i + 2]);
  }
};

Points read(const std::string& bytes) {
  Points points;
  const char* at = bytes.data();
  const auto take = [&](void* target, size_t size) {
    ASSERT_LE(at + size, bytes.data() + bytes.size());
    if (size > 0) std::memcpy(target, at, size);
    at += size;
  };
  take(&points.count, 4);
  take(&points.step_m, 4);
  take(&points.sigma_step_m, 4);
  points.positions.resize(3 * points.count);
  points.grey.resize(points.count);
  points.sigma.resize(points.count);
  take(points.positions.data(), 6 * points.count);
  take(points.grey.data(), points.count);
  take(points.sigma.data(), points.count);
  EXPECT_EQ(at, bytes.data() + bytes.size());
  return points;
}

class PointsOfAPlane : public testing::Test {
 protected:
  PointsOfAPlane() {
    frame_.texture = cv::Mat1b(frame_.points_m.size(), 77);
    frame_.sigma_m = cv::Mat1f(frame_.points_m.size(), 1e-4f);
  }
  Points points(int most) const { return read(keyframe_points(stored(frame_), pixel_rays(rig_.camera), most)); }

  const RigModel rig_ = support::small_rig(false);
  Frame frame_ = observe(support::plane(Eigen::Vector3d::UnitZ(), 0.9), rig_, {}, 0);
};

TEST_F(PointsOfAPlane, LieOnIt) {
  const Points all = points(1000);
  EXPECT_GT(all.count, 500u);
  EXPECT_LT(all.step_m, 5e-5);
  for (size_t i = 0; i < all.count; ++i) {
    EXPECT_NEAR(all.position_m(i).z(), 0.9, all.step_m);
    EXPECT_EQ(all.grey[i], 77);
    EXPECT_NEAR(all.sigma[i] * all.sigma_step_m, 1e-4, 2e-6);
  }
  // The first grid pixel is the image's corner.
  const Eigen::Vector2d corner = rig_.camera.undistort({0, 0});
  EXPECT_NEAR((all.position_m(0).head<2>() - 0.9 * corner).norm(), 0, 2 * all.step_m);
}

TEST_F(PointsOfAPlane, AreAtMostAsManyAsAllowed) {
  for (const int most : {1, 10, 999, 1000, 100000}) EXPECT_LE(points(most).count, static_cast<unsigned>(most));
  EXPECT_EQ(points(100000).count, 133u * 125u);
}

TEST_F(PointsOfAPlane, AreNoneWhereThereIsNoDepth) {
  frame_.points_m(cv::Rect(0, 0, 133, 60)).setTo(cv::Scalar::all(std::nan("")));
  const Points half = points(100000);
  EXPECT_EQ(half.count, 133u * 65u);
  for (size_t i = 0; i < half.count; ++i) EXPECT_NEAR(half.position_m(i).z(), 0.9, half.step_m);
  frame_.points_m.setTo(cv::Scalar::all(std::nan("")));
  EXPECT_EQ(points(1000).count, 0u);
}

TEST_F(PointsOfAPlane, SigmasBeyondTheScaleAreItsEnd) {
  frame_.sigma_m.setTo(0.004f);
  EXPECT_EQ(points(10).sigma.front(), 255);
}

}  // namespace
}  // namespace fringeslam
