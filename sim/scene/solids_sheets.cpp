// SPDX-License-Identifier: Apache-2.0
// Boards, sheets and bags: plank, paper, carton, plastic bag.
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "core/base/constants.h"
#include "sim/random.h"
#include "sim/scene/noise.h"
#include "sim/scene/solid_parts.h"
#include "sim/scene/solids.h"

namespace fringeslam::sim {

namespace {

enum SheetSurface : uint32_t { kPlank = 300, kPaper, kCarton, kPlasticBag };

}  // namespace

Solid plank_solid(const Eigen::Vector3d& size, uint32_t seed) {
  Philox random(seed, Stream::shape, kPlank);
  const double bow = random.uniform(0.003, 0.01) * size.z();
  const double splinter = std::min(0.22 * size.z(), random.uniform(1.0, 1.8) * size.x());
  const double lean = random.uniform(-0.35, 0.35), region = 0.35;
  Mesh mesh = cells_mesh({even_ticks(size.x(), 26), even_ticks(size.y(), 5), even_ticks(size.z(), 18)});
  double longest = -size.z();
  for (auto& v : mesh.vertices) {
    // Fibres break at heights that are nearly independent of their neighbours.
    const Eigen::Vector3d fibre(v.x() / size.x() * 9 + 20, v.y() / size.y() * 1.6 + 20, 0);
    const double tear = 0.5 + 0.75 * fractal_noise(fibre, 4, seed) + lean * v.x() / size.x();
    const double along = v.z() / size.z() + 0.5;
    v.z() -= splinter * std::clamp(tear, 0.0, 1.0) * std::max(0.0, (along - 1 + region) / region);
    longest = std::max(longest, v.z());
  }
  for (auto& v : mesh.vertices) {
    v.z() *= v.z() > 0 ? size.z() / 2 / longest : 1;
    v.y() += bow * (1 - 4 * std::pow(v.z() / size.z(), 2));
  }
  const auto quarter = [&](const Eigen::Vector3d& p) { return static_cast<int>(4 * (p.z() / size.z() + 0.5)); };
  std::vector<Points3d> hulls = covers(split(mesh, 4, quarter));
  return centred(std::move(mesh), std::move(hulls));
}

namespace {

struct Fold {  // a straight crease of a flat sheet
  Eigen::Vector2d direction;
  double offset, slope;
};

std::vector<Fold> random_folds(double reach, Philox& random) {
  std::vector<Fold> folds;
  for (int i = 0; i < 7; ++i) {
    const double angle = random.uniform(0, kPi);
    folds.push_back(
        {{std::cos(angle), std::sin(angle)}, reach * random.uniform(-0.4, 0.4), random.uniform(-0.09, 0.09)});
  }
  return folds;
}

// A flat sheet bent about parallel lines; the coordinate s is the arc length across them, with zero slope at s = 0.
class Bending {
 public:
  Bending(double size, double curl, Philox& random)
      : size_(size), curl_(curl), phase_(random.uniform(0, 2 * kPi)), uneven_(random.uniform(0.2, 0.5)) {
    Eigen::Vector2d point = Eigen::Vector2d::Zero();
    const double step = size / kSteps;
    for (int i = 0; i <= kSteps; ++i) {
      points_.push_back(point);
      const double middle = turn(-size / 2 + (i + 0.5) * step);
      point += step * Eigen::Vector2d(std::cos(middle), std::sin(middle));
    }
  }

  // Returns the point at `height` above the sheet; t is the coordinate along the lines.
  Eigen::Vector3d at(double s, double t, double height) const {
    const double place = std::clamp((s / size_ + 0.5) * kSteps, 0.0, kSteps - 1e-9);
    const auto i = static_cast<size_t>(place);
    const Eigen::Vector2d on = points_[i] + (place - static_cast<double>(i)) * (points_[i + 1] - points_[i]);
    return {on.x() - height * std::sin(turn(s)), t, on.y() + height * std::cos(turn(s))};
  }

 private:
  // Returns the angle by which the sheet has turned at s: nonuniform but monotonic.
  double turn(double s) const {
    const double angle = 2 * kPi * s / size_;
    return curl_ / (2 * kPi) * (angle + uneven_ * (std::sin(angle + phase_) - std::sin(phase_)));
  }

  static constexpr int kSteps = 512;
  double size_, curl_, phase_, uneven_;
  std::vector<Eigen::Vector2d> points_;
};

// Splits a thick sheet into strips between lines x = const of the flat sheet; neighbours share a row of vertices.
std::vector<Points3d> strips(const Mesh& flat, const Mesh& thick, double size_x, int count) {
  std::vector<Points3d> parts(static_cast<size_t>(count));
  for (size_t i = 0; i < flat.vertices.size(); ++i) {
    const double place = count * (flat.vertices[i].x() / size_x + 0.5);
    for (int k = 0; k < count; ++k) {
      if (place > k - 1e-6 && place < k + 1 + 1e-6) parts[static_cast<size_t>(k)].push_back(thick.vertices[i]);
    }
  }
  return parts;
}

}  // namespace

Solid paper_solid(double size_x, double size_y, double curl, uint32_t seed) {
  constexpr double kThickness = 0.0003, kHullThickness = 0.0024;
  constexpr int kStrips = 9, kCells = 4 * kStrips;
  Philox random(seed, Stream::shape, kPaper);
  const Eigen::Rotation2Dd turned(random.uniform(-0.4, 0.4));
  const Bending bending(std::hypot(size_x, size_y), curl * std::hypot(size_x, size_y) / size_x, random);
  const std::vector<Fold> folds = random_folds(std::min(size_x, size_y), random);
  const double stiffness = 1 / (1 + 2 * std::abs(curl));  // curled sheets fold less
  const auto crumple = [&](const Eigen::Vector2d& p) {
    const Eigen::Vector3d place(p.x() / (0.2 * size_x), p.y() / (0.2 * size_x), 9);
    double height = 0.004 * size_x * fractal_noise(place, 2, seed);
    for (const Fold& fold : folds) height += stiffness * fold.slope * std::abs(fold.direction.dot(p) - fold.offset);
    return height;
  };
  const int cells_y = std::clamp(static_cast<int>(kCells * size_y / size_x), 8, 60);
  const Mesh flat = cells_mesh({even_ticks(size_x, kCells), even_ticks(size_y, cells_y), even_ticks(1, 1)});
  double mean_height = 0;
  for (const auto& p : flat.vertices) mean_height += crumple(p.head<2>()) / static_cast<double>(flat.vertices.size());
  const auto bent = [&](const Eigen::Vector3d& p, double thickness) {
    const Eigen::Vector2d st = turned * p.head<2>();
    const double height = crumple(p.head<2>()) - mean_height + p.z() * thickness;
    Eigen::Vector3d point = bending.at(st.x(), st.y(), height);
    point.head<2>() = turned.inverse() * Eigen::Vector2d(point.head<2>());
    return point;
  };
  Mesh mesh = flat, thick = flat;
  for (auto& v : mesh.vertices) v = bent(v, kThickness);
  for (auto& v : thick.vertices) v = bent(v, kHullThickness);
  std::vector<Points3d> hulls = covers(strips(flat, thick, size_x, kStrips));
  return centred(std::move(mesh), std::move(hulls));
}

namespace {

constexpr double kPanel = 0.003;  // thickness of cardboard, m

struct Carton {
  Mesh mesh;
  std::vector<Points3d> hulls;

  // Adds a panel of the given width (x), height (y) and thickness kPanel (z), bulging by at most `bulge` along z.
  void add_panel(double width, double height, double bulge, const Eigen::Isometry3d& pose) {
    Mesh panel = cells_mesh({even_ticks(width, 8), even_ticks(height, 8), even_ticks(kPanel, 1)});
    for (auto& v : panel.vertices) v.z() += bulge * std::cos(kPi * v.x() / width) * std::cos(kPi * v.y() / height);
    Points3d hull = box_corners({width, height, kPanel + std::abs(bulge)});
    for (auto& p : hull) p.z() += bulge / 2;
    transform(panel.vertices, pose);
    transform(hull, pose);
    append(mesh, panel);
    hulls.push_back(std::move(hull));
  }
};

// Returns the frame at the centre of a wall's outer face: x along the wall, y upwards, z outwards.
Eigen::Isometry3d wall_pose(double distance, double angle) {
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  pose.rotate(Eigen::AngleAxisd(angle, Eigen::Vector3d::UnitZ()));
  pose.translate(Eigen::Vector3d(distance, 0, 0));
  pose.rotate((Eigen::Matrix3d() << 0, 0, 1, 1, 0, 0, 0, 1, 0).finished());
  return pose;
}

// Returns the pose, in a wall's frame, of the flap hinged at its upper edge.
Eigen::Isometry3d flap_pose(double wall_height, double flap_height, double angle) {
  Eigen::Isometry3d pose(Eigen::Translation3d(0, wall_height / 2, -kPanel / 2));
  pose.rotate(Eigen::AngleAxisd(angle - kPi / 2, Eigen::Vector3d::UnitX()));
  pose.translate(Eigen::Vector3d(0, flap_height / 2, 0));
  return pose;
}

}  // namespace

Solid carton_solid(const Eigen::Vector3d& size, double min_flap_angle, double max_flap_angle, uint32_t seed) {
  Philox random(seed, Stream::shape, kCarton);
  Carton carton;
  const double flap = std::min(size.x(), size.y()) / 2, give = 0.015 * size.minCoeff();
  const Eigen::Translation3d to_bottom(0, 0, -size.z() / 2 + kPanel / 2);
  carton.add_panel(size.x() - kPanel, size.y() - kPanel, 0, Eigen::Isometry3d(to_bottom));
  for (int side = 0; side < 4; ++side) {
    const bool across = side % 2 == 0;  // the walls at the ends of x stand between the other two
    const Eigen::Isometry3d outside = wall_pose((across ? size.x() : size.y()) / 2, kPi / 2 * side);
    const double width = across ? size.y() - kPanel : size.x();
    carton.add_panel(width, size.z(), -random.uniform(0, give), outside * Eigen::Translation3d(0, 0, -kPanel / 2));
    const double angle = random.uniform(min_flap_angle, max_flap_angle);
    carton.add_panel(width - 2 * kPanel, flap, random.uniform(-give, give), outside * flap_pose(size.z(), flap, angle));
  }
  return centred(std::move(carton.mesh), std::move(carton.hulls));
}

namespace {

struct BagSection {
  double radius, z;
};

// Profile from the centre of the base over the belly and neck to the inside of the tuft.
constexpr std::array<BagSection, 15> kBag = {{{0.25, -0.50},
                                              {0.60, -0.495},
                                              {0.84, -0.45},
                                              {0.98, -0.34},
                                              {1.00, -0.20},
                                              {0.95, -0.05},
                                              {0.84, 0.08},
                                              {0.64, 0.19},
                                              {0.40, 0.27},
                                              {0.20, 0.32},
                                              {0.13, 0.35},
                                              {0.17, 0.40},
                                              {0.26, 0.47},
                                              {0.24, 0.48},
                                              {0.08, 0.42}}};

// Interpolates the profile with `steps` sections per table entry.
std::vector<BagSection> smooth_bag_sections(int steps) {
  const int last = static_cast<int>(kBag.size()) - 1;
  const auto at = [&](int i) { return kBag[static_cast<size_t>(std::clamp(i, 0, last))]; };
  std::vector<BagSection> fine;
  for (int i = 0; i < last * steps; ++i) {
    const int k = i / steps;
    const double t = static_cast<double>(i % steps) / steps;
    fine.push_back({catmull_rom(at(k - 1).radius, at(k).radius, at(k + 1).radius, at(k + 2).radius, t),
                    catmull_rom(at(k - 1).z, at(k).z, at(k + 1).z, at(k + 2).z, t)});
  }
  fine.push_back(kBag.back());
  return fine;
}

// Returns the relative radial displacement of the film: lumps of the contents, sharp creases, and pleats at the neck.
double film_height(const Eigen::Vector3d& p, double angle, int pleats, uint32_t seed) {
  const Eigen::Vector3d place = p + Eigen::Vector3d::Constant(20);
  double height = 0.16 * fractal_noise(1.3 * place, 2, seed);
  const Eigen::Vector3d warped = place + 0.25 * fractal_noise(2 * place, 2, seed + 1) * Eigen::Vector3d(1, -1, 0.5);
  double weight = 0.12;
  for (const double frequency : {1.9, 3.6, 6.1}) {
    height += weight * (0.4 - std::abs(2 * value_noise(frequency * warped, seed + 2)));
    weight *= 0.55;
  }
  const double to_neck = std::exp(-std::pow((p.z() - 0.32) / 0.16, 2));
  return height + 0.3 * to_neck * (std::abs(std::sin(pleats * angle / 2 + 2 * value_noise(2 * place, seed + 3))) - 0.6);
}

}  // namespace

Solid bag_solid(const Eigen::Vector3d& size, uint32_t seed) {
  constexpr int kSides = 84;
  Philox random(seed, Stream::shape, kPlasticBag);
  const Eigen::Vector3d lean(random.uniform(-0.8, 0.8), random.uniform(-0.8, 0.8), 0);
  const int pleats = 2 * static_cast<int>(random.uniform(6, 10));
  std::vector<Points3d> rings;
  for (const BagSection& section : smooth_bag_sections(3)) {
    Points3d& ring = rings.emplace_back();
    for (int i = 0; i < kSides; ++i) {
      const double angle = 2 * kPi * i / kSides;
      const Eigen::Vector3d outward(std::cos(angle), std::sin(angle), 0);
      const Eigen::Vector3d smooth(section.radius * outward.x(), section.radius * outward.y(), section.z);
      const double radius = section.radius * (1 + film_height(smooth, angle, pleats, seed));
      const double height = section.z + 0.08 * (section.z + 0.5) * fractal_noise(3 * smooth, 3, seed + 4);
      ring.push_back(radius * outward + std::max(0.0, section.z - 0.05) * lean + height * Eigen::Vector3d::UnitZ());
    }
  }
  Mesh mesh = loft(rings);
  fit(mesh, size);
  const double neck = size.z() * 0.27;
  std::vector<Points3d> hulls = covers(split(mesh, 2, [&](const Eigen::Vector3d& p) { return p.z() < neck ? 0 : 1; }));
  return centred(std::move(mesh), std::move(hulls));
}

}  // namespace fringeslam::sim
