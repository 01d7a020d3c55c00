// SPDX-License-Identifier: Apache-2.0
// The bricks of a surface model by their keys.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <unordered_map>
#include <utility>
#include <vector>

#include "core/map/surface_bricks.h"

namespace fringeslam {

using BrickVoxels = std::array<int64_t, kBrickVoxels>;

// Any number of threads may search the map while none adds bricks.
class BrickMap {
 public:
  // Returns the voxels of a brick, or null if the map does not have it.
  int64_t* find(uint64_t key) const {
    const auto found = bricks_.find(key);
    return found == bricks_.end() ? nullptr : found->second->data();
  }
  // Adds a brick that the map does not have.
  void add(uint64_t key, std::unique_ptr<BrickVoxels> voxels) { bricks_.emplace(key, std::move(voxels)); }

  // Returns all bricks, neighbors close to each other, in an order that depends on nothing but their indices.
  std::vector<Brick> bricks() const;
  size_t memory_bytes() const;

 private:
  struct Hash {
    size_t operator()(uint64_t key) const noexcept { return static_cast<size_t>(key * 0x9e3779b97f4a7c15u >> 7); }
  };
  std::unordered_map<uint64_t, std::unique_ptr<BrickVoxels>, Hash> bricks_;
};

}  // namespace fringeslam
