// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/furniture.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "sim/scene/solid_parts.h"

namespace fringeslam::sim {

namespace {

std::vector<double> ticks_from_zero(double size, int cells) {
  std::vector<double> ticks = even_ticks(size, cells);
  for (double& tick : ticks) tick += size / 2;
  return ticks;
}

// Returns ticks at both edges of the plate and of the hole in each cell.
std::vector<double> hole_ticks(double size, int cells, double hole_share) {
  std::vector<double> ticks = {-size / 2};
  for (int i = 0; i < cells; ++i) {
    for (const double side : {-0.5, 0.5}) ticks.push_back(size * ((i + 0.5 + side * hole_share) / cells - 0.5));
  }
  ticks.push_back(size / 2);
  return ticks;
}

}  // namespace

Mesh wedge_mesh(const Eigen::Vector3d& size) {
  const double x = size.x() / 2, y = size.y() / 2, z = size.z();
  return {{{-x, -y, 0}, {x, -y, 0}, {x, -y, z}, {-x, y, 0}, {x, y, 0}, {x, y, z}},
          {{0, 1, 2}, {3, 5, 4}, {0, 3, 1}, {1, 3, 4}, {1, 4, 2}, {2, 4, 5}, {0, 2, 3}, {2, 5, 3}}};
}

Mesh bowl_mesh(const Eigen::Vector3d& size) {
  constexpr int kSectors = 96, kRings = 40;
  const double thickness = size.z() / 10, depth = size.z() - thickness;
  Mesh bowl;
  // The centre and rings of the inner surface, then those of the outer one.
  for (const double bottom : {thickness, 0.0}) {
    bowl.vertices.emplace_back(0, 0, bottom);
    for (int ring = 1; ring <= kRings; ++ring) {
      const double share = static_cast<double>(ring) / kRings;
      for (int sector = 0; sector < kSectors; ++sector) {
        const double angle = 2 * std::numbers::pi * sector / kSectors;
        bowl.vertices.emplace_back(share * size.x() / 2 * std::cos(angle), share * size.y() / 2 * std::sin(angle),
                                   bottom + depth * share * share);
      }
    }
  }
  const auto outer = static_cast<int>(bowl.vertices.size() / 2);
  const auto at = [&](int surface, int ring, int sector) {
    return ring == 0 ? surface : surface + 1 + (ring - 1) * kSectors + sector % kSectors;
  };
  const auto add = [&](int a, int b, int c, bool inner) {
    if (inner)
      bowl.triangles.emplace_back(a, b, c);
    else
      bowl.triangles.emplace_back(a, c, b);
  };
  for (int sector = 0; sector < kSectors; ++sector) {
    for (const int surface : {0, outer}) {
      const bool inner = surface == 0;
      add(at(surface, 0, 0), at(surface, 1, sector), at(surface, 1, sector + 1), inner);
      for (int ring = 1; ring < kRings; ++ring) {
        add(at(surface, ring, sector), at(surface, ring + 1, sector), at(surface, ring + 1, sector + 1), inner);
        add(at(surface, ring, sector), at(surface, ring + 1, sector + 1), at(surface, ring, sector + 1), inner);
      }
    }
    const int a = at(0, kRings, sector), b = at(0, kRings, sector + 1), c = at(outer, kRings, sector),
              d = at(outer, kRings, sector + 1);
    add(a, c, d, true);
    add(a, d, b, true);
  }
  return bowl;
}

Mesh stairs_mesh(const Eigen::Vector3d& size, int steps) {
  const Ticks ticks = {even_ticks(size.x(), steps), even_ticks(size.y(), 1), ticks_from_zero(size.z(), steps)};
  return cells_mesh(ticks, [&](const Eigen::Vector3d& centre) {
    return centre.z() / size.z() < centre.x() / size.x() + 0.5 + 0.25 / steps;
  });
}

Mesh blinds_mesh(double width, double height, int slats, double slat_angle_rad, double thickness) {
  const double pitch = height / slats;
  Mesh blinds;
  for (const double side : {-0.5, 0.5}) {
    Mesh post = box_mesh({thickness, pitch, height});
    const Eigen::Translation3d place(side * (width - thickness), 0, height / 2);
    transform(post.vertices, Eigen::Isometry3d(place));
    append(blinds, post);
  }
  for (int i = 0; i < slats; ++i) {
    Mesh slat = box_mesh({width - thickness, pitch - thickness, thickness});  // ends inside the posts
    const Eigen::AngleAxisd turn(slat_angle_rad, Eigen::Vector3d::UnitX());
    transform(slat.vertices, Eigen::Translation3d(0, 0, (i + 0.5) * pitch) * Eigen::Isometry3d(turn));
    append(blinds, slat);
  }
  return blinds;
}

Mesh lattice_mesh(double size_x, double size_y, double thickness, int columns, int rows, double hole_share) {
  const double side_share = std::sqrt(hole_share);
  const Ticks ticks = {hole_ticks(size_x, columns, side_share), hole_ticks(size_y, rows, side_share),
                       ticks_from_zero(thickness, 1)};
  const auto in_hole = [&](double at, double size, int cells) {
    const double in_cell = (at / size + 0.5) * cells;
    return std::abs(in_cell - std::floor(in_cell) - 0.5) < side_share / 2;
  };
  return cells_mesh(ticks, [&](const Eigen::Vector3d& centre) {
    return !in_hole(centre.x(), size_x, columns) || !in_hole(centre.y(), size_y, rows);
  });
}

}  // namespace fringeslam::sim
