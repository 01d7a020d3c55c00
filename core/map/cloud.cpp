// SPDX-License-Identifier: Apache-2.0
#include "core/map/cloud.h"

#include <algorithm>
#include <cmath>

namespace fringeslam {

namespace {

Eigen::Vector3d to_eigen(const cv::Vec3f& v) { return {v[0], v[1], v[2]}; }

}  // namespace

size_t CloudMap::KeyHash::operator()(const Key& key) const {
  uint64_t h = 0;
  for (const int32_t k : key) h = (h ^ static_cast<uint32_t>(k)) * 0x9e3779b97f4a7c15u, h ^= h >> 29;
  return static_cast<size_t>(h);
}

CloudMap::CloudMap(const CloudOptions& options) : cell_m_(options.cell_m) { check_options(options, "cloud"); }

void CloudMap::add(const Frame& frame, const Pose& world_from_camera) {
  for (int row = 0; row < frame.height(); ++row) {
    for (int col = 0; col < frame.width(); ++col) {
      if (std::isnan(frame.normals(row, col)[2])) continue;
      const Eigen::Vector3d point = world_from_camera * to_eigen(frame.points_m(row, col));
      Key key;
      for (int i = 0; i < 3; ++i) key[static_cast<size_t>(i)] = static_cast<int32_t>(std::floor(point[i] / cell_m_));
      const double sigma = frame.sigma_m(row, col);
      const double weight = 1 / (sigma * sigma + 1e-18);
      Cell& cell = cells_[key];
      cell.position += weight * point;
      cell.normal += weight * (world_from_camera.rotation * to_eigen(frame.normals(row, col)));
      cell.grey += weight * frame.texture(row, col);
      cell.weight += weight;
    }
  }
}

std::vector<CloudPoint> CloudMap::points() const {
  std::vector<const std::pair<const Key, Cell>*> order;
  order.reserve(cells_.size());
  for (const auto& entry : cells_) order.push_back(&entry);
  std::sort(order.begin(), order.end(), [](const auto* a, const auto* b) { return a->first < b->first; });
  std::vector<CloudPoint> points;
  points.reserve(order.size());
  for (const auto* entry : order) {
    const Cell& cell = entry->second;
    points.push_back({(cell.position / cell.weight).cast<float>(), cell.normal.normalized().cast<float>(),
                      static_cast<uint8_t>(std::lround(std::clamp(cell.grey / cell.weight, 0.0, 255.0))),
                      static_cast<float>(1 / std::sqrt(cell.weight))});
  }
  return points;
}

}  // namespace fringeslam
