// SPDX-License-Identifier: Apache-2.0
#include "core/map/surface_nets.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <unordered_map>

#include "core/base/parallel.h"
#include "core/types/selected_instruction_set.h"

namespace fringeslam {

namespace {

constexpr int kPatch = kBrickEdge + 1;  // a brick and the adjacent voxels of its neighbours
constexpr float kMaxStep = 1.5f;        // largest change of distance along an edge, in voxels
constexpr int16_t kNoCellVertex = -1;

constexpr int patch_at(int x, int y, int z) { return (x * kPatch + y) * kPatch + z; }
constexpr int cell_at(int x, int y, int z) { return (x * kBrickEdge + y) * kBrickEdge + z; }

struct CellVertex {
  int16_t cell = 0;
  // For each axis, the sign of the surface crossing on the edge from the cell's first corner: outwards 1, inwards -1.
  std::array<int8_t, 3> crossing{};
};

// Results of the first pass for a brick.
struct BrickSurface {
  std::vector<CellVertex> cells;
  std::vector<CloudPoint> vertices;
  std::vector<std::array<uint32_t, 3>> triangles;
  std::array<int16_t, kBrickVoxels> vertex_of_cell;
};

// For each cell of a brick, the number of corners that lie inside, plus at least 16 if one is unobserved. Rows of a patch
// start at multiples of kCountStride.
constexpr int kCountStride = 16;
using CornerCounts = std::array<uint8_t, kPatch * kPatch * kCountStride>;

FRINGESLAM_INLINE void count_corners_body(const uint64_t* patch, float min_weight, CornerCounts& counts) {
  constexpr int kSize = kPatch * kPatch * kCountStride, kAcross = kCountStride, kDown = kPatch * kCountStride;
  alignas(64) uint8_t corner[kSize + kCountStride] = {}, pairs[kSize + kCountStride], squares[kSize];
  for (int row = 0; row < kPatch * kPatch; ++row) {
    for (int z = 0; z < kPatch; ++z) {
      const uint64_t voxel = patch[row * kPatch + z];
      corner[row * kCountStride + z] =
          static_cast<uint8_t>((voxel >> 15 & 1) + (voxel_weight(voxel) >= min_weight ? 0 : 16));
    }
  }
  for (int i = 0; i < kSize; ++i) pairs[i] = static_cast<uint8_t>(corner[i] + corner[i + 1]);
  for (int i = 0; i < kSize - kAcross; ++i) squares[i] = static_cast<uint8_t>(pairs[i] + pairs[i + kAcross]);
  for (int i = 0; i < kSize - kDown - kAcross; ++i)
    counts[static_cast<size_t>(i)] = static_cast<uint8_t>(squares[i] + squares[i + kDown]);
}

class SurfaceNetsMesher {
 public:
  SurfaceNetsMesher(const std::vector<Brick>& bricks, const VoxelScale& scale, double min_weight)
      : bricks_(bricks), scale_(scale), min_weight_(static_cast<float>(min_weight)), surfaces_(bricks.size()) {
    number_.reserve(bricks.size());
    for (size_t i = 0; i < bricks.size(); ++i) number_.emplace(brick_key(bricks[i].index), i);
  }

  SurfacePatch patch(const GridRange& range) {
    const int count = static_cast<int>(bricks_.size());
    // Triangles use vertices of their own brick and of those that precede it.
    const GridRange up_to{GridRange().first, range.last};
    for_each_row(count, [&](int i) {
      if (up_to.contains(bricks_[static_cast<size_t>(i)].index)) find_vertices(static_cast<size_t>(i));
    });
    first_.assign(bricks_.size() + 1, 0);
    for (size_t i = 0; i < bricks_.size(); ++i)
      first_[i + 1] = first_[i] + static_cast<uint32_t>(surfaces_[i].vertices.size());
    for_each_row(count, [&](int i) {
      if (range.contains(bricks_[static_cast<size_t>(i)].index)) find_triangles(static_cast<size_t>(i));
    });
    return collected();
  }

 private:
  // Concatenates the bricks' meshes, without unused vertices.
  SurfacePatch collected() const {
    constexpr uint32_t kUnused = UINT32_MAX;
    std::vector<uint32_t> place(first_.back(), kUnused);
    for (const BrickSurface& surface : surfaces_) {
      for (const auto& triangle : surface.triangles) {
        for (const uint32_t vertex : triangle) place[vertex] = 0;
      }
    }
    SurfacePatch result;
    SurfaceMesh& mesh = result.mesh;
    size_t number = 0;
    for (size_t b = 0; b < surfaces_.size(); ++b) {
      const uint64_t key = brick_key(bricks_[b].index);
      for (size_t v = 0; v < surfaces_[b].vertices.size(); ++v) {
        uint32_t& at = place[number++];
        if (at == kUnused) continue;
        at = static_cast<uint32_t>(mesh.vertices.size());
        mesh.vertices.push_back(surfaces_[b].vertices[v]);
        result.cells.push_back({key, static_cast<uint16_t>(surfaces_[b].cells[v].cell)});
      }
    }
    for (const BrickSurface& surface : surfaces_) {
      for (const auto& triangle : surface.triangles)
        mesh.triangles.push_back({place[triangle[0]], place[triangle[1]], place[triangle[2]]});
    }
    return result;
  }

  // The voxels of a brick and the adjacent ones of its neighbours; 0 where there is no brick.
  using Patch = std::array<uint64_t, kPatch * kPatch * kPatch>;

  const Brick* neighbour(size_t brick, int x, int y, int z) const {
    const BrickIndex& at = bricks_[brick].index;
    const auto found = number_.find(brick_key({at[0] + x, at[1] + y, at[2] + z}));
    return found == number_.end() ? nullptr : &bricks_[found->second];
  }

  void fill(Patch& patch, size_t brick) const {
    for (int side = 0; side < 8; ++side) {
      const int sx = side >> 2, sy = side >> 1 & 1, sz = side & 1;
      const Brick* const from = neighbour(brick, sx, sy, sz);
      const auto end = [](int s) { return s ? 1 : kBrickEdge; };
      const auto bytes = static_cast<size_t>(end(sz)) * sizeof(uint64_t);
      for (int x = 0; x < end(sx); ++x) {
        for (int y = 0; y < end(sy); ++y) {
          uint64_t* const to =
              patch.data() + patch_at(x + sx * kBrickEdge, y + sy * kBrickEdge, sz * kBrickEdge);
          if (from != nullptr)
            std::memcpy(to, from->voxels + cell_at(x, y, 0), bytes);
          else
            std::memset(to, 0, bytes);
        }
      }
    }
  }

  void find_vertices(size_t brick) {
    BrickSurface& surface = surfaces_[brick];
    surface.vertex_of_cell.fill(kNoCellVertex);
    Patch patch;
    fill(patch, brick);
    CornerCounts counts;
    static const auto count_corners = Variants<count_corners_body>::of(selected_instruction_set());
    count_corners(patch.data(), min_weight_, counts);
    for (int x = 0; x < kBrickEdge; ++x) {
      for (int y = 0; y < kBrickEdge; ++y) {
        const uint8_t* const row = counts.data() + (x * kPatch + y) * kCountStride;
        for (int z = 0; z < kBrickEdge; ++z) {
          if (row[z] > 0 && row[z] < 8) add_cell(surface, patch, bricks_[brick].index, {x, y, z});
        }
      }
    }
  }

  // The distances, in voxels, and the voxels at the corners of a cell. Corner i is (i >> 2, i >> 1 & 1, i & 1).
  struct Corners {
    std::array<float, 8> distance;
    std::array<uint64_t, 8> voxel;
  };

  // Adds the vertex of a cell that is observed and contains a change of sign.
  void add_cell(BrickSurface& surface, const Patch& patch, const BrickIndex& brick, const std::array<int, 3>& cell) {
    const float voxels_per_step = static_cast<float>(scale_.truncation_m / scale_.voxel_m) / kDistanceSteps;
    Corners corners;
    for (size_t i = 0; i < 8; ++i) {
      const int corner = static_cast<int>(i);
      corners.voxel[i] = patch[static_cast<size_t>(
          patch_at(cell[0] + (corner >> 2), cell[1] + (corner >> 1 & 1), cell[2] + (corner & 1)))];
      corners.distance[i] = voxels_per_step * voxel_distance(corners.voxel[i]);
    }
    CellVertex vertex{static_cast<int16_t>(cell_at(cell[0], cell[1], cell[2])), {}};
    std::array<double, 3> sum{};
    int crossings = 0;
    for (size_t axis = 0; axis < 3; ++axis) {
      const size_t step = 4u >> axis;
      for (size_t i = 0; i < 8; ++i) {
        if ((i & step) != 0) continue;
        const float from = corners.distance[i], to = corners.distance[i + step];
        if ((from < 0) == (to < 0)) continue;
        if (std::abs(from - to) > kMaxStep) return;
        std::array<double, 3> crossing = {static_cast<double>(i >> 2), static_cast<double>(i >> 1 & 1),
                                          static_cast<double>(i & 1)};
        crossing[axis] = static_cast<double>(from) / (static_cast<double>(from) - static_cast<double>(to));
        for (size_t k = 0; k < 3; ++k) sum[k] += crossing[k];
        ++crossings;
        if (i == 0) vertex.crossing[axis] = from < 0 ? 1 : -1;
      }
    }
    surface.vertex_of_cell[static_cast<size_t>(vertex.cell)] = static_cast<int16_t>(surface.cells.size());
    surface.cells.push_back(vertex);
    for (double& coordinate : sum) coordinate /= crossings;
    surface.vertices.push_back(vertex_at(corners, sum));
    for (int k = 0; k < 3; ++k) {
      const auto axis = static_cast<size_t>(k);
      surface.vertices.back().position_m[k] =
          static_cast<float>(scale_.voxel_m * (sum[axis] + kBrickEdge * brick[axis] + cell[axis]));
    }
  }

  // Interpolates grey value and weight trilinearly; the normal is the gradient of the trilinearly interpolated
  // distance.
  static CloudPoint vertex_at(const Corners& corners, const std::array<double, 3>& in_cell) {
    double grey = 0, weight = 0;
    Eigen::Vector3d gradient = Eigen::Vector3d::Zero();
    for (size_t i = 0; i < 8; ++i) {
      const bool side[3] = {(i & 4) != 0, (i & 2) != 0, (i & 1) != 0};
      const double a = side[0] ? in_cell[0] : 1 - in_cell[0], b = side[1] ? in_cell[1] : 1 - in_cell[1],
                   c = side[2] ? in_cell[2] : 1 - in_cell[2];
      grey += a * b * c * static_cast<double>(voxel_grey(corners.voxel[i]));
      weight += a * b * c * static_cast<double>(voxel_weight(corners.voxel[i]));
      const auto distance = static_cast<double>(corners.distance[i]);
      gradient[0] += side[0] ? distance * (b * c) : -distance * (b * c);
      gradient[1] += side[1] ? distance * (a * c) : -distance * (a * c);
      gradient[2] += side[2] ? distance * (a * b) : -distance * (a * b);
    }
    CloudPoint point;
    point.normal = gradient.normalized().cast<float>();
    point.grey = static_cast<uint8_t>(std::lround(std::clamp(grey / static_cast<double>(kGreySteps), 0.0, 255.0)));
    point.sigma_m = static_cast<float>(1 / std::sqrt(weight));
    return point;
  }

  // Adds the quads around the edges that start at the cells' first corners; the other three cells of such an edge
  // precede its own.
  void find_triangles(size_t brick) {
    BrickSurface& surface = surfaces_[brick];
    std::array<const Brick*, 8> before{};
    for (int side = 0; side < 8; ++side)
      before[static_cast<size_t>(side)] = neighbour(brick, -(side >> 2), -(side >> 1 & 1), -(side & 1));
    for (const CellVertex& vertex : surface.cells) {
      for (int axis = 0; axis < 3; ++axis) {
        const int crossing = vertex.crossing[static_cast<size_t>(axis)];
        if (crossing == 0) continue;
        // Counter-clockwise about the axis.
        static constexpr std::array<std::array<int, 2>, 4> kRound = {{{1, 1}, {0, 1}, {0, 0}, {1, 0}}};
        std::array<uint32_t, 4> quad{};
        bool complete = true;
        for (size_t i = 0; i < 4 && complete; ++i) {
          std::array<int, 3> cell = {vertex.cell >> 6, vertex.cell >> 3 & 7, vertex.cell & 7};
          cell[static_cast<size_t>((axis + 1) % 3)] -= kRound[i][0];
          cell[static_cast<size_t>((axis + 2) % 3)] -= kRound[i][1];
          complete = find(before, cell, quad[i]);
        }
        if (!complete) continue;
        if (crossing < 0) std::swap(quad[1], quad[3]);
        surface.triangles.push_back({quad[0], quad[1], quad[2]});
        surface.triangles.push_back({quad[0], quad[2], quad[3]});
      }
    }
  }

  // Finds the vertex of a cell, whose coordinates may extend into the preceding bricks.
  bool find(const std::array<const Brick*, 8>& before, std::array<int, 3> cell, uint32_t& vertex) const {
    int side = 0;
    for (int& c : cell) {
      side = 2 * side + (c < 0 ? 1 : 0);
      c &= kBrickEdge - 1;
    }
    const Brick* const brick = before[static_cast<size_t>(side)];
    if (brick == nullptr) return false;
    const auto number = static_cast<size_t>(brick - bricks_.data());
    const int16_t found = surfaces_[number].vertex_of_cell[static_cast<size_t>(cell_at(cell[0], cell[1], cell[2]))];
    if (found == kNoCellVertex) return false;
    vertex = first_[number] + static_cast<uint32_t>(found);
    return true;
  }

  const std::vector<Brick>& bricks_;
  VoxelScale scale_;
  float min_weight_;
  std::unordered_map<uint64_t, size_t> number_;
  std::vector<BrickSurface> surfaces_;
  std::vector<uint32_t> first_;
};

}  // namespace

SurfaceMesh surface_nets(const std::vector<Brick>& bricks, const VoxelScale& scale, double min_weight) {
  return surface_nets(bricks, scale, min_weight, {}).mesh;
}

SurfacePatch surface_nets(const std::vector<Brick>& bricks, const VoxelScale& scale, double min_weight,
                          const GridRange& range) {
  return SurfaceNetsMesher(bricks, scale, min_weight).patch(range);
}

}  // namespace fringeslam
