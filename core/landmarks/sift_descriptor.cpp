// SPDX-License-Identifier: Apache-2.0
#include "core/landmarks/sift_descriptor.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "core/base/lanes.h"
#include "core/types/selected_instruction_set.h"

namespace fringeslam {

namespace {

constexpr float kPi = std::numbers::pi_v<float>;

// Within 3e-4 rad (Hastings, Approximations for digital computers, 1955); 0 if both are 0.
FRINGESLAM_INLINE float angle_of(float y, float x) {
  const float ax = x < 0 ? -x : x, ay = y < 0 ? -y : y;
  const float larger = ax > ay ? ax : ay, smaller = ax > ay ? ay : ax;
  const float t = smaller / (larger > 1e-20f ? larger : 1e-20f), s = t * t;
  const float first = ((-0.0464964749f * s + 0.15931422f) * s - 0.327622764f) * s * t + t;
  const float quadrant = ay > ax ? kPi / 2 - first : first;
  const float half = x < 0 ? kPi - quadrant : quadrant;
  return y < 0 ? 2 * kPi - half : half;  // may be 2 pi
}

// ---- orientations

constexpr int kBins = 36, kMaxRadius = 24, kMaxWidth = 64;
static_assert(2 * kMaxRadius + 1 <= kMaxWidth);

// Computes the orientation bin and the weighted magnitude of each gradient in a row; `weights` are those of the row's
// pixels.
FRINGESLAM_INLINE void row_body(const float* above, const float* row, const float* below, const float* weights,
                                float weight, int count, int32_t* __restrict bins, float* __restrict parts) {
  constexpr float kPerBin = kBins / (2 * kPi);
  for (int i = 0; i < count; ++i) {
    const float gx = row[i + 1] - row[i - 1], gy = below[i] - above[i];
    const int bin = static_cast<int>(angle_of(gy, gx) * kPerBin + 0.5f);
    bins[i] = bin < kBins ? bin : bin - kBins;
    parts[i] = weight * weights[i] * std::sqrt(gx * gx + gy * gy);
  }
}

// ---- descriptors

constexpr int kPerCell = 4;                                                  // samples along a cell's side
constexpr int kGrid = (kDescriptorCells + 1) * kPerCell, kSide = kGrid + 2;  // of gradients, and of samples for them
constexpr int whole_vectors(int count) { return (count + 15) / 16 * 16; }
constexpr int kGradients = whole_vectors(kGrid * kSide), kSamples = whole_vectors(kGradients + 2 * kSide);
constexpr int kDirections = kDescriptorDirections;

struct Grid {
  // Offsets of the samples from the centre, in steps.
  alignas(64) std::array<float, kSamples> right, down;
  // Weight of a row (column) of gradients in each row (column) of cells: bilinear between cell centres, times a
  // Gaussian with a sigma of half the descriptor's width.
  std::array<std::array<float, kGrid>, kDescriptorCells> of_cell;
};
Grid grid() {
  Grid grid{};
  for (int i = 0; i < kSamples; ++i) {
    grid.right[static_cast<size_t>(i)] = static_cast<float>(i % kSide) - (kSide - 1) / 2.0f;
    grid.down[static_cast<size_t>(i)] = static_cast<float>(i / kSide) - (kSide - 1) / 2.0f;
  }
  for (int cell = 0; cell < kDescriptorCells; ++cell) {
    for (int i = 0; i < kGrid; ++i) {
      const double from_centre = (i + 0.5) / kPerCell - (kDescriptorCells + 1) / 2.0;  // in cells
      const double from_cell = from_centre + (kDescriptorCells - 1) / 2.0 - cell;
      const double sigma = kDescriptorCells / 2.0;
      grid.of_cell[static_cast<size_t>(cell)][static_cast<size_t>(i)] = static_cast<float>(
          std::max(0.0, 1 - std::abs(from_cell)) * std::exp(-from_centre * from_centre / (2 * sigma * sigma)));
    }
  }
  return grid;
}
struct Level {
  const float* pixels;
  int stride;  // in pixels
  float last_x, last_y;
};

// Samples the level at the grid points by bilinear interpolation; border values are replicated.
FRINGESLAM_INLINE void sample_body(Level level, LevelPosition place, float cosine, float sine, const Grid& grid,
                                   float* __restrict samples) {
  constexpr float kCellSigmas = 3;
  const float step = kCellSigmas / kPerCell * place.sigma, along = step * cosine, across = step * sine;
  alignas(64) int32_t at[kSamples];
  alignas(64) float wx[kSamples], wy[kSamples];
  for (int i = 0; i < kSamples; ++i) {
    const float right = grid.right[static_cast<size_t>(i)], down = grid.down[static_cast<size_t>(i)];
    const float x = place.x + along * right - across * down, y = place.y + across * right + along * down;
    const float from_x = x > 0 ? x : 0, from_y = y > 0 ? y : 0;
    const float inner_x = from_x < level.last_x ? from_x : level.last_x;
    const float inner_y = from_y < level.last_y ? from_y : level.last_y;
    const int col = static_cast<int>(inner_x), row = static_cast<int>(inner_y);
    at[i] = row * level.stride + col;
    wx[i] = inner_x - static_cast<float>(col), wy[i] = inner_y - static_cast<float>(row);
  }
  alignas(64) float upper_left[kSamples], upper_right[kSamples], lower_left[kSamples], lower_right[kSamples];
  for (int i = 0; i < kSamples; ++i) {
    const float *const upper = level.pixels + at[i], *const lower = upper + level.stride;
    upper_left[i] = upper[0], upper_right[i] = upper[1], lower_left[i] = lower[0], lower_right[i] = lower[1];
  }
  for (int i = 0; i < kSamples; ++i) {
    const float upper = upper_left[i] + wx[i] * (upper_right[i] - upper_left[i]);
    const float lower = lower_left[i] + wx[i] * (lower_right[i] - lower_left[i]);
    samples[i] = upper + wy[i] * (lower - upper);
  }
}

FRINGESLAM_INLINE void describe_body(Level level, LevelPosition place, float cosine, float sine, const Grid& grid,
                                     float* __restrict descriptor) {
  using L = Lanes<kDirections>;
  alignas(64) float samples[kSamples], angle[kGradients], magnitude[kGradients];
  sample_body(level, place, cosine, sine, grid, samples);
  for (int i = 0; i < kGradients; ++i) {
    const float gx = samples[i + kSide + 2] - samples[i + kSide], gy = samples[i + 2 * kSide + 1] - samples[i + 1];
    angle[i] = angle_of(gy, gx) * (kDirections / (2 * kPi));
    magnitude[i] = std::sqrt(gx * gx + gy * gy);
  }
  const typename L::Floats none = {}, direction = {0, 1, 2, 3, 4, 5, 6, 7};
  typename L::Floats cells[kDescriptorCells][kDescriptorCells];
  for (auto& row : cells) {
    for (auto& cell : row) cell = none;
  }
  for (int j = 0; j < kGrid; ++j) {
    // Each gradient lies between the centres of two cells, or outside the first or last centre.
    typename L::Floats across[kDescriptorCells + 2];
    for (auto& cell : across) cell = none;
    for (int i = 0; i < kGrid; ++i) {
      const int n = j * kSide + i, left = i / kPerCell;
      const typename L::Floats off = L::absolute(angle[n] - direction);
      const typename L::Floats share = 1 - L::least(off, kDirections - off);
      const typename L::Floats part = magnitude[n] * L::masked(share, L::not_negative(share));
      if (left > 0) across[left] += grid.of_cell[static_cast<size_t>(left - 1)][static_cast<size_t>(i)] * part;
      if (left < kDescriptorCells)
        across[left + 1] += grid.of_cell[static_cast<size_t>(left)][static_cast<size_t>(i)] * part;
    }
    const int upper = j / kPerCell;
    for (int cell = upper - 1; cell <= upper; ++cell) {
      if (cell < 0 || cell >= kDescriptorCells) continue;
      for (int k = 0; k < kDescriptorCells; ++k)
        cells[cell][k] += grid.of_cell[static_cast<size_t>(cell)][static_cast<size_t>(j)] * across[k + 1];
    }
  }
  for (int cell = 0; cell < kDescriptorCells * kDescriptorCells; ++cell)
    L::store(cells[cell / kDescriptorCells][cell % kDescriptorCells], descriptor + cell * kDirections);
}

void make_unit(float* descriptor) {
  double sum = 0;
  for (int i = 0; i < kDescriptorSize; ++i)
    sum += static_cast<double>(descriptor[i]) * static_cast<double>(descriptor[i]);
  const auto scale = static_cast<float>(1 / std::sqrt(std::max(sum, 1e-24)));
  for (int i = 0; i < kDescriptorSize; ++i) descriptor[i] *= scale;
}

}  // namespace

std::vector<float> dominant_orientations(const cv::Mat1f& level, const LevelPosition& place) {
  static const auto row_of = Variants<row_body>::of(selected_instruction_set());
  constexpr float kWindowSigmas = 1.5f, kReach = 3, kAlsoMost = 0.8f;
  const float window = kWindowSigmas * place.sigma;
  const int radius = std::min(kMaxRadius, static_cast<int>(std::lround(kReach * window)));
  const int x = static_cast<int>(std::lround(place.x)), y = static_cast<int>(std::lround(place.y));
  const auto weight = [&](int off) { return std::exp(-static_cast<float>(off * off) / (2 * window * window)); };
  const int first = std::max(x - radius, 1), last = std::min(x + radius, level.cols - 2);
  std::array<float, kMaxWidth> weights, parts;
  std::array<int32_t, kMaxWidth> bins;
  for (int col = first; col <= last; ++col) weights[static_cast<size_t>(col - first)] = weight(col - x);
  std::array<float, kBins> most{};
  for (int row = std::max(y - radius, 1); row <= std::min(y + radius, level.rows - 2); ++row) {
    const int count = last - first + 1;
    row_of(level[row - 1] + first, level[row] + first, level[row + 1] + first, weights.data(), weight(row - y), count,
           bins.data(), parts.data());
    for (size_t i = 0; i < static_cast<size_t>(std::max(count, 0)); ++i) most[static_cast<size_t>(bins[i])] += parts[i];
  }
  std::array<float, kBins> smooth;
  const auto at = [](const std::array<float, kBins>& bins_of, size_t i) { return bins_of[i % kBins]; };
  for (size_t i = 0; i < kBins; ++i)
    smooth[i] = (at(most, i + kBins - 2) + at(most, i + 2)) / 16 + (at(most, i + kBins - 1) + at(most, i + 1)) / 4 +
                at(most, i) * 3 / 8;
  const float least = kAlsoMost * *std::max_element(smooth.begin(), smooth.end());
  std::vector<float> directions;
  for (size_t i = 0; i < kBins; ++i) {
    const float before = at(smooth, i + kBins - 1), here = smooth[i], after = at(smooth, i + 1);
    if (!(here > before && here > after && here >= least)) continue;
    const float bin = static_cast<float>(i) + 0.5f * (before - after) / (before - 2 * here + after);
    const float turn = bin * (2 * kPi / kBins), positive = turn < 0 ? turn + 2 * kPi : turn;
    directions.push_back(positive < 2 * kPi ? positive : 0);
  }
  return directions;
}

void compute_descriptor(const cv::Mat1f& level, const LevelPosition& place, float direction, float* descriptor) {
  static const auto describe = Variants<describe_body>::of(selected_instruction_set());
  static const Grid the_grid = grid();
  constexpr float kLargest = 0.2f;
  // The upper limit guarantees a pixel to the right and below.
  const auto last = [](int count) { return std::nextafter(static_cast<float>(count - 1), 0.0f); };
  const Level pixels{level[0], static_cast<int>(level.step1()), last(level.cols), last(level.rows)};
  describe(pixels, place, std::cos(direction), std::sin(direction), the_grid, descriptor);
  make_unit(descriptor);
  for (int i = 0; i < kDescriptorSize; ++i) descriptor[i] = std::min(descriptor[i], kLargest);
  make_unit(descriptor);
}

}  // namespace fringeslam
