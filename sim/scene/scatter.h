// SPDX-License-Identifier: Apache-2.0
// Scatters boxes, cylinders, spheres and rocks at random upright poses on the ground or flat on one another, without
// interpenetration.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <string>
#include <vector>

#include "sim/scene/scene.h"

namespace fringeslam::sim {

enum class Shape { box, cylinder, sphere, rock };

// One kind of object to scatter; sizes are drawn uniformly between size_min and size_max (m).
struct ScatterItem {
  Shape shape = Shape::box;
  Eigen::Vector3d size_min = Eigen::Vector3d::Zero(), size_max = Eigen::Vector3d::Zero();
  Material material;
  double weight = 1;
};

struct Scatter {
  int count = 0;
  double area_x = 0, area_y = 0;  // m, centred on the scatter's origin
  double max_height = 0.3;        // m; limit on stacking height
  Pose world_from_area;
  std::vector<ScatterItem> items;
};

// Places the objects; returns fewer than `count` if no room is found. `generator` selects the random stream.
std::vector<Object> scatter_objects(const Scatter& scatter, uint64_t seed, uint32_t generator);

}  // namespace fringeslam::sim
