// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/furniture.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

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
