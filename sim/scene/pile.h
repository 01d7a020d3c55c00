// SPDX-License-Identifier: Apache-2.0
// Piles: pieces of several kinds, dropped onto an area and settled by rigid-body simulation (sim/scene/settle.h).
// Lengths in m. Previously settled piles are read from the cache (sim/scene/cache.h).
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

// Returns the names of the piece kinds, as used in scene files.
const std::vector<std::string>& piece_kinds();

// Builds a piece of the given kind with extents `size` along x, y and z; properties not fixed by the size, such as
// bends, are drawn from the seed. `detail` is the subdivision level of stones.
Solid make_piece(const std::string& kind, const Eigen::Vector3d& size, int detail, uint32_t seed);

struct PileItem {
  std::string kind;
  Eigen::Vector3d size_min = Eigen::Vector3d::Zero(), size_max = Eigen::Vector3d::Zero();  // drawn uniformly between
  Material material;
  double weight = 1;  // relative frequency among the items
  int variants = 0;   // number of distinct shapes, each stored once and reused; 0: every piece is distinct
  int detail = 3;
  // Fixed number of pieces instead of a weight, inserted after the fraction `after` of the weighted pieces.
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
// Draws the pieces, settles them and returns the objects; `generator` selects the random stream, `piles_before` that of the fall.
// Throws Error if the pieces do not come to rest.
PileObjects pile_objects(const Pile& pile, uint64_t seed, uint32_t generator, uint32_t piles_before = 0);

}  // namespace fringeslam::sim
