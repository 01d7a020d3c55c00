// SPDX-License-Identifier: Apache-2.0
// A mannequin's forearm and hand.
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <span>

#include "core/base/constants.h"
#include "sim/random.h"
#include "sim/scene/solid_parts.h"
#include "sim/scene/solids.h"

namespace fringeslam::sim {

namespace {

constexpr uint32_t kArm = 400;  // selects the random stream

// Semi-axes of the arm's elliptical section at height z; all relative to the arm's length.
struct ArmSection {
  double z, half_width, half_thickness;
};

// Profile: elbow, muscles, wrist (at 0.56), palm, knuckles (at 0.8).
constexpr std::array<ArmSection, 15> kForearm = {{{0.00, 0.098, 0.088},
                                                  {0.08, 0.106, 0.094},
                                                  {0.18, 0.106, 0.093},
                                                  {0.30, 0.091, 0.078},
                                                  {0.42, 0.072, 0.059},
                                                  {0.51, 0.061, 0.046},
                                                  {0.56, 0.059, 0.041},
                                                  {0.61, 0.068, 0.040},
                                                  {0.68, 0.083, 0.038},
                                                  {0.74, 0.089, 0.033},
                                                  {0.78, 0.087, 0.027},
                                                  {0.805, 0.080, 0.020},
                                                  {0.818, 0.072, 0.014},
                                                  {0.826, 0.060, 0.008},
                                                  {0.828, 0.045, 0.004}}};

// Interpolates the table with `steps` sections per entry.
std::vector<ArmSection> smooth_arm_sections(int steps) {
  const int last = static_cast<int>(kForearm.size()) - 1;
  const auto at = [&](int i) { return kForearm[static_cast<size_t>(std::clamp(i, 0, last))]; };
  std::vector<ArmSection> fine;
  for (int i = 0; i < last; ++i) {
    const ArmSection a = at(i - 1), b = at(i), c = at(i + 1), d = at(i + 2);
    for (int k = 0; k < steps; ++k) {
      const double t = static_cast<double>(k) / steps;
      fine.push_back({b.z + t * (c.z - b.z), catmull_rom(a.half_width, b.half_width, c.half_width, d.half_width, t),
                      catmull_rom(a.half_thickness, b.half_thickness, c.half_thickness, d.half_thickness, t)});
    }
  }
  fine.push_back(kForearm.back());
  return fine;
}

Mesh forearm_and_palm() {
  const std::vector<ArmSection> sections = smooth_arm_sections(3);
  Points3d curve;
  for (const ArmSection& section : sections) curve.emplace_back(0, 0, section.z);
  return loft(rings_along(curve, 32, Eigen::Vector3d::UnitX(), [&](size_t i, double angle) {
    return Eigen::Vector3d(sections[i].half_width * std::cos(angle), sections[i].half_thickness * std::sin(angle), 0);
  }));
}

struct Finger {
  Eigen::Vector3d root, direction, palm;  // flexes from `direction` towards `palm`
  double length, root_radius, tip_radius;
  double flexion;  // total angle, rad
};

struct FingerPart {
  Mesh mesh;
  std::vector<Points3d> hulls;
};

// Builds a finger bent at two joints, with a round tip and a rounded root.
FingerPart finger_part(const Finger& finger) {
  std::vector<double> along;
  const double straight = finger.length - finger.tip_radius;
  for (int i = 0; i < 18; ++i) along.push_back(straight * i / 18);
  for (int i = 0; i <= 6; ++i) along.push_back(straight + finger.tip_radius * std::sin(kPi / 2 * i / 6.3));
  Points3d curve = {finger.root};
  std::vector<double> radii;
  const auto step_up = [](double x) { return 1 / (1 + std::exp(-x)); };
  for (size_t i = 0; i < along.size(); ++i) {
    const double share = along[i] / finger.length;
    const double turned = finger.flexion * (step_up((share - 0.38) * 25) + 0.7 * step_up((share - 0.7) * 25)) / 1.7;
    const double joint = std::exp(-std::pow((share - 0.38) / 0.06, 2)) + std::exp(-std::pow((share - 0.7) / 0.05, 2));
    const double past = std::max(0.0, (along[i] - straight) / finger.tip_radius);
    const double root = std::min(1.0, 0.5 + 5 * share);
    radii.push_back(root * (finger.root_radius + share * (finger.tip_radius - finger.root_radius)) *
                    (1 + 0.05 * joint) * std::sqrt(1 - past * past));
    if (i + 1 < along.size())
      curve.push_back(curve.back() + (along[i + 1] - along[i]) * (std::cos(turned) * finger.direction.normalized() +
                                                                  std::sin(turned) * finger.palm.normalized()));
  }
  const auto rings = rings_along(curve, 16, finger.palm, [&](size_t i, double angle) {
    return Eigen::Vector3d(0.92 * radii[i] * std::cos(angle), radii[i] * std::sin(angle), 0);
  });
  const std::span all(rings);
  const std::vector<Points3d> phalanges = {joined(all.first(8)), joined(all.subspan(7, 7)), joined(all.subspan(13))};
  return {loft(rings), covers(phalanges, 32)};
}

// Draws the fingers; the ball of the thumb is modelled as a finger.
std::array<Finger, 6> fingers(Philox& random) {
  const Eigen::Vector3d palm(0, -1, 0);
  const double pose = random.uniform(0.35, 0.9), spread = random.uniform(0.5, 1.2);
  const auto finger = [&](double x, double z, double length, double radius) {
    const Eigen::Vector3d direction(spread * 1.4 * x, -random.uniform(0.02, 0.25), 1);
    return Finger{{x, 0, z}, direction, palm, length, radius, 0.8 * radius, pose * random.uniform(0.7, 1.4)};
  };
  const Finger ball{{0.03, -0.004, 0.565}, {0.28, -0.13, 1}, palm, 0.155, 0.036, 0.034, 0};
  const Finger thumb{{0.05, -0.012, 0.625},   {0.62, -0.25, 0.8}, {-0.4, -0.6, 0.3}, 0.19, 0.029, 0.021,
                     random.uniform(0.1, 0.5)};
  return {ball,
          thumb,
          finger(0.066, 0.75, 0.22, 0.0235),
          finger(0.022, 0.76, 0.245, 0.024),
          finger(-0.022, 0.755, 0.23, 0.023),
          finger(-0.064, 0.74, 0.185, 0.0205)};
}

}  // namespace

Solid arm_solid(double length, uint32_t seed) {
  Philox random(seed, Stream::shape, kArm);
  Mesh mesh = forearm_and_palm();
  std::vector<Points3d> hulls = covers(split(mesh, 3, [](const Eigen::Vector3d& p) {
    return p.z() < 0.3 ? 0 : p.z() < 0.56 ? 1 : 2;
  }));
  for (const Finger& finger : fingers(random)) {
    FingerPart part = finger_part(finger);
    append(mesh, part.mesh);
    hulls.insert(hulls.end(), part.hulls.begin(), part.hulls.end());
  }
  double tip = 0;
  for (const auto& v : mesh.vertices) tip = std::max(tip, v.z());
  for (auto& v : mesh.vertices) v *= length / tip;
  for (auto& hull : hulls) {
    for (auto& p : hull) p *= length / tip;
  }
  return centred(std::move(mesh), std::move(hulls));
}

}  // namespace fringeslam::sim
