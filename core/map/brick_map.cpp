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
  std::vector<Brick> all;
  all.reserve(bricks_.size());
  for (const auto& [key, voxels] : bricks_) all.push_back({brick_of(key), voxels->data()});
  std::sort(all.begin(), all.end(),
            [](const Brick& a, const Brick& b) { return place_of(a.index) < place_of(b.index); });
  return all;
}

size_t BrickMap::memory_bytes() const {
  // A node has the key, the pointer, the next node and the sizes of both allocations.
  constexpr size_t kNode = 3 * sizeof(void*) + 2 * sizeof(size_t);
  return sizeof(*this) + bricks_.size() * (sizeof(BrickVoxels) + kNode) + bricks_.bucket_count() * sizeof(void*);
}

}  // namespace fringeslam
