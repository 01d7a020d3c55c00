// SPDX-License-Identifier: Apache-2.0
// Point cloud in the world frame (docs/method.md, section 8.3): frames are merged in cells of a fixed size, and the
// points of one cell are averaged, weighted by their sigmas. map_cloud.h makes the cloud of a whole map.
#pragma once

#include <cstdint>
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
  // Throws Error unless cell_m is at least 1e-5. Points in cells outside `range` are ignored.
  explicit CloudMap(double cell_m, const GridRange& range = {});
  void add(const Frame& frame, const Pose& world_from_camera);
  // Returns the points sorted by cell coordinates, independent of the order in which cells were created.
  std::vector<CloudPoint> points() const;

 private:
  using Key = GridIndex;
  struct Cell {
    Eigen::Vector3d position = Eigen::Vector3d::Zero(), normal = Eigen::Vector3d::Zero();
    double grey = 0, weight = 0;
  };
  Cell& cell_at(const Key& key);
  void grow();

  double cell_m_;
  GridRange range_;
  std::vector<Key> keys_;  // of the cells
  std::vector<Cell> cells_;
  std::vector<uint32_t> slots_;  // hash table: position of a cell + 1, or 0
};

}  // namespace fringeslam
