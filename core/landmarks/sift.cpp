// SPDX-License-Identifier: Apache-2.0
#include "core/landmarks/sift.h"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <optional>

#include "core/base/parallel.h"
#include "core/landmarks/scale_space.h"
#include "core/landmarks/sift_descriptor.h"
#include "core/types/selected_instruction_set.h"

namespace fringeslam {

namespace {

constexpr int kBorder = 5;  // margin of an octave without extrema, px
constexpr int kDifferences = kLevels - 1;
constexpr float kFullScale = 255;

struct Extremum {
  int octave = 0, level = 0, row = 0, col = 0;
  double x = 0, y = 0, scale = 0;  // in the octave's pixels and levels
  double strength = 0;
};

// Rows of the differences between an octave's levels.
struct DifferenceRows {
  const float* at[kDifferences][3];  // level; row above, current row, row below
};

// Marks the pixels of a row that are extrema of level `level` among their 26 neighbours.
FRINGESLAM_INLINE void extrema_body(const DifferenceRows& rows, int level, int first, int end, float threshold,
                                    uint8_t* __restrict found) {
  const float *const b0 = rows.at[level - 1][0], *const b1 = rows.at[level - 1][1], *const b2 = rows.at[level - 1][2];
  const float *const h0 = rows.at[level][0], *const h1 = rows.at[level][1], *const h2 = rows.at[level][2];
  const float *const a0 = rows.at[level + 1][0], *const a1 = rows.at[level + 1][1], *const a2 = rows.at[level + 1][2];
  const auto most = [](float a, float b) { return a > b ? a : b; };
  const auto least = [](float a, float b) { return a < b ? a : b; };
  for (int x = first; x < end; ++x) {
    const auto most3 = [&](const float* r) { return most(most(r[x - 1], r[x]), r[x + 1]); };
    const auto least3 = [&](const float* r) { return least(least(r[x - 1], r[x]), r[x + 1]); };
    const float high =
        most(most(most(most3(b0), most3(b1)), most(most3(b2), most3(a0))),
             most(most(most3(a1), most3(a2)), most(most(most3(h0), most3(h2)), most(h1[x - 1], h1[x + 1]))));
    const float low =
        least(least(least(least3(b0), least3(b1)), least(least3(b2), least3(a0))),
              least(least(least3(a1), least3(a2)), least(least(least3(h0), least3(h2)), least(h1[x - 1], h1[x + 1]))));
    const float value = h1[x];
    const bool peak = (value > threshold) & (value >= high), pit = (value < -threshold) & (value <= low);
    found[x] = peak | pit ? 1 : 0;
  }
}

double difference(const Octave& octave, int level, int row, int col) {
  const auto at = static_cast<size_t>(level);
  return (static_cast<double>(octave[at + 1](row, col)) - static_cast<double>(octave[at](row, col))) /
         static_cast<double>(kFullScale);
}

// Locates the extremum of the quadratic fitted to the neighbours (Lowe, section 4), moving to the pixel and level
// nearest to it; rejects low contrast and edge responses.
std::optional<Extremum> located(const Octave& octave, Extremum at, const SiftOptions& options) {
  constexpr int kSteps = 5;
  const int rows = octave[0].rows, cols = octave[0].cols;
  for (int step = 0; step < kSteps; ++step) {
    const auto d = [&](int dl, int dy, int dx) { return difference(octave, at.level + dl, at.row + dy, at.col + dx); };
    const double here = d(0, 0, 0);
    const Eigen::Vector3d gradient =
        0.5 * Eigen::Vector3d(d(0, 0, 1) - d(0, 0, -1), d(0, 1, 0) - d(0, -1, 0), d(1, 0, 0) - d(-1, 0, 0));
    const auto mixed = [](double pp, double pm, double mp, double mm) { return (pp - pm - mp + mm) / 4; };
    const double xx = d(0, 0, 1) + d(0, 0, -1) - 2 * here, yy = d(0, 1, 0) + d(0, -1, 0) - 2 * here;
    const double ss = d(1, 0, 0) + d(-1, 0, 0) - 2 * here;
    const double xy = mixed(d(0, 1, 1), d(0, 1, -1), d(0, -1, 1), d(0, -1, -1));
    const double xs = mixed(d(1, 0, 1), d(1, 0, -1), d(-1, 0, 1), d(-1, 0, -1));
    const double ys = mixed(d(1, 1, 0), d(1, -1, 0), d(-1, 1, 0), d(-1, -1, 0));
    Eigen::Matrix3d hessian;
    hessian << xx, xy, xs, xy, yy, ys, xs, ys, ss;
    const Eigen::Vector3d off = hessian.fullPivLu().solve(-gradient);
    if (!off.allFinite() || off.cwiseAbs().maxCoeff() > 1e3) return std::nullopt;
    if (off.cwiseAbs().maxCoeff() > 0.5) {
      at.col += static_cast<int>(std::lround(off.x()));
      at.row += static_cast<int>(std::lround(off.y()));
      at.level += static_cast<int>(std::lround(off.z()));
      if (at.level < 1 || at.level > kScalesPerOctave || at.col < kBorder || at.col >= cols - kBorder ||
          at.row < kBorder || at.row >= rows - kBorder)
        return std::nullopt;
      continue;
    }
    const double contrast = std::abs(here + 0.5 * gradient.dot(off)), determinant = xx * yy - xy * xy;
    const double ratio = options.edge_threshold, trace = xx + yy;
    if (contrast * kScalesPerOctave < options.contrast_threshold) return std::nullopt;
    if (!(determinant > 0) || trace * trace * ratio >= (ratio + 1) * (ratio + 1) * determinant) return std::nullopt;
    at.x = at.col + off.x(), at.y = at.row + off.y(), at.scale = at.level + off.z();
    at.strength = contrast;
    return at;
  }
  return std::nullopt;
}

// Finds the extrema in rows [first, end) of an octave.
void find_extrema(const Octave& octave, int number, int first, int end, const SiftOptions& options,
                  std::vector<Extremum>& found) {
  static const auto extrema = Variants<extrema_body>::of(selected_instruction_set());
  const int cols = octave[0].cols;
  const auto threshold = static_cast<float>(0.5 * options.contrast_threshold / kScalesPerOctave) * kFullScale;
  std::array<cv::Mat1f, kDifferences> differences;  // rows first - 1 to end
  for (size_t level = 0; level < kDifferences; ++level)
    cv::subtract(octave[level + 1].rowRange(first - 1, end + 1), octave[level].rowRange(first - 1, end + 1),
                 differences[level]);
  std::vector<uint8_t> is_extremum(static_cast<size_t>(cols));
  for (int row = first; row < end; ++row) {
    DifferenceRows rows;
    for (int level = 0; level < kDifferences; ++level) {
      for (int i = 0; i < 3; ++i) rows.at[level][i] = differences[static_cast<size_t>(level)][row - first + i];
    }
    for (int level = 1; level <= kScalesPerOctave; ++level) {
      extrema(rows, level, kBorder, cols - kBorder, threshold, is_extremum.data());
      for (int col = kBorder; col < cols - kBorder; ++col) {
        if (is_extremum[static_cast<size_t>(col)] == 0) continue;
        if (const auto extremum = located(octave, {number, level, row, col}, options)) found.push_back(*extremum);
      }
    }
  }
}

// Returns the strongest extrema in a deterministic order; extrema reached from several pixels are kept once.
std::vector<Extremum> strongest(std::vector<Extremum> extrema, int count) {
  const auto place = [](const Extremum& e) { return std::array{e.octave, e.level, e.row, e.col}; };
  std::sort(extrema.begin(), extrema.end(), [&](const Extremum& a, const Extremum& b) {
    return a.strength != b.strength ? a.strength > b.strength : place(a) < place(b);
  });
  const auto same = [&](const Extremum& a, const Extremum& b) { return place(a) == place(b); };
  extrema.erase(std::unique(extrema.begin(), extrema.end(), same), extrema.end());
  extrema.resize(std::min(extrema.size(), static_cast<size_t>(count)));
  return extrema;
}

std::vector<Extremum> extrema_of(const std::vector<Octave>& octaves, const SiftOptions& options) {
  constexpr int kBand = 32;  // rows per parallel task
  std::vector<Extremum> all;
  for (size_t number = 0; number < octaves.size(); ++number) {
    const Octave& octave = octaves[number];
    const int rows = octave[0].rows - 2 * kBorder;
    if (rows <= 0 || octave[0].cols <= 2 * kBorder) break;
    std::vector<std::vector<Extremum>> bands(static_cast<size_t>((rows + kBand - 1) / kBand));
    for_each_row(static_cast<int>(bands.size()), [&](int band) {
      const int first = band * kBand, end = std::min(first + kBand, rows);
      find_extrema(octave, static_cast<int>(number), kBorder + first, kBorder + end, options,
                   bands[static_cast<size_t>(band)]);
    });
    for (const auto& band : bands) std::copy(band.begin(), band.end(), std::back_inserter(all));
  }
  return strongest(std::move(all), options.max_keypoints);
}

struct Directed {
  const Extremum* extremum = nullptr;
  float direction = 0;
};

}  // namespace

SiftFeatures sift(const cv::Mat1b& image, const SiftOptions& options, Describe describe) {
  const std::vector<Octave> octaves = scale_space(image);
  const std::vector<Extremum> extrema = extrema_of(octaves, options);
  const auto level_of = [&](const Extremum& e) -> const cv::Mat1f& {
    return octaves[static_cast<size_t>(e.octave)][static_cast<size_t>(e.level)];
  };
  const auto place_of = [](const Extremum& e) {
    return LevelPosition{static_cast<float>(e.x), static_cast<float>(e.y), static_cast<float>(level_sigma(e.scale))};
  };
  std::vector<std::vector<float>> directions(extrema.size());
  for_each_row(static_cast<int>(extrema.size()), [&](int i) {
    const Extremum& extremum = extrema[static_cast<size_t>(i)];
    directions[static_cast<size_t>(i)] = dominant_orientations(level_of(extremum), place_of(extremum));
  });
  std::vector<Directed> directed;
  for (size_t i = 0; i < extrema.size(); ++i) {
    for (const float direction : directions[i]) directed.push_back({&extrema[i], direction});
  }
  directed.resize(std::min(directed.size(), static_cast<size_t>(options.max_keypoints)));

  SiftFeatures features;
  for (const auto& [extremum, direction] : directed) {
    const int octave = extremum->octave;
    features.keypoints.push_back({{pixel_of(octave, extremum->x), pixel_of(octave, extremum->y)},
                                  std::ldexp(level_sigma(extremum->scale), octave - 1),
                                  static_cast<double>(direction),
                                  extremum->strength});
  }
  if (describe == Describe::no) return features;
  features.descriptors.create(static_cast<int>(directed.size()), kDescriptorSize);
  for_each_row(features.descriptors.rows, [&](int i) {
    const auto& [extremum, direction] = directed[static_cast<size_t>(i)];
    compute_descriptor(level_of(*extremum), place_of(*extremum), direction, features.descriptors[i]);
  });
  return features;
}

}  // namespace fringeslam
