// SPDX-License-Identifier: Apache-2.0
// Shadow of a box on a plane, compared with the ray that grazes the box's edge.
#include <gtest/gtest.h>

#include "tests/sim/test_scenes.h"

namespace fringeslam::sim {
namespace {

constexpr double kHeight = 1, kBaseline = 0.4;        // of camera and projector above the table, m
constexpr double kBoxWidth = 0.2, kBoxHeight = 0.15;  // m
constexpr int kBoxId = 2, kTableId = 1;

// Camera above the origin, looking straight down at the table z = 0; image x along world x.
Pose world_from_camera() { return pose_from({{0, 0, 1e3 * kHeight}, {180, 0, 0}}); }

// The projector is offset by kBaseline along +x and also looks straight down, with a wide beam.
RigModel rig() {
  RigModel rig = coaxial_rig();
  rig.camera = {401, 301, 400, 400, 200, 150, {}};
  rig.projector = {2001, 1501, 500, 500, 1000, 750, {}};
  rig.projector_from_camera.translation = {-kBaseline, 0, 0};
  set_lux_at_1m(rig, kWhiteLux);
  return rig;
}

Scene box_on_table() {
  const Pose box{Eigen::Matrix3d::Identity(), {0, 0, kBoxHeight / 2}};
  return world_of(
      {grey_object(plane_mesh(3, 3), Pose{}), grey_object(box_mesh({kBoxWidth, kBoxWidth, kBoxHeight}), box)}, rig());
}

double table_column(double x) { return 200 + 400 * x / kHeight; }
double top_column(double x) { return 200 + 400 * x / (kHeight - kBoxHeight); }

class BoxShadow : public testing::Test {
 protected:
  bool in_shadow(int row, int col) const { return static_cast<int>(truth_.mask(row, col)) & kTruthInShadow; }
  int object(int row, int col) const { return static_cast<int>(truth_.object_id(row, col)); }
  TruthFrame truth_ = truth_of(box_on_table(), 1, world_from_camera());
};

TEST_F(BoxShadow, EndsWhereTheRayOverTheEdgeMeetsTheTable) {
  // The ray from (b, H) over the edge (-w/2, h) meets the table at x = b - (b + w/2) H / (H - h).
  const double x = kBaseline - (kBaseline + kBoxWidth / 2) * kHeight / (kHeight - kBoxHeight);
  const double shadow_end = table_column(x), box_begin = top_column(-kBoxWidth / 2);
  ASSERT_GT(box_begin - shadow_end, 20);  // px of visible shadow
  for (int row = 120; row <= 180; ++row) {
    for (int col = 0; col < 401; ++col) {
      if (std::abs(col - shadow_end) < 1 || std::abs(col - box_begin) < 1) continue;
      const bool expected = col > shadow_end && col < box_begin;
      ASSERT_EQ(in_shadow(row, col), expected) << row << ' ' << col << ", edge at " << shadow_end;
    }
  }
}

TEST_F(BoxShadow, IsWidestAtTheEndsOfTheBox) {
  // The far corners (-w/2, +-w/2, h) cast shadows to y = +-(w/2) H / (H - h); image rows increase along -y.
  const double half_rows = 400 * (kBoxWidth / 2) / (kHeight - kBoxHeight);
  const double x = kBaseline - (kBaseline + kBoxWidth / 2) * kHeight / (kHeight - kBoxHeight);
  const int col = static_cast<int>(table_column(x)) + 3;
  for (int row = 0; row < 301; ++row) {
    if (std::abs(std::abs(row - 150) - half_rows) < 1) continue;
    ASSERT_EQ(in_shadow(row, col), std::abs(row - 150) < half_rows) << row;
  }
}

TEST_F(BoxShadow, TopOfTheBoxIsLitAndItsDepthIsRight) {
  const double half = 400 * (kBoxWidth / 2) / (kHeight - kBoxHeight);
  for (int col = 0; col < 401; ++col) {
    if (std::abs(std::abs(col - 200) - half) < 1) continue;
    const bool on_box = std::abs(col - 200) < half;
    ASSERT_EQ(object(150, col), on_box ? kBoxId : kTableId) << col;
    ASSERT_NEAR(truth_.depth_m(150, col), on_box ? kHeight - kBoxHeight : kHeight, 1e-7) << col;
    if (on_box) {
      ASSERT_FALSE(in_shadow(150, col)) << col;
    }
  }
}

TEST_F(BoxShadow, HoldsAmbientLightOnly) {
  Scene scene = box_on_table();
  scene.ambient_lux = 100;
  const cv::Mat1f image = lux_of(scene, {constant_pattern(1)}, 1, Effects::none(), world_from_camera())[0];
  for (int col = 0; col < 401; ++col) {
    if (in_shadow(150, col)) {
      ASSERT_FLOAT_EQ(image(150, col), 0.5f * 100) << col;
    }
    if (!in_shadow(150, col)) {
      ASSERT_GT(image(150, col), 1000) << col;
    }
  }
}

}  // namespace
}  // namespace fringeslam::sim
