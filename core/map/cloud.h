// SPDX-License-Identifier: Apache-2.0
// Point cloud in the world frame (docs/method.md, section 8.3): frames are merged in cells of a fixed size, and the
// points of one cell are averaged, weighted by their sigmas.
#pragma once

#include <array>
#include <cstdint>
#include <unordered_map>
#include <vector>

#include "core/types/frame.h"
#include "core/types/options.h"
#include "core/types/pose.h"

namespace fringeslam {

struct CloudOptions {
  double cell_m = 0.001;

  template <class Visitor>
  void describe(Visitor& v) {
    v.field("cell_m", cell_m, {1e-5, 1}, "edge length of the cells in which points are merged, m");
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
  explicit CloudMap(const CloudOptions& options);
  void add(const Frame& frame, const Pose& world_from_camera);
  // Returns the points sorted by cell coordinates, independent of the order in which cells were created.
  std::vector<CloudPoint> points() const;

 private:
  using Key = std::array<int32_t, 3>;
  struct KeyHash {
    size_t operator()(const Key& key) const;
  };
  struct Cell {
    Eigen::Vector3d position = Eigen::Vector3d::Zero(), normal = Eigen::Vector3d::Zero();
    double grey = 0, weight = 0;
  };
  double cell_m_;
  std::unordered_map<Key, Cell, KeyHash> cells_;
};

}  // namespace fringeslam
