// SPDX-License-Identifier: Apache-2.0
// Point cloud in the world frame (docs/method.md, section 8.3): frames are merged in cells of a fixed size, and the
// points of one cell are averaged, weighted by their sigmas. map_cloud.h makes the cloud of a whole map.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "core/map/grid_range.h"
#include "core/types/frame.h"
#include "core/types/options.h"
#include "core/types/pose.h"

namespace fringeslam {

struct CloudOptions {
  double cell_m = 0;

  template <class Visitor>
  void describe(Visitor& v) {
    v.field("cell_m", cell_m, {0, 1},
            "edge length of the cells in which points are merged, m; 0: a pixel's footprint at mid range");
  }
};

struct CloudPoint {
  Eigen::Vector3f position_m;  // world frame
  Eigen::Vector3f normal;
  uint8_t grey = 0;
  float sigma_m = 0;
};

class CloudMap {
 public:
  // Throws Error unless cell_m is at least 1e-5. Points in cells outside `range`, or 2^30 cells from the origin, are
  // ignored.
  explicit CloudMap(double cell_m, const GridRange& range = {});
  ~CloudMap();
  CloudMap(CloudMap&&) noexcept;
  CloudMap& operator=(CloudMap&&) noexcept;

  void add(const Frame& frame, const Pose& world_from_camera);
  // Returns the points in the order of their blocks of 4 x 4 x 4 cells and of the cells in these, independent of the order
  // in which frames were added.
  std::vector<CloudPoint> points() const;

 private:
  struct Block;
  Block& block_at(const GridIndex& index);
  void grow();

  double cell_m_;
  GridRange range_;
  std::vector<GridIndex> indices_;  // of the blocks
  std::vector<std::unique_ptr<Block>> blocks_;
  std::vector<uint32_t> slots_;  // hash table: position of a block + 1, or 0
};

}  // namespace fringeslam
