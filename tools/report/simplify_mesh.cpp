// SPDX-License-Identifier: Apache-2.0
#include "tools/report/simplify_mesh.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <set>

namespace fringeslam::tools {

namespace {

using Triangle = std::array<uint32_t, 3>;

struct Cells {
  std::vector<uint32_t> of_vertex;  // cell index
  size_t count = 0;
};

// Cells are numbered by position, so that the result does not depend on the order of the vertices.
Cells cells_of(const std::vector<CloudPoint>& vertices, const Eigen::Vector3f& low, double cell_m) {
  constexpr int kBits = 21;  // per coordinate: three fit into a key
  std::vector<uint64_t> keys;
  keys.reserve(vertices.size());
  for (const CloudPoint& vertex : vertices) {
    uint64_t key = 0;
    for (int i = 0; i < 3; ++i)
      key = key << kBits | static_cast<uint64_t>((static_cast<double>(vertex.position_m[i]) - low[i]) / cell_m);
    keys.push_back(key);
  }
  std::vector<uint64_t> distinct = keys;
  std::sort(distinct.begin(), distinct.end());
  distinct.erase(std::unique(distinct.begin(), distinct.end()), distinct.end());
  Cells cells{{}, distinct.size()};
  cells.of_vertex.reserve(keys.size());
  for (const uint64_t key : keys)
    cells.of_vertex.push_back(
        static_cast<uint32_t>(std::lower_bound(distinct.begin(), distinct.end(), key) - distinct.begin()));
  return cells;
}

std::vector<CloudPoint> merged(const std::vector<CloudPoint>& vertices, const Cells& cells) {
  struct Mean {
    Eigen::Vector3d position = Eigen::Vector3d::Zero();
    double grey = 0, count = 0;
    double nearest = std::numeric_limits<double>::infinity();
  };
  std::vector<Mean> means(cells.count);
  for (size_t v = 0; v < vertices.size(); ++v) {
    Mean& mean = means[cells.of_vertex[v]];
    mean.position += vertices[v].position_m.cast<double>();
    mean.grey += vertices[v].grey;
    mean.count += 1;
  }
  std::vector<CloudPoint> result(cells.count);
  for (size_t v = 0; v < vertices.size(); ++v) {
    Mean& mean = means[cells.of_vertex[v]];
    const double distance = (vertices[v].position_m.cast<double>() - mean.position / mean.count).squaredNorm();
    if (distance >= mean.nearest) continue;
    mean.nearest = distance;
    result[cells.of_vertex[v]] = vertices[v];
  }
  for (size_t c = 0; c < cells.count; ++c)
    result[c].grey = static_cast<uint8_t>(std::lround(means[c].grey / means[c].count));
  return result;
}

std::vector<Triangle> merged(const std::vector<Triangle>& triangles, const Cells& cells) {
  std::vector<Triangle> result;
  for (Triangle triangle : triangles) {
    for (uint32_t& corner : triangle) corner = cells.of_vertex[corner];
    if (triangle[0] == triangle[1] || triangle[1] == triangle[2] || triangle[2] == triangle[0]) continue;
    // The same winding with the smallest index first, so that equal triangles compare equal.
    std::rotate(triangle.begin(), std::min_element(triangle.begin(), triangle.end()), triangle.end());
    result.push_back(triangle);
  }
  std::sort(result.begin(), result.end());
  result.erase(std::unique(result.begin(), result.end()), result.end());
  return result;
}

}  // namespace

SimplifiedMesh thinned(SurfaceMesh mesh, size_t max_vertices) {
  if (mesh.vertices.size() <= max_vertices) return {std::move(mesh), 0};
  Eigen::Vector3f low = mesh.vertices.front().position_m, high = low;
  for (const CloudPoint& vertex : mesh.vertices) {
    low = low.cwiseMin(vertex.position_m);
    high = high.cwiseMax(vertex.position_m);
  }
  // Start near the cell size at which a surface of the bounding box's largest face would have max_vertices cells.
  double cell_m = (high - low).maxCoeff() / std::sqrt(static_cast<double>(max_vertices)) / 4;
  Cells cells = cells_of(mesh.vertices, low, cell_m);
  while (cells.count > max_vertices) {
    // The number of cells is proportional to the inverse square of their edge, or falls more slowly where points are
    // sparse.
    cell_m *= std::max(1.02, std::sqrt(static_cast<double>(cells.count) / static_cast<double>(max_vertices)));
    cells = cells_of(mesh.vertices, low, cell_m);
  }
  return {{merged(mesh.vertices, cells), merged(mesh.triangles, cells)}, cell_m};
}

}  // namespace fringeslam::tools
