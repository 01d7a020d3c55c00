// SPDX-License-Identifier: Apache-2.0
// Random selection among the items of a scatter or a pile.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "sim/random.h"

namespace fringeslam::sim {

// Draws the index of an item with probability proportional to its weight.
template <class Item>
size_t draw_item(const std::vector<Item>& items, Philox& random) {
  double total = 0;
  for (const Item& item : items) total += item.weight;
  double pick = random.uniform() * total;
  size_t chosen = 0;
  while (chosen + 1 < items.size() && pick >= items[chosen].weight) pick -= items[chosen++].weight;
  return chosen;
}

// Draws a size (m) uniformly between the item's minimum and maximum size, each axis independently.
template <class Item>
Eigen::Vector3d draw_size(const Item& item, Philox& random) {
  Eigen::Vector3d size;
  for (int i = 0; i < 3; ++i) size[i] = random.uniform(item.size_min[i], item.size_max[i]);
  return size;
}

}  // namespace fringeslam::sim
