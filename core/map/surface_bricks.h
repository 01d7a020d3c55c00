// SPDX-License-Identifier: Apache-2.0
// Bricks of 8 x 8 x 8 voxels, the unit in which the surface model is stored, fused and meshed. Voxel (i, j, k) samples
// the world at (i, j, k) voxel_m; brick b holds the voxels 8 b to 8 b + 7 of each axis, z varying fastest, then y,
// then x.
//
// A voxel has 64 bits, so that a brick is a memory page and a cache line holds eight voxels: the signed distance in
// steps of truncation / 32767 (16 bits), the grey value in steps of 1/256 (16 bits), and the weight (a float), 0 if
// unobserved. With 0.5 mm voxels a distance step is 0.05 um, less than a float's rounding of a depth of 1 m.
#pragma once

#include <bit>
#include <cstdint>

#include "core/base/instruction_set.h"
#include "core/map/grid_range.h"

namespace fringeslam {

constexpr int kBrickEdge = 8, kBrickVoxels = kBrickEdge * kBrickEdge * kBrickEdge;
constexpr float kDistanceSteps = 32767, kGreySteps = 256;

using BrickIndex = GridIndex;
struct Brick {
  BrickIndex index;
  const int64_t* voxels;
};

struct VoxelScale {
  double voxel_m = 0, truncation_m = 0;
};

// Bricks lie within +-2^20 of the world's origin.
constexpr int32_t kMaxBrick = (1 << 20) - 2;
inline uint64_t brick_key(const BrickIndex& brick) {
  uint64_t key = 0;
  for (const int32_t i : brick) key = key << 21 | (static_cast<uint64_t>(i + (1 << 20)) & 0x1fffff);
  return key;
}
inline BrickIndex brick_of(uint64_t key) {
  const auto part = [&](int shift) { return static_cast<int32_t>(key >> shift & 0x1fffff) - (1 << 20); };
  return {part(42), part(21), part(0)};
}

FRINGESLAM_INLINE float voxel_distance(uint64_t voxel) {
  return static_cast<float>(static_cast<int16_t>(static_cast<uint16_t>(voxel)));
}
FRINGESLAM_INLINE float voxel_grey(uint64_t voxel) { return static_cast<float>(static_cast<uint16_t>(voxel >> 16)); }
FRINGESLAM_INLINE float voxel_weight(uint64_t voxel) {
  return std::bit_cast<float>(static_cast<uint32_t>(voxel >> 32));
}

}  // namespace fringeslam
