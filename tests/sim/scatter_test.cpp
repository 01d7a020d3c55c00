// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/scatter.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <limits>
#include <set>

namespace fringeslam::sim {
namespace {

constexpr uint64_t kSeeds = 50;
constexpr double kTouch = 1e-9;  // m; stacked objects share a plane up to rounding

ScatterItem item(Shape shape, const Eigen::Vector3d& low, const Eigen::Vector3d& high, double weight = 1) {
  return {shape, low, high, {}, weight};
}

Scatter crowd(std::vector<ScatterItem> items) {
  Scatter scatter;
  scatter.count = 60;
  scatter.area_x = 0.4;
  scatter.area_y = 0.3;
  scatter.max_height = 0.16;
  scatter.items = std::move(items);
  return scatter;
}

Scatter boxes_and_more() {
  return crowd({item(Shape::box, {0.04, 0.03, 0.02}, {0.11, 0.09, 0.08}, 3),
                item(Shape::cylinder, {0.02, 0.02, 0.02}, {0.05, 0.05, 0.07}),
                item(Shape::sphere, {0.02, 0.02, 0.02}, {0.05, 0.05, 0.05})});
}

struct Interval {
  double low = std::numeric_limits<double>::infinity(), high = -std::numeric_limits<double>::infinity();
};

Interval along(const Object& object, const Eigen::Vector3d& direction) {
  Interval interval;
  for (const Eigen::Vector3d& v : object.mesh->vertices) {
    const double x = direction.dot(object.world_from_object * v);
    interval.low = std::min(interval.low, x);
    interval.high = std::max(interval.high, x);
  }
  return interval;
}

// True if two upright cuboids are separate (separating axis theorem; the cross products of their edges add only the
// vertical axis).
bool cuboids_apart(const Object& a, const Object& b) {
  const Eigen::Matrix3d& ra = a.world_from_object.rotation;
  const Eigen::Matrix3d& rb = b.world_from_object.rotation;
  const std::array<Eigen::Vector3d, 5> axes = {ra.col(0), ra.col(1), ra.col(2), rb.col(0), rb.col(1)};
  return std::any_of(axes.begin(), axes.end(), [&](const Eigen::Vector3d& axis) {
    const Interval i = along(a, axis), j = along(b, axis);
    return i.high <= j.low + kTouch || j.high <= i.low + kTouch;
  });
}

bool equal(const std::vector<Object>& a, const std::vector<Object>& b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(), [](const Object& x, const Object& y) {
    return x.mesh->vertices == y.mesh->vertices && x.texture_seed == y.texture_seed &&
           x.world_from_object.rotation == y.world_from_object.rotation &&
           x.world_from_object.translation == y.world_from_object.translation;
  });
}

TEST(Scatter, ObjectsDoNotInterpenetrate) {
  for (uint64_t seed = 0; seed < kSeeds; ++seed) {
    const std::vector<Object> objects = scatter_objects(boxes_and_more(), seed, 1);
    ASSERT_GT(objects.size(), 10u);
    for (size_t i = 0; i < objects.size(); ++i) {
      for (size_t j = 0; j < i; ++j)
        ASSERT_TRUE(cuboids_apart(objects[i], objects[j])) << "seed " << seed << ", objects " << i << " and " << j;
    }
  }
}

TEST(Scatter, EveryObjectStandsOnTheGroundOrOnAnother) {
  int stacked = 0;
  for (uint64_t seed = 0; seed < kSeeds; ++seed) {
    std::set<double> tops;
    for (const Object& object : scatter_objects(boxes_and_more(), seed, 1)) {
      const Interval z = along(object, Eigen::Vector3d::UnitZ());
      const auto stands_on = [&](double top) { return std::abs(z.low - top) < kTouch; };
      const bool on_another = std::any_of(tops.begin(), tops.end(), stands_on);
      ASSERT_TRUE(stands_on(0) || on_another) << "seed " << seed << ", bottom at " << z.low;
      stacked += !stands_on(0);
      tops.insert(z.high);
    }
  }
  EXPECT_GT(stacked, 50);  // otherwise stacking was not tested
}

TEST(Scatter, StaysWithinItsHeightAndArea) {
  Scatter scatter = boxes_and_more();
  scatter.items.push_back(item(Shape::rock, {0.03, 0.03, 0.03}, {0.1, 0.08, 0.15}, 3));
  for (uint64_t seed = 0; seed < kSeeds; ++seed) {
    for (const Object& object : scatter_objects(scatter, seed, 1)) {
      ASSERT_LE(along(object, Eigen::Vector3d::UnitZ()).high, scatter.max_height + kTouch) << "seed " << seed;
      ASSERT_LE(std::abs(object.world_from_object.translation.x()), scatter.area_x / 2);
      ASSERT_LE(std::abs(object.world_from_object.translation.y()), scatter.area_y / 2);
    }
  }
}

TEST(Scatter, SizesLieBetweenTheirCorners) {
  const ScatterItem boxes = item(Shape::box, {0.04, 0.03, 0.02}, {0.05, 0.035, 0.06});
  for (const Object& object : scatter_objects(crowd({boxes}), 3, 0)) {
    const Eigen::Vector3d size = 2 * object.mesh->vertices.back();
    for (int i = 0; i < 3; ++i) {
      EXPECT_GE(size[i], boxes.size_min[i]);
      EXPECT_LE(size[i], boxes.size_max[i]);
    }
  }
}

TEST(Scatter, IsAFunctionOfSeedAndGenerator) {
  const Scatter scatter = boxes_and_more();
  for (uint64_t seed = 0; seed < kSeeds; ++seed) {
    const std::vector<Object> objects = scatter_objects(scatter, seed, 1);
    EXPECT_TRUE(equal(objects, scatter_objects(scatter, seed, 1))) << seed;
    EXPECT_FALSE(equal(objects, scatter_objects(scatter, seed + 1, 1))) << seed;
    EXPECT_FALSE(equal(objects, scatter_objects(scatter, seed, 2))) << seed;
  }
}

TEST(Scatter, MovesWithItsArea) {
  Scatter scatter = boxes_and_more();
  const std::vector<Object> reference = scatter_objects(scatter, 4, 1);
  scatter.world_from_area = pose_from({{100, -200, 300}, {10, 20, 30}});
  const std::vector<Object> moved = scatter_objects(scatter, 4, 1);
  ASSERT_EQ(moved.size(), reference.size());
  for (size_t i = 0; i < moved.size(); ++i) {
    const Pose expected = scatter.world_from_area * reference[i].world_from_object;
    EXPECT_LT(difference(moved[i].world_from_object, expected).norm(), 1e-12);
  }
}

TEST(Scatter, WeightsAreShares) {
  Scatter scatter = crowd({item(Shape::box, {0.01, 0.01, 0.01}, {0.01, 0.01, 0.01}, 3),
                           item(Shape::sphere, {0.01, 0.01, 0.01}, {0.01, 0.01, 0.01}, 1)});
  scatter.count = 2000;
  scatter.area_x = scatter.area_y = 20;  // room for all
  const std::vector<Object> objects = scatter_objects(scatter, 1, 0);
  ASSERT_EQ(objects.size(), 2000u);
  const auto boxes = std::count_if(objects.begin(), objects.end(),
                                   [](const Object& object) { return object.mesh->vertices.size() == 8; });
  EXPECT_NEAR(static_cast<double>(boxes), 1500, 5 * std::sqrt(2000 * 0.75 * 0.25));
}

TEST(Scatter, PlacesFewerObjectsWhenTheAreaIsFull) {
  Scatter scatter = crowd({item(Shape::box, {0.2, 0.2, 0.1}, {0.2, 0.2, 0.1})});
  scatter.max_height = 0.11;
  const size_t placed = scatter_objects(scatter, 1, 0).size();
  EXPECT_GE(placed, 1u);
  EXPECT_LT(placed, 15u);
}

}  // namespace
}  // namespace fringeslam::sim
