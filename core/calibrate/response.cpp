// SPDX-License-Identifier: Apache-2.0
#include "core/calibrate/response.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/base/constants.h"
#include "core/types/error.h"

namespace fringeslam {

namespace {

// Pool adjacent violators: the non-decreasing sequence nearest to the values, weighted by 1 / sigma^2.
std::vector<double> growing(const std::vector<double>& values, const std::vector<double>& sigma) {
  struct Pool {
    double sum, weight;
    size_t count;
  };
  std::vector<Pool> pools;
  for (size_t i = 0; i < values.size(); ++i) {
    const double weight = 1 / std::max(sigma[i] * sigma[i], 1e-12);
    pools.push_back({values[i] * weight, weight, 1});
    while (pools.size() > 1) {
      const Pool last = pools.back();
      Pool& before = pools[pools.size() - 2];
      if (before.sum / before.weight <= last.sum / last.weight) break;
      before = {before.sum + last.sum, before.weight + last.weight, before.count + last.count};
      pools.pop_back();
    }
  }
  std::vector<double> result;
  for (const Pool& pool : pools) result.insert(result.end(), pool.count, pool.sum / pool.weight);
  return result;
}

// Monotone piecewise cubic (Fritsch and Carlson 1980, slopes by the weighted harmonic mean).
class MonotoneCubic {
 public:
  MonotoneCubic(std::vector<double> x, std::vector<double> y)
      : x_(std::move(x)), y_(std::move(y)), slope_(x_.size(), 0) {
    const size_t n = x_.size();
    const auto secant = [&](size_t i) { return (y_[i + 1] - y_[i]) / (x_[i + 1] - x_[i]); };
    slope_.front() = secant(0);
    slope_.back() = secant(n - 2);
    for (size_t i = 1; i + 1 < n; ++i) {
      const double before = secant(i - 1), after = secant(i);
      if (before * after <= 0) continue;
      const double h0 = x_[i] - x_[i - 1], h1 = x_[i + 1] - x_[i];
      slope_[i] = 3 * (h0 + h1) / ((2 * h1 + h0) / before + (h1 + 2 * h0) / after);
    }
  }

  double operator()(double x) const {
    const auto above = std::upper_bound(x_.begin() + 1, x_.end() - 1, x);
    const auto i = static_cast<size_t>(above - x_.begin()) - 1;
    const double h = x_[i + 1] - x_[i], t = (x - x_[i]) / h;
    const double t2 = t * t, t3 = t2 * t;
    return y_[i] * (2 * t3 - 3 * t2 + 1) + h * slope_[i] * (t3 - 2 * t2 + t) + y_[i + 1] * (3 * t2 - 2 * t3) +
           h * slope_[i + 1] * (t3 - t2);
  }

 private:
  std::vector<double> x_, y_, slope_;
};

// Least-squares fit of light = level^gamma in logarithms, residuals weighted by the light.
double fitted_gamma(const std::vector<double>& level, const std::vector<double>& light) {
  double top = 0, bottom = 0;
  for (size_t i = 0; i < level.size(); ++i) {
    if (level[i] < 0.05 || level[i] > 0.99 || light[i] <= 0) continue;
    const double weight = light[i] * light[i];
    top += weight * std::log(level[i]) * std::log(light[i]);
    bottom += weight * std::log(level[i]) * std::log(level[i]);
  }
  return bottom > 0 ? top / bottom : 0;
}

void finish(Response& response, const ResponseOptions& options) {
  for (size_t i = 1; i < response.light.size(); ++i) {
    const double fall = response.light[i - 1] - response.light[i];
    if (fall > 5 * std::hypot(response.sigma[i], response.sigma[i - 1]) + 0.01)
      throw Error("the light decreases from " + to_text(response.light[i - 1]) + " to " + to_text(response.light[i]) +
                  " between levels " + to_text(response.level[i - 1]) + " and " + to_text(response.level[i]) +
                  "; check the levels of the images and that nothing moved");
  }
  std::vector<double> light = growing(response.light, response.sigma);
  light.front() = 0;
  light.back() = 1;
  const MonotoneCubic curve(response.level, light);
  for (int i = 0; i < options.entries; ++i)
    response.table.push_back(std::clamp(curve(static_cast<double>(i) / (options.entries - 1)), 0.0, 1.0));
  // Makes the table strictly increasing, and thereby invertible.
  for (size_t i = 1; i < response.table.size(); ++i)
    response.table[i] = std::max(response.table[i], response.table[i - 1] + 1e-9);
  for (double& value : response.table) value /= response.table.back();
  response.gamma = fitted_gamma(response.level, light);
}

void check_images(const std::vector<cv::Mat1f>& images, size_t described, size_t least) {
  if (images.size() != described) throw Error("response: the numbers of images and of levels or shifts differ");
  if (images.size() < least)
    throw Error("a response requires at least " + std::to_string(least) + " images, not " +
                std::to_string(images.size()));
}

void require_pixels(int usable, const ResponseOptions& options, int clipped, int dark) {
  if (usable >= options.min_pixels) return;
  throw Error("only " + std::to_string(usable) + " pixels are usable: " + std::to_string(clipped) + " are saturated, " +
              std::to_string(dark) + " too dark; " +
              (clipped > dark ? "reduce the exposure time" : "increase the exposure time or use a bright near board"));
}

// Phase, mean and modulation of equally spaced phase steps.
struct Harmonic {
  double phase = 0, mean = 0, modulation = 0;
};
Harmonic first_harmonic(const std::vector<cv::Mat1f>& images, const std::vector<double>& shifts_rad,
                        const std::vector<size_t>& which, int row, int col) {
  Harmonic h;
  double c = 0, s = 0;
  for (const size_t k : which) {
    const double grey = images[k](row, col);
    h.mean += grey / static_cast<double>(which.size());
    c += grey * std::cos(shifts_rad[k]);
    s -= grey * std::sin(shifts_rad[k]);
  }
  h.phase = std::atan2(s, c);
  h.modulation = 2 * std::hypot(s, c) / static_cast<double>(which.size());
  return h;
}

std::vector<size_t> all_of(size_t count) {
  std::vector<size_t> indices(count);
  for (size_t i = 0; i < count; ++i) indices[i] = i;
  return indices;
}

// Calls visit(row, col, harmonic) for every pixel with sufficient modulation and no saturation.
template <class Visit>
void for_fringe_pixels(const std::vector<cv::Mat1f>& images, const std::vector<double>& shifts_rad,
                       const SensorModel& sensor, const ResponseOptions& options, Visit&& visit) {
  const std::vector<size_t> all = all_of(images.size());
  int usable = 0, clipped = 0, dark = 0;
  for (int row = 0; row < images[0].rows; ++row) {
    for (int col = 0; col < images[0].cols; ++col) {
      double largest = 0;
      for (const cv::Mat1f& image : images) largest = std::max(largest, static_cast<double>(image(row, col)));
      const Harmonic h = first_harmonic(images, shifts_rad, all, row, col);
      if (largest > options.saturation * sensor.max_dn()) {
        ++clipped;
      } else if (2 * h.modulation < options.min_contrast_dn) {
        ++dark;
      } else {
        ++usable;
        visit(row, col, h);
      }
    }
  }
  require_pixels(usable, options, clipped, dark);
}

}  // namespace

Response response_from_ramp(const std::vector<cv::Mat1f>& images, const std::vector<double>& levels,
                            const SensorModel& sensor, const ResponseOptions& options) {
  check_options(options, "response");
  check_images(images, levels.size(), 5);
  std::vector<size_t> order = all_of(levels.size());
  std::sort(order.begin(), order.end(), [&](size_t a, size_t b) { return levels[a] < levels[b]; });
  const size_t black = order.front(), white = order.back();
  if (levels[black] > 1e-9 || levels[white] < 1 - 1e-9)
    throw Error("a grey ramp must begin with black (level 0) and end with white (level 1)");
  // light_k minimises sum (I_k - I_black - light_k (I_white - I_black))^2 over the pixels.
  std::vector<double> products(levels.size(), 0), squares(levels.size(), 0);
  double contrast_squares = 0;
  int usable = 0, clipped = 0, dark = 0;
  for (int row = 0; row < images[0].rows; ++row) {
    for (int col = 0; col < images[0].cols; ++col) {
      const double low = images[black](row, col), contrast = images[white](row, col) - low;
      if (images[white](row, col) > options.saturation * sensor.max_dn()) {
        ++clipped;
        continue;
      }
      if (contrast < options.min_contrast_dn) {
        ++dark;
        continue;
      }
      ++usable;
      contrast_squares += contrast * contrast;
      for (size_t k = 0; k < images.size(); ++k) {
        const double rise = images[k](row, col) - low;
        products[k] += rise * contrast;
        squares[k] += rise * rise;
      }
    }
  }
  require_pixels(usable, options, clipped, dark);
  Response response;
  response.pixels = usable;
  for (const size_t k : order) {
    if (!response.level.empty() && levels[k] - response.level.back() < 1e-9) continue;  // the same level again
    const double light = products[k] / contrast_squares;
    const double residual = std::max(0.0, squares[k] - light * products[k]) / usable;
    response.level.push_back(levels[k]);
    response.light.push_back(light);
    response.sigma.push_back(std::sqrt(residual / contrast_squares));
  }
  finish(response, options);
  return response;
}

Response response_from_fringes(const std::vector<cv::Mat1f>& images, const std::vector<double>& shifts_rad,
                               const SensorModel& sensor, const ResponseOptions& options) {
  check_options(options, "response");
  check_images(images, shifts_rad.size(), 8);
  // Histogram over the ideal level of the grey values minus the pixel's mean, divided by its modulation.
  constexpr int kBins = 64;
  std::vector<double> sum(kBins, 0), squares(kBins, 0), levels(kBins, 0), counts(kBins, 0);
  Response response;
  for_fringe_pixels(images, shifts_rad, sensor, options, [&](int row, int col, const Harmonic& h) {
    ++response.pixels;
    for (size_t k = 0; k < images.size(); ++k) {
      // Bins of equal width in angle, which contain equal numbers of samples.
      const double angle = std::abs(std::remainder(h.phase + shifts_rad[k], kTwoPi));
      const int bin = std::min(kBins - 1, static_cast<int>(angle / std::numbers::pi * kBins));
      const double value = (images[k](row, col) - h.mean) / h.modulation;
      const auto b = static_cast<size_t>(bin);
      sum[b] += value;
      squares[b] += value * value;
      levels[b] += 0.5 + 0.5 * std::cos(angle);
      ++counts[b];
    }
  });
  for (size_t b = kBins; b-- > 0;) {  // from dark to bright
    if (counts[b] < 10) continue;
    const double mean = sum[b] / counts[b];
    response.level.push_back(levels[b] / counts[b]);
    response.light.push_back(mean);
    response.sigma.push_back(std::sqrt(std::max(0.0, squares[b] / counts[b] - mean * mean) / counts[b]));
  }
  if (response.level.size() < 8) throw Error("the fringes cover too few phases; use a board at least one period wide");
  // Normalises to black and white at the ends; the centres of the outermost bins lie 0.02 % of the range inside.
  const double low = response.light.front(), high = response.light.back();
  for (size_t i = 0; i < response.light.size(); ++i) {
    response.light[i] = (response.light[i] - low) / (high - low);
    response.sigma[i] /= high - low;
  }
  response.level.front() = 0;
  response.level.back() = 1;
  finish(response, options);
  return response;
}

PhaseCorrection phase_correction_from_fringes(const std::vector<cv::Mat1f>& images,
                                              const std::vector<double>& shifts_rad, int steps,
                                              const SensorModel& sensor, const ResponseOptions& options) {
  check_options(options, "response");
  check_images(images, shifts_rad.size(), 8);
  const size_t all = images.size(), few = static_cast<size_t>(steps);
  if (few < 3 || all % few != 0 || all == few)
    throw Error("a phase correction for " + std::to_string(steps) +
                " steps requires a larger multiple of that number of images, not " + std::to_string(all));
  // Sorts by shift, so that every (N / steps)-th image is equally spaced.
  std::vector<size_t> order = all_of(all);
  const auto turns = [&](size_t k) { return shifts_rad[k] / kTwoPi - std::floor(shifts_rad[k] / kTwoPi + 1e-9); };
  std::sort(order.begin(), order.end(), [&](size_t a, size_t b) { return turns(a) < turns(b); });
  std::vector<std::vector<size_t>> subsets(all / few);
  for (size_t i = 0; i < all; ++i) subsets[i % subsets.size()].push_back(order[i]);

  constexpr int kBins = 360;
  std::vector<double> sum(kBins, 0), counts(kBins, 0);
  for_fringe_pixels(images, shifts_rad, sensor, options, [&](int row, int col, const Harmonic& h) {
    for (const std::vector<size_t>& subset : subsets) {
      const double offset =
          std::remainder(first_harmonic(images, shifts_rad, subset, row, col).phase - h.phase, kTwoPi);
      // The table's phase is that of steps centred on zero.
      const double first = turns(subset.front()) * kTwoPi, centred = -std::numbers::pi * (steps - 1) / steps;
      const double place = (h.phase + first - centred) / kTwoPi;
      const auto bin = static_cast<size_t>(std::floor((place - std::floor(place)) * kBins + 0.5)) % kBins;
      sum[bin] += offset;
      ++counts[bin];
    }
  });
  PhaseCorrection correction{steps, {}};
  for (size_t b = 0; b < kBins; ++b) {
    if (counts[b] == 0) throw Error("the fringes cover too few phases; use a board at least one period wide");
    correction.offset_rad.push_back(sum[b] / counts[b]);
  }
  return correction;
}

}  // namespace fringeslam
