// SPDX-License-Identifier: Apache-2.0
#include "tools/report/simplify_mesh.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <unordered_set>

#include "core/io/ply_blocks.h"

namespace fringeslam::tools {

namespace {

using Triangle = std::array<uint32_t, 3>;

// A mesh that can be passed over several times; for_each_vertex stops when `use` returns false.
class MemoryMesh {
 public:
  explicit MemoryMesh(const SurfaceMesh& mesh) : mesh_(mesh) {}
  uint64_t vertices() const { return mesh_.vertices.size(); }
  uint64_t triangles() const { return mesh_.triangles.size(); }
  template <class Use>
  void for_each_vertex(const Use& use) {
    for (const CloudPoint& vertex : mesh_.vertices) {
      if (!use(vertex)) return;
    }
  }
  template <class Use>
  void for_each_triangle(const Use& use) {
    for (const Triangle& triangle : mesh_.triangles) use(triangle);
  }

 private:
  const SurfaceMesh& mesh_;
};

class FileMesh {
 public:
  explicit FileMesh(const std::filesystem::path& ply) : blocks_(ply) {}
  uint64_t vertices() const { return blocks_.vertices(); }
  uint64_t triangles() const { return blocks_.triangles(); }
  template <class Use>
  void for_each_vertex(const Use& use) {
    blocks_.for_each_vertex([&](const char* bytes) -> bool {
      CloudPoint vertex;
      std::memcpy(vertex.position_m.data(), bytes, PlyBlocks::kNormal);
      std::memcpy(vertex.normal.data(), bytes + PlyBlocks::kNormal, PlyBlocks::kGrey - PlyBlocks::kNormal);
      vertex.grey = static_cast<uint8_t>(bytes[PlyBlocks::kGrey]);
      std::memcpy(&vertex.sigma_m, bytes + PlyBlocks::kSigma, sizeof vertex.sigma_m);
      return use(vertex);
    });
  }
  template <class Use>
  void for_each_triangle(const Use& use) {
    blocks_.for_each_triangle([&](const char* bytes) {
      Triangle triangle;
      std::memcpy(triangle.data(), bytes + 1, sizeof triangle);
      use(triangle);
    });
  }

 private:
  PlyBlocks blocks_;
};

// The cells of a grid that contain vertices, numbered by position, so that the result does not depend on the order of the
// vertices.
class Grid {
 public:
  Grid(const Eigen::Vector3f& low, double cell_m) : low_(low), cell_m_(cell_m) {}

  uint64_t key_of(const CloudPoint& vertex) const {
    constexpr int kBits = 21;  // per coordinate: three fit into a key
    uint64_t key = 0;
    for (int i = 0; i < 3; ++i)
      key = key << kBits |
            static_cast<uint64_t>((static_cast<double>(vertex.position_m[i]) - static_cast<double>(low_[i])) / cell_m_);
    return key;
  }

  // Finds the cells. If there are more than `most`, returns false and an estimate of their number.
  template <class Mesh>
  bool collect(Mesh& mesh, size_t most, double& count) {
    std::unordered_set<uint64_t> keys;
    uint64_t seen = 0;
    mesh.for_each_vertex([&](const CloudPoint& vertex) {
      keys.insert(key_of(vertex));
      ++seen;
      return keys.size() <= most;
    });
    count = static_cast<double>(keys.size()) * static_cast<double>(mesh.vertices()) / static_cast<double>(seen);
    if (keys.size() > most) return false;
    keys_.assign(keys.begin(), keys.end());
    std::sort(keys_.begin(), keys_.end());
    return true;
  }
  size_t size() const { return keys_.size(); }
  uint32_t cell_of(const CloudPoint& vertex) const {
    return static_cast<uint32_t>(std::lower_bound(keys_.begin(), keys_.end(), key_of(vertex)) - keys_.begin());
  }

 private:
  Eigen::Vector3f low_;
  double cell_m_;
  std::vector<uint64_t> keys_;
};

struct Cell {
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  // sums over the vertices
  double grey = 0, count = 0;
  double nearest = std::numeric_limits<double>::infinity();
  CloudPoint vertex;
};

// Merges the vertices; `cell_of_vertex` receives the cell of each.
template <class Mesh>
std::vector<CloudPoint> merged_vertices(Mesh& mesh, const Grid& grid, std::vector<uint32_t>& cell_of_vertex) {
  std::vector<Cell> cells(grid.size());
  cell_of_vertex.reserve(mesh.vertices());
  mesh.for_each_vertex([&](const CloudPoint& vertex) {
    cell_of_vertex.push_back(grid.cell_of(vertex));
    Cell& cell = cells[cell_of_vertex.back()];
    cell.position += vertex.position_m.cast<double>();
    cell.grey += vertex.grey;
    cell.count += 1;
    return true;
  });
  size_t number = 0;
  mesh.for_each_vertex([&](const CloudPoint& vertex) {
    Cell& cell = cells[cell_of_vertex[number++]];
    const double distance = (vertex.position_m.cast<double>() - cell.position / cell.count).squaredNorm();
    if (distance < cell.nearest) {
      cell.nearest = distance;
      cell.vertex = vertex;
    }
    return true;
  });
  std::vector<CloudPoint> vertices;
  for (const Cell& cell : cells) {
    vertices.push_back(cell.vertex);
    vertices.back().grey = static_cast<uint8_t>(std::lround(cell.grey / cell.count));
  }
  return vertices;
}

void remove_duplicates(std::vector<Triangle>& triangles) {
  std::sort(triangles.begin(), triangles.end());
  triangles.erase(std::unique(triangles.begin(), triangles.end()), triangles.end());
}

template <class Mesh>
std::vector<Triangle> merged_triangles(Mesh& mesh, const std::vector<uint32_t>& cell_of_vertex) {
  std::vector<Triangle> result;
  size_t limit = 1 << 20;
  mesh.for_each_triangle([&](Triangle triangle) {
    for (uint32_t& corner : triangle) corner = cell_of_vertex.at(corner);
    if (triangle[0] == triangle[1] || triangle[1] == triangle[2] || triangle[2] == triangle[0]) return;
    // The same winding with the smallest index first, so that equal triangles compare equal.
    std::rotate(triangle.begin(), std::min_element(triangle.begin(), triangle.end()), triangle.end());
    result.push_back(triangle);
    if (result.size() < limit) return;
    remove_duplicates(result);
    limit = std::max(limit, 2 * result.size());
  });
  remove_duplicates(result);
  return result;
}

template <class Mesh>
SimplifiedMesh thinned_mesh(Mesh mesh, size_t max_vertices) {
  SimplifiedMesh result;
  result.whole_vertices = mesh.vertices();
  result.whole_triangles = mesh.triangles();
  if (mesh.vertices() <= max_vertices) {
    mesh.for_each_vertex([&](const CloudPoint& vertex) {
      result.mesh.vertices.push_back(vertex);
      return true;
    });
    mesh.for_each_triangle([&](const Triangle& triangle) { result.mesh.triangles.push_back(triangle); });
    return result;
  }
  Eigen::Vector3f low = Eigen::Vector3f::Constant(std::numeric_limits<float>::infinity()), high = -low;
  mesh.for_each_vertex([&](const CloudPoint& vertex) {
    low = low.cwiseMin(vertex.position_m);
    high = high.cwiseMax(vertex.position_m);
    return true;
  });
  // Start near the cell size at which a surface of the bounding box's largest face would have max_vertices cells.
  result.cell_m = static_cast<double>((high - low).maxCoeff()) / std::sqrt(static_cast<double>(max_vertices)) / 4;
  Grid grid(low, result.cell_m);
  double count = 0;
  while (!grid.collect(mesh, max_vertices, count)) {
    // The number of cells is proportional to the inverse square of their edge, or falls more slowly where points are
    // sparse.
    result.cell_m *= std::max(1.02, std::sqrt(count / static_cast<double>(max_vertices)));
    grid = Grid(low, result.cell_m);
  }
  std::vector<uint32_t> cell_of_vertex;
  result.mesh.vertices = merged_vertices(mesh, grid, cell_of_vertex);
  result.mesh.triangles = merged_triangles(mesh, cell_of_vertex);
  return result;
}

}  // namespace

SimplifiedMesh thinned(const SurfaceMesh& mesh, size_t max_vertices) {
  return thinned_mesh(MemoryMesh(mesh), max_vertices);
}

SimplifiedMesh thinned(const std::filesystem::path& ply, size_t max_vertices) {
  return thinned_mesh(FileMesh(ply), max_vertices);
}

}  // namespace fringeslam::tools
