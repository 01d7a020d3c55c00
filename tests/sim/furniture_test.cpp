// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/furniture.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "sim/light/ray_scene.h"
#include "tests/sim/solid_checks.h"
#include "tests/sim/test_scenes.h"

namespace fringeslam::sim {
namespace {

void expect_stands(const Mesh& mesh, const Eigen::Vector3d& size) {
  const Eigen::AlignedBox3d box = bounds_of(mesh);
  EXPECT_LT((box.min() - Eigen::Vector3d(-size.x() / 2, -size.y() / 2, 0)).norm(), 1e-12);
  EXPECT_LT((box.sizes() - size).norm(), 1e-12);
}

// Height of the surface above (x, y).
double height_at(const RayScene& world, double x, double y) {
  const auto hit = world.trace({x, y, 10}, {0, 0, -1});
  return hit ? hit->point.z() : 0;
}

// Fraction of parallel rays, spread over a rectangle, that hit nothing.
double open_share(const Mesh& mesh, const Eigen::Vector3d& corner, const Eigen::Vector3d& across,
                  const Eigen::Vector3d& up, const Eigen::Vector3d& direction) {
  const RayScene world(world_of({grey_object(mesh, {})}, coaxial_rig()));
  constexpr int kRays = 200;
  int open = 0;
  for (int i = 0; i < kRays * kRays; ++i) {
    const Eigen::Vector3d place =
        corner + (i % kRays + 0.5) / kRays * across + (static_cast<double>(i / kRays) + 0.5) / kRays * up;
    open += !world.trace(place - direction, direction);
  }
  return static_cast<double>(open) / kRays / kRays;
}

TEST(Furniture, WedgeIsHalfABoxAndRisesAlongX) {
  const Eigen::Vector3d size(0.5, 0.3, 0.2);
  const Mesh wedge = wedge_mesh(size);
  expect_sound(wedge);
  expect_stands(wedge, size);
  EXPECT_NEAR(signed_volume(wedge), size.prod() / 2, 1e-15);
  const RayScene world(world_of({grey_object(wedge, {})}, coaxial_rig()));
  for (double x = -0.24; x < 0.25; x += 0.04)
    EXPECT_NEAR(height_at(world, x, 0.1), size.z() * (x / size.x() + 0.5), 1e-12);
}

TEST(Furniture, BowlIsAShiftedParaboloid) {
  const Eigen::Vector3d size(0.2, 0.3, 0.1);
  const Mesh bowl = bowl_mesh(size);
  expect_sound(bowl);
  expect_stands(bowl, size);
  // Every vertical line inside the rim crosses the same thickness. The rim is a polygon of 96 corners.
  const double polygon = 96 / 2.0 * std::sin(2 * std::numbers::pi / 96);
  EXPECT_NEAR(signed_volume(bowl), polygon * size.x() / 2 * size.y() / 2 * size.z() / 10, 1e-12);
}

TEST(Furniture, StairsHaveTheirStepsAndVolume) {
  const Eigen::Vector3d size(0.6, 0.4, 0.45);
  for (const int steps : {1, 3, 12}) {
    const Mesh stairs = stairs_mesh(size, steps);
    expect_sound(stairs);
    expect_stands(stairs, size);
    EXPECT_NEAR(signed_volume(stairs), size.prod() * (steps + 1) / (2 * steps), 1e-14);
    const RayScene world(world_of({grey_object(stairs, {})}, coaxial_rig()));
    for (int step = 0; step < steps; ++step) {
      const double x = size.x() * ((step + 0.5) / steps - 0.5);
      EXPECT_NEAR(height_at(world, x, -0.1), size.z() * (step + 1) / steps, 1e-12);
    }
  }
}

TEST(Furniture, BlindsHaveTheVolumeOfSlatsAndPosts) {
  const double width = 0.8, height = 0.6, thickness = 0.003;
  const int slats = 12;
  const double pitch = height / slats;
  for (const double angle : {0.0, 0.6, -1.2, kPi / 2}) {
    const Mesh blinds = blinds_mesh(width, height, slats, angle, thickness);
    expect_sound(blinds);
    expect_stands(blinds, {width, pitch, height});
    const double slat = (width - thickness) * (pitch - thickness) * thickness;
    EXPECT_NEAR(signed_volume(blinds), slats * slat + 2 * thickness * pitch * height, 1e-15);
  }
}

TEST(Furniture, OneLooksThroughBlindsBetweenTheShadowsOfTheirSlats) {
  const double width = 0.8, height = 0.6, thickness = 0.003;
  const int slats = 12;
  const double pitch = height / slats;
  for (const double angle : {0.0, 0.6, -0.6, kPi / 2}) {
    const Mesh blinds = blinds_mesh(width, height, slats, angle, thickness);
    const double shadow = (pitch - thickness) * std::abs(std::sin(angle)) + thickness * std::cos(angle);
    const double share = open_share(blinds, {-width / 4, 0, 0}, {width / 2, 0, 0}, {0, 0, height}, {0, 1, 0});
    EXPECT_NEAR(share, 1 - shadow / pitch, 0.03) << angle;
  }
}

TEST(Furniture, LatticeIsOpenByItsShare) {
  const double size_x = 0.5, size_y = 0.4, thickness = 0.02;
  for (const double share : {0.25, 0.5, 0.8}) {
    const Mesh lattice = lattice_mesh(size_x, size_y, thickness, 5, 4, share);
    expect_sound(lattice);
    expect_stands(lattice, {size_x, size_y, thickness});
    EXPECT_NEAR(signed_volume(lattice), size_x * size_y * thickness * (1 - share), 1e-15);
    const double seen = open_share(lattice, {-size_x / 2, -size_y / 2, 0}, {size_x, 0, 0}, {0, size_y, 0}, {0, 0, -1});
    EXPECT_NEAR(seen, share, 0.04);
  }
}

}  // namespace
}  // namespace fringeslam::sim
