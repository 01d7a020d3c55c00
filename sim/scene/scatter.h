// SPDX-License-Identifier: Apache-2.0
// Places boxes, cylinders and rocks at random upright poses on a table, on the floor or flat on one
// another, without interpenetration.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <string>
#include <vector>

#include "sim/scene/scene.h"

namespace fringeslam::sim {

enum class Shape { box, cylinder, sphere, rock };

// One kind of thing to scatter; sizes are drawn uniformly between the two corners.
struct ScatterItem {
  Shape shape = Shape::box;
  Eigen::Vector3d size_min = Eigen::Vector3d::Zero(), size_max = Eigen::Vector3d::Zero();
  Material material;
  double weight = 1;
};

struct Scatter {
  int count = 0;
  double area_x = 0, area_y = 0;  // m, around the origin of the scatter
  double max_height = 0.3;        // m; nothing is stacked higher
  Pose world_from_area;
  std::vector<ScatterItem> items;
};

// Fewer objects than `count` when the area is full.
std::vector<Object> scatter_objects(const Scatter& scatter, uint64_t seed, uint32_t generator);

}  // namespace fringeslam::sim
