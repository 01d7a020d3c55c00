// SPDX-License-Identifier: Apache-2.0
// Bulk solids: stone, brick, concrete slab, foam.
#include "sim/scene/solids.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "sim/random.h"
#include "sim/scene/noise.h"
#include "sim/scene/solid_parts.h"

namespace fringeslam::sim {

namespace {

enum SolidSurface : uint32_t { kRock = 100, kBrick, kSlab, kFoam };

Eigen::Vector3d random_direction(Philox& random) {
  const double z = random.uniform(-1, 1), angle = random.uniform(0, 2 * std::numbers::pi);
  const double radius = std::sqrt(1 - z * z);
  return {radius * std::cos(angle), radius * std::sin(angle), z};
}

}  // namespace

Solid box_solid(const Eigen::Vector3d& size) { return {box_mesh(size), {box_corners(size)}}; }

Solid rock_solid(const Eigen::Vector3d& size, int detail, double roughness, uint32_t seed) {
  Philox random(seed, Stream::shape, kRock);
  Mesh mesh = rock_mesh({2, 2, 2}, detail, roughness, seed);
  for (int fracture = 0; fracture < 14; ++fracture) {
    const Eigen::Vector3d normal = random_direction(random);
    const double offset = random.uniform(0.55, 0.85);
    const auto grain = static_cast<uint32_t>(fracture) + seed;
    for (auto& v : mesh.vertices) {
      const double plane = offset * (1 + 0.3 * roughness * fractal_noise(v * 4 + normal * 20, 4, grain));
      const double height = normal.dot(v);
      if (height > plane) v *= plane / height;  // radially towards the centre, so that the surface stays closed
    }
  }
  fit(mesh, size);
  Points3d hull = convex_cover(mesh.vertices);
  return centred(std::move(mesh), {std::move(hull)});
}

namespace {

// Maps a point on a box's surface to the box with edges rounded by `radius`.
Eigen::Vector3d rounded(const Eigen::Vector3d& point, const Eigen::Vector3d& size, double radius) {
  const Eigen::Vector3d inner = size / 2 - Eigen::Vector3d::Constant(radius);
  const Eigen::Vector3d centre = point.cwiseMax(-inner).cwiseMin(inner);
  return centre + radius * (point - centre).normalized();
}

// A conchoidal chip: vertices inside a ball move towards the box's centre onto the ball's near surface.
struct Chip {
  Eigen::Vector3d centre;
  double radius;

  Eigen::Vector3d cut(const Eigen::Vector3d& v, double ball_radius) const {
    if ((v - centre).squaredNorm() >= ball_radius * ball_radius) return v;
    const Eigen::Vector3d ray = v.normalized();
    const double nearest = ray.dot(centre);
    const double half = std::sqrt(ball_radius * ball_radius - (centre - nearest * ray).squaredNorm());
    return (nearest - half) * ray;
  }
};

// Returns ticks that are denser towards the ends, where chips and rounded edges need resolution.
std::vector<double> edge_refined_ticks(double size, int cells) {
  std::vector<double> ticks = even_ticks(size, cells);
  for (double& tick : ticks) tick = tick / 2 + size / 4 * std::sin(std::numbers::pi * tick / size);
  return ticks;
}

// Draws chips on corners (all three coordinates at their ends) and on edges.
std::vector<Chip> random_chips(const Eigen::Vector3d& size, Philox& random) {
  std::vector<Chip> chips;
  for (int i = 0; i < 11; ++i) {
    Chip chip;
    const int free_axis = i < 5 ? 3 : std::min(2, static_cast<int>(random.uniform(0, 3)));
    for (int axis = 0; axis < 3; ++axis) {
      const double end = random.uniform() < 0.5 ? -0.5 : 0.5;
      chip.centre[axis] = size[axis] * (axis == free_axis ? random.uniform(-0.45, 0.45) : end);
    }
    chip.radius = size.minCoeff() * (i < 5 ? random.uniform(0.1, 0.4) : random.uniform(0.08, 0.17));
    chips.push_back(chip);
  }
  return chips;
}

}  // namespace

Solid brick_solid(const Eigen::Vector3d& size, uint32_t seed) {
  Philox random(seed, Stream::shape, kBrick);
  const std::vector<Chip> chips = random_chips(size, random);
  const double small = size.minCoeff(), wear = 0.05 * small;
  Ticks ticks;
  for (int axis = 0; axis < 3; ++axis)
    ticks[static_cast<size_t>(axis)] =
        edge_refined_ticks(size[axis], 10 + static_cast<int>(42 * size[axis] / size.sum()));
  Mesh mesh = cells_mesh(ticks);
  for (auto& v : mesh.vertices) {
    const double radius = wear * (0.6 + 0.4 * fractal_noise(v / (0.3 * small), 3, seed));
    v = rounded(v, size, radius);
    const double ragged = 1 + 0.3 * fractal_noise(v / (0.15 * small), 3, seed + 1);
    for (const Chip& chip : chips) v = chip.cut(v, chip.radius * ragged);
  }
  return centred(std::move(mesh), {box_corners(size)});
}

namespace {

struct Line {  // in the plane: normal direction `angle`, distance `offset` from the origin
  double angle, offset;
  bool broken;
};

// Draws the outline of a slab: a square of half-width 1 with broken corners and sides, one side left as cast.
std::vector<Line> slab_outline(Philox& random) {
  std::vector<Line> sides;
  const int cast = static_cast<int>(random.uniform(0, 4));
  for (int i = 0; i < 4; ++i) {
    const double turn = i == cast ? 0 : random.uniform(-0.2, 0.2);
    sides.push_back({std::numbers::pi / 2 * i + turn, random.uniform(0.8, 1), i != cast});
    sides.push_back({std::numbers::pi / 2 * (i + random.uniform(0.3, 0.7)), random.uniform(0.85, 1.25), true});
  }
  return sides;
}

struct OutlinePoint {
  double radius;
  bool broken;
};

OutlinePoint outline_at(const std::vector<Line>& sides, double angle) {
  OutlinePoint nearest{std::numeric_limits<double>::infinity(), false};
  for (const Line& side : sides) {
    const double cosine = std::cos(angle - side.angle);
    if (cosine > 0.05 && side.offset / cosine < nearest.radius) nearest = {side.offset / cosine, side.broken};
  }
  return nearest;
}

}  // namespace

Solid slab_solid(const Eigen::Vector3d& size, uint32_t seed) {
  Philox random(seed, Stream::shape, kSlab);
  const std::vector<Line> sides = slab_outline(random);
  constexpr int kAround = 160, kLayers = 10;
  const double lean = random.uniform(-0.35, 0.35), lean_angle = random.uniform(0, 2 * std::numbers::pi);
  std::vector<Points3d> rings;
  for (int layer = 0; layer <= kLayers; ++layer) {
    Points3d& ring = rings.emplace_back();
    const double up = static_cast<double>(layer) / kLayers - 0.5, z = up * size.z();
    for (int i = 0; i < kAround; ++i) {
      const double angle = 2 * std::numbers::pi * i / kAround;
      const OutlinePoint outline = outline_at(sides, angle);
      const Eigen::Vector3d at = outline.radius * Eigen::Vector3d(std::cos(angle), std::sin(angle), 0);
      const Eigen::Vector3d place(at.x() * size.x() / 2, at.y() * size.y() / 2, z);
      const double rough = fractal_noise(place / (0.6 * size.z()), 5, seed);
      const double slant = lean * std::sin(2 * angle + lean_angle) * up;  // fracture surfaces are not vertical
      const double depth = outline.broken ? 0.3 * rough + slant + 0.15 * std::abs(2 * up) : 0.02 * rough;
      const Eigen::Vector3d sideways = depth * size.z() * Eigen::Vector3d(at.x(), at.y(), 0).normalized();
      ring.push_back(place - sideways);
    }
  }
  Mesh mesh = loft(rings);
  fit(mesh, size);
  Points3d hull = convex_cover(mesh.vertices);
  return centred(std::move(mesh), {std::move(hull)});
}

namespace {

using Box = Eigen::AlignedBox3d;

bool in_any(const std::vector<Box>& boxes, const Eigen::Vector3d& point) {
  return std::any_of(boxes.begin(), boxes.end(), [&](const Box& box) { return box.contains(point); });
}

// Draws the section: a base along x and one or two legs that rise from it along y.
std::vector<Box> foam_section(const Eigen::Vector3d& size, Philox& random) {
  const Eigen::Vector3d end = size / 2;
  const double base = random.uniform(0.28, 0.42) * size.y(), leg = random.uniform(0.16, 0.26) * size.x();
  std::vector<Box> boxes = {Box(-end, Eigen::Vector3d(end.x(), -end.y() + base, end.z()))};
  boxes.emplace_back(-end, Eigen::Vector3d(-end.x() + leg, end.y(), end.z()));
  const bool is_u = random.uniform() < 0.5;
  if (is_u) boxes.emplace_back(Eigen::Vector3d(end.x() - leg, -end.y(), -end.z()), end);
  return boxes;
}

// Draws a recess in the base, open upwards and clear of the legs.
Box foam_recess(const Eigen::Vector3d& size, const std::vector<Box>& section, Philox& random) {
  const Eigen::Vector3d end = size / 2;
  const double left = section[1].max().x(), right = section.size() > 2 ? section[2].min().x() : end.x();
  const double margin = 0.18 * (right - left), top = section[0].max().y();
  const double depth = random.uniform(0.4, 0.6) * section[0].sizes().y();
  const double half = random.uniform(0.45, 0.7) * end.z(), shift = random.uniform(-0.15, 0.15) * end.z();
  return {Eigen::Vector3d(left + margin, top - depth, shift - half),
          Eigen::Vector3d(right - margin, end.y(), shift + half)};
}

std::vector<double> breaks_of(const std::vector<Box>& boxes, int axis, double end) {
  std::vector<double> breaks;
  for (const Box& box : boxes) {
    for (const double at : {box.min()[axis], box.max()[axis]}) breaks.push_back(std::min(at, end));
  }
  std::sort(breaks.begin(), breaks.end());
  const auto same = [&](double a, double b) { return b - a < 1e-9 * end; };
  breaks.erase(std::unique(breaks.begin(), breaks.end(), same), breaks.end());
  return breaks;
}

// Rounds convex corners and edges by moving their vertices inwards, towards the mean of their neighbours.
void wear_edges(Mesh& mesh) {
  const size_t count = mesh.vertices.size();
  std::vector<Eigen::Vector3d> outward(count, Eigen::Vector3d::Zero()), pull = outward;
  std::vector<int> neighbours(count, 0);
  for (const Eigen::Vector3i& t : mesh.triangles) {
    const auto v = [&](int i) -> const Eigen::Vector3d& { return mesh.vertices[static_cast<size_t>(t[i])]; };
    const Eigen::Vector3d normal = (v(1) - v(0)).cross(v(2) - v(0)).normalized();
    for (int i = 0; i < 3; ++i) {
      const auto at = static_cast<size_t>(t[i]);
      outward[at] += normal;
      pull[at] += v((i + 1) % 3) - v(i);
      ++neighbours[at];
    }
  }
  for (size_t i = 0; i < count; ++i) {
    const Eigen::Vector3d normal = outward[i].normalized();
    mesh.vertices[i] += std::min(0.0, pull[i].dot(normal) / neighbours[i]) * normal;
  }
}

}  // namespace

Solid foam_solid(const Eigen::Vector3d& size, uint32_t seed) {
  Philox random(seed, Stream::shape, kFoam);
  const std::vector<Box> section = foam_section(size, random);
  const Box recess = foam_recess(size, section, random);
  std::vector<Box> edges = section;
  edges.push_back(recess);
  Ticks ticks;
  for (int axis = 0; axis < 3; ++axis) {
    ticks[static_cast<size_t>(axis)] =
        bordered_ticks(breaks_of(edges, axis, size[axis] / 2), size.maxCoeff() / 10, 0.02 * size.minCoeff());
  }
  Mesh mesh = cells_mesh(
      ticks, [&](const Eigen::Vector3d& centre) { return in_any(section, centre) && !recess.contains(centre); });
  wear_edges(mesh);
  std::vector<Points3d> hulls;
  for (const Box& box : section) {
    Points3d& hull = hulls.emplace_back(box_corners(box.sizes()));
    for (auto& p : hull) p += box.center();
  }
  return centred(std::move(mesh), std::move(hulls));
}

}  // namespace fringeslam::sim
