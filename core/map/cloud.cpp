// SPDX-License-Identifier: Apache-2.0
#include "core/map/cloud.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

#include "core/types/error.h"
#include "core/types/selected_instruction_set.h"

namespace fringeslam {

namespace {

constexpr int kBlockBits = 2, kBlockEdge = 1 << kBlockBits, kBlockCells = kBlockEdge * kBlockEdge * kBlockEdge;

// Weighted sums over the points of a cell: positions relative to the cell's first corner, in cells.
struct Cell {
  float position[3], normal[3], grey, weight;
};

constexpr int kRun = 64;  // pixels located together

// A run of pixels, the camera's pose in cells, and the range of cells.
struct PixelsOfRun {
  const float *points, *normals, *sigma;  // three, three and one floats per pixel
  double cells_from_camera[12];           // rotation and scale row by row, then the translation
  float rotation[9];
  int32_t first[3], last[3];
  int count;
};

// The cell of each pixel's point, the position in this cell, the normal in the world frame, and the weight, 0 if the pixel
// has none.
struct CellsOfRun {
  alignas(64) int32_t cell[3][kRun];
  alignas(64) float position[3][kRun], normal[3][kRun], weight[kRun];
};

FRINGESLAM_INLINE void locate_body(PixelsOfRun pixels, CellsOfRun& __restrict run) {
  constexpr double kMostCells = 1 << 30;
  for (int i = 0; i < pixels.count; ++i) {
    const float sigma = pixels.sigma[i], weight = 1 / (sigma * sigma + 1e-18f);
    const bool whole = (pixels.normals[3 * i + 2] == pixels.normals[3 * i + 2]) & (weight > 0);  // false for NaN
    run.weight[i] = whole ? weight : 0;
  }
  for (int k = 0; k < 3; ++k) {
    const double mx = pixels.cells_from_camera[3 * k], my = pixels.cells_from_camera[3 * k + 1],
                 mz = pixels.cells_from_camera[3 * k + 2], shift = pixels.cells_from_camera[9 + k];
    const float rx = pixels.rotation[3 * k], ry = pixels.rotation[3 * k + 1], rz = pixels.rotation[3 * k + 2];
    const int32_t first = pixels.first[k], last = pixels.last[k];
    for (int i = 0; i < pixels.count; ++i) {
      const double at = mx * static_cast<double>(pixels.points[3 * i]) +
                        my * static_cast<double>(pixels.points[3 * i + 1]) +
                        mz * static_cast<double>(pixels.points[3 * i + 2]) + shift;
      const bool near = (at > -kMostCells) & (at < kMostCells);
      const double place = near ? at : 0;
      const int32_t cut = static_cast<int32_t>(place);
      const int32_t cell = cut - (static_cast<double>(cut) > place ? 1 : 0);
      run.cell[k][i] = cell;
      run.position[k][i] = static_cast<float>(place - static_cast<double>(cell));
      run.weight[i] = near & (cell >= first) & (cell <= last) ? run.weight[i] : 0;
    }
    for (int i = 0; i < pixels.count; ++i)
      run.normal[k][i] = rx * pixels.normals[3 * i] + ry * pixels.normals[3 * i + 1] + rz * pixels.normals[3 * i + 2];
  }
}

size_t hash_of(const GridIndex& index) {
  uint64_t h = 0;
  for (const int32_t i : index) h = (h ^ static_cast<uint32_t>(i)) * 0x9e3779b97f4a7c15u, h ^= h >> 29;
  return static_cast<size_t>(h);
}

// GridIndex's own comparison calls memcmp().
bool same(const GridIndex& a, const GridIndex& b) { return a[0] == b[0] && a[1] == b[1] && a[2] == b[2]; }

}  // namespace

// Neighboring pixels fall into the same block, so that most of them need no search.
struct CloudMap::Block {
  std::array<Cell, kBlockCells> cells{};
};

CloudMap::CloudMap(double cell_m, const GridRange& range) : cell_m_(cell_m), range_(range), slots_(1024) {
  constexpr double kLeast_m = 1e-5;
  if (!(cell_m >= kLeast_m && cell_m <= 1))
    throw Error("cloud.cell_m is " + to_text(cell_m) + "; it must lie in " + to_text(kLeast_m) + " to 1");
}
CloudMap::~CloudMap() = default;
CloudMap::CloudMap(CloudMap&&) noexcept = default;
CloudMap& CloudMap::operator=(CloudMap&&) noexcept = default;

// Doubles the hash table.
void CloudMap::grow() {
  slots_.assign(2 * slots_.size(), 0);
  const size_t mask = slots_.size() - 1;
  for (size_t i = 0; i < indices_.size(); ++i) {
    size_t slot = hash_of(indices_[i]) & mask;
    while (slots_[slot] != 0) slot = (slot + 1) & mask;
    slots_[slot] = static_cast<uint32_t>(i + 1);
  }
}

CloudMap::Block& CloudMap::block_at(const GridIndex& index) {
  if (2 * (indices_.size() + 1) > slots_.size()) grow();
  const size_t mask = slots_.size() - 1;
  size_t slot = hash_of(index) & mask;
  while (slots_[slot] != 0) {
    const size_t found = slots_[slot] - 1;
    if (same(indices_[found], index)) return *blocks_[found];
    slot = (slot + 1) & mask;
  }
  indices_.push_back(index);
  blocks_.push_back(std::make_unique<Block>());
  slots_[slot] = static_cast<uint32_t>(indices_.size());
  return *blocks_.back();
}

void CloudMap::add(const Frame& frame, const Pose& world_from_camera) {
  static const auto locate = Variants<locate_body>::of(selected_instruction_set());
  PixelsOfRun pixels{};
  for (int i = 0; i < 9; ++i) {
    pixels.cells_from_camera[i] = world_from_camera.rotation(i / 3, i % 3) / cell_m_;
    pixels.rotation[i] = static_cast<float>(world_from_camera.rotation(i / 3, i % 3));
  }
  for (size_t i = 0; i < 3; ++i) {
    pixels.cells_from_camera[9 + i] = world_from_camera.translation[static_cast<int>(i)] / cell_m_;
    pixels.first[i] = range_.first[i], pixels.last[i] = range_.last[i];
  }
  CellsOfRun run;
  GridIndex last{};
  Block* block = nullptr;
  for (int row = 0; row < frame.height(); ++row) {
    for (int col = 0; col < frame.width(); col += kRun) {
      pixels.points = frame.points_m[row][col].val, pixels.normals = frame.normals[row][col].val;
      pixels.sigma = frame.sigma_m[row] + col;
      pixels.count = std::min(kRun, frame.width() - col);
      locate(pixels, run);
      for (int i = 0; i < pixels.count; ++i) {
        const float weight = run.weight[i];
        if (!(weight > 0)) continue;
        GridIndex index;
        size_t number = 0;
        for (size_t k = 0; k < 3; ++k) {
          index[k] = run.cell[k][i] >> kBlockBits;
          number = number << kBlockBits | static_cast<size_t>(run.cell[k][i] & (kBlockEdge - 1));
        }
        if (block == nullptr || !same(index, last)) {
          block = &block_at(index);
          last = index;
        }
        Cell& cell = block->cells[number];
        for (size_t k = 0; k < 3; ++k) {
          cell.position[k] += weight * run.position[k][i];
          cell.normal[k] += weight * run.normal[k][i];
        }
        cell.grey += weight * static_cast<float>(frame.texture(row, col + i));
        cell.weight += weight;
      }
    }
  }
}

std::vector<CloudPoint> CloudMap::points() const {
  std::vector<uint32_t> order(indices_.size());
  std::iota(order.begin(), order.end(), 0u);
  std::sort(order.begin(), order.end(), [&](uint32_t a, uint32_t b) { return indices_[a] < indices_[b]; });
  size_t count = 0;
  for (const auto& block : blocks_)
    count += static_cast<size_t>(
        std::count_if(block->cells.begin(), block->cells.end(), [](const Cell& cell) { return cell.weight > 0; }));
  std::vector<CloudPoint> points;
  points.reserve(count);
  for (const uint32_t i : order) {
    for (int number = 0; number < kBlockCells; ++number) {
      const Cell& cell = blocks_[i]->cells[static_cast<size_t>(number)];
      if (!(cell.weight > 0)) continue;
      CloudPoint& point = points.emplace_back();
      for (int k = 0; k < 3; ++k) {
        const int first =
            kBlockEdge * indices_[i][static_cast<size_t>(k)] + (number >> (2 - k) * kBlockBits & (kBlockEdge - 1));
        point.position_m[k] = static_cast<float>(
            cell_m_ * (static_cast<double>(first) + static_cast<double>(cell.position[k] / cell.weight)));
      }
      point.normal = Eigen::Vector3f(cell.normal[0], cell.normal[1], cell.normal[2]).normalized();
      point.grey = static_cast<uint8_t>(std::lround(std::clamp(cell.grey / cell.weight, 0.0f, 255.0f)));
      point.sigma_m = 1 / std::sqrt(cell.weight);
    }
  }
  return points;
}

}  // namespace fringeslam
