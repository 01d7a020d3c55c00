// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/settle.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>

#include "core/types/error.h"
#include "sim/random.h"
#include "sim/scene/solids.h"

namespace fringeslam::sim {
namespace {

Hull box_hull(const Eigen::Vector3d& size) { return box_solid(size).hulls[0]; }

// Penetration depth of two boxes, m: the minimum overlap over face normals and cross products of edges (separating axis
// theorem). Negative: a gap.
double box_penetration(const Pose& a, const Eigen::Vector3d& size_a, const Pose& b, const Eigen::Vector3d& size_b) {
  std::vector<Eigen::Vector3d> axes;
  for (int i = 0; i < 3; ++i) axes.push_back(a.rotation.col(i)), axes.push_back(b.rotation.col(i));
  for (int i = 0; i < 3; ++i) {
    for (int k = 0; k < 3; ++k) {
      const Eigen::Vector3d cross = a.rotation.col(i).cross(b.rotation.col(k));
      if (cross.norm() > 1e-6) axes.push_back(cross.normalized());
    }
  }
  double least = std::numeric_limits<double>::infinity();
  for (const Eigen::Vector3d& axis : axes) {
    const auto reach = [&](const Pose& pose, const Eigen::Vector3d& size) {
      return (pose.rotation.transpose() * axis).cwiseAbs().dot(size / 2);
    };
    least = std::min(least, reach(a, size_a) + reach(b, size_b) - std::abs(axis.dot(a.translation - b.translation)));
  }
  return least;
}

double lowest(const Body& body, const Pose& pose) {
  double z = std::numeric_limits<double>::infinity();
  for (const Hull& hull : body.hulls) {
    for (const Eigen::Vector3d& p : hull) z = std::min(z, (pose * p).z());
  }
  return z;
}

struct Boxes {
  std::vector<Eigen::Vector3d> sizes;
  std::vector<Body> bodies;
};

Boxes boxes(int count, uint64_t seed) {
  Philox random(seed, Stream::shape, 7);
  Boxes result;
  for (int i = 0; i < count; ++i) {
    result.sizes.emplace_back(random.uniform(0.04, 0.2), random.uniform(0.03, 0.1), random.uniform(0.01, 0.06));
    result.bodies.push_back({{box_hull(result.sizes.back())}});
  }
  return result;
}

constexpr DropArea kArea{0.5, 0.5, 0};

TEST(Settle, BoxesRestWithoutEnergyAndOutsideEachOther) {
  for (const uint64_t seed : {1u, 2u, 3u}) {
    const Boxes pile = boxes(40, seed);
    const Settled settled = settle(pile.bodies, kArea, seed);
    ASSERT_EQ(settled.ground_from_body.size(), 40u);
    EXPECT_LT(settled.energy_j_per_kg, 2e-6);  // 2 mm/s
    double deepest = -1, highest = 0;
    for (size_t i = 0; i < 40; ++i) {
      const Pose& pose = settled.ground_from_body[i];
      EXPECT_NEAR((pose.rotation.transpose() * pose.rotation - Eigen::Matrix3d::Identity()).norm(), 0, 1e-9);
      deepest = std::max(deepest, -lowest(pile.bodies[i], pose));
      highest = std::max(highest, pose.translation.z());
      for (size_t k = 0; k < i; ++k)
        deepest = std::max(deepest, box_penetration(pose, pile.sizes[i], settled.ground_from_body[k], pile.sizes[k]));
    }
    EXPECT_LT(deepest, 1e-3) << "seed " << seed;
    EXPECT_LT(settled.penetration_m, 1e-3);
    EXPECT_GT(highest, 0.06);  // the boxes are stacked
    // Settled bodies stay in place when the simulation is continued.
    std::vector<double> drift = drifts_m(pile.bodies, kArea, settled.ground_from_body, 1);
    std::sort(drift.begin(), drift.end());
    EXPECT_LT(drift[20], 1e-3) << "seed " << seed;
    EXPECT_LT(drift[35], 5e-3) << "seed " << seed;
  }
}

// A single box lies flat with its centre of mass at half its height.
TEST(Settle, OneBoxLiesFlat) {
  const Eigen::Vector3d size(0.2, 0.1, 0.03);
  const Settled settled = settle({{{box_hull(size)}}}, kArea, 5);
  const Pose& pose = settled.ground_from_body[0];
  EXPECT_NEAR(std::abs(pose.rotation(2, 2)), 1, 1e-4);
  EXPECT_NEAR(pose.translation.z(), 0.015, 5e-4);
}

// Every kind of solid comes to rest in a pile on the ground.
TEST(Settle, AllKindsOfSolids) {
  std::vector<Body> bodies;
  for (uint32_t seed = 1; seed <= 3; ++seed) {
    for (const Solid& solid :
         {rock_solid({0.1, 0.08, 0.06}, 2, 0.3, seed), brick_solid({0.12, 0.06, 0.04}, seed),
          slab_solid({0.2, 0.15, 0.04}, seed), pipe_solid(0.02, 0.003, 0.25, 24), plank_solid({0.06, 0.02, 0.3}, seed),
          rebar_solid(0.006, 0.3, 0.6, seed), paper_solid(0.15, 0.1, 1, seed),
          carton_solid({0.12, 0.1, 0.08}, 1, 3, seed), foam_solid({0.1, 0.08, 0.12}, seed), arm_solid(0.35, seed),
          wire_solid(0.002, 0.1, 3, seed), bag_solid({0.12, 0.1, 0.08}, seed)})
      bodies.push_back({solid.hulls});
  }
  const DropArea area{0.7, 0.7, 0.4};
  const Settled settled = settle(bodies, area, 4);
  EXPECT_LT(settled.penetration_m, 1e-3);
  EXPECT_LT(settled.energy_j_per_kg, 2e-6);
  for (size_t i = 0; i < bodies.size(); ++i) {
    EXPECT_GT(lowest(bodies[i], settled.ground_from_body[i]), -1e-3) << i;
    EXPECT_LT(settled.ground_from_body[i].translation.head<2>().cwiseAbs().maxCoeff(), 0.4) << i;  // within the walls
  }
}

TEST(Settle, TheSameSeedGivesTheSamePoses) {
  const Boxes pile = boxes(15, 9);
  const Settled a = settle(pile.bodies, kArea, 9), b = settle(pile.bodies, kArea, 9),
                c = settle(pile.bodies, kArea, 10);
  for (size_t i = 0; i < 15; ++i) {
    EXPECT_EQ(a.ground_from_body[i].translation, b.ground_from_body[i].translation);
    EXPECT_EQ(a.ground_from_body[i].rotation, b.ground_from_body[i].rotation);
    EXPECT_NE(a.ground_from_body[i].translation, c.ground_from_body[i].translation);
  }
}

TEST(Settle, ABodyWithoutVolumeIsRefused) {
  const Hull flat = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {1, 1, 0}};
  EXPECT_THROW(settle({{{flat}}}, kArea, 1), Error);
}

// Heavy boxes penetrate light ones and are dropped again, between the same walls as at first.
TEST(Settle, ObjectsDroppedAgainStayWithinTheWalls) {
  constexpr uint64_t kSeed = 33;  // without walls, one of the boxes that are dropped again falls out of the area
  constexpr DropArea kWalled{0.3, 0.3, 0.05};
  Boxes pile = boxes(8, kSeed);
  for (size_t i = 0; i < pile.bodies.size(); ++i) pile.bodies[i].density_kg_m3 = i < 4 ? 1 : 20000;
  const Settled settled = settle(pile.bodies, kWalled, kSeed);
  EXPECT_GT(settled.redrop_count, 0);
  EXPECT_LT(settled.penetration_m, 1e-3);
  for (size_t i = 0; i < pile.bodies.size(); ++i)
    EXPECT_LT(settled.ground_from_body[i].translation.head<2>().cwiseAbs().maxCoeff(), 0.15) << i;
}

}  // namespace
}  // namespace fringeslam::sim
