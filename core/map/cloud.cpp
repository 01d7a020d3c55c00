// SPDX-License-Identifier: Apache-2.0
#include "core/map/cloud.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "core/types/error.h"

namespace fringeslam {

namespace {

// Cells of a block have neighboring slots, because neighboring pixels fall into the same block.
size_t slot_of(const GridIndex& key) {
  constexpr int kBits = 2;
  constexpr int32_t kInBlock = (1 << kBits) - 1;
  uint64_t h = 0, inside = 0;
  for (const int32_t k : key) {
    h = (h ^ static_cast<uint32_t>(k >> kBits)) * 0x9e3779b97f4a7c15u, h ^= h >> 29;
    inside = inside << kBits | static_cast<uint32_t>(k & kInBlock);
  }
  return static_cast<size_t>(h << (3 * kBits) | inside);
}

// GridIndex's own comparison calls memcmp().
bool same(const GridIndex& a, const GridIndex& b) { return a[0] == b[0] && a[1] == b[1] && a[2] == b[2]; }

}  // namespace

CloudMap::CloudMap(double cell_m, const GridRange& range) : cell_m_(cell_m), range_(range), slots_(1024) {
  constexpr double kLeast_m = 1e-5;
  if (!(cell_m >= kLeast_m && cell_m <= 1))
    throw Error("cloud.cell_m is " + to_text(cell_m) + "; it must lie in " + to_text(kLeast_m) + " to 1");
}

// Doubles the hash table; cells keep their positions.
void CloudMap::grow() {
  slots_.assign(2 * slots_.size(), 0);
  const size_t mask = slots_.size() - 1;
  for (size_t i = 0; i < keys_.size(); ++i) {
    size_t slot = slot_of(keys_[i]) & mask;
    while (slots_[slot] != 0) slot = (slot + 1) & mask;
    slots_[slot] = static_cast<uint32_t>(i + 1);
  }
}

CloudMap::Cell& CloudMap::cell_at(const Key& key) {
  if (2 * (keys_.size() + 1) > slots_.size()) grow();
  const size_t mask = slots_.size() - 1;
  size_t slot = slot_of(key) & mask;
  while (slots_[slot] != 0) {
    const size_t found = slots_[slot] - 1;
    if (same(keys_[found], key)) return cells_[found];
    slot = (slot + 1) & mask;
  }
  keys_.push_back(key);
  cells_.emplace_back();
  slots_[slot] = static_cast<uint32_t>(keys_.size());
  return cells_.back();
}

void CloudMap::add(const Frame& frame, const Pose& world_from_camera) {
  for (int row = 0; row < frame.height(); ++row) {
    for (int col = 0; col < frame.width(); ++col) {
      if (std::isnan(frame.normals(row, col)[2])) continue;
      const Eigen::Vector3d point = world_from_camera * vector_of(frame.points_m(row, col));
      Key key;
      for (int i = 0; i < 3; ++i) key[static_cast<size_t>(i)] = static_cast<int32_t>(std::floor(point[i] / cell_m_));
      if (!range_.contains(key)) continue;
      const double sigma = frame.sigma_m(row, col);
      const double weight = 1 / (sigma * sigma + 1e-18);
      Cell& cell = cell_at(key);
      cell.position += weight * point;
      cell.normal += weight * (world_from_camera.rotation * vector_of(frame.normals(row, col)));
      cell.grey += weight * frame.texture(row, col);
      cell.weight += weight;
    }
  }
}

std::vector<CloudPoint> CloudMap::points() const {
  std::vector<uint32_t> order(keys_.size());
  std::iota(order.begin(), order.end(), 0u);
  std::sort(order.begin(), order.end(), [&](uint32_t a, uint32_t b) { return keys_[a] < keys_[b]; });
  std::vector<CloudPoint> points;
  points.reserve(order.size());
  for (const uint32_t i : order) {
    const Cell& cell = cells_[i];
    points.push_back({(cell.position / cell.weight).cast<float>(), cell.normal.normalized().cast<float>(),
                      static_cast<uint8_t>(std::lround(std::clamp(cell.grey / cell.weight, 0.0, 255.0))),
                      static_cast<float>(1 / std::sqrt(cell.weight))});
  }
  return points;
}

}  // namespace fringeslam
