// SPDX-License-Identifier: Apache-2.0
// Scatters boxes, cylinders, spheres and rocks at random upright poses on the ground or flat on one another, without
// interpenetration.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <map>
#include <memory>
#include <utility>
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
  int variants = 0;  // number of distinct shapes, each stored once and reused; 0: every object is distinct
};

struct Scatter {
  int count = 0;
  double area_x = 0, area_y = 0;  // m, centred on the scatter's origin
  double max_height = 0.3;        // m; limit on stacking height
  Pose world_from_area;
  std::vector<ScatterItem> items;
};

// The distinct shapes of items with `variants`, made on demand. Scatters of the same items may share them.
class ScatterShapes {
 public:
  struct Variant {
    Eigen::Vector3d size;
    std::shared_ptr<const Mesh> mesh;
  };
  ScatterShapes(uint64_t seed, uint32_t generator) : seed_(seed), generator_(generator) {}
  // Returns variant `number` of the item, which is number `kind` of its scatter.
  const Variant& variant(const ScatterItem& item, size_t kind, uint32_t number);

 private:
  uint64_t seed_;
  uint32_t generator_;
  std::map<std::pair<size_t, uint32_t>, Variant> variants_;
};

// Places the objects; returns fewer than `count` if no room is found. `generator` selects the random stream. Shapes of
// items with `variants` are taken from `shapes` if given.
std::vector<Object> scatter_objects(const Scatter& scatter, uint64_t seed, uint32_t generator,
                                    ScatterShapes* shapes = nullptr);

}  // namespace fringeslam::sim
