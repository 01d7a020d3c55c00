// SPDX-License-Identifier: Apache-2.0
#include "sim/light/projected_patterns.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <numbers>

#include "core/base/constants.h"
#include "core/base/symmetric_filter.h"
#include "core/types/selected_instruction_set.h"

namespace fringeslam::sim {

namespace {

constexpr int kVector = 4;  // floats per vector; sums are padded to a multiple
constexpr int kBlurLevels = 16;
constexpr int kPerPixel = 4;

int padded(int n) { return (n + kVector - 1) / kVector * kVector; }

bool is_wave(const Pattern& pattern, const PatternSequence& sequence, const RigModel& rig) {
  const bool cosine = pattern.coding == Coding::fringe || pattern.coding == Coding::extra;
  return cosine && pattern.bits == 0 && sequence.inverse_response.empty() && rig.projector_response.empty();
}

// Projected light of pixels with input levels from 0 to 1.
cv::Mat1f light_at(const cv::Mat1f& levels, const RigModel& rig) {
  cv::Mat1f light = levels.clone();
  const double black = rig.projector_black_level;
  for (float& level : light)
    level =
        static_cast<float>(black + (1 - black) * interpolate_table(rig.projector_response, static_cast<double>(level)));
  return light;
}

// Projected light of a pattern; a dimension along which it is constant has size 1.
cv::Mat1f light_of(const Pattern& pattern, const PatternSequence& sequence, const RigModel& rig) {
  return light_at(pattern_levels(pattern, sequence), rig);
}

// True if all rows of an image equal this row, or all columns this column.
bool is_repeated(const cv::Mat1f& line, const cv::Mat1f& image) {
  const bool row = line.rows == 1;
  for (int y = 0; y < image.rows; ++y) {
    for (int x = 0; x < image.cols; ++x) {
      if (image(y, x) != (row ? line(0, x) : line(y, 0))) return false;
    }
  }
  return true;
}

// Convolves a row of square pixels with a Gaussian: at x, sum_i l_i (G(x - i + 1/2) - G(x - i - 1/2)), with G the
// Gaussian's integral.
std::vector<float> blurred(const cv::Mat1f& pixels, double sigma, int per_px) {
  const int n = static_cast<int>(pixels.total());
  const int reach = static_cast<int>(std::ceil(5 * sigma + 1));
  // Weights of the neighbouring pixels, for each sub-pixel position.
  std::vector<std::vector<double>> weights(static_cast<size_t>(per_px));
  for (int part = 0; part < per_px; ++part) {
    const double x = static_cast<double>(part) / per_px;
    double total = 0;
    auto& w = weights[static_cast<size_t>(part)];
    for (int i = -reach; i <= reach; ++i) {
      const double high = x - i + 0.5, low = x - i - 0.5, scale = 1 / (std::numbers::sqrt2 * std::max(sigma, 1e-3));
      w.push_back(0.5 * (std::erf(high * scale) - std::erf(low * scale)));
      total += w.back();
    }
    for (double& value : w) value /= total;
  }
  std::vector<float> result;
  const float* line = pixels.ptr<float>();
  for (int k = 0; k < (n - 1) * per_px + 1; ++k) {
    const auto& w = weights[static_cast<size_t>(k % per_px)];
    double sum = 0;
    for (int i = -reach; i <= reach; ++i)
      sum += w[static_cast<size_t>(i + reach)] * static_cast<double>(line[std::clamp(k / per_px + i, 0, n - 1)]);
    result.push_back(static_cast<float>(sum));
  }
  return result;
}

struct Place {
  int low, high;
  float part;
};
Place place(float coordinate, int size) {
  const float clamped = std::clamp(coordinate, 0.0f, static_cast<float>(size - 1));
  const int low = static_cast<int>(clamped);
  return {low, std::min(low + 1, size - 1), clamped - static_cast<float>(low)};
}

float bilinear(const cv::Mat1f& image, const Place& x, const Place& y) {
  const float* above = image[y.low];
  const float* below = image[y.high];
  const float top = above[x.low] + x.part * (above[x.high] - above[x.low]);
  const float bottom = below[x.low] + x.part * (below[x.high] - below[x.low]);
  return top + y.part * (bottom - top);
}

}  // namespace

ProjectedPatterns::ProjectedPatterns(int count, const RigModel& rig, const BlurRange& blur)
    : count_(count),
      per_px_(blur.largest > 0 ? kPerPixel : 1),
      black_(static_cast<float>(rig.projector_black_level)),
      slots_(static_cast<size_t>(count)),
      blur_(blur) {
  const int levels = blur.largest > 0 ? kBlurLevels : 1;
  for (int k = 0; k < levels; ++k) {
    const double part = levels == 1 ? 0 : static_cast<double>(k) / (levels - 1);
    sigmas_.push_back(blur.least + (blur.largest - blur.least) * part * part);
  }
}

ProjectedPatterns::ProjectedPatterns(const std::vector<cv::Mat1f>& images, const RigModel& rig, const BlurRange& blur)
    : ProjectedPatterns(static_cast<int>(images.size()), rig, blur) {
  std::vector<int> columns, rows, plane;
  std::vector<cv::Mat1f> of_columns, of_rows;
  for (int i = 0; i < count_; ++i) {
    const cv::Mat1f& image = images[static_cast<size_t>(i)];
    const cv::Mat1f row = image.row(0), column = image.col(0);
    if (is_repeated(row, image)) {
      columns.push_back(i);
      of_columns.push_back(light_at(row, rig));
    } else if (is_repeated(column, image)) {
      rows.push_back(i);
      of_rows.push_back(light_at(column, rig));
    } else {
      plane.push_back(i);
    }
  }
  if (!columns.empty()) add_profile(Axis::columns, images.front().cols, columns, of_columns);
  if (!rows.empty()) add_profile(Axis::rows, images.front().rows, rows, of_rows);
  for (const int i : plane) add_image(i, light_at(images[static_cast<size_t>(i)], rig));
  stride_ = padded(stride_);
}

ProjectedPatterns::ProjectedPatterns(const PatternSequence& sequence, const RigModel& rig, const BlurRange& blur)
    : ProjectedPatterns(static_cast<int>(sequence.patterns.size()), rig, blur) {
  std::vector<int> columns, rows, plane;
  for (int i = 0; i < count_; ++i) {
    const Pattern& pattern = sequence.patterns[static_cast<size_t>(i)];
    if (is_wave(pattern, sequence, rig)) continue;
    (pattern.dithered                                               ? plane
     : pattern.coding != Coding::flat && pattern.axis == Axis::rows ? rows
                                                                    : columns)
        .push_back(i);
  }
  const auto lights = [&](const std::vector<int>& patterns) {
    std::vector<cv::Mat1f> result;
    for (const int i : patterns) result.push_back(light_of(sequence.patterns[static_cast<size_t>(i)], sequence, rig));
    return result;
  };
  add_profile(Axis::columns, sequence.width, columns, lights(columns));
  add_profile(Axis::rows, sequence.height, rows, lights(rows));
  for (const int i : plane) add_image(i, light_of(sequence.patterns[static_cast<size_t>(i)], sequence, rig));
  for (int i = 0; i < count_; ++i) {
    const Pattern& pattern = sequence.patterns[static_cast<size_t>(i)];
    if (!is_wave(pattern, sequence, rig)) continue;
    waves_.push_back({stride_, pattern.axis, 1 / pattern.period_px, pattern.shift_rad / (2 * kPi)});
    slots_[static_cast<size_t>(i)] = stride_++;
  }
  stride_ = padded(stride_);
}

void ProjectedPatterns::add_image(int i, const cv::Mat1f& light) {
  Image image{stride_, {}};
  for (const double sigma : sigmas_) {
    // Target variance: sigma^2 + 1/12 px^2, for square pixels; linear interpolation contributes 1/6 px^2 on average.
    cv::Mat1f soft = light.clone();  // each level is computed from the sharp image
    if (sigma > 0.3)
      soft = filtered(light, point_spread_half(std::sqrt(sigma * sigma - 1.0 / 12)), FilterBorder::replicated,
                      selected_instruction_set());
    image.levels.push_back(soft);
  }
  slots_[static_cast<size_t>(i)] = stride_++;
  images_.push_back(std::move(image));
}

void ProjectedPatterns::add_profile(Axis axis, int length, const std::vector<int>& patterns,
                                    const std::vector<cv::Mat1f>& lights) {
  if (patterns.empty()) return;
  Profile profile;
  profile.along_columns = axis == Axis::columns;
  profile.first = stride_;
  profile.width = padded(static_cast<int>(patterns.size()));
  profile.positions = (std::max(length, 1) - 1) * per_px_ + 1;
  profile.levels.assign(sigmas_.size(), std::vector<float>(static_cast<size_t>(profile.positions * profile.width)));
  for (size_t i = 0; i < patterns.size(); ++i) {
    cv::Mat1f light = lights[i];
    if (light.total() == 1) light = cv::Mat1f(1, std::max(length, 1), light(0, 0));
    for (size_t level = 0; level < profile.levels.size(); ++level) {
      const std::vector<float> line =
          per_px_ == 1 ? std::vector<float>(light.begin(), light.end()) : blurred(light, sigmas_[level], per_px_);
      for (size_t x = 0; x < line.size(); ++x)
        profile.levels[level][x * static_cast<size_t>(profile.width) + i] = line[x];
    }
    slots_[static_cast<size_t>(patterns[i])] = stride_ + static_cast<int>(i);
  }
  stride_ += profile.width;
  profiles_.push_back(std::move(profile));
}

namespace {

constexpr int kLanes = 16;

// Interpolation taps per lane: two entries in each of two blur levels, with their weights.
struct Places {
  alignas(64) int level[kLanes], low[kLanes], high[kLanes];
  alignas(64) float sharp_low[kLanes], sharp_high[kLanes], soft_low[kLanes], soft_high[kLanes];
};

// Blur levels: sigma = least + step k^2, k up to `last`.
struct Ladder {
  float least, step, inverse_step, last;
};

// Finds the blur levels that bracket each lane's sigma, and the weight of the softer one, linear in the variance.
FRINGESLAM_INLINE void find_levels(const ProjectedPatterns::Points& points, const Ladder& ladder, Places& places,
                                   float* softer) {
#pragma GCC ivdep
  for (int i = 0; i < kLanes; ++i) {
    const float excess = std::max(points.blur_px[i] - ladder.least, 0.0f) * ladder.inverse_step;
    const float level = static_cast<float>(static_cast<int>(std::min(std::sqrt(excess), ladder.last)));
    const float low = ladder.least + ladder.step * level * level;
    const float high = ladder.least + ladder.step * (level + 1) * (level + 1);
    const float sigma = std::min(std::max(points.blur_px[i], low), high);
    places.level[i] = static_cast<int>(level);
    softer[i] = (sigma * sigma - low * low) / std::max(high * high - low * low, 1e-12f);
  }
}

FRINGESLAM_INLINE void find_places(const float* coordinate, const float* weight, const float* softer, float per_px,
                                   int positions, Places& places) {
#pragma GCC ivdep
  for (int i = 0; i < kLanes; ++i) {
    const float at = std::min(std::max(coordinate[i] * per_px, 0.0f), static_cast<float>(positions - 1));
    const int low = static_cast<int>(at);
    const float part = at - static_cast<float>(low);
    places.low[i] = low;
    places.high[i] = std::min(low + 1, positions - 1);
    const float high = weight[i] * part, rest = weight[i] - high;
    places.soft_low[i] = rest * softer[i];
    places.soft_high[i] = high * softer[i];
    places.sharp_low[i] = rest - places.soft_low[i];
    places.sharp_high[i] = high - places.soft_high[i];
  }
}

FRINGESLAM_INLINE void find_body(const ProjectedPatterns::Points& points, const Ladder& ladder, bool columns,
                                 float per_px, int positions, Places& places) {
  alignas(64) float softer[kLanes];
  find_levels(points, ladder, places, softer);
  find_places(columns ? points.column : points.row, points.weight, softer, per_px, positions, places);
}

}  // namespace

void ProjectedPatterns::add(const Points& points, uint32_t lanes, float* sums) const {
  static const auto find = Variants<find_body>::of(selected_instruction_set());
  const auto n = static_cast<float>(sigmas_.size() - 1);
  const auto least = static_cast<float>(blur_.least), range = static_cast<float>(blur_.largest - blur_.least);
  const bool ladder_has_steps = n > 0 && range > 0;
  const Ladder ladder{least, ladder_has_steps ? range / (n * n) : 0, ladder_has_steps ? n * n / range : 0,
                      ladder_has_steps ? n - 1 : 0};
  for (const Profile& profile : profiles_) {
    Places places;
    find(points, ladder, profile.along_columns, static_cast<float>(per_px_), profile.positions, places);
    const auto width = static_cast<size_t>(profile.width);
    for (uint32_t left = lanes; left != 0; left &= left - 1) {
      const int i = std::countr_zero(left);
      float* out = sums + i * stride_ + profile.first;
      const size_t low = static_cast<size_t>(places.low[i]) * width, high = static_cast<size_t>(places.high[i]) * width;
      const auto level = static_cast<size_t>(places.level[i]);
      const float* sharp = profile.levels[level].data();
      const float* soft = profile.levels[std::min(level + 1, profile.levels.size() - 1)].data();
      const float a = places.sharp_low[i], b = places.sharp_high[i], c = places.soft_low[i], d = places.soft_high[i];
      for (size_t k = 0; k < width; k += kVector) {
        for (size_t j = k; j < k + kVector; ++j)
          out[j] += (a * sharp[low + j] + b * sharp[high + j]) + (c * soft[low + j] + d * soft[high + j]);
      }
    }
  }
  if (!images_.empty()) add_images(points, lanes, sums);
  if (!waves_.empty()) add_waves(points, lanes, sums);
}

void ProjectedPatterns::add_images(const Points& points, uint32_t lanes, float* sums) const {
  for (uint32_t left = lanes; left != 0; left &= left - 1) {
    const int i = std::countr_zero(left);
    for (const Image& image : images_) {
      const Place x = place(points.column[i], image.levels[0].cols), y = place(points.row[i], image.levels[0].rows);
      float light = bilinear(image.levels[0], x, y);
      if (image.levels.size() > 1) {
        const auto above = std::upper_bound(sigmas_.begin(), sigmas_.end(), static_cast<double>(points.blur_px[i]));
        const size_t upper = std::clamp<size_t>(static_cast<size_t>(above - sigmas_.begin()), 1, sigmas_.size() - 1);
        const double low = sigmas_[upper - 1], high = sigmas_[upper];
        const double sigma = std::clamp(static_cast<double>(points.blur_px[i]), low, high);
        const auto part = static_cast<float>((sigma * sigma - low * low) / std::max(high * high - low * low, 1e-12));
        light = (1 - part) * bilinear(image.levels[upper - 1], x, y) + part * bilinear(image.levels[upper], x, y);
      }
      sums[i * stride_ + image.slot] += points.weight[i] * light;
    }
  }
}

void ProjectedPatterns::add_waves(const Points& points, uint32_t lanes, float* sums) const {
  for (uint32_t left = lanes; left != 0; left &= left - 1) {
    const int i = std::countr_zero(left);
    const auto variance = static_cast<double>(points.blur_px[i] * points.blur_px[i]);
    for (const Wave& wave : waves_) {
      const auto along = static_cast<double>(wave.axis == Axis::columns ? points.column[i] : points.row[i]) + 0.5;
      const double turns = along * wave.turns_per_px + wave.shift_turns;
      const double kept = std::exp(-2 * kPi * kPi * variance * wave.turns_per_px * wave.turns_per_px);
      const double light = 0.5 + 0.5 * kept * std::cos(2 * kPi * (turns - std::floor(turns)));
      sums[i * stride_ + wave.slot] += points.weight[i] * (black_ + (1 - black_) * static_cast<float>(light));
    }
  }
}

}  // namespace fringeslam::sim
