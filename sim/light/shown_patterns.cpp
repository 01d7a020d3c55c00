// SPDX-License-Identifier: Apache-2.0
#include "sim/light/shown_patterns.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <opencv2/imgproc.hpp>

namespace fringeslam::sim {

namespace {

constexpr double kPi = std::numbers::pi;
constexpr int kVector = 4;  // floats; sums are padded to it
constexpr int kBlurLevels = 16, kImageBlurLevels = 8;
constexpr int kPerPixel = 4;

int padded(int n) { return (n + kVector - 1) / kVector * kVector; }

bool is_wave(const Pattern& pattern, const PatternSequence& sequence, const RigModel& rig) {
  return pattern.coding == Coding::fringe && pattern.bits == 0 && sequence.inverse_response.empty() &&
         rig.projector_response.empty();
}

// Light of the projector's pixels; a dimension along which the pattern does not change has size 1.
cv::Mat1f light_of(const Pattern& pattern, const PatternSequence& sequence, const RigModel& rig) {
  cv::Mat1f light = pattern_levels(pattern, sequence).clone();
  const double black = rig.projector_black_level;
  for (float& level : light)
    level = static_cast<float>(black + (1 - black) * table_value(rig.projector_response, static_cast<double>(level)));
  return light;
}

// A row of square pixels through a Gaussian: at x, sum_i l_i (G(x - i + 1/2) - G(x - i - 1/2)), G its integral.
std::vector<float> blurred(const cv::Mat1f& pixels, double sigma, int per_px) {
  const int n = static_cast<int>(pixels.total());
  const int reach = static_cast<int>(std::ceil(5 * sigma + 1));
  // Weights of the pixels about a position, for each position within a pixel.
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

ShownPatterns::ShownPatterns(const PatternSequence& sequence, const RigModel& rig, double largest_blur_px)
    : count_(static_cast<int>(sequence.patterns.size())),
      per_px_(largest_blur_px > 0 ? kPerPixel : 1),
      black_(static_cast<float>(rig.projector_black_level)),
      slots_(sequence.patterns.size()) {
  const int levels = largest_blur_px > 0 ? kBlurLevels : 1;
  for (int k = 0; k < levels; ++k) {
    const double sigma = levels == 1 ? 0 : largest_blur_px * k / (levels - 1);
    blur_variances_.push_back(static_cast<float>(sigma * sigma));
  }
  std::vector<int> columns, rows, plane;
  for (int i = 0; i < count_; ++i) {
    const Pattern& pattern = sequence.patterns[static_cast<size_t>(i)];
    if (is_wave(pattern, sequence, rig)) continue;
    (pattern.dithered                                               ? plane
     : pattern.coding != Coding::flat && pattern.axis == Axis::rows ? rows
                                                                    : columns)
        .push_back(i);
  }
  add_profile(sequence, Axis::columns, columns, rig);
  add_profile(sequence, Axis::rows, rows, rig);
  for (const int i : plane) {
    Image image{stride_, {}};
    const cv::Mat1f light = light_of(sequence.patterns[static_cast<size_t>(i)], sequence, rig);
    const int image_levels = levels == 1 ? 1 : kImageBlurLevels;
    for (int k = 0; k < image_levels; ++k) {
      // Square pixels have a variance of 1/12 px^2, of which interpolation between them gives 1/6 on average.
      const double sigma = image_levels == 1 ? 0 : largest_blur_px * k / (image_levels - 1);
      cv::Mat1f soft = light;
      if (sigma > 0.3) cv::GaussianBlur(light, soft, {}, std::sqrt(sigma * sigma - 1.0 / 12), 0, cv::BORDER_REPLICATE);
      image.levels.push_back(soft);
    }
    slots_[static_cast<size_t>(i)] = stride_++;
    images_.push_back(std::move(image));
  }
  for (int i = 0; i < count_; ++i) {
    const Pattern& pattern = sequence.patterns[static_cast<size_t>(i)];
    if (!is_wave(pattern, sequence, rig)) continue;
    waves_.push_back({stride_, pattern.axis, 1 / pattern.period_px, pattern.shift_rad / (2 * kPi)});
    slots_[static_cast<size_t>(i)] = stride_++;
  }
  stride_ = padded(stride_);
}

void ShownPatterns::add_profile(const PatternSequence& sequence, Axis axis, const std::vector<int>& patterns,
                                const RigModel& rig) {
  if (patterns.empty()) return;
  const int length = axis == Axis::columns ? sequence.width : sequence.height;
  Profile profile;
  profile.along_columns = axis == Axis::columns;
  profile.first = stride_;
  profile.width = padded(static_cast<int>(patterns.size()));
  profile.positions = (std::max(length, 1) - 1) * per_px_ + 1;
  profile.levels.assign(blur_variances_.size(),
                        std::vector<float>(static_cast<size_t>(profile.positions * profile.width)));
  for (size_t i = 0; i < patterns.size(); ++i) {
    cv::Mat1f light = light_of(sequence.patterns[static_cast<size_t>(patterns[i])], sequence, rig);
    if (light.total() == 1) light = cv::Mat1f(1, std::max(length, 1), light(0, 0));
    for (size_t level = 0; level < profile.levels.size(); ++level) {
      const std::vector<float> line =
          per_px_ == 1 ? std::vector<float>(light.begin(), light.end())
                       : blurred(light, std::sqrt(static_cast<double>(blur_variances_[level])), per_px_);
      for (size_t x = 0; x < line.size(); ++x)
        profile.levels[level][x * static_cast<size_t>(profile.width) + i] = line[x];
    }
    slots_[static_cast<size_t>(patterns[i])] = stride_ + static_cast<int>(i);
  }
  stride_ += profile.width;
  profiles_.push_back(std::move(profile));
}

void ShownPatterns::add(float column, float row, float blur_px, float weight, float* sums) const {
  // The two levels of blur between which the point lies, and the weight of the upper.
  const float variance = blur_px * blur_px;
  int level = 0;
  float upper = 0;
  if (blur_variances_.size() > 1) {
    const float last = blur_variances_.back();
    const auto n = static_cast<float>(blur_variances_.size() - 1);
    level = std::min(static_cast<int>(std::sqrt(std::min(variance / last, 1.0f)) * n),
                     static_cast<int>(blur_variances_.size()) - 2);
    const float low = blur_variances_[static_cast<size_t>(level)],
                high = blur_variances_[static_cast<size_t>(level) + 1];
    upper = std::clamp((variance - low) / (high - low), 0.0f, 1.0f);
  }
  for (const Profile& profile : profiles_) {
    const Place at = place((profile.along_columns ? column : row) * static_cast<float>(per_px_), profile.positions);
    const auto width = static_cast<size_t>(profile.width);
    const float b = weight * at.part, a = weight - b;
    float* out = sums + profile.first;
    const std::vector<float>& table = profile.levels[static_cast<size_t>(level)];
    const float* low = table.data() + static_cast<size_t>(at.low) * width;
    const float* high = table.data() + static_cast<size_t>(at.high) * width;
    if (upper == 0) {
      for (size_t i = 0; i < width; i += kVector) {
        for (size_t k = i; k < i + kVector; ++k) out[k] += a * low[k] + b * high[k];
      }
      continue;
    }
    const std::vector<float>& soft_table = profile.levels[static_cast<size_t>(level) + 1];
    const float* soft_low = soft_table.data() + static_cast<size_t>(at.low) * width;
    const float* soft_high = soft_table.data() + static_cast<size_t>(at.high) * width;
    const float a1 = a * upper, b1 = b * upper, a0 = a - a1, b0 = b - b1;
    for (size_t i = 0; i < width; i += kVector) {
      for (size_t k = i; k < i + kVector; ++k)
        out[k] += (a0 * low[k] + b0 * high[k]) + (a1 * soft_low[k] + b1 * soft_high[k]);
    }
  }
  for (const Image& image : images_) {
    const Place x = place(column, image.levels[0].cols), y = place(row, image.levels[0].rows);
    float light = 0;
    if (image.levels.size() == 1) {
      light = bilinear(image.levels[0], x, y);
    } else {
      const auto n = static_cast<float>(image.levels.size() - 1);
      const float position = std::min(std::sqrt(variance / blur_variances_.back()), 1.0f) * n;
      const auto lower = std::min(static_cast<size_t>(position), image.levels.size() - 2);
      const float part = position - static_cast<float>(lower);
      light = (1 - part) * bilinear(image.levels[lower], x, y) + part * bilinear(image.levels[lower + 1], x, y);
    }
    sums[image.slot] += weight * light;
  }
  for (const Wave& wave : waves_) {
    const auto along = static_cast<double>(wave.axis == Axis::columns ? column : row) + 0.5;
    const double turns = along * wave.turns_per_px + wave.shift_turns;
    const double kept =
        variance == 0
            ? 1
            : std::exp(-2 * kPi * kPi * static_cast<double>(variance) * wave.turns_per_px * wave.turns_per_px);
    const double light = 0.5 + 0.5 * kept * std::cos(2 * kPi * (turns - std::floor(turns)));
    sums[wave.slot] += weight * (black_ + (1 - black_) * static_cast<float>(light));
  }
}

}  // namespace fringeslam::sim
