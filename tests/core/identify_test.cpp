// SPDX-License-Identifier: Apache-2.0
// Landmarks of an analytic scene: a slab in front of a tilted wall.
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <array>
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

Landmarks identified(const Frame& frame, const RigModel& rig, OutlineSource outlines, LandmarkStages* stages = nullptr,
                     const ClusterOptions& clusters = {}) {
  LandmarkOptions options;
  options.outlines = outlines;
  options.min_keypoints = 3;
  return extract_landmarks(frame, detect_keypoints(frame, rig, pixel_rays(rig.camera), {}), rig, {}, {}, clusters,
                           options, stages);
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

INSTANTIATE_TEST_SUITE_P(Identify, BothOutlines, testing::ValuesIn(choice_values<OutlineSource>()));

// Two slabs with bumps, which have depth keypoints.
const std::array kSlabs = {cv::Rect(14, 20, 46, 56), cv::Rect(74, 24, 46, 60)};

Frame view_of_slabs(const RigModel& rig) {
  constexpr int kSpacing = 14;
  constexpr double kBump_m = 0.01, kSigma_px = 4;
  Frame frame = view(rig, false);
  Random random(5);
  const Frame slabs = observe(plane(kWall, kWall.z() + 0.06), rig, {}, 3e-5, &random);
  for (const cv::Rect& slab : kSlabs) {
    for (int r = slab.y; r < slab.br().y; ++r) {
      for (int c = slab.x; c < slab.br().x; ++c) {
        const double dr = (r - slab.y) % kSpacing - kSpacing / 2, dc = (c - slab.x) % kSpacing - kSpacing / 2;
        const double bump_m = kBump_m * std::exp(-(dr * dr + dc * dc) / (2 * kSigma_px * kSigma_px));
        const cv::Vec3f point = slabs.points_m(r, c);
        frame.points_m(r, c) = point * static_cast<float>(1 - bump_m / point[2]);
      }
    }
  }
  return frame;
}

struct Outliner {
  OutlineSource source;
  ClusterMethod method;
};

cv::Point rounded(const Eigen::Vector2d& p) {
  return {static_cast<int>(std::lround(p.x())), static_cast<int>(std::lround(p.y()))};
}

class EveryOutline : public testing::TestWithParam<Outliner> {};

TEST_P(EveryOutline, LandmarksLieOnOneObjectEach) {
  const RigModel rig = small_rig(false);
  const Frame frame = view_of_slabs(rig);
  ClusterOptions clusters;
  clusters.method = GetParam().method;
  const Landmarks found = identified(frame, rig, GetParam().source, nullptr, clusters);
  ASSERT_EQ(found.landmarks.size(), kSlabs.size());
  std::array<bool, kSlabs.size()> has_landmark{};
  for (const Landmark& landmark : found.landmarks) {
    const cv::Rect box = cv::boundingRect(landmark.outline);
    const size_t i = (box & kSlabs[0]).area() > 0 ? 0 : 1;
    has_landmark[i] = true;
    // An edge may be off by two pixels.
    const cv::Rect slab = kSlabs[i] + cv::Size(4, 4) - cv::Point(2, 2);
    EXPECT_EQ(box & slab, box);
    EXPECT_GT(box.area(), kSlabs[i].area() / 4);
    for (const int k : landmark.depth_keypoints)
      EXPECT_TRUE(slab.contains(rounded(found.depth_keypoints[static_cast<size_t>(k)].pixel)));
    EXPECT_GE(landmark.keypoints.size(), 6U);
    for (const int k : landmark.keypoints) {
      const cv::Point pixel = rounded(found.keypoints.keypoints[static_cast<size_t>(k)].pixel);
      EXPECT_GE(cv::pointPolygonTest(landmark.outline, pixel, true), -LandmarkOptions{}.margin_px - 1);
    }
  }
  EXPECT_TRUE(has_landmark[0] && has_landmark[1]);
}

INSTANTIATE_TEST_SUITE_P(Identify, EveryOutline,
                         testing::Values(Outliner{OutlineSource::regions, ClusterMethod::both},
                                         Outliner{OutlineSource::clusters, ClusterMethod::depth_sampling},
                                         Outliner{OutlineSource::clusters, ClusterMethod::convex_hull},
                                         Outliner{OutlineSource::clusters, ClusterMethod::both}));

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
