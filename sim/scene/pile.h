// SPDX-License-Identifier: Apache-2.0
// A pile: pieces of several kinds, dropped onto an area and settled (sim/scene/settle.h). Lengths in m. A pile that was
// settled before is taken from the cache (sim/scene/cache.h).
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "sim/scene/scene.h"
#include "sim/scene/settle.h"
#include "sim/scene/solids.h"

namespace fringeslam::sim {

// The kinds of pieces, by the names that they have in scene files.
const std::vector<std::string>& piece_kinds();

// A piece of a kind, of this extent along x, y and z; thicknesses and bends that the extent leaves open are drawn from
// the seed. `detail` is of stones.
Solid make_piece(const std::string& kind, const Eigen::Vector3d& size, int detail, uint32_t seed);

struct PileItem {
  std::string kind;
  Eigen::Vector3d size_min = Eigen::Vector3d::Zero(), size_max = Eigen::Vector3d::Zero();  // drawn evenly between
  Material material;
  double weight = 1;  // how often, against the other items
  int variants = 0;   // so many different ones, each several times and held once; 0: all different
  int detail = 3;
  // Instead of by weight: so many of it, dropped when this share of the others has been dropped.
  std::optional<int> exactly = {};
  double after = 0;
};

struct Pile {
  int count = 0;
  DropArea area;
  Pose world_from_area;
  std::vector<PileItem> items;
};

struct PileObjects {
  std::vector<Object> objects;
  Settled settled;
  bool from_cache = false;
};
PileObjects pile_objects(const Pile& pile, uint64_t seed, uint32_t generator);

}  // namespace fringeslam::sim
