// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/mesh.h"

#include <cmath>
#include <map>
#include <numbers>

#include "sim/scene/noise.h"

namespace fringeslam::sim {

namespace {

Mesh icosahedron() {
  const double g = std::numbers::phi;
  Mesh mesh;
  mesh.vertices = {{-1, g, 0},  {1, g, 0},  {-1, -g, 0}, {1, -g, 0}, {0, -1, g},  {0, 1, g},
                   {0, -1, -g}, {0, 1, -g}, {g, 0, -1},  {g, 0, 1},  {-g, 0, -1}, {-g, 0, 1}};
  for (auto& v : mesh.vertices) v.normalize();
  mesh.triangles = {{0, 11, 5},  {0, 5, 1},  {0, 1, 7},  {0, 7, 10}, {0, 10, 11}, {1, 5, 9}, {5, 11, 4},
                    {11, 10, 2}, {10, 7, 6}, {7, 1, 8},  {3, 9, 4},  {3, 4, 2},   {3, 2, 6}, {3, 6, 8},
                    {3, 8, 9},   {4, 9, 5},  {2, 4, 11}, {6, 2, 10}, {8, 6, 7},   {9, 8, 1}};
  return mesh;
}

// Each triangle into four, new vertices on the unit sphere.
Mesh subdivided(const Mesh& mesh) {
  Mesh fine;
  fine.vertices = mesh.vertices;
  std::map<std::pair<int, int>, int> midpoints;
  const auto midpoint = [&](int a, int b) {
    const auto [entry, is_new] = midpoints.try_emplace(std::minmax(a, b), static_cast<int>(fine.vertices.size()));
    if (is_new)
      fine.vertices.push_back(
          (mesh.vertices[static_cast<size_t>(a)] + mesh.vertices[static_cast<size_t>(b)]).normalized());
    return entry->second;
  };
  for (const Eigen::Vector3i& t : mesh.triangles) {
    const int ab = midpoint(t[0], t[1]), bc = midpoint(t[1], t[2]), ca = midpoint(t[2], t[0]);
    for (const Eigen::Vector3i& part : {Eigen::Vector3i(t[0], ab, ca), {t[1], bc, ab}, {t[2], ca, bc}, {ab, bc, ca}})
      fine.triangles.push_back(part);
  }
  return fine;
}

}  // namespace

Mesh plane_mesh(double size_x, double size_y) {
  const double x = size_x / 2, y = size_y / 2;
  return {{{-x, -y, 0}, {x, -y, 0}, {x, y, 0}, {-x, y, 0}}, {{0, 1, 2}, {0, 2, 3}}};
}

Mesh box_mesh(const Eigen::Vector3d& size) {
  Mesh mesh;
  for (int corner = 0; corner < 8; ++corner) {
    const Eigen::Vector3d sign(corner & 1 ? 1 : -1, corner & 2 ? 1 : -1, corner & 4 ? 1 : -1);
    mesh.vertices.push_back(sign.cwiseProduct(size) / 2);
  }
  mesh.triangles = {{0, 2, 1}, {1, 2, 3}, {4, 5, 6}, {5, 7, 6}, {0, 1, 4}, {1, 5, 4},
                    {2, 6, 3}, {3, 6, 7}, {0, 4, 2}, {2, 4, 6}, {1, 3, 5}, {3, 7, 5}};
  return mesh;
}

Mesh cylinder_mesh(double radius, double length, int sides) {
  Mesh mesh;
  mesh.vertices = {{0, 0, -length / 2}, {0, 0, length / 2}};
  for (int i = 0; i < sides; ++i) {
    const double angle = 2 * std::numbers::pi * i / sides;
    const double x = radius * std::cos(angle), y = radius * std::sin(angle);
    mesh.vertices.emplace_back(x, y, -length / 2);
    mesh.vertices.emplace_back(x, y, length / 2);
  }
  for (int i = 0; i < sides; ++i) {
    const int low = 2 + 2 * i, high = low + 1, next_low = 2 + 2 * ((i + 1) % sides), next_high = next_low + 1;
    for (const Eigen::Vector3i& t :
         {Eigen::Vector3i(low, next_low, high), {next_low, next_high, high}, {0, next_low, low}, {1, high, next_high}})
      mesh.triangles.push_back(t);
  }
  return mesh;
}

Mesh sphere_mesh(double radius, int subdivisions) {
  Mesh mesh = icosahedron();
  for (int i = 0; i < subdivisions; ++i) mesh = subdivided(mesh);
  for (auto& v : mesh.vertices) v *= radius;
  return mesh;
}

Mesh rock_mesh(const Eigen::Vector3d& size, int subdivisions, double roughness, uint32_t seed) {
  Mesh mesh = sphere_mesh(1, subdivisions);
  for (auto& v : mesh.vertices) {
    const double radius = 1 + roughness * fractal_noise(v * 2.0 + Eigen::Vector3d::Constant(10), 5, seed);
    v = (v * radius).cwiseProduct(size) / 2;
  }
  return mesh;
}

}  // namespace fringeslam::sim
