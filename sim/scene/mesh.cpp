// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/mesh.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <mutex>
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

// Splits each triangle into four, with the new vertices on the unit sphere.
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

// Memoised, because subdivision takes most of the time of building a stone and scenes contain many.
Mesh unit_sphere(int subdivisions) {
  static std::mutex mutex;
  static std::vector<Mesh> spheres = {icosahedron()};
  const std::lock_guard lock(mutex);
  while (static_cast<int>(spheres.size()) <= subdivisions) spheres.push_back(subdivided(spheres.back()));
  return spheres[static_cast<size_t>(subdivisions)];
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
  Mesh mesh = unit_sphere(subdivisions);
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

namespace {

// Evaluates the face height over the unit disc, x towards the left eye, y towards the brow; the centre of the
// underlying half ellipsoid has height 1.
double face_height(double x, double y) {
  const auto bump = [&](double cx, double cy, double wx, double wy) {
    const double dx = (x - cx) / wx, dy = (y - cy) / wy;
    return std::exp(-0.5 * (dx * dx + dy * dy));
  };
  const double rim = std::max(0.0, 1 - x * x - y * y);
  double height = std::pow(rim, 0.4);
  const double side = std::abs(x);  // a face is symmetric
  const auto pair = [&](double cx, double cy, double wx, double wy) {
    const double dx = (side - cx) / wx, dy = (y - cy) / wy;
    return std::exp(-0.5 * (dx * dx + dy * dy));
  };
  // The nose widens and rises from between the eyes to the tip.
  const double along = std::clamp((0.28 - y) / 0.38, 0.0, 1.0);
  height +=
      0.42 * along * bump(0, y, 0.05 + 0.07 * along, 1) * (y < -0.1 ? std::exp(-std::pow((y + 0.1) / 0.05, 2)) : 1);
  height += 0.10 * pair(0.36, 0.40, 0.20, 0.07);   // brows
  height -= 0.22 * pair(0.36, 0.22, 0.13, 0.08);   // sockets
  height += 0.10 * pair(0.36, 0.21, 0.07, 0.04);   // lids
  height += 0.10 * pair(0.48, -0.10, 0.16, 0.16);  // cheeks
  height += 0.12 * bump(0, -0.36, 0.20, 0.045);    // lips
  height += 0.11 * bump(0, -0.46, 0.16, 0.04);
  height -= 0.06 * bump(0, -0.41, 0.20, 0.015);
  height += 0.10 * bump(0, -0.72, 0.18, 0.12);  // chin
  return std::min(1.0, 4 * rim) * height;
}

}  // namespace

Mesh face_mask_mesh(const Eigen::Vector3d& size, int rings) {
  const int spokes = 4 * rings;
  Mesh mesh;
  const auto add = [&](double radius, double angle) {
    const double x = radius * std::cos(angle), y = radius * std::sin(angle);
    mesh.vertices.emplace_back(0.5 * size.x() * x, 0.5 * size.y() * y, size.z() / 1.4 * face_height(x, y));
  };
  add(0, 0);
  for (int ring = 1; ring <= rings; ++ring) {
    for (int spoke = 0; spoke < spokes; ++spoke)
      add(static_cast<double>(ring) / rings, 2 * std::numbers::pi * spoke / spokes);
  }
  const auto at = [&](int ring, int spoke) { return ring == 0 ? 0 : 1 + (ring - 1) * spokes + spoke % spokes; };
  for (int ring = 0; ring < rings; ++ring) {
    for (int spoke = 0; spoke < spokes; ++spoke) {
      mesh.triangles.emplace_back(at(ring, spoke), at(ring + 1, spoke), at(ring + 1, spoke + 1));
      if (ring > 0) mesh.triangles.emplace_back(at(ring, spoke), at(ring + 1, spoke + 1), at(ring, spoke + 1));
    }
  }
  return mesh;
}

}  // namespace fringeslam::sim
