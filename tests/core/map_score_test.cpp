// SPDX-License-Identifier: Apache-2.0
// Map statistics against hand-computed values.
#include "core/score/map_score.h"

#include <gmock/gmock.h>

#include <cmath>

#include "tests/support/matchers.h"

namespace fringeslam {
namespace {

using support::error_of;

TEST(MapScore, ByHand) {
  // Accuracy: mean 3/5, squares 0 + 1 + 1 + 0 + 1 (mm). Completeness: the 90th percentile is 1 + 0.9 (3 - 1) mm.
  const MapScore score = score_map({0, 0.001, 0.001, 0, 0.001}, {0.003, 0.001}, 0.001);
  EXPECT_EQ(score.accuracy.points, 5u);
  EXPECT_DOUBLE_EQ(score.accuracy.mean_m, 0.0006);
  EXPECT_DOUBLE_EQ(score.accuracy.rms_m, std::sqrt(0.6) * 1e-3);
  EXPECT_DOUBLE_EQ(score.accuracy.median_m, 0.001);
  EXPECT_DOUBLE_EQ(score.completeness.p90_m, 0.0028);
  EXPECT_EQ(score.precision, 1);
  EXPECT_EQ(score.recall, 0.5);
  EXPECT_DOUBLE_EQ(score.f_score(), 2.0 / 3);
  EXPECT_EQ(score_map({1}, {1}, 0.001).f_score(), 0);
}

RigModel rig_of_8x8_px() {
  RigModel rig;
  rig.camera = {8, 8, 100, 100, 3.5, 3.5, {}};
  rig.near_m = 0.5, rig.far_m = 2;
  return rig;
}

// A wall 1 m in front of the camera.
TruthFrame truth_of_8x8_px() {
  TruthFrame truth;
  truth.depth_m = cv::Mat1f(8, 8, 1.0F);
  truth.normals = cv::Mat3f(8, 8, cv::Vec3f(0, 0, -1));
  truth.position_m = cv::Mat3f(8, 8, cv::Vec3f(1, 2, 3));
  truth.mask = cv::Mat1f(8, 8, kTruthSurface | kTruthInBeam | kTruthVictim | kTruthThermal);
  return truth;
}

// The rows and columns 2 and 6 of 8 x 8 pixels are sampled.
TEST(MapScore, OnlyWhatTheSensorSeesIsToBeFound) {
  const RigModel rig = rig_of_8x8_px();
  TruthFrame truth = truth_of_8x8_px();
  const auto seen = [&] {
    std::vector<Eigen::Vector3d> points;
    append_visible_surface(truth, rig, pixel_rays(rig.camera), points);
    return points.size();
  };
  EXPECT_EQ(seen(), 4u);
  truth.mask(2, 2) += static_cast<float>(kTruthInShadow);
  truth.mask(2, 6) += static_cast<float>(kTruthMixed);
  EXPECT_EQ(seen(), 2u);
  truth.depth_m(6, 2) = 2.1F;
  EXPECT_EQ(seen(), 1u);
  truth.normals(6, 6) = {0.9962F, 0, -0.0872F};  // 85 degrees
  EXPECT_EQ(seen(), 0u);
}

TEST(MapScore, TruthThatDoesNotFitTheCameraIsAnError) {
  RigModel rig = rig_of_8x8_px();
  TruthFrame truth = truth_of_8x8_px();
  const auto see = [&] {
    std::vector<Eigen::Vector3d> points;
    append_visible_surface(truth, rig, pixel_rays(rig.camera), points);
  };
  truth.position_m.release();
  EXPECT_THAT(error_of(see), testing::HasSubstr("the ground truth's position has 0x0 px but the rig's camera 8x8"));
  truth = truth_of_8x8_px();
  rig.camera.height = 4;
  EXPECT_THAT(error_of(see), testing::HasSubstr("has 8x8 px but the rig's camera 8x4"));
}

}  // namespace
}  // namespace fringeslam
