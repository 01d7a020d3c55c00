// SPDX-License-Identifier: Apache-2.0
// Panes of glass, compared with Fresnel's equations and with the mirror images of what they reflect.
#include "sim/light/panes.h"

#include <gmock/gmock.h>

#include "sim/nearest_surface.h"
#include "tests/sim/test_scenes.h"
#include "tests/support/matchers.h"

namespace fringeslam::sim {
namespace {

constexpr double kFace = 0.04;  // glass of refractive index 1.5

Object pane(const Pose& world_from_object, double size_m = 4) {
  Object object = grey_object(plane_mesh(size_m, size_m), world_from_object, 0);
  object.material.pane = true;
  object.material.reflectance = kFace;
  return object;
}

Object wall(const Pose& world_from_object) { return grey_object(plane_mesh(3, 3), world_from_object); }

Effects with_panes() {
  Effects effects = Effects::none();
  effects.panes = true;
  return effects;
}

Eigen::Vector3d ray(const RigModel& rig, int row, int col) {
  return Eigen::Vector3d((col - rig.camera.cx) / rig.camera.fx, (row - rig.camera.cy) / rig.camera.fy, 1).normalized();
}

TEST(SheetReflectance, FollowsFresnel) {
  EXPECT_NEAR(sheet_reflectance(kFace, 1), 2 * kFace / (1 + kFace), 1e-12);
  EXPECT_NEAR(sheet_reflectance(kFace, 0), 1, 1e-12);
  // At Brewster's angle a face reflects no p-polarized light, and ((n^2 - 1) / (n^2 + 1))^2 of the s-polarized light.
  const double brewster = std::atan(1.5), s = std::pow((1.5 * 1.5 - 1) / (1.5 * 1.5 + 1), 2);
  EXPECT_NEAR(sheet_reflectance(kFace, std::cos(brewster)), s / (1 + s), 1e-12);
}

// Light of the projector passes the pane twice; the camera also sees the surroundings mirrored.
TEST(Panes, WeakenTheLightThatPasses) {
  const RigModel rig = coaxial_rig();
  Scene scene = world_of({wall(pose_from({{0, 0, 1000}, {0, 0, 0}})), pane(pose_from({{0, 0, 500}, {0, 0, 0}}))}, rig);
  scene.ambient_lux = 100;
  const std::vector<Pattern> patterns = {constant_pattern(1), constant_pattern(0)};
  const auto seen = lux_of(scene, patterns, 1, with_panes()), without = lux_of(scene, patterns);
  for (int row = 0; row < rig.camera.height; row += 6) {
    for (int col = 0; col < rig.camera.width; col += 8) {
      const double reflected = sheet_reflectance(kFace, ray(rig, row, col).z()), passed = 1 - reflected;
      const auto value = [&](const std::vector<cv::Mat1f>& images, size_t i) {
        return static_cast<double>(images[i](row, col));
      };
      EXPECT_NEAR((value(seen, 0) - value(seen, 1)) / (value(without, 0) - value(without, 1)), passed * passed, 1e-5);
      EXPECT_NEAR(value(seen, 1), 100 * (0.5 * passed + reflected), 1e-3);
    }
  }
}

// A pane at 45 degrees shows a wall beside the camera, in the light that it mirrors onto the wall: an image behind the pane,
// seen through two reflections.
TEST(Panes, MirrorSurfacesAndTheBeam) {
  const RigModel rig = coaxial_rig();
  const Scene scene =
      world_of({wall(pose_from({{-1000, 0, 1000}, {0, 90, 0}})), pane(pose_from({{0, 0, 1000}, {0, 45, 0}}), 1)}, rig);
  const Scene image = world_of({wall(pose_from({{0, 0, 2000}, {0, 0, 0}}))}, rig);
  const std::vector<Pattern> patterns = {constant_pattern(1), {Axis::columns, 23, 0.4, 0}, {Axis::rows, 31, 0, 0}};
  const auto seen = lux_of(scene, patterns, 1, with_panes()), direct = lux_of(image, patterns);
  const Eigen::Vector3d normal(std::sqrt(0.5), 0, std::sqrt(0.5));
  for (size_t k = 0; k < patterns.size(); ++k) {
    for (int row = 0; row < rig.camera.height; row += 6) {
      for (int col = 0; col < rig.camera.width; col += 8) {
        const double reflected = sheet_reflectance(kFace, ray(rig, row, col).dot(normal));
        const auto expected = static_cast<double>(direct[k](row, col)) * reflected * reflected;
        EXPECT_NEAR(static_cast<double>(seen[k](row, col)), expected, 1e-4 * expected + 1e-3) << k;
      }
    }
  }
}

// A projector that looks away from the scene lights it by a pane, as its mirror image does.
TEST(Panes, MirrorTheProjector) {
  RigModel away = coaxial_rig(), behind = coaxial_rig();
  away.projector_from_camera.rotation = Eigen::Vector3d(-1, 1, -1).asDiagonal();
  behind.projector_from_camera.translation = {0, 0, 2};
  const Pose at = pose_from({{0, 0, 1000}, {0, 0, 0}});
  const Scene scene = world_of({wall(at), pane(pose_from({{0, 0, -1000}, {0, 0, 0}}))}, away);
  const Scene image = world_of({wall(at)}, behind);
  const std::vector<Pattern> patterns = {constant_pattern(1), {Axis::columns, 12, 0.4, 0}};
  TruthFrame truth;
  const auto seen = lux_of(scene, patterns, 1, with_panes(), {}, &truth), direct = lux_of(image, patterns);
  for (int row = 0; row < away.camera.height; row += 6) {
    for (int col = 0; col < away.camera.width; col += 8) {
      const Eigen::Vector3d d = ray(away, row, col);
      const double r = std::hypot(d.x(), d.y()) / d.z(), cosine = 3 / std::hypot(3, r);
      for (size_t k = 0; k < patterns.size(); ++k) {
        const int there = away.camera.width - 1 - col;  // the mirror image swaps left and right
        const auto expected =
            static_cast<double>(direct[k](row, k == 0 ? col : there)) * sheet_reflectance(kFace, cosine);
        EXPECT_NEAR(static_cast<double>(seen[k](row, col)), expected, 1e-4 * expected + 1e-3) << k;
      }
      EXPECT_EQ(truth.indirect_share(row, col), 1) << "no light comes directly";
    }
  }
}

TEST(Panes, AreInvisibleToTheGroundTruth) {
  const Pose at = pose_from({{0, 0, 1000}, {10, 20, 0}});
  const Scene without = world_of({wall(at)}, coaxial_rig());
  const Scene with = world_of({pane(pose_from({{0, 0, 500}, {0, 30, 0}})), wall(at)}, coaxial_rig());
  const TruthFrame plain = truth_of(without), behind = truth_of(with);
  for (int row = 0; row < plain.depth_m.rows; row += 6) {
    for (int col = 0; col < plain.depth_m.cols; col += 8) {
      EXPECT_EQ(plain.depth_m(row, col), behind.depth_m(row, col));
      EXPECT_EQ(plain.projector_column(row, col), behind.projector_column(row, col));
      EXPECT_EQ(behind.object_id(row, col), 2) << "objects keep their numbers";
    }
  }
  EXPECT_EQ(NearestSurface(with).distances_m({{0, 0, 0.5}}, 2), NearestSurface(without).distances_m({{0, 0, 0.5}}, 2));
}

TEST(Panes, OfManyTrianglesAreRefused) {
  Object ball = grey_object(sphere_mesh(0.1, 3), {});
  ball.name = "object 1";
  ball.material.pane = true;
  EXPECT_THAT(support::error_of([&] { Panes{world_of({ball}, coaxial_rig())}; }),
              testing::HasSubstr("object 1: the panes of a scene may have 64 triangles; use shape plane"));
}

}  // namespace
}  // namespace fringeslam::sim
