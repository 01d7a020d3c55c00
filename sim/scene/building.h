// SPDX-License-Identifier: Apache-2.0
// A building drawn from a seed, and a tour through it. Every storey has a corridor along x with a row of rooms on each
// side; a stairwell at each end of the corridor connects the storeys, so that a tour closes loops of a room, of a row of
// rooms, of a storey and of the whole building. Lengths in m.
//
//    +-------+----+---------+--------+----+-------+    y
//    |gallery|    |  room   |  room  |    |gallery|    ^
//    |       | end|---door--+--door--| end|       |    |
//    |flight |     corridor, y = 0        | flight|    +--> x
//    +-------+-door--+--door--+--door-----+-------+
//            |  room |  room  |   room    |
//            +-------+--------+-----------+
#pragma once

#include <cstdint>
#include <vector>

#include "sim/scene/scatter.h"

namespace fringeslam::sim {

struct BuildingPlan {
  int storeys = 2;
  int rooms = 5;          // of a row, two or more
  double room_x = 3.2;    // mean size along the corridor; the partitions' places are drawn
  double room_y = 3.4;    // across it
  double corridor = 1.8;  // width; also that of flights and galleries
  double storey = 2.4;    // height from floor to floor
  double wall = 0.12;
  double door = 1;
};

struct Building {
  BuildingPlan plan;
  Material wall, floor;
  double rubble_per_m2 = 0;  // attempted; fewer fit
  double max_height = 0.3;   // of rubble
  std::vector<ScatterItem> items;
};

// Returns floors, walls, stairs and the rubble in rooms, corridors and on the steps.
std::vector<Object> building_objects(const Building& building, uint64_t seed);

struct Tour {
  double height = 0.95;  // of the camera above the floor, perpendicular to a flight's slope
  double ahead = 0.55;   // distance of the point it looks at along the floor
  int laps = 1;
};

// Returns world_from_camera at waypoints of a tour that starts and ends in the corridor of the lowest storey. It visits
// every room of every storey: the row at +y through the doors between its rooms, the other row from the corridor; it
// climbs the stairs at the end x = 0, descends those at the other end, and passes through the first row once more.
std::vector<Pose> tour_waypoints(const BuildingPlan& plan, const Tour& tour, uint64_t seed);

}  // namespace fringeslam::sim
