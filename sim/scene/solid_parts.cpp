// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/solid_parts.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <set>
#include <utility>

namespace fringeslam::sim {

namespace {

Eigen::Vector3d mean(const Points3d& points) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const auto& p : points) sum += p;
  return sum / static_cast<double>(points.size());
}

// Adds the band of triangles between two rings, given by the indices of their first vertices. Quadrilaterals are split
// along the shorter diagonal, which follows creases.
void add_band(Mesh& mesh, int low, int high, int sides) {
  const auto distance = [&](int a, int b) {
    return (mesh.vertices[static_cast<size_t>(a)] - mesh.vertices[static_cast<size_t>(b)]).norm();
  };
  for (int i = 0; i < sides; ++i) {
    const int next = (i + 1) % sides;
    if (distance(low + i, high + next) < (1 - 1e-9) * distance(low + next, high + i)) {
      mesh.triangles.emplace_back(low + i, low + next, high + next);
      mesh.triangles.emplace_back(low + i, high + next, high + i);
    } else {
      mesh.triangles.emplace_back(low + i, low + next, high + i);
      mesh.triangles.emplace_back(low + next, high + next, high + i);
    }
  }
}

Mesh bands(const std::vector<Points3d>& rings) {
  Mesh mesh;
  mesh.vertices = joined(rings);
  const int sides = static_cast<int>(rings[0].size());
  for (int i = 0; i + 1 < static_cast<int>(rings.size()); ++i) add_band(mesh, i * sides, (i + 1) * sides, sides);
  return mesh;
}

}  // namespace

Mesh loft(const std::vector<Points3d>& rings) {
  Mesh mesh = bands(rings);
  const int sides = static_cast<int>(rings[0].size());
  const int bottom = static_cast<int>(mesh.vertices.size()), top = bottom + 1, last = bottom - sides;
  mesh.vertices.push_back(mean(rings.front()));
  mesh.vertices.push_back(mean(rings.back()));
  for (int i = 0; i < sides; ++i) {
    const int next = (i + 1) % sides;
    mesh.triangles.emplace_back(bottom, next, i);
    mesh.triangles.emplace_back(top, last + i, last + next);
  }
  return mesh;
}

Mesh loft_closed(const std::vector<Points3d>& rings) {
  Mesh mesh = bands(rings);
  const int sides = static_cast<int>(rings[0].size());
  add_band(mesh, static_cast<int>(mesh.vertices.size()) - sides, 0, sides);
  return mesh;
}

std::vector<Points3d> rings_along(const Points3d& curve, int sides, const Eigen::Vector3d& up,
                                  const std::function<Eigen::Vector3d(size_t ring, double angle)>& section) {
  std::vector<Points3d> rings;
  Eigen::Vector3d normal = up;
  for (size_t i = 0; i < curve.size(); ++i) {
    const Eigen::Vector3d tangent =
        (curve[std::min(i + 1, curve.size() - 1)] - curve[std::max<size_t>(i, 1) - 1]).normalized();
    normal = (normal - normal.dot(tangent) * tangent).normalized();
    const Eigen::Vector3d binormal = tangent.cross(normal);
    Points3d& ring = rings.emplace_back();
    for (int side = 0; side < sides; ++side) {
      const Eigen::Vector3d offset = section(i, 2 * std::numbers::pi * side / sides);
      ring.push_back(curve[i] + offset.x() * normal + offset.y() * binormal + offset.z() * tangent);
    }
  }
  return rings;
}

Points3d joined(std::span<const Points3d> rings) {
  Points3d points;
  for (const auto& ring : rings) points.insert(points.end(), ring.begin(), ring.end());
  return points;
}

namespace {

// Surface under construction: lattice points become vertices when a face first uses them.
class CellSurface {
 public:
  explicit CellSurface(const Ticks& ticks) : ticks_(ticks) {}

  // Adds the cell's face normal to `axis` on its low (0) or high (1) side.
  void add_face(const Eigen::Vector3i& cell, int axis, int side) {
    const int u = (axis + 1) % 3, v = (axis + 2) % 3;
    Eigen::Vector3i corner = cell;
    corner[axis] += side;
    std::array<int, 4> around{};
    for (size_t i = 0; i < 4; ++i) {
      Eigen::Vector3i point = corner;
      point[u] += i == 1 || i == 2;
      point[v] += i >= 2;
      around[i] = vertex(point);
    }
    if (side == 0) std::swap(around[1], around[3]);
    mesh_.triangles.emplace_back(around[0], around[1], around[2]);
    mesh_.triangles.emplace_back(around[0], around[2], around[3]);
  }

  Mesh mesh() && { return std::move(mesh_); }

 private:
  double tick(const Eigen::Vector3i& point, int axis) const {
    return ticks_[static_cast<size_t>(axis)][static_cast<size_t>(point[axis])];
  }

  int vertex(const Eigen::Vector3i& point) {
    const auto [entry, is_new] =
        vertices_.try_emplace({point[0], point[1], point[2]}, static_cast<int>(mesh_.vertices.size()));
    if (is_new) mesh_.vertices.emplace_back(tick(point, 0), tick(point, 1), tick(point, 2));
    return entry->second;
  }

  const Ticks& ticks_;
  std::map<std::array<int, 3>, int> vertices_;
  Mesh mesh_;
};

Eigen::Vector3i cell_counts(const Ticks& ticks) {
  return {static_cast<int>(ticks[0].size()) - 1, static_cast<int>(ticks[1].size()) - 1,
          static_cast<int>(ticks[2].size()) - 1};
}

Eigen::Vector3d cell_centre(const Ticks& ticks, const Eigen::Vector3i& cell) {
  Eigen::Vector3d centre;
  for (int axis = 0; axis < 3; ++axis) {
    const auto& along = ticks[static_cast<size_t>(axis)];
    const auto at = static_cast<size_t>(cell[axis]);
    centre[axis] = (along[at] + along[at + 1]) / 2;
  }
  return centre;
}

}  // namespace

Mesh cells_mesh(const Ticks& ticks, const std::function<bool(const Eigen::Vector3d& cell_centre)>& filled) {
  const Eigen::Vector3i counts = cell_counts(ticks);
  const auto is_filled = [&](const Eigen::Vector3i& cell) {
    const bool inside = (cell.array() >= 0).all() && (cell.array() < counts.array()).all();
    return inside && filled(cell_centre(ticks, cell));
  };
  CellSurface surface(ticks);
  for (int i = 0; i < counts.prod(); ++i) {
    const Eigen::Vector3i cell(i % counts.x(), i / counts.x() % counts.y(), i / counts.x() / counts.y());
    if (!is_filled(cell)) continue;
    for (int axis = 0; axis < 3; ++axis) {
      for (const int side : {0, 1}) {
        if (!is_filled(cell + (side == 1 ? 1 : -1) * Eigen::Vector3i::Unit(axis))) surface.add_face(cell, axis, side);
      }
    }
  }
  return std::move(surface).mesh();
}

Mesh cells_mesh(const Ticks& ticks) {
  return cells_mesh(ticks, [](const Eigen::Vector3d&) { return true; });
}

std::vector<double> even_ticks(double size, int cells) {
  std::vector<double> ticks;
  for (int i = 0; i <= cells; ++i) ticks.push_back(size * (static_cast<double>(i) / cells - 0.5));
  return ticks;
}

std::vector<double> bordered_ticks(const std::vector<double>& breaks, double cell, double border) {
  std::vector<double> ticks = {breaks.front()};
  for (size_t i = 0; i + 1 < breaks.size(); ++i) {
    const double low = breaks[i], high = breaks[i + 1], edge = std::min(border, (high - low) / 4);
    const int inner = static_cast<int>(std::ceil((high - low - 2 * edge) / cell));
    ticks.push_back(low + 0.4 * edge);
    for (int k = 0; k <= inner; ++k) ticks.push_back(low + edge + (high - low - 2 * edge) * k / inner);
    ticks.push_back(high - 0.4 * edge);
    ticks.push_back(high);
  }
  return ticks;
}

void append(Mesh& mesh, const Mesh& part) {
  const int first = static_cast<int>(mesh.vertices.size());
  mesh.vertices.insert(mesh.vertices.end(), part.vertices.begin(), part.vertices.end());
  for (const Eigen::Vector3i& t : part.triangles) mesh.triangles.push_back(t.array() + first);
}

void transform(Points3d& points, const Eigen::Isometry3d& pose) {
  for (auto& p : points) p = pose * p;
}

void fit(Mesh& mesh, const Eigen::Vector3d& size) {
  Eigen::Vector3d low = mesh.vertices[0], high = low;
  for (const auto& v : mesh.vertices) low = low.cwiseMin(v), high = high.cwiseMax(v);
  const Eigen::Vector3d middle = (low + high) / 2, scale = size.cwiseQuotient(high - low);
  for (auto& v : mesh.vertices) v = (v - middle).cwiseProduct(scale);
}

Eigen::Vector3d centroid(const Mesh& mesh) {
  double volume = 0;
  Eigen::Vector3d moment = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3i& t : mesh.triangles) {  // tetrahedra from the origin
    const auto corner = [&](int i) -> const Eigen::Vector3d& { return mesh.vertices[static_cast<size_t>(t[i])]; };
    const double part = corner(0).dot(corner(1).cross(corner(2)));
    volume += part;
    moment += part * (corner(0) + corner(1) + corner(2)) / 4;
  }
  return moment / volume;
}

double catmull_rom(double before, double from, double to, double after, double t) {
  const double slope_from = (to - before) / 2, slope_to = (after - from) / 2;
  return from + t * (slope_from +
                     t * (3 * (to - from) - 2 * slope_from - slope_to + t * (2 * (from - to) + slope_from + slope_to)));
}

Points3d box_corners(const Eigen::Vector3d& size) { return box_mesh(size).vertices; }

std::vector<Points3d> split(const Mesh& mesh, int parts,
                            const std::function<int(const Eigen::Vector3d& triangle_centre)>& part_of) {
  std::vector<std::set<int>> used(static_cast<size_t>(parts));
  for (const Eigen::Vector3i& t : mesh.triangles) {
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    for (const int i : t) sum += mesh.vertices[static_cast<size_t>(i)];
    used[static_cast<size_t>(std::clamp(part_of(sum / 3), 0, parts - 1))].insert(t.begin(), t.end());
  }
  std::vector<Points3d> points;
  for (const auto& indices : used) {
    if (indices.empty()) continue;
    Points3d& part = points.emplace_back();
    for (const int i : indices) part.push_back(mesh.vertices[static_cast<size_t>(i)]);
  }
  return points;
}

std::vector<Points3d> covers(const std::vector<Points3d>& parts, size_t max_corners) {
  std::vector<Points3d> hulls;
  for (const auto& part : parts) hulls.push_back(convex_cover(part, max_corners));
  return hulls;
}

Solid centred(Mesh mesh, std::vector<Points3d> hulls) {
  const Eigen::Vector3d shift = -centroid(mesh);
  for (auto& v : mesh.vertices) v += shift;
  for (auto& hull : hulls) {
    for (auto& p : hull) p += shift;
  }
  return {std::move(mesh), std::move(hulls)};
}

}  // namespace fringeslam::sim
