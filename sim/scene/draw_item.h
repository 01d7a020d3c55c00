// SPDX-License-Identifier: Apache-2.0
// Drawing among the items of a scatter or a pile.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "sim/random.h"

namespace fringeslam::sim {

// The number of an item, each as often as its weight says.
template <class Item>
size_t draw_item(const std::vector<Item>& items, Philox& random) {
  double total = 0;
  for (const Item& item : items) total += item.weight;
  double pick = random.uniform() * total;
  size_t chosen = 0;
  while (chosen + 1 < items.size() && pick >= items[chosen].weight) pick -= items[chosen++].weight;
  return chosen;
}

// Evenly between the item's least and greatest size, m.
template <class Item>
Eigen::Vector3d draw_size(const Item& item, Philox& random) {
  Eigen::Vector3d size;
  for (int i = 0; i < 3; ++i) size[i] = random.uniform(item.size_min[i], item.size_max[i]);
  return size;
}

}  // namespace fringeslam::sim
