// SPDX-License-Identifier: Apache-2.0
// Boxes of cells of a grid that covers the world.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace fringeslam {

using GridIndex = std::array<int32_t, 3>;

// Cells from `first` to `last`, both included; by default all.
struct GridRange {
  GridIndex first = {INT32_MIN, INT32_MIN, INT32_MIN}, last = {INT32_MAX, INT32_MAX, INT32_MAX};

  bool contains(const GridIndex& cell) const {
    bool inside = true;
    for (size_t i = 0; i < 3; ++i) inside &= cell[i] >= first[i] && cell[i] <= last[i];
    return inside;
  }
};

}  // namespace fringeslam
