// SPDX-License-Identifier: Apache-2.0
#include "sim/nearest_surface.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>

#include "sim/random.h"
#include "tests/sim/test_scenes.h"

namespace fringeslam::sim {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

Eigen::Vector3d random_point(Philox& random, double half_edge) {
  const double x = random.uniform(-half_edge, half_edge), y = random.uniform(-half_edge, half_edge);
  return {x, y, random.uniform(-half_edge, half_edge)};
}

// Distance from a point, inside or outside, to the surface of a box centred at the origin.
double box_distance(const Eigen::Vector3d& point, const Eigen::Vector3d& size) {
  const Eigen::Vector3d beyond = point.cwiseAbs() - size / 2;
  return beyond.maxCoeff() < 0 ? -beyond.maxCoeff() : beyond.cwiseMax(0).norm();
}

// Point-triangle distance by ternary search over the segments from points of side ab to c; the distance is convex.
double distance_by_search(const Eigen::Vector3d& p, const Eigen::Vector3d& a, const Eigen::Vector3d& b,
                          const Eigen::Vector3d& c) {
  const auto to_segment = [&](double share) {
    const Eigen::Vector3d from = a + share * (b - a), along = c - from;
    const double t = std::clamp((p - from).dot(along) / along.squaredNorm(), 0.0, 1.0);
    return (p - from - t * along).norm();
  };
  double low = 0, high = 1;
  for (int i = 0; i < 100; ++i) {
    const double one = low + (high - low) / 3, other = high - (high - low) / 3;
    to_segment(one) < to_segment(other) ? high = other : low = one;
  }
  return to_segment((low + high) / 2);
}

double distance_by_search(const Eigen::Vector3d& point, const Mesh& mesh) {
  double least = kInfinity;
  for (const Eigen::Vector3i& t : mesh.triangles) {
    const auto at = [&](int i) { return mesh.vertices.at(static_cast<size_t>(t[i])); };
    least = std::min(least, distance_by_search(point, at(0), at(1), at(2)));
  }
  return least;
}

TEST(NearestSurface, OfABoxIsItsClosedForm) {
  const Eigen::Vector3d size(0.5, 0.4, 0.3);
  const NearestSurface box(box_mesh(size));
  Philox random(1, Stream::shape, 0);
  for (int i = 0; i < 5000; ++i) {
    const Eigen::Vector3d point = random_point(random, 0.5);
    EXPECT_NEAR(box.distance_m(point, 1), box_distance(point, size), 1e-15);
  }
  EXPECT_EQ(box.distance_m({0.25, 0.1, 0.1}, 1), 0);
}

// Also tested far from the origin, where single precision resolves only 8 um.
TEST(NearestSurface, OfTurnedAndRepeatedObjectsIsThatOfTheNearest) {
  const Eigen::Vector3d size(0.5, 0.4, 0.3);
  const auto mesh = std::make_shared<const Mesh>(box_mesh(size));
  for (const Eigen::Vector3d& centre : {Eigen::Vector3d(0, 0, 0), Eigen::Vector3d(100, -50, 20)}) {
    Philox random(2, Stream::shape, 0);
    std::vector<Object> objects;
    for (int i = 0; i < 20; ++i) {
      Object object;
      object.mesh = mesh;
      object.world_from_object = {rotation_exp(random_point(random, 3)), centre + random_point(random, 2)};
      objects.push_back(object);
    }
    const NearestSurface boxes(world_of(objects, coaxial_rig()));
    std::vector<Eigen::Vector3d> points;
    for (int i = 0; i < 2000; ++i) points.push_back(centre + random_point(random, 2));
    const std::vector<double> distances = boxes.distances_m(points, 10);
    for (size_t i = 0; i < points.size(); ++i) {
      double least = kInfinity;
      for (const Object& object : objects)
        least = std::min(least, box_distance(object.world_from_object.inverse() * points[i], size));
      EXPECT_NEAR(distances[i], least, 1e-13);
      EXPECT_EQ(distances[i], boxes.distance_m(points[i], 10));
    }
  }
}

TEST(NearestSurface, OfASphereIsThatOfAllItsTriangles) {
  constexpr double kRadius = 0.2;
  const Mesh mesh = sphere_mesh(kRadius, 2);
  const NearestSurface sphere(mesh);
  Philox random(3, Stream::shape, 0);
  for (int i = 0; i < 200; ++i) {
    const Eigen::Vector3d point = random_point(random, 0.4);
    const double distance = sphere.distance_m(point, kInfinity);
    EXPECT_NEAR(distance, distance_by_search(point, mesh), 1e-9);
    EXPECT_NEAR(distance, std::abs(point.norm() - kRadius), 0.02 * kRadius);
  }
}

TEST(NearestSurface, IsInfiniteBeyondWhatIsAskedFor) {
  const NearestSurface plane(plane_mesh(2, 2));
  EXPECT_NEAR(plane.distance_m({0.1, 0.2, 0.001}, 0.0010001), 0.001, 1e-15);
  EXPECT_EQ(plane.distance_m({0.1, 0.2, 0.001}, 0.0009999), kInfinity);
  EXPECT_NEAR(plane.distance_m({1.3, 0.2, 0.4}, 0.6), 0.5, 1e-15);
  EXPECT_EQ(plane.distance_m({1.3, 0.2, 0.4}, 0.49), kInfinity);
  EXPECT_EQ(plane.distance_m({0, 0, 1e6}, kInfinity), 1e6);
}

TEST(NearestSurface, OfNothingIsInfinite) {
  EXPECT_EQ(NearestSurface(Mesh{}).distance_m({0, 0, 0}, kInfinity), kInfinity);
  EXPECT_TRUE(NearestSurface(Mesh{}).distances_m({}, 1).empty());
}

TEST(NearestSurface, OfATriangleWithoutAreaIsThatOfItsEdges) {
  const Mesh segment{{{0, 0, 0}, {1, 0, 0}, {0.5, 0, 0}}, {{0, 1, 2}}};
  EXPECT_NEAR(NearestSurface(segment).distance_m({0.7, 0.3, 0}, 1), 0.3, 1e-15);
  const Mesh point{{{0, 0, 0}, {0, 0, 0}, {0, 0, 0}}, {{0, 1, 2}}};
  EXPECT_NEAR(NearestSurface(point).distance_m({0.3, 0.4, 0}, 1), 0.5, 1e-15);
}

}  // namespace
}  // namespace fringeslam::sim
