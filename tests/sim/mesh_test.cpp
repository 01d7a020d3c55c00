// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/mesh.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <map>
#include <numbers>
#include <set>

namespace fringeslam::sim {
namespace {

constexpr double kPi = std::numbers::pi;

const Eigen::Vector3d& corner(const Mesh& mesh, const Eigen::Vector3i& triangle, int i) {
  return mesh.vertices.at(static_cast<size_t>(triangle[i]));
}

// Enclosed volume by the divergence theorem: the sum of the signed volumes of the tetrahedra from the origin to each
// triangle; positive if the triangles are counter-clockwise seen from outside.
double volume(const Mesh& mesh) {
  double sum = 0;
  for (const Eigen::Vector3i& t : mesh.triangles)
    sum += corner(mesh, t, 0).dot(corner(mesh, t, 1).cross(corner(mesh, t, 2))) / 6;
  return sum;
}

// On a closed surface, every directed edge occurs exactly once, as does its reverse.
void expect_closed(const Mesh& mesh) {
  std::map<std::pair<int, int>, int> edges;
  for (const Eigen::Vector3i& t : mesh.triangles) {
    for (int i = 0; i < 3; ++i) ++edges[{t[i], t[(i + 1) % 3]}];
  }
  for (const auto& [edge, count] : edges) {
    ASSERT_NE(edge.first, edge.second);
    ASSERT_EQ(count, 1) << edge.first << " -> " << edge.second;
    ASSERT_EQ(edges.count({edge.second, edge.first}), 1u) << edge.second << " -> " << edge.first << " is missing";
  }
}

// Unused or duplicate vertices indicate an open seam.
void expect_each_vertex_used_once(const Mesh& mesh) {
  std::set<int> used;
  for (const Eigen::Vector3i& t : mesh.triangles) used.insert({t[0], t[1], t[2]});
  EXPECT_EQ(used.size(), mesh.vertices.size());
  std::set<std::array<double, 3>> places;
  for (const Eigen::Vector3d& v : mesh.vertices) places.insert({v.x(), v.y(), v.z()});
  EXPECT_EQ(places.size(), mesh.vertices.size());
}

void expect_solid(const Mesh& mesh) {
  expect_closed(mesh);
  expect_each_vertex_used_once(mesh);
}

TEST(Mesh, BoxIsClosedAndHasItsVolume) {
  const Mesh box = box_mesh({0.3, 0.2, 0.05});
  expect_solid(box);
  EXPECT_NEAR(volume(box), 0.3 * 0.2 * 0.05, 1e-16);
}

TEST(Mesh, BoxTrianglesFaceOutwards) {
  const Mesh box = box_mesh({0.3, 0.2, 0.05});
  ASSERT_EQ(box.triangles.size(), 12u);
  for (const Eigen::Vector3i& t : box.triangles) {
    const Eigen::Vector3d a = corner(box, t, 0), b = corner(box, t, 1), c = corner(box, t, 2);
    EXPECT_GT((b - a).cross(c - a).dot((a + b + c) / 3), 0);
  }
}

TEST(Mesh, CylinderIsAPrismWithTheVolumeOfItsPolygon) {
  const double radius = 0.04, length = 0.1;
  for (const int sides : {3, 64, 96}) {
    const Mesh cylinder = cylinder_mesh(radius, length, sides);
    expect_solid(cylinder);
    const double polygon = sides / 2.0 * radius * radius * std::sin(2 * kPi / sides);
    EXPECT_NEAR(volume(cylinder), polygon * length, 1e-16) << sides;
  }
  EXPECT_NEAR(volume(cylinder_mesh(radius, length, 96)), kPi * radius * radius * length,
              1e-3 * kPi * radius * radius * length);
}

TEST(Mesh, SphereApproachesItsVolumeFourTimesCloserWithEachSubdivision) {
  const double radius = 0.05, truth = 4.0 / 3.0 * kPi * std::pow(radius, 3);
  double previous = 0;
  for (int subdivisions = 0; subdivisions <= 5; ++subdivisions) {
    const Mesh sphere = sphere_mesh(radius, subdivisions);
    expect_solid(sphere);
    EXPECT_EQ(sphere.triangles.size(), 20u << (2 * subdivisions));
    for (const Eigen::Vector3d& v : sphere.vertices) ASSERT_NEAR(v.norm(), radius, 1e-15);
    const double deficit = 1 - volume(sphere) / truth;
    if (subdivisions > 1) {
      EXPECT_NEAR(previous / deficit, 4, 0.4) << subdivisions;
    }
    previous = deficit;
  }
  EXPECT_GT(previous, 0);  // inscribed
  EXPECT_LT(previous, 1e-3);
}

TEST(Mesh, SmoothRockIsAnEllipsoid) {
  const Eigen::Vector3d size(0.1, 0.06, 0.04);
  const Mesh rock = rock_mesh(size, 5, 0, 1);
  expect_solid(rock);
  const double truth = kPi / 6 * size.prod();
  EXPECT_NEAR(volume(rock), truth, 1e-3 * truth);
}

TEST(Mesh, RockIsClosedBoundedAndAFunctionOfItsSeed) {
  const Eigen::Vector3d size(0.1, 0.06, 0.04);
  const Mesh rock = rock_mesh(size, 4, 0.25, 7);
  expect_solid(rock);
  for (const Eigen::Vector3d& v : rock.vertices) {
    const double radius = v.cwiseQuotient(size / 2).norm();
    ASSERT_GE(radius, 0.75);
    ASSERT_LE(radius, 1.25);
  }
  EXPECT_EQ(rock_mesh(size, 4, 0.25, 7).vertices, rock.vertices);
  EXPECT_NE(rock_mesh(size, 4, 0.25, 8).vertices, rock.vertices);
}

TEST(Mesh, PlaneFacesUpAndHasItsSize) {
  const Mesh plane = plane_mesh(0.4, 0.3);
  double area = 0;
  for (const Eigen::Vector3i& t : plane.triangles) {
    const Eigen::Vector3d twice =
        (corner(plane, t, 1) - corner(plane, t, 0)).cross(corner(plane, t, 2) - corner(plane, t, 0));
    EXPECT_GT(twice.z(), 0);
    area += twice.norm() / 2;
  }
  EXPECT_NEAR(area, 0.4 * 0.3, 1e-16);
  for (const Eigen::Vector3d& v : plane.vertices) EXPECT_EQ(v.z(), 0);
}

}  // namespace
}  // namespace fringeslam::sim
