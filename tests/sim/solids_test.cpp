// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/solids.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <functional>
#include <limits>
#include <numbers>
#include <string>

#include "sim/random.h"
#include "sim/scene/solid_parts.h"
#include "tests/sim/solid_checks.h"

namespace fringeslam::sim {
namespace {

constexpr double kPi = std::numbers::pi;

struct Plane {
  Eigen::Vector3d normal;  // unit, outwards
  double offset;
};

// Returns the half-spaces whose intersection is the convex hull of the points, by testing all triplets for having all
// points on one side. Nearly collinear triplets are skipped; each face of a solid has a better-conditioned one.
std::vector<Plane> faces_of_hull(const Points3d& points) {
  std::vector<Plane> faces;
  const auto add_if_outside_all = [&](const Eigen::Vector3d& normal, double offset) {
    for (const auto& p : points) {
      if (normal.dot(p) - offset > 1e-9) return;
    }
    faces.push_back({normal, offset});
  };
  for (size_t i = 0; i < points.size(); ++i) {
    for (size_t j = i + 1; j < points.size(); ++j) {
      for (size_t k = j + 1; k < points.size(); ++k) {
        const Eigen::Vector3d a = points[j] - points[i], b = points[k] - points[i], twice = a.cross(b);
        if (twice.norm() < 1e-5 * a.norm() * b.norm()) continue;
        const Eigen::Vector3d normal = twice.normalized();
        add_if_outside_all(normal, normal.dot(points[i]));
        add_if_outside_all(-normal, -normal.dot(points[i]));
      }
    }
  }
  return faces;
}

double height_above(const std::vector<Plane>& faces, const Eigen::Vector3d& point) {
  double most = -std::numeric_limits<double>::infinity();
  for (const Plane& face : faces) most = std::max(most, face.normal.dot(point) - face.offset);
  return most;
}

std::vector<std::vector<Plane>> all_faces(const Solid& solid) {
  std::vector<std::vector<Plane>> result;
  for (const auto& hull : solid.hulls) {
    result.push_back(faces_of_hull(hull));
    EXPECT_GE(result.back().size(), 4u);
  }
  return result;
}

// Largest distance of any point outside all hulls, as height above a face; negative if all points are inside.
double worst_height(const std::vector<std::vector<Plane>>& hulls, const Points3d& points) {
  double worst = -std::numeric_limits<double>::infinity();
  for (const auto& p : points) {
    double least = std::numeric_limits<double>::infinity();
    for (const auto& hull : hulls) least = std::min(least, height_above(hull, p));
    worst = std::max(worst, least);
  }
  return worst;
}

Points3d triangle_centres(const Mesh& mesh) {
  Points3d centres;
  for (const Eigen::Vector3i& t : mesh.triangles) {
    const auto [a, b, c] = corners_of(mesh, t);
    centres.emplace_back((a + b + c) / 3);
  }
  return centres;
}

struct Kind {
  std::string name;
  std::function<Solid(uint32_t)> make;
  bool seeded = true;
};

std::vector<Kind> kinds() {
  return {
      {"box",
       [](uint32_t) {
         return box_solid({0.3, 0.2, 0.1});
       },
       false},
      {"rock",
       [](uint32_t seed) {
         return rock_solid({0.12, 0.09, 0.07}, 3, 0.25, seed);
       }},
      {"brick",
       [](uint32_t seed) {
         return brick_solid({0.24, 0.115, 0.071}, seed);
       }},
      {"slab",
       [](uint32_t seed) {
         return slab_solid({0.5, 0.4, 0.08}, seed);
       }},
      {"foam",
       [](uint32_t seed) {
         return foam_solid({0.3, 0.2, 0.25}, seed);
       }},
      {"pipe", [](uint32_t) { return pipe_solid(0.05, 0.004, 0.6, 40); }, false},
      {"rebar", [](uint32_t seed) { return rebar_solid(0.006, 0.8, 1.2, seed); }},
      {"wire", [](uint32_t seed) { return wire_solid(0.0015, 0.25, 5, seed); }},
      {"arm", [](uint32_t seed) { return arm_solid(0.45, seed); }},
      {"plank",
       [](uint32_t seed) {
         return plank_solid({0.1, 0.022, 0.8}, seed);
       }},
      {"paper", [](uint32_t seed) { return paper_solid(0.21, 0.297, 1.5, seed); }},
      {"carton",
       [](uint32_t seed) {
         return carton_solid({0.35, 0.25, 0.2}, 0.3, 4.2, seed);
       }},
      {"bag",
       [](uint32_t seed) {
         return bag_solid({0.35, 0.3, 0.28}, seed);
       }},
  };
}

class EverySolid : public testing::TestWithParam<Kind> {};

TEST_P(EverySolid, IsClosedOrientedAndSound) {
  for (uint32_t seed = 0; seed < 6; ++seed) expect_sound(GetParam().make(seed).mesh);
}

TEST_P(EverySolid, IsCoveredByItsHulls) {
  for (uint32_t seed = 0; seed < 3; ++seed) {
    const Solid solid = GetParam().make(seed);
    ASSERT_FALSE(solid.hulls.empty());
    for (const auto& hull : solid.hulls) EXPECT_LE(hull.size(), 64u);
    const auto faces = all_faces(solid);
    EXPECT_LT(worst_height(faces, solid.mesh.vertices), 1e-6);
    EXPECT_LT(worst_height(faces, triangle_centres(solid.mesh)), 1e-4);
  }
}

TEST_P(EverySolid, HasHullsThatDoNotReachFarBeyondIt) {
  for (uint32_t seed = 0; seed < 3; ++seed) {
    const Solid solid = GetParam().make(seed);
    const Eigen::AlignedBox3d box = bounds_of(solid.mesh);
    const double slack = 0.04 * box.sizes().maxCoeff();
    for (const auto& hull : solid.hulls) {
      for (const auto& p : hull) EXPECT_LT(box.exteriorDistance(p), slack);
    }
  }
}

TEST_P(EverySolid, HasItsCentroidAtTheOrigin) {
  const Solid solid = GetParam().make(4);
  EXPECT_LT(centroid(solid.mesh).norm(), 1e-9);
}

TEST_P(EverySolid, IsAFunctionOfItsSeed) {
  const Solid solid = GetParam().make(7), again = GetParam().make(7), other = GetParam().make(8);
  EXPECT_EQ(solid.mesh.vertices, again.mesh.vertices);
  EXPECT_EQ(solid.mesh.triangles, again.mesh.triangles);
  EXPECT_EQ(solid.hulls, again.hulls);
  EXPECT_EQ(solid.mesh.vertices != other.mesh.vertices, GetParam().seeded);
}

TEST_P(EverySolid, HasAReasonableNumberOfTriangles) { EXPECT_LT(GetParam().make(5).mesh.triangles.size(), 9000u); }

INSTANTIATE_TEST_SUITE_P(All, EverySolid, testing::ValuesIn(kinds()),
                         [](const auto& tested) { return tested.param.name; });

TEST(ConvexCover, KeepsTheCornersOfABox) {
  Points3d points = box_corners({2, 3, 4});
  Philox random(1, Stream::shape, 0);
  for (int i = 0; i < 500; ++i)
    points.emplace_back(random.uniform(-1, 1), random.uniform(-1.5, 1.5), random.uniform(-2, 2));
  for (int i = 0; i < 30; ++i) points.emplace_back(1, random.uniform(-1.5, 1.5), 2);  // on an edge
  const Points3d cover = convex_cover(points);
  ASSERT_EQ(cover.size(), 8u);
  for (const auto& p : cover) EXPECT_LT((p.cwiseAbs() - Eigen::Vector3d(1, 1.5, 2)).norm(), 1e-6);
}

TEST(ConvexCover, OfASphereWithFewCornersIsLittleLarger) {
  const Points3d sphere = sphere_mesh(1, 4).vertices;
  for (const size_t corners : {8u, 16u, 32u, 64u}) {
    const Points3d cover = convex_cover(sphere, corners);
    EXPECT_LE(cover.size(), corners);
    EXPECT_LT(worst_height({faces_of_hull(cover)}, sphere), 1e-6);
    // The tightest enclosing polytope with n corners exceeds a sphere's radius by the order of 1/n.
    for (const auto& p : cover) EXPECT_LT(p.norm(), 1 + 9.0 / static_cast<double>(corners));
  }
}

TEST(PrismCover, HoldsItsPoints) {
  Philox random(2, Stream::shape, 0);
  Points3d points;
  for (int i = 0; i < 200; ++i)
    points.emplace_back(random.uniform(0, 1), random.uniform(0, 0.2), random.uniform(-0.1, 0.2));
  const Points3d prism = prism_cover(points, {1, 0.1, -0.2}, 8);
  EXPECT_EQ(prism.size(), 16u);
  EXPECT_LT(worst_height({faces_of_hull(prism)}, points), 1e-9);
}

TEST(Solids, BoxHasItsVolume) { EXPECT_NEAR(signed_volume(box_solid({0.3, 0.2, 0.1}).mesh), 0.006, 1e-16); }

TEST(Solids, PipeHasTheVolumeOfItsWall) {
  const double outer = 0.05, inner = 0.046, length = 0.6;
  const double truth = kPi * (outer * outer - inner * inner) * length;
  for (const int sides : {3, 12, 48, 96}) {
    const Solid pipe = pipe_solid(outer, outer - inner, length, sides);
    const double faceting = sides / (2 * kPi) * std::sin(2 * kPi / sides);  // polygon area over circle area
    EXPECT_NEAR(signed_volume(pipe.mesh), truth * faceting, 1e-15);
  }
  EXPECT_NEAR(signed_volume(pipe_solid(outer, outer - inner, length, 96).mesh), truth, 1e-3 * truth);
}

TEST(Solids, ThoseOfGivenBoundsHaveThem) {
  const Eigen::Vector3d size(0.31, 0.22, 0.17);
  for (uint32_t seed = 0; seed < 8; ++seed) {
    for (const Solid& solid : {rock_solid(size, 3, 0.2, seed), slab_solid(size, seed), foam_solid(size, seed),
                               bag_solid(size, seed), box_solid(size)})
      EXPECT_LT((bounds_of(solid.mesh).sizes() - size).norm(), 1e-9);
  }
}

TEST(Solids, RockOfFewTrianglesOrMany) {
  for (const int detail : {0, 2, 5})
    EXPECT_EQ(rock_solid({0.1, 0.1, 0.1}, detail, 0.2, 1).mesh.triangles.size(), 20u << (2 * detail));
}

TEST(Solids, BrickLosesLittleAndNeverGains) {
  const Eigen::Vector3d size(0.24, 0.115, 0.071);
  for (uint32_t seed = 0; seed < 20; ++seed) {
    const Solid brick = brick_solid(size, seed);
    EXPECT_LT(signed_volume(brick.mesh), size.prod());
    EXPECT_GT(signed_volume(brick.mesh), 0.9 * size.prod());
    EXPECT_TRUE((bounds_of(brick.mesh).sizes().array() <= size.array() + 1e-12).all());
    EXPECT_TRUE((bounds_of(brick.mesh).sizes().array() >= 0.98 * size.array()).all());
  }
}

TEST(Solids, SlabIsFlatAboveAndBelow) {
  const Eigen::Vector3d size(0.5, 0.4, 0.08);
  for (uint32_t seed = 0; seed < 8; ++seed) {
    const Mesh slab = slab_solid(size, seed).mesh;
    double above = 0;
    for (const Eigen::Vector3i& t : slab.triangles) {
      const auto [a, b, c] = corners_of(slab, t);
      const Eigen::Vector3d twice = (b - a).cross(c - a);
      if (twice.normalized().z() > 1 - 1e-12) above += twice.norm() / 2;
    }
    EXPECT_GT(above, 0.4 * size.x() * size.y());
  }
}

TEST(Solids, RebarIsAsHeavyAsABarOfItsLengthWithRibs) {
  const double radius = 0.006, length = 0.8, bar = kPi * radius * radius * length;
  for (uint32_t seed = 0; seed < 8; ++seed) {
    const double volume = signed_volume(rebar_solid(radius, length, 1.0, seed).mesh);
    EXPECT_GT(volume, 0.95 * bar);  // twelve sides
    EXPECT_LT(volume, 1.15 * bar);
  }
}

TEST(Solids, RebarWithoutBendIsStraight) {
  const Solid bar = rebar_solid(0.006, 0.8, 0, 3);
  const Eigen::Vector3d size = bounds_of(bar.mesh).sizes();
  EXPECT_LT(size.head<2>().maxCoeff(), 2.3 * 0.006);
  EXPECT_NEAR(size.z(), 0.8, 0.008);
}

TEST(Solids, WireFillsItsCube) {
  const double radius = 0.0015, extent = 0.25;
  for (const int loops : {1, 4, 9}) {
    const Solid wire = wire_solid(radius, extent, loops, 5);
    EXPECT_NEAR(bounds_of(wire.mesh).sizes().maxCoeff(), extent, 2 * radius);
    EXPECT_LE(wire.hulls.size(), 40u);
    // A wire's volume is its section (an octagon) times its length, which grows with the number of loops.
    const double length = signed_volume(wire.mesh) / (4 * radius * radius * std::sin(kPi / 4));
    EXPECT_GT(length, loops * 1.2 * extent);
    EXPECT_LT(length, loops * 4.5 * extent);
  }
}

TEST(Solids, ArmHasItsLengthAndFiveFingers) {
  for (uint32_t seed = 0; seed < 8; ++seed) {
    const Solid arm = arm_solid(0.45, seed);
    EXPECT_NEAR(bounds_of(arm.mesh).sizes().z(), 0.45, 1e-3);
    EXPECT_EQ(connected_parts(arm.mesh).size(), 7u);  // forearm with palm, five fingers, ball of the thumb
  }
}

TEST(Solids, PlankHasItsSizeAndBowsWithinItsBounds) {
  const Eigen::Vector3d size(0.1, 0.022, 0.8);
  for (uint32_t seed = 0; seed < 8; ++seed) {
    const Eigen::Vector3d sizes = bounds_of(plank_solid(size, seed).mesh).sizes();
    EXPECT_NEAR(sizes.x(), size.x(), 1e-9);
    EXPECT_NEAR(sizes.z(), size.z(), 1e-9);
    EXPECT_GT(sizes.y(), size.y());
    EXPECT_LE(sizes.y(), size.y() + 0.01 * size.z());
  }
}

TEST(Solids, PaperKeepsItsAreaHoweverItIsCurled) {
  const double size_x = 0.21, size_y = 0.297, thickness = 0.0003;
  for (const double curl : {0.0, 1.0, 3.0}) {
    const double volume = signed_volume(paper_solid(size_x, size_y, curl, 6).mesh);
    EXPECT_NEAR(volume, size_x * size_y * thickness, 0.03 * size_x * size_y * thickness) << curl;
  }
}

TEST(Solids, PaperTurnsByItsCurl) {
  // Chord over arc length of a circular arc with this angle; folds and uneven bending have little effect.
  const double curl = 2.5, size = 0.2;
  const Eigen::Vector3d sizes = bounds_of(paper_solid(size, size, curl, 2).mesh).sizes();
  EXPECT_NEAR(sizes.x(), size * std::sin(curl / 2) / (curl / 2), 0.2 * size);
  EXPECT_GT(sizes.z(), 0.2 * size);
}

TEST(Solids, PaperIsBumpedAgainstAsTwoMillimetres) {
  for (const double curl : {0.0, 1.0, 3.0}) {
    const Solid paper = paper_solid(0.21, 0.297, curl, 6);
    for (const auto& hull : paper.hulls) {
      for (const Plane& face : faces_of_hull(hull)) {  // a polytope is thinnest across a face or two edges
        double depth = 0;
        for (const auto& p : hull) depth = std::max(depth, face.offset - face.normal.dot(p));
        EXPECT_GT(depth, 0.002);
      }
    }
  }
}

TEST(Solids, CartonIsOpenAtTheTopAndItsFlapsKeepTheirAngles) {
  const Eigen::Vector3d size(0.35, 0.25, 0.2);
  EXPECT_EQ(connected_parts(carton_solid(size, 1, 2, 1).mesh).size(), 9u);
  const double flap = 0.125, panel = 0.003;
  const auto extent = [&](double angle) -> Eigen::Vector3d {
    return bounds_of(carton_solid(size, angle, angle, 3).mesh).sizes();
  };
  EXPECT_NEAR(extent(kPi / 2).z(), size.z() + flap, 0.002);           // upright
  EXPECT_NEAR(extent(kPi).x(), size.x() + 2 * (flap - panel), 0.01);  // outwards
  EXPECT_NEAR(extent(kPi).y(), size.y() + 2 * (flap - panel), 0.01);
  EXPECT_NEAR(extent(0).x(), size.x(), 0.01);  // closed
  EXPECT_NEAR(extent(0).z(), size.z() + panel / 2, 0.006);
  EXPECT_NEAR(extent(1.5 * kPi).z(), size.z() + panel / 2, 0.006);  // hanging
}

TEST(Solids, FoamIsHollowedOut) {
  const Eigen::Vector3d size(0.3, 0.2, 0.25);
  for (uint32_t seed = 0; seed < 8; ++seed) {
    const Solid foam = foam_solid(size, seed);
    double hulls = 0;
    for (const auto& hull : foam.hulls) {
      Eigen::AlignedBox3d box;
      for (const auto& p : hull) box.extend(p);
      hulls += box.volume();
    }
    EXPECT_TRUE(foam.hulls.size() == 2 || foam.hulls.size() == 3);
    EXPECT_LT(signed_volume(foam.mesh), 0.95 * hulls);
    EXPECT_LT(signed_volume(foam.mesh), 0.75 * size.prod());
  }
}

}  // namespace
}  // namespace fringeslam::sim
