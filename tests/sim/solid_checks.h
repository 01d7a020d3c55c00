// SPDX-License-Identifier: Apache-2.0
// Invariants of closed meshes, for the tests of solids and furniture.
#pragma once

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <map>
#include <utility>

#include "sim/scene/mesh.h"

namespace fringeslam::sim {

inline std::array<Eigen::Vector3d, 3> corners_of(const Mesh& mesh, const Eigen::Vector3i& t) {
  const auto at = [&](int i) { return mesh.vertices.at(static_cast<size_t>(t[i])); };
  return {at(0), at(1), at(2)};
}

// Returns the enclosed volume by the divergence theorem; positive if the triangles face outwards.
inline double signed_volume(const Mesh& mesh) {
  double sum = 0;
  for (const Eigen::Vector3i& t : mesh.triangles) {
    const auto [a, b, c] = corners_of(mesh, t);
    sum += a.dot(b.cross(c)) / 6;
  }
  return sum;
}

inline Eigen::AlignedBox3d bounds_of(const Mesh& mesh) {
  Eigen::AlignedBox3d box;
  for (const auto& v : mesh.vertices) box.extend(v);
  return box;
}

// On a closed surface, every directed edge occurs exactly once, as does its reverse.
inline void expect_closed(const Mesh& mesh) {
  std::map<std::pair<int, int>, int> edges;
  for (const Eigen::Vector3i& t : mesh.triangles) {
    for (int i = 0; i < 3; ++i) ++edges[{t[i], t[(i + 1) % 3]}];
  }
  for (const auto& [edge, count] : edges) {
    ASSERT_EQ(count, 1) << edge.first << " -> " << edge.second;
    ASSERT_EQ(edges.count({edge.second, edge.first}), 1u) << edge.second << " -> " << edge.first << " is missing";
  }
}

// Expects every triangle's height above its longest side to exceed 1 um.
inline void expect_no_degenerate_triangle(const Mesh& mesh) {
  for (const Eigen::Vector3i& t : mesh.triangles) {
    const auto [a, b, c] = corners_of(mesh, t);
    const double longest = std::max({(b - a).norm(), (c - b).norm(), (a - c).norm()});
    ASSERT_GT((b - a).cross(c - a).norm() / longest, 1e-6) << a.transpose();
  }
}

inline void expect_finite_and_used(const Mesh& mesh) {
  std::vector<bool> used(mesh.vertices.size(), false);
  for (const Eigen::Vector3i& t : mesh.triangles) {
    for (const int i : t) used.at(static_cast<size_t>(i)) = true;
  }
  EXPECT_TRUE(std::all_of(used.begin(), used.end(), [](bool is) { return is; }));
  for (const auto& v : mesh.vertices) ASSERT_TRUE(v.allFinite());
}

// Splits the mesh into its connected parts.
inline std::vector<Mesh> connected_parts(const Mesh& mesh) {
  std::vector<int> parent(mesh.vertices.size());
  for (size_t i = 0; i < parent.size(); ++i) parent[i] = static_cast<int>(i);
  const auto root = [&](int i) {
    while (parent[static_cast<size_t>(i)] != i) i = parent[static_cast<size_t>(i)];
    return i;
  };
  for (const Eigen::Vector3i& t : mesh.triangles) {
    const int first = root(t[0]);
    for (const int i : {t[1], t[2]}) parent[static_cast<size_t>(root(i))] = first;
  }
  std::map<int, Mesh> parts;
  for (const Eigen::Vector3i& t : mesh.triangles) {
    Mesh& part = parts[root(t[0])];
    part.vertices = mesh.vertices;
    part.triangles.push_back(t);
  }
  std::vector<Mesh> result;
  for (auto& [first, part] : parts) result.push_back(std::move(part));
  return result;
}

inline void expect_sound(const Mesh& mesh) {
  ASSERT_FALSE(mesh.triangles.empty());
  expect_closed(mesh);
  expect_no_degenerate_triangle(mesh);
  expect_finite_and_used(mesh);
  for (const Mesh& part : connected_parts(mesh)) EXPECT_GT(signed_volume(part), 0);
}

}  // namespace fringeslam::sim
