// SPDX-License-Identifier: Apache-2.0
// Solids swept along a line: pipe, reinforcing bar, wire.
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <span>

#include "core/base/constants.h"
#include "sim/random.h"
#include "sim/scene/noise.h"
#include "sim/scene/solid_parts.h"
#include "sim/scene/solids.h"

namespace fringeslam::sim {

namespace {

enum RodSurface : uint32_t { kRebar = 200, kWire };

Points3d circle(double radius, double z, int sides) {
  Points3d ring;
  for (int i = 0; i < sides; ++i) {
    const double angle = 2 * kPi * i / sides;
    ring.emplace_back(radius * std::cos(angle), radius * std::sin(angle), z);
  }
  return ring;
}

}  // namespace

Solid pipe_solid(double outer_radius, double wall, double length, int sides) {
  const double inner_radius = outer_radius - wall, end = length / 2;
  const Mesh mesh = loft_closed({circle(outer_radius, -end, sides), circle(outer_radius, end, sides),
                                 circle(inner_radius, end, sides), circle(inner_radius, -end, sides)});
  constexpr int kHullSides = 32;
  const double hull_radius = outer_radius / std::cos(kPi / kHullSides);  // circumscribed
  return {mesh, {joined(std::array{circle(hull_radius, -end, kHullSides), circle(hull_radius, end, kHullSides)})}};
}

namespace {

struct Bend {
  double start, length;  // along the bar, m
  double angle;
  double plane;  // azimuth of the bending axis in the xy plane
};

std::vector<Bend> random_bends(double radius, double length, double bend, Philox& random) {
  const bool two = random.uniform() < 0.5;
  std::vector<Bend> bends;
  for (int i = 0; i < (two ? 2 : 1); ++i) {
    const double angle = bend * random.uniform(0.7, 1.3);
    const double arc = std::min(std::max(radius * random.uniform(5, 8) * std::abs(angle), 2 * radius), 0.2 * length);
    const double middle = length * (two ? random.uniform(0.2, 0.35) + 0.45 * i : random.uniform(0.3, 0.7));
    bends.push_back({middle - arc / 2, arc, angle, random.uniform(0, 2 * kPi)});
  }
  return bends;
}

// Returns the bar's direction at distance `s` from its start.
Eigen::Vector3d heading(const std::vector<Bend>& bends, double s) {
  Eigen::Vector3d direction = Eigen::Vector3d::UnitZ();
  for (const Bend& bend : bends) {
    const double turned = bend.angle * std::clamp((s - bend.start) / bend.length, 0.0, 1.0);
    direction = Eigen::AngleAxisd(turned, Eigen::Vector3d(std::cos(bend.plane), std::sin(bend.plane), 0)) * direction;
  }
  return direction;
}

// Ring positions along the bar: four per rib, at its two feet and two shoulders.
struct RibbedLine {
  std::vector<double> along;
  std::vector<bool> raised;
};

RibbedLine ribbed_line(double radius, double length) {
  const int ribs = std::max(1, static_cast<int>(length / std::max(1.6 * radius, length / 90)));
  const double pitch = length / ribs;
  RibbedLine line;
  for (int rib = 0; rib < ribs; ++rib) {
    for (const double share : {0.0, 0.45, 0.6, 0.85}) {
      line.along.push_back((rib + share) * pitch);
      line.raised.push_back(share == 0.6 || share == 0.85);
    }
  }
  line.along.push_back(length);
  line.raised.push_back(false);
  return line;
}

Points3d curve_at(const std::vector<Bend>& bends, const std::vector<double>& along) {
  constexpr int kSteps = 4;  // per interval, midpoint rule
  Points3d curve = {Eigen::Vector3d::Zero()};
  for (size_t i = 1; i < along.size(); ++i) {
    const double step = (along[i] - along[i - 1]) / kSteps;
    Eigen::Vector3d point = curve.back();
    for (int k = 0; k < kSteps; ++k) point += step * heading(bends, along[i - 1] + (k + 0.5) * step);
    curve.push_back(point);
  }
  return curve;
}

// Returns a prism around each straight piece and a convex cover of each half of each bend; neighbours share a ring.
std::vector<Points3d> bar_hulls(const std::vector<Points3d>& rings, const std::vector<double>& along,
                                const std::vector<Bend>& bends) {
  std::vector<Points3d> hulls;
  size_t first = 0;
  const auto add_piece = [&](double end, bool straight) {
    const auto last = static_cast<size_t>(std::lower_bound(along.begin(), along.end(), end) - along.begin());
    if (last == first) return;  // shorter than the ring spacing: merged into the next piece
    const Points3d piece = joined(std::span(rings).subspan(first, last - first + 1));
    const Eigen::Vector3d axis = rings[last][0] - rings[first][0];
    hulls.push_back(straight ? prism_cover(piece, axis, 8) : convex_cover(piece, 32));
    first = last;
  };
  for (const Bend& bend : bends) {
    add_piece(bend.start, true);
    add_piece(bend.start + bend.length / 2, false);
    add_piece(bend.start + bend.length, false);
  }
  add_piece(along.back(), true);
  return hulls;
}

}  // namespace

Solid rebar_solid(double radius, double length, double bend, uint32_t seed) {
  Philox random(seed, Stream::shape, kRebar);
  const std::vector<Bend> bends = random_bends(radius, length, bend, random);
  const RibbedLine line = ribbed_line(radius, length);
  const auto section = [&](size_t ring, double angle) {
    const bool seam = std::abs(std::sin(angle)) < 0.1;  // a longitudinal rib on either side
    const double height = seam ? 0.1 : line.raised[ring] ? 0.14 * std::abs(std::sin(angle)) : 0;
    const double slant = 0.5 * std::cos(angle);
    return Eigen::Vector3d(radius * (1 + height) * std::cos(angle), radius * (1 + height) * std::sin(angle),
                           radius * slant);
  };
  const auto rings = rings_along(curve_at(bends, line.along), 12, Eigen::Vector3d::UnitX(), section);
  return centred(loft(rings), bar_hulls(rings, line.along, bends));
}

namespace {

// Generates loops around z with wandering radius, height and centre.
Points3d tangled_curve(int loops, int points, uint32_t seed) {
  const auto wander = [&](double t, double rate, double axis) {
    return fractal_noise(Eigen::Vector3d(10 + rate * t, 10 + 7 * axis, 3), 2, seed);
  };
  Points3d curve;
  for (int i = 0; i <= points; ++i) {
    const double turns = loops * static_cast<double>(i) / points;
    const double angle = 2 * kPi * turns + 1.2 * wander(turns, 0.8, 0);
    const double radius = 1 + 0.45 * wander(turns, 1.1, 1);
    curve.emplace_back(radius * std::cos(angle) + 0.5 * wander(turns, 0.9, 2),
                       radius * std::sin(angle) + 0.5 * wander(turns, 0.9, 3), 0.8 * wander(turns, 1.3, 4));
  }
  return curve;
}

// Rotates the curve randomly about z and scales it to fit into a centred cube.
void fit_into_cube(Points3d& curve, double edge, Philox& random) {
  const Eigen::Matrix3d turn = Eigen::AngleAxisd(random.uniform(0, 2 * kPi), Eigen::Vector3d::UnitZ()).matrix();
  Eigen::Vector3d low = turn * curve[0], high = low;
  for (auto& p : curve) {
    p = turn * p;
    low = low.cwiseMin(p), high = high.cwiseMax(p);
  }
  for (auto& p : curve) p = (p - (low + high) / 2) * edge / (high - low).maxCoeff();
}

}  // namespace

Solid wire_solid(double radius, double extent, int loops, uint32_t seed) {
  Philox random(seed, Stream::shape, kWire);
  constexpr int kPieces = 40;
  const int per_piece = std::max(4, 48 * loops / kPieces);
  Points3d curve = tangled_curve(loops, kPieces * per_piece, seed);
  // Even a wire as thick as the cube keeps a centre line of nonzero length.
  fit_into_cube(curve, std::max(extent - 2 * radius, 0.1 * extent), random);
  const auto round = [&](size_t, double angle) {
    return Eigen::Vector3d(radius * std::cos(angle), radius * std::sin(angle), 0);
  };
  const auto rings = rings_along(curve, 8, Eigen::Vector3d::UnitZ(), round);
  std::vector<Points3d> pieces;
  for (size_t i = 0; i < kPieces; ++i) {
    const auto count = static_cast<size_t>(per_piece);
    pieces.push_back(joined(std::span(rings).subspan(i * count, count + 1)));
  }
  return centred(loft(rings), covers(pieces, 24));
}

}  // namespace fringeslam::sim
