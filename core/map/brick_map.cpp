// SPDX-License-Identifier: Apache-2.0
#include "core/map/brick_map.h"

#include <algorithm>

namespace fringeslam {

namespace {

// Blocks of 512, 16 and 1 bricks along each axis; within a block, x varies most slowly.
using Place = std::array<int32_t, 9>;
Place place_of(const BrickIndex& brick) {
  constexpr int kBlock = 9, kPart = 4;  // bits
  Place place;
  for (size_t axis = 0; axis < 3; ++axis) {
    place[axis] = brick[axis] >> kBlock;
    place[3 + axis] = (brick[axis] >> kPart) & ((1 << (kBlock - kPart)) - 1);
    place[6 + axis] = brick[axis] & ((1 << kPart) - 1);
  }
  return place;
}

}  // namespace

std::vector<Brick> BrickMap::bricks() const {
  std::vector<std::pair<Place, const int64_t*>> sorted;
  sorted.reserve(bricks_.size());
  for (const auto& [key, voxels] : bricks_) sorted.emplace_back(place_of(brick_of(key)), voxels->data());
  std::sort(sorted.begin(), sorted.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
  std::vector<Brick> all;
  all.reserve(sorted.size());
  for (const auto& [place, voxels] : sorted) {
    Brick brick{{}, voxels};
    for (size_t axis = 0; axis < 3; ++axis)
      brick.index[axis] = place[axis] * 512 + place[3 + axis] * 16 + place[6 + axis];
    all.push_back(brick);
  }
  return all;
}

size_t BrickMap::memory_bytes() const {
  // A node has the key, the pointer, the next node and the sizes of both allocations.
  constexpr size_t kNode = 3 * sizeof(void*) + 2 * sizeof(size_t);
  return sizeof(*this) + bricks_.size() * (sizeof(BrickVoxels) + kNode) + bricks_.bucket_count() * sizeof(void*);
}

}  // namespace fringeslam
