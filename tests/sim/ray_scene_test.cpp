// SPDX-License-Identifier: Apache-2.0
#include "sim/light/ray_scene.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <atomic>
#include <chrono>
#include <limits>
#include <opencv2/core.hpp>
#include <opencv2/core/utility.hpp>
#include <thread>

#include "sim/random.h"
#include "tests/sim/test_scenes.h"

namespace fringeslam::sim {
namespace {

RayScene world_with(std::vector<Object> objects) { return RayScene(world_of(std::move(objects), coaxial_rig())); }

Eigen::Vector3d random_direction(Philox& random) {
  const double z = random.uniform(-1, 1), angle = random.uniform(0, 2 * kPi), radius = std::sqrt(1 - z * z);
  return {radius * std::cos(angle), radius * std::sin(angle), z};
}

// Distance along a ray to its first intersection with a sphere around the origin.
double sphere_distance(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction, double radius) {
  const double a = direction.squaredNorm(), b = origin.dot(direction), c = origin.squaredNorm() - radius * radius;
  return (-b - std::sqrt(b * b - a * c)) / a;
}

// Radius of the inscribed sphere of a mesh around the origin; the mesh lies between it and the sphere through its
// vertices.
double inner_radius(const Mesh& mesh) {
  double least = std::numeric_limits<double>::infinity();
  for (const Eigen::Vector3i& t : mesh.triangles) {
    const Eigen::Vector3d a = mesh.vertices.at(static_cast<size_t>(t[0]));
    const Eigen::Vector3d b = mesh.vertices.at(static_cast<size_t>(t[1]));
    const Eigen::Vector3d c = mesh.vertices.at(static_cast<size_t>(t[2]));
    least = std::min(least, std::abs((b - a).cross(c - a).normalized().dot(a)));
  }
  return least;
}

TEST(RayScene, MeetsATiltedPlaneAtItsExactDepth) {
  const Pose world_from_plane = pose_from({{20, -30, 1000}, {25, -40, 10}});
  const RayScene world = world_with({grey_object(plane_mesh(4, 4), world_from_plane)});
  const Eigen::Vector3d normal = world_from_plane.rotation.col(2);
  for (double x = -0.3; x <= 0.3; x += 0.05) {
    for (double y = -0.3; y <= 0.3; y += 0.05) {
      const Eigen::Vector3d origin(0.1, 0.2, -0.3), direction(x, y, 1);
      const auto hit = world.trace(origin, direction);
      ASSERT_TRUE(hit) << x << ' ' << y;
      const double truth = normal.dot(world_from_plane.translation - origin) / normal.dot(direction);
      EXPECT_NEAR(hit->distance, truth, 1e-13);
      EXPECT_LT((hit->point - (origin + truth * direction)).norm(), 1e-13);
      EXPECT_LT(hit->normal.dot(direction), 0);
      EXPECT_NEAR(std::abs(hit->normal.dot(normal)), 1, 1e-14);
    }
  }
}

TEST(RayScene, DistanceIsInUnitsOfTheDirection) {
  const RayScene world = world_with({grey_object(plane_mesh(2, 2), {Eigen::Matrix3d::Identity(), {0, 0, 3}})});
  for (const double length : {0.25, 1.0, 8.0}) {
    const auto hit = world.trace({0, 0, 0}, Eigen::Vector3d(0.1, 0.05, 1) * length);
    ASSERT_TRUE(hit);
    EXPECT_NEAR(hit->distance, 3 / length, 1e-13);
  }
}

TEST(RayScene, NormalFacesTheRayFromBothSides) {
  const RayScene world = world_with({grey_object(plane_mesh(2, 2), Pose{})});
  const auto above = world.trace({0.1, 0.2, 1}, {0, 0, -1}), below = world.trace({0.1, 0.2, -1}, {0, 0, 1});
  ASSERT_TRUE(above && below);
  EXPECT_EQ(above->normal, Eigen::Vector3d(0, 0, 1));
  EXPECT_EQ(below->normal, Eigen::Vector3d(0, 0, -1));
}

TEST(RayScene, MeetsASphereBetweenItsFacetsAndItsVertices) {
  constexpr double kRadius = 0.2;
  const Mesh sphere = sphere_mesh(kRadius, 5);
  const double inner = inner_radius(sphere);
  ASSERT_GT(inner, kRadius * (1 - 5e-4));  // otherwise the bounds below are too loose
  const RayScene world = world_with({grey_object(sphere, Pose{})});
  Philox random(3, Stream::shape, 0);
  for (int i = 0; i < 5000; ++i) {
    const Eigen::Vector3d origin = random_direction(random);  // 1 m away
    const Eigen::Vector3d aim = 0.99 * inner * random_direction(random);
    const Eigen::Vector3d direction = (aim - origin).normalized();
    const auto hit = world.trace(origin, direction);
    ASSERT_TRUE(hit);
    EXPECT_GE(hit->distance, sphere_distance(origin, direction, kRadius) - 1e-12);
    EXPECT_LE(hit->distance, sphere_distance(origin, direction, inner) + 1e-12);
    // A facet's normal equals the sphere's normal at the facet's circumcentre, at most its circumradius away.
    EXPECT_GT(hit->normal.dot(hit->point.normalized()), 0.999);
  }
}

TEST(RayScene, ClosedSurfacesDoNotLeak) {
  const Pose world_from_mesh = pose_from({{10, 20, 30}, {10, 20, 30}});
  const Eigen::Vector3d inside(0.01, 0.02, 0.03);
  for (const Mesh& mesh : {box_mesh({0.5, 0.4, 0.3}), sphere_mesh(0.2, 4), cylinder_mesh(0.2, 0.5, 64)}) {
    const RayScene world = world_with({grey_object(mesh, world_from_mesh)});
    Philox random(4, Stream::shape, 0);
    int leaks = 0;
    for (int i = 0; i < 20000; ++i) leaks += !world.trace(inside, random_direction(random));
    EXPECT_EQ(leaks, 0);
    // Rays aimed at the edges shared by two triangles.
    for (const Eigen::Vector3i& t : mesh.triangles) {
      const Eigen::Vector3d a = world_from_mesh * mesh.vertices.at(static_cast<size_t>(t[0]));
      const Eigen::Vector3d b = world_from_mesh * mesh.vertices.at(static_cast<size_t>(t[1]));
      for (int i = 0; i < 10; ++i) leaks += !world.trace(inside, a + random.uniform() * (b - a) - inside);
    }
    EXPECT_EQ(leaks, 0);
  }
}

TEST(RayScene, ReturnsTheNearestObject) {
  const Pose far{Eigen::Matrix3d::Identity(), {0, 0, 2}}, near{Eigen::Matrix3d::Identity(), {0, 0, 1}};
  const RayScene world =
      world_with({grey_object(plane_mesh(2, 2), far, 0.2), grey_object(box_mesh({0.2, 0.2, 0.2}), near, 0.7)});
  const auto box = world.trace({0, 0, 0}, {0, 0, 1}), plane = world.trace({0, 0, 0}, {0.2, 0, 1});
  ASSERT_TRUE(box && plane);
  EXPECT_EQ(box->object, 1);
  EXPECT_NEAR(box->distance, 0.9, 1e-14);
  EXPECT_EQ(plane->object, 0);
}

// A packet gives the same hits as single rays.
TEST(RayScene, PacketsAgreeWithSingleRays) {
  const RayScene world = world_with({grey_object(sphere_mesh(0.3, 4), {Eigen::Matrix3d::Identity(), {0, 0, 1}}),
                                     grey_object(plane_mesh(3, 3), pose_from({{0, 0, 1500}, {20, 10, 0}}))});
  const Eigen::Vector3d light(0.5, 0.2, 0);
  for (int turn = 0; turn < 20; ++turn) {
    RayPacket rays;
    for (int i = 0; i < kPacket; ++i) {
      rays.origin.set(i, {0, 0, 0});
      rays.direction.set(i, {0.0513 * (i % 4) - 0.3971 + 0.0397 * turn, 0.0517 * (i / 4) - 0.1013, 1});
    }
    rays.active = 0xfff7;
    HitPacket hits;
    world.trace(rays, hits);
    const LaneMask dark = world.occluded(RayScene::lifted(hits), hits.hit, light);
    for (int i = 0; i < kPacket; ++i) {
      const auto single = world.trace(rays.origin.at(i), rays.direction.at(i));
      if (i == 3) {
        EXPECT_FALSE(has(hits.hit, i));
        continue;
      }
      ASSERT_EQ(has(hits.hit, i), single.has_value());
      if (!single) continue;
      EXPECT_EQ(hits.object[i], single->object);
      EXPECT_NEAR(hits.distance[i], single->distance, 1e-12);
      EXPECT_LT((hits.normal.at(i) - single->normal).norm(), 1e-12);
      EXPECT_EQ(has(dark, i), world.occluded(*single, light));
    }
  }
}

TEST(RayScene, SeesNothingInAnEmptyWorldOrBesideTheObjects) {
  EXPECT_FALSE(world_with({}).trace({0, 0, 0}, {0, 0, 1}));
  const RayScene world = world_with({grey_object(plane_mesh(1, 1), {Eigen::Matrix3d::Identity(), {0, 0, 1}})});
  EXPECT_TRUE(world.trace({0, 0, 0}, {0.4999, 0, 1}));
  EXPECT_FALSE(world.trace({0, 0, 0}, {0.5001, 0, 1}));
  EXPECT_FALSE(world.trace({0, 0, 0}, {0, 0, -1}));  // behind the origin
}

TEST(RayScene, OccludedOnlyByWhatLiesBetween) {
  // A floor, and a ball of radius 0.1 one metre above it.
  const RayScene world = world_with({grey_object(plane_mesh(6, 6), Pose{}),
                                     grey_object(sphere_mesh(0.1, 4), {Eigen::Matrix3d::Identity(), {0, 0, 1}})});
  const auto floor_at = [&](double x) { return world.trace({x, 0, 0.5}, {0, 0, -1}).value(); };
  EXPECT_TRUE(world.occluded(floor_at(0), {0, 0, 2}));
  EXPECT_FALSE(world.occluded(floor_at(0), {0, 0, 0.85})) << "the target lies in front of the ball";
  EXPECT_FALSE(world.occluded(floor_at(1), {1, 0, 2}));
  EXPECT_FALSE(world.occluded(floor_at(0), {2, 0, 1.5}));
  // Seen from the light at (0, 0, 2), the ball subtends the half angle asin(0.1 / 1): its shadow on the floor has the
  // radius 2 tan(asin(0.1)).
  const double edge = 2 * std::tan(std::asin(0.1));
  EXPECT_TRUE(world.occluded(floor_at(0.99 * edge), {0, 0, 2}));
  EXPECT_FALSE(world.occluded(floor_at(1.01 * edge), {0, 0, 2}));
}

TEST(RayScene, SurfacesDoNotShadowThemselves) {
  const RayScene world = world_with({grey_object(plane_mesh(6, 6), pose_from({{0, 0, 0}, {20, 30, 0}}))});
  const Eigen::Vector3d normal = pose_from({{0, 0, 0}, {20, 30, 0}}).rotation.col(2);
  Philox random(5, Stream::shape, 0);
  int shadowed = 0;
  for (int i = 0; i < 20000; ++i) {
    const auto hit = world.trace(normal * 2, Eigen::Vector3d(-normal + 0.7 * random_direction(random)));
    if (!hit) continue;
    // Directions down to half a degree above the surface.
    Eigen::Vector3d grazing = random_direction(random);
    grazing = (grazing - grazing.dot(normal) * normal).normalized();
    shadowed += world.occluded(*hit, hit->point + 2 * (grazing + 0.0087 * normal));
  }
  EXPECT_EQ(shadowed, 0);
}

// Live and recorded images must give the same bytes, and worker threads the same results as the main thread. Therefore
// tracing must not change the floating-point mode.
TEST(RayScene, LeavesTheFloatingPointModeOfTheCallerAlone) {
  volatile double tiny = std::numeric_limits<double>::min();
  ASSERT_GT(tiny / 4, 0);
  const RayScene world = world_with({grey_object(plane_mesh(1, 1), Pose{})});
  EXPECT_GT(tiny / 4, 0) << "denormal numbers are flushed to zero on this thread from now on";
}

// Returns the largest number of threads that execute the body of a parallel loop concurrently.
int parallel_threads() {
  std::atomic<int> inside{0}, most{0};
  cv::parallel_for_(
      cv::Range(0, 8),
      [&](const cv::Range&) {
        most = std::max(most.load(), ++inside);
        std::this_thread::sleep_for(std::chrono::milliseconds(20));
        --inside;
      },
      8);
  return most;
}

TEST(RayScene, LeavesTheThreadsOfTheCallerAlone) {
  if (parallel_threads() < 2) GTEST_SKIP() << "only one processor";
  const RayScene world = world_with({grey_object(plane_mesh(1, 1), Pose{})});
  EXPECT_GE(parallel_threads(), 2) << "parallel loops run on one thread while a RayWorld exists";
}

// Instances of a shared mesh give the same hits as copies of the mesh, for single rays and for packets.
TEST(RayScene, SharedMeshesAreMetWhereCopiesAre) {
  const auto rock = std::make_shared<const Mesh>(rock_mesh({0.2, 0.3, 0.25}, 3, 0.3, 5));
  std::vector<Object> shared, copies;
  Philox random(3, Stream::placement, 0);
  for (int i = 0; i < 40; ++i) {
    Object object;
    object.mesh = rock;
    object.world_from_object = {rotation_exp(3 * random_direction(random)), 2 * random_direction(random)};
    shared.push_back(object);
    object.mesh = std::make_shared<const Mesh>(*rock);
    copies.push_back(object);
  }
  const RayScene one = world_with(shared), other = world_with(copies);
  int hits = 0;
  for (int i = 0; i < 10000; ++i) {
    RayPacket rays;
    rays.active = 1;
    const Eigen::Vector3d origin = 4 * random_direction(random);
    const Eigen::Vector3d target = 1.5 * random_direction(random);
    for (int lane = 0; lane < kPacket; ++lane) rays.origin.set(lane, origin), rays.direction.set(lane, target - origin);
    HitPacket packet;
    one.trace(rays, packet);
    const auto a = one.trace(origin, target - origin), b = other.trace(origin, target - origin);
    ASSERT_EQ(a.has_value(), has(packet.hit, 0));
    if (!a || !b || a->object != b->object) continue;  // silhouette rays may hit either object
    ++hits;
    EXPECT_NEAR((a->point - b->point).norm(), 0, 1e-9);
    EXPECT_NEAR((a->normal - b->normal).norm(), 0, 1e-9);
    EXPECT_NEAR((a->point - packet.point.at(0)).norm(), 0, 1e-12);
    EXPECT_EQ(a->object, packet.object[0]);
    EXPECT_EQ(one.occluded(*a, origin), other.occluded(*b, origin));
  }
  EXPECT_GT(hits, 500);
}

// Packets of shadow rays with instances terminate and agree with single rays.
TEST(RayScene, ShadowPacketsAmongSharedMeshes) {
  const auto rock = std::make_shared<const Mesh>(rock_mesh({0.1, 0.1, 0.1}, 3, 0.3, 5));
  std::vector<Object> objects = {grey_object(plane_mesh(2, 2), {})};
  Philox random(3, Stream::placement, 0);
  for (int i = 0; i < 30; ++i) {
    Object object;
    object.mesh = rock;
    object.world_from_object = {rotation_exp(3 * random_direction(random)),
                                {random.uniform(-0.5, 0.5), random.uniform(-0.5, 0.5), random.uniform(0.05, 0.3)}};
    objects.push_back(object);
  }
  const RayScene world = world_with(objects);
  const Eigen::Vector3d eye(0, 0, 1), lamp(-0.25, 0, 1);
  int agree = 0, asked = 0;
  for (int i = 0; i < 1000; ++i) {
    RayPacket rays;
    rays.active = kAllLanes;
    const Eigen::Vector3d middle(random.uniform(-0.5, 0.5), random.uniform(-0.5, 0.5), 0);
    for (int lane = 0; lane < kPacket; ++lane) {
      rays.origin.set(lane, eye);
      rays.direction.set(lane, middle + Eigen::Vector3d(0.002 * (lane % 4), 0.002 * (lane / 4), 0) - eye);
    }
    HitPacket hits;
    world.trace(rays, hits);
    const LaneMask dark = world.occluded(RayScene::lifted(hits), hits.hit, lamp);
    for (int lane = 0; lane < kPacket; ++lane) {
      const auto hit = world.trace(eye, rays.direction.at(lane));
      if (!hit || !has(hits.hit, lane)) continue;
      ++asked;
      agree += world.occluded(*hit, lamp) == has(dark, lane);
    }
  }
  EXPECT_GT(asked, 15000);
  EXPECT_GT(agree, asked - 20);  // silhouette rays may differ
}

}  // namespace
}  // namespace fringeslam::sim
