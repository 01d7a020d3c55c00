// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/building.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "sim/nearest_surface.h"
#include "sim/scene/routes.h"
#include "tests/sim/test_scenes.h"

namespace fringeslam::sim {
namespace {

constexpr uint64_t kSeeds = 20;

Building rough(double rubble_per_m2) {
  Building building;
  building.rubble_per_m2 = rubble_per_m2;
  building.items = {{Shape::box, {0.1, 0.1, 0.05}, {0.3, 0.25, 0.2}, {}, 2, 20},
                    {Shape::rock, {0.1, 0.08, 0.06}, {0.25, 0.2, 0.15}, {}, 1, 20}};
  return building;
}

std::vector<Pose> walk(const BuildingPlan& plan, const Tour& tour, uint64_t seed) {
  const std::vector<Pose> waypoints = tour_waypoints(plan, tour, seed);
  return sample_spline(waypoints, 8 * static_cast<int>(waypoints.size()), false);
}

double length_m(const std::vector<Pose>& path) {
  double length = 0;
  for (size_t i = 1; i < path.size(); ++i) length += (path[i].translation - path[i - 1].translation).norm();
  return length;
}

// The place on the floor below a camera, perpendicular to a flight's slope.
Eigen::Vector3d floor_point(const Pose& world_from_camera, const Tour& tour) {
  const Eigen::Vector3d down = Eigen::Vector3d(0, tour.height, tour.ahead).normalized();  // y is down, z ahead
  return world_from_camera * (tour.height * down);
}

class BuildingOfSeed : public testing::TestWithParam<uint64_t> {};

TEST_P(BuildingOfSeed, LeavesRoomForTheTour) {
  const Building building = rough(0);
  const NearestSurface walls(world_of(building_objects(building, GetParam()), coaxial_rig()));
  std::vector<Eigen::Vector3d> eyes;
  for (const Pose& camera : walk(building.plan, {}, GetParam())) eyes.push_back(camera.translation);
  const std::vector<double> distances = walls.distances_m(eyes, 2);
  // A door leaves half its width, less where a corner nearby is rounded.
  EXPECT_GT(*std::min_element(distances.begin(), distances.end()), 0.4 * building.plan.door);
}

TEST_P(BuildingOfSeed, HasAFloorBelowTheWholeTour) {
  const Building building = rough(0);
  const Tour tour;
  const NearestSurface walls(world_of(building_objects(building, GetParam()), coaxial_rig()));
  std::vector<Eigen::Vector3d> floor;
  for (const Pose& camera : tour_waypoints(building.plan, tour, GetParam())) floor.push_back(floor_point(camera, tour));
  const std::vector<double> distances = walls.distances_m(floor, 2);
  // The slope of a flight touches the edges of its steps or is half a riser above them.
  EXPECT_LT(*std::max_element(distances.begin(), distances.end()), 0.2);
}

TEST_P(BuildingOfSeed, IsVisitedCompletelyAndLeftWhereItWasEntered) {
  const BuildingPlan plan;
  const std::vector<Pose> path = walk(plan, {}, GetParam());
  EXPECT_GT(length_m(path), 300);
  EXPECT_LT((path.front().translation - path.back().translation).norm(), 1.5);
  // Every place of the two rows of rooms is near the path.
  const double half = plan.corridor / 2, length = plan.rooms * plan.room_x + 2 * plan.corridor;
  for (int storey = 0; storey < plan.storeys; ++storey) {
    for (const double side : {-1.0, 1.0}) {
      const double margin = side > 0 ? plan.corridor : 0;
      for (double x = margin + 0.2; x < length - margin; x += 0.4) {
        for (double y = half + 0.2; y < half + plan.room_y; y += 0.4) {
          const Eigen::Vector3d place(x, side * y, storey * plan.storey + 0.95);
          const double nearest =
              (std::min_element(path.begin(), path.end(),
                                [&](const Pose& a, const Pose& b) {
                                  return (a.translation - place).norm() < (b.translation - place).norm();
                                })
                   ->translation -
               place)
                  .norm();
          ASSERT_LT(nearest, 1.5) << "storey " << storey << ", x " << x << ", y " << side * y;
        }
      }
    }
  }
}

TEST_P(BuildingOfSeed, TurnsTheCameraSmoothly) {
  const std::vector<Pose> path = walk({}, {.laps = 2}, GetParam());
  for (size_t i = 1; i < path.size(); ++i) {
    const Pose step = path[i - 1].inverse() * path[i];
    ASSERT_LT(rotation_rad(step), 0.35) << i;
    // The camera stays upright: image rows run downwards.
    ASSERT_LT(path[i].rotation.col(1).z(), 0.2) << i;
  }
}

INSTANTIATE_TEST_SUITE_P(Seeds, BuildingOfSeed, testing::Range<uint64_t>(1, kSeeds + 1));

TEST(Building, ConnectsSeveralStoreys) {
  const BuildingPlan plan{.storeys = 4, .rooms = 2};
  double top = 0;
  for (const Pose& camera : tour_waypoints(plan, {}, 3)) top = std::max(top, camera.translation.z());
  EXPECT_NEAR(top, 3 * plan.storey + 0.95, 0.4);
  const BuildingPlan flat{.storeys = 1, .rooms = 3};
  for (const Pose& camera : walk(flat, {}, 3)) ASSERT_NEAR(camera.translation.z(), 0.95, 0.1);
}

TEST(Building, StoresSharedShapesOnce) {
  const Building building = rough(18);
  const std::vector<Object> objects = building_objects(building, 1);
  const size_t structure = building_objects(rough(0), 1).size();
  std::set<const Mesh*> meshes;
  for (const Object& object : objects) meshes.insert(object.mesh.get());
  EXPECT_GT(objects.size(), structure + 2000);
  EXPECT_LE(meshes.size(), structure + 2 * 2 * 20);  // two items, in rooms and on steps
}

TEST(Building, DependsOnTheSeedOnly) {
  const Building building = rough(5);
  const auto places = [&](uint64_t seed) {
    std::vector<double> x;
    for (const Object& object : building_objects(building, seed)) x.push_back(object.world_from_object.translation.x());
    return x;
  };
  EXPECT_EQ(places(1), places(1));
  EXPECT_NE(places(1), places(2));
}

// Rubble on the steps lies on them: the lowest point of each piece is at the height of a tread.
TEST(Building, PutsRubbleOntoTheSteps) {
  Building building = rough(18);
  building.items.resize(1);  // boxes; rocks sink into the ground
  const BuildingPlan& plan = building.plan;
  const int steps = static_cast<int>(std::ceil(plan.storey / 0.18));
  int on_steps = 0;
  for (const Object& object : building_objects(building, 1)) {
    const Eigen::Vector3d& place = object.world_from_object.translation;
    if (object.mesh->vertices.size() != 8 || place.x() > -0.05 || place.x() < -plan.storey / 0.625 ||
        std::abs(place.y()) > 0.4 * plan.corridor)
      continue;
    Eigen::Vector3d low = Eigen::Vector3d::Constant(1e9), high = -low;
    for (const Eigen::Vector3d& vertex : object.mesh->vertices) {
      low = low.cwiseMin(object.world_from_object * vertex);
      high = high.cwiseMax(object.world_from_object * vertex);
    }
    if ((high - low).maxCoeff() > 0.5) continue;  // a floor
    ++on_steps;
    const double tread = low.z() / (plan.storey / steps);
    EXPECT_NEAR(tread, std::round(tread), 0.7) << place.transpose();  // others are stacked on a piece
    EXPECT_GT(low.z(), 0.1);
  }
  EXPECT_GT(on_steps, 20);
}

}  // namespace
}  // namespace fringeslam::sim
