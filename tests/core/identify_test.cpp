// SPDX-License-Identifier: Apache-2.0
// Landmarks of an analytic scene: a slab in front of a tilted wall.
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>

#include "core/landmarks/landmarks.h"
#include "tests/support/scene.h"

namespace fringeslam {
namespace {

using support::observe;
using support::plane;
using support::Random;
using support::small_rig;

const Eigen::Vector3d kWall = Eigen::Vector3d(0.3, -0.2, -1).normalized();

// Image region of the slab, 60 mm in front of the wall and parallel to it.
const cv::Rect kSlab(40, 35, 55, 50);

Frame view(const RigModel& rig, bool with_slab, double noise_m = 3e-5) {
  Random random(4);
  Frame frame = observe(plane(kWall, kWall.z()), rig, {}, noise_m, &random);
  const Frame slab = observe(plane(kWall, kWall.z() + 0.06), rig, {}, noise_m, &random);
  if (with_slab) {
    slab.points_m(kSlab).copyTo(frame.points_m(kSlab));
    slab.sigma_m(kSlab).copyTo(frame.sigma_m(kSlab));
  }
  frame.texture = cv::Mat1b(frame.height(), frame.width());
  for (uchar& value : frame.texture) value = static_cast<uchar>(random.uniform(40, 200));
  return frame;
}

Landmarks identified(const Frame& frame, const RigModel& rig, OutlineSource outlines,
                     LandmarkStages* stages = nullptr) {
  LandmarkOptions options;
  options.outlines = outlines;
  options.min_keypoints = 3;
  return extract_landmarks(frame, detect_keypoints(frame, rig, pixel_rays(rig.camera), {}), rig, {}, {}, {}, options,
                           stages);
}

class BothOutlines : public testing::TestWithParam<OutlineSource> {};

TEST_P(BothOutlines, NoDepthNoLandmarks) {
  const RigModel rig = small_rig(false);
  Frame frame = view(rig, true);
  frame.points_m = cv::Vec3f::all(std::numeric_limits<float>::quiet_NaN());
  const Landmarks landmarks = identified(frame, rig, GetParam());
  EXPECT_TRUE(landmarks.landmarks.empty());
  EXPECT_TRUE(landmarks.depth_keypoints.empty());
  EXPECT_TRUE(landmarks.keypoints.keypoints.empty());
}

TEST_P(BothOutlines, ABareWallIsBackground) {
  const RigModel rig = small_rig(false);
  const Landmarks landmarks = identified(view(rig, false), rig, GetParam());
  EXPECT_TRUE(landmarks.landmarks.empty());
  EXPECT_TRUE(landmarks.depth_keypoints.empty());
  EXPECT_FALSE(landmarks.keypoints.keypoints.empty());
}

TEST_P(BothOutlines, KeypointsOfALandmarkAreWithinItsOutline) {
  const RigModel rig = small_rig(false);
  const Frame frame = view(rig, true);
  for (const Landmark& landmark : identified(frame, rig, GetParam()).landmarks) {
    cv::Rect box = cv::boundingRect(landmark.outline);
    box += cv::Size(12, 12);
    box -= cv::Point(6, 6);
    const Landmarks all = identified(frame, rig, GetParam());
    for (const int k : landmark.keypoints) {
      const Eigen::Vector2d p = all.keypoints.keypoints[static_cast<size_t>(k)].pixel;
      EXPECT_TRUE(box.contains(cv::Point2d(p.x(), p.y())));
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Identify, BothOutlines, testing::ValuesIn(choice_values<OutlineSource>()));

TEST(Identify, ASlabBeforeAWall) {
  const RigModel rig = small_rig(false);
  LandmarkStages stages;
  const Landmarks landmarks = identified(view(rig, true), rig, OutlineSource::regions, &stages);
  cv::Mat1b slab(stages.levels.size(), uchar{0});
  slab(kSlab) = 255;
  EXPECT_EQ(cv::countNonZero(stages.conditioned.foreground != slab), 0);
  ASSERT_EQ(landmarks.landmarks.size(), 1U);
  const cv::Rect box = cv::boundingRect(landmarks.landmarks[0].outline);
  EXPECT_LE((box | kSlab).area() - (box & kSlab).area(), 4 * (kSlab.width + kSlab.height));
  // Its edges form a closed ring, from which nothing was removed.
  EXPECT_GE(cv::countNonZero(stages.conditioned.cleaned), 2 * (kSlab.width + kSlab.height) - 12);
}

TEST(Identify, TheFillTakesTheFartherSide) {
  const RigModel rig = small_rig(false);
  Frame frame = view(rig, true, 0);
  const cv::Mat1f whole = depth_levels(frame, 0.7, 1.4);
  // A shadow to the left of the slab that covers its edge.
  const cv::Rect shadow(kSlab.x - 8, kSlab.y, 12, kSlab.height);
  frame.points_m(shadow) = cv::Vec3f::all(std::numeric_limits<float>::quiet_NaN());
  const cv::Mat1f filled = depth_levels(frame, 0.7, 1.4);
  for (int r = shadow.y; r < shadow.br().y; ++r) {
    for (int c = shadow.x; c < shadow.br().x; ++c) EXPECT_EQ(filled(r, c), whole(r, shadow.x - 1));
  }
}

TEST(Identify, OptionsOutOfRangeAreRefused) {
  ConditioningOptions options;
  options.max_dilations = -1;
  EXPECT_THROW(condition(view(small_rig(false), true), options), Error);
}

}  // namespace
}  // namespace fringeslam
