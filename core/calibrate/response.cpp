// SPDX-License-Identifier: Apache-2.0
#include "core/calibrate/response.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <numbers>
#include <optional>

#include "core/base/constants.h"
#include "core/base/parallel.h"
#include "core/patterns/waveform.h"
#include "core/types/error.h"
#include "core/types/linear_algebra.h"

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

// The sums over phase steps are those of a harmonic only if the steps are equally spaced.
void check_many_steps(const std::vector<cv::Mat1f>& images, const std::vector<double>& shifts_rad) {
  check_images(images, shifts_rad.size(), 8);
  if (!equally_spaced(shifts_rad))
    throw Error(
        "the " + std::to_string(shifts_rad.size()) +
        " phase shifts are not equally spaced over one turn; use patterns with `steps: 12` or more, each shown once");
}

void require_pixels(int usable, const ResponseOptions& options, int clipped, int dark) {
  if (usable >= options.min_pixels) return;
  throw Error("only " + std::to_string(usable) + " pixels are usable: " + std::to_string(clipped) + " are saturated, " +
              std::to_string(dark) + " too dark; " +
              (clipped > dark ? "reduce the exposure time" : "increase the exposure time or use a bright near board"));
}

std::vector<size_t> all_of(size_t count) {
  std::vector<size_t> indices(count);
  for (size_t i = 0; i < count; ++i) indices[i] = i;
  return indices;
}

// Phase, mean and modulation of equally spaced phase steps.
struct Harmonic {
  double phase = 0, mean = 0, modulation = 0;
};

// Some of the images of a period, equally spaced.
class PhaseSteps {
 public:
  PhaseSteps(const std::vector<cv::Mat1f>& images, const std::vector<double>& shifts_rad,
             const std::vector<size_t>& which) {
    for (const size_t k : which) steps_.push_back({images[k], std::cos(shifts_rad[k]), std::sin(shifts_rad[k])});
  }

  Harmonic harmonic(int row, int col) const {
    Harmonic h;
    double c = 0, s = 0;
    for (const Step& step : steps_) {
      const double grey = step.image(row, col);
      h.mean += grey / static_cast<double>(steps_.size());
      c += grey * step.cosine;
      s -= grey * step.sine;
    }
    h.phase = std::atan2(s, c);
    h.modulation = 2 * std::hypot(s, c) / static_cast<double>(steps_.size());
    return h;
  }
  double largest(int row, int col) const {
    double grey = 0;
    for (const Step& step : steps_) grey = std::max(grey, static_cast<double>(step.image(row, col)));
    return grey;
  }

 private:
  struct Step {
    cv::Mat1f image;
    double cosine = 1, sine = 0;
  };
  std::vector<Step> steps_;
};

// Calls visit(row, col, harmonic) for every pixel with sufficient modulation and no saturation.
template <class Visit>
void for_fringe_pixels(const std::vector<cv::Mat1f>& images, const std::vector<double>& shifts_rad,
                       const SensorModel& sensor, const ResponseOptions& options, Visit&& visit) {
  const PhaseSteps steps(images, shifts_rad, all_of(images.size()));
  int usable = 0, clipped = 0, dark = 0;
  for (int row = 0; row < images[0].rows; ++row) {
    for (int col = 0; col < images[0].cols; ++col) {
      const Harmonic h = steps.harmonic(row, col);
      if (steps.largest(row, col) > options.saturation * sensor.saturation_dn()) {
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
      if (images[white](row, col) > options.saturation * sensor.saturation_dn()) {
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
  check_many_steps(images, shifts_rad);
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
  check_many_steps(images, shifts_rad);
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
  std::vector<PhaseSteps> steps_of;
  for (const std::vector<size_t>& subset : subsets) steps_of.emplace_back(images, shifts_rad, subset);

  constexpr int kBins = 360;
  std::vector<double> sum(kBins, 0), counts(kBins, 0);
  for_fringe_pixels(images, shifts_rad, sensor, options, [&](int row, int col, const Harmonic& h) {
    for (size_t i = 0; i < subsets.size(); ++i) {
      const double offset = std::remainder(steps_of[i].harmonic(row, col).phase - h.phase, kTwoPi);
      // The table's phase is that of steps centred on zero.
      const double first = turns(subsets[i].front()) * kTwoPi, centred = -std::numbers::pi * (steps - 1) / steps;
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

double PeriodDeviation::rms_px() const { return rms_rad * period_px / kTwoPi; }

namespace {

// Fourier coefficient of a table at `harmonic` turns per turn.
std::complex<double> coefficient_of(const std::vector<double>& table, int harmonic) {
  std::complex<double> sum = 0;
  for (size_t i = 0; i < table.size(); ++i) {
    const double angle = kTwoPi * harmonic * static_cast<double>(i) / static_cast<double>(table.size());
    sum += table[i] * std::polar(2.0 / static_cast<double>(table.size()), -angle);
  }
  return sum;
}

constexpr double kLeastGamma = 0.2, kMostGamma = 5;

// The amplitude of sin(N phi) in the phase error of N steps behind a power law.
double error_amplitude(double gamma, int steps) {
  return -coefficient_of(phase_correction_of(gamma_table(gamma), steps).offset_rad, steps).imag();
}

// Inverts error_amplitude() for three steps, which falls with gamma.
double gamma_of_amplitude(double amplitude) {
  double low = kLeastGamma, high = kMostGamma;
  for (int iteration = 0; iteration < 50; ++iteration) {
    const double middle = 0.5 * (low + high);
    (error_amplitude(middle, 3) > amplitude ? low : high) = middle;
  }
  return 0.5 * (low + high);
}

// The second harmonic of the waveform, relative to the first, in the residuals of more than three steps: least squares
// over the pixels of I_k = A + B cos(theta_k + e) + r B cos(2 theta_k).
class SecondHarmonic {
 public:
  explicit SecondHarmonic(const std::vector<double>& shifts_rad)
      : shifts_rad_(shifts_rad), values_(shifts_rad.size()) {}

  void add(const std::vector<cv::Mat1f>& images, int row, int col, double phase, double modulation) {
    for (size_t k = 0; k < images.size(); ++k) values_[k] = images[k](row, col);
    remove_first_harmonic();
    std::vector<double> grey = values_;
    for (size_t k = 0; k < images.size(); ++k) values_[k] = modulation * std::cos(2 * (phase + shifts_rad_[k]));
    remove_first_harmonic();
    for (size_t k = 0; k < images.size(); ++k) product_ += grey[k] * values_[k], square_ += values_[k] * values_[k];
  }
  double value() const { return square_ > 0 ? product_ / square_ : 0; }

 private:
  // Mean, sine and cosine of equally spaced steps are orthogonal.
  void remove_first_harmonic() {
    double mean = 0, c = 0, s = 0;
    for (size_t k = 0; k < values_.size(); ++k) {
      mean += values_[k];
      c += values_[k] * std::cos(shifts_rad_[k]);
      s += values_[k] * std::sin(shifts_rad_[k]);
    }
    const auto count = static_cast<double>(values_.size());
    for (size_t k = 0; k < values_.size(); ++k)
      values_[k] -= (mean + 2 * c * std::cos(shifts_rad_[k]) + 2 * s * std::sin(shifts_rad_[k])) / count;
  }

  const std::vector<double>& shifts_rad_;
  std::vector<double> values_;
  double product_ = 0, square_ = 0;
};

// A power law has r = (gamma - 1) / (gamma + 2).
double gamma_of_second_harmonic(double r) { return std::clamp((1 + 2 * r) / (1 - r), kLeastGamma, kMostGamma); }

// Phases of one period. The table's phase is that of steps centred on zero; it exceeds the phase by `to_table_rad`.
struct PeriodPhases {
  std::vector<cv::Mat1f> images;
  cv::Mat1d phase_rad, modulation_dn;  // NaN, 0: saturated or dark
  double to_table_rad = 0;
};

PeriodPhases phases_of(const std::vector<cv::Mat>& images, const FringeGroup& group, const SensorModel& sensor,
                       const ResponseOptions& options) {
  PeriodPhases result;
  for (const int i : group.images) {
    cv::Mat1f image;
    images[static_cast<size_t>(i)].convertTo(image, CV_32F);
    result.images.push_back(image);
  }
  result.to_table_rad = kTwoPi * turns_from_centred(group.shifts_rad);
  const cv::Size size = result.images.front().size();
  result.phase_rad = cv::Mat1d(size, std::numeric_limits<double>::quiet_NaN());
  result.modulation_dn = cv::Mat1d(size, 0.0);
  const PhaseSteps steps(result.images, group.shifts_rad, all_of(result.images.size()));
  for_each_row(size.height, [&](int row) {
    for (int col = 0; col < size.width; ++col) {
      const Harmonic h = steps.harmonic(row, col);
      if (steps.largest(row, col) > options.saturation * sensor.saturation_dn() ||
          2 * h.modulation < options.min_contrast_dn)
        continue;
      result.phase_rad(row, col) = h.phase;
      result.modulation_dn(row, col) = h.modulation;
    }
  });
  return result;
}

// Mean difference of two phases in bins of the coarser one.
class BinnedDifference {
 public:
  void add(double table_phase_rad, double difference_rad) {
    const double turns = table_phase_rad / kTwoPi;
    const auto bin = static_cast<size_t>((turns - std::floor(turns)) * kBins) % kBins;
    sums_[bin] += std::polar(1.0, difference_rad);
    ++counts_[bin];
  }

  struct Bin {
    double phase_rad = 0, difference_rad = 0, weight = 0;
  };
  // The differences are continuous over the phase, so they may exceed half a turn; their mean does not.
  std::vector<Bin> unwrapped() const {
    std::vector<Bin> bins;
    double last = 0, sum = 0, weights = 0;
    for (size_t b = 0; b < kBins; ++b) {
      if (counts_[b] == 0) continue;
      last += std::remainder(std::arg(sums_[b]) - last, kTwoPi);
      bins.push_back({kTwoPi * (static_cast<double>(b) + 0.5) / kBins, last, static_cast<double>(counts_[b])});
      sum += last * bins.back().weight;
      weights += bins.back().weight;
    }
    const double turns = weights > 0 ? std::round(sum / weights / kTwoPi) : 0;
    for (Bin& bin : bins) bin.difference_rad -= kTwoPi * turns;
    return bins;
  }

 private:
  static constexpr size_t kBins = 720;
  std::array<std::complex<double>, kBins> sums_{};
  std::array<int64_t, kBins> counts_{};
};

// Fits the deviation by its harmonics N phi, 2 N phi over the true phase. The table is that of the fit, because a narrow
// view need not show all phases.
std::optional<PeriodDeviation> fitted(const std::vector<BinnedDifference::Bin>& bins, double ratio, int steps) {
  constexpr int kMultiples = 2, kEntries = 360, kUnknowns = 1 + 2 * kMultiples;
  Eigen::MatrixXd normal = Eigen::MatrixXd::Zero(kUnknowns, kUnknowns);
  Eigen::VectorXd right = Eigen::VectorXd::Zero(kUnknowns);
  double squares = 0, pixels = 0;
  for (const auto& bin : bins) {
    const double deviation = -bin.difference_rad / ratio, phase = bin.phase_rad - deviation;
    Eigen::VectorXd terms(kUnknowns);
    terms[0] = 1;
    for (int m = 1; m <= kMultiples; ++m) {
      terms[2 * m - 1] = std::cos(m * steps * phase);
      terms[2 * m] = std::sin(m * steps * phase);
    }
    normal += bin.weight * terms * terms.transpose();
    right += bin.weight * deviation * terms;
    squares += bin.weight * deviation * deviation;
    pixels += bin.weight;
  }
  // A view of less than a period of the error does not determine it: this keeps it small.
  normal.diagonal().array() += 1e-6 * pixels;
  const Eigen::VectorXd fit = solve_positive_definite(normal, right);
  PeriodDeviation deviation;
  deviation.pixels = static_cast<int64_t>(pixels);
  deviation.correction.steps = steps;
  for (int i = 0; i < kEntries; ++i) {
    const double phase = kTwoPi * i / kEntries;
    double offset = 0;
    for (int m = 1; m <= kMultiples; ++m)
      offset += fit[2 * m - 1] * std::cos(m * steps * phase) + fit[2 * m] * std::sin(m * steps * phase);
    deviation.correction.offset_rad.push_back(offset);
  }
  deviation.rms_rad = fit.tail(2 * kMultiples).norm() / std::numbers::sqrt2;
  deviation.sigma_rad =
      std::sqrt(2 * std::max(0.0, squares - right.dot(fit)) / pixels / static_cast<double>(bins.size()));
  deviation.gamma = gamma_of_amplitude(fit[2]);
  return deviation;
}

}  // namespace

std::vector<PeriodDeviation> period_deviations(const std::vector<cv::Mat>& images, const PatternSequence& sequence,
                                               Axis axis, const SensorModel& sensor, const ResponseOptions& options) {
  constexpr double kWhole = 0.97;  // of the projector's image: the coarsest period has no fringe orders
  check_options(options, "response");
  std::vector<PeriodDeviation> deviations;
  const std::vector<FringeGroup> groups = fringe_groups(sequence, axis);
  const int length_px = axis == Axis::columns ? sequence.width : sequence.height;
  if (groups.size() < 2 || groups.front().period_px < kWhole * length_px) return deviations;
  for (const FringeGroup& group : groups) {
    if (!equally_spaced(group.shifts_rad)) return deviations;
  }
  PeriodPhases coarse = phases_of(images, groups.front(), sensor, options);
  cv::Mat1d order(coarse.phase_rad.size(), 0.0);  // of the coarser period
  for (double& phase : coarse.phase_rad) phase -= kTwoPi * std::floor(phase / kTwoPi);
  for (size_t g = 1; g < groups.size(); ++g) {
    const FringeGroup &group = groups[g - 1], &finer = groups[g];
    PeriodPhases fine = phases_of(images, finer, sensor, options);
    const double ratio = group.period_px / finer.period_px;
    const auto steps = static_cast<int>(group.images.size());
    BinnedDifference differences;
    SecondHarmonic second(group.shifts_rad);
    int64_t pixels = 0;
    const auto usable = [&](int row, int col) {
      return !std::isnan(coarse.phase_rad(row, col) + fine.phase_rad(row, col) + order(row, col));
    };
    const auto absolute = [&](int row, int col) { return coarse.phase_rad(row, col) + kTwoPi * order(row, col); };
    for (int row = 0; row < order.rows; ++row) {
      for (int col = 0; col < order.cols; ++col) {
        if (!usable(row, col)) continue;
        ++pixels;
        const double phase = coarse.phase_rad(row, col);
        differences.add(phase + coarse.to_table_rad, fine.phase_rad(row, col) - ratio * absolute(row, col));
        if (steps > 3) second.add(coarse.images, row, col, phase, coarse.modulation_dn(row, col));
      }
    }
    if (pixels < options.min_pixels) return deviations;
    std::optional<PeriodDeviation> deviation = fitted(differences.unwrapped(), ratio, steps);
    if (steps > 3) deviation->gamma = gamma_of_second_harmonic(second.value());
    deviation->period_px = group.period_px;
    // Fringe orders of the finer period, from the corrected coarser one.
    std::vector<double> table = deviation->correction.offset_rad;
    table.push_back(table.front());
    for (int row = 0; row < order.rows; ++row) {
      for (int col = 0; col < order.cols; ++col) {
        const double turns = (coarse.phase_rad(row, col) + coarse.to_table_rad) / kTwoPi;
        const double corrected = absolute(row, col) - interpolate_table(table, turns - std::floor(turns));
        order(row, col) = std::round((ratio * corrected - fine.phase_rad(row, col)) / kTwoPi);
      }
    }
    deviations.push_back(std::move(*deviation));
    coarse = std::move(fine);
  }
  return deviations;
}

Response response_from_deviations(const std::vector<PeriodDeviation>& deviations, const ResponseOptions& options) {
  if (deviations.empty()) throw Error("no period has enough usable pixels to compare its phase with the finest one");
  constexpr int kLevels = 17;
  Response response;
  double sum = 0, weights = 0;
  for (const PeriodDeviation& deviation : deviations) {
    sum += static_cast<double>(deviation.pixels) * std::log(deviation.gamma);
    weights += static_cast<double>(deviation.pixels);
    response.pixels = std::max(response.pixels, static_cast<int>(deviation.pixels));
  }
  response.gamma = std::exp(sum / weights);
  // Blur and the unequal errors of the periods are common to their pixels, so the periods' scatter counts.
  constexpr double kSingle = 0.03;
  double squares = 0;
  for (const PeriodDeviation& deviation : deviations)
    squares += static_cast<double>(deviation.pixels) / weights * std::pow(deviation.gamma - response.gamma, 2);
  const auto count = static_cast<double>(deviations.size());
  const double sigma = count > 1 ? std::sqrt(squares / (count - 1)) : kSingle * response.gamma;
  response.table = gamma_table(response.gamma, options.entries);
  for (int i = 0; i < kLevels; ++i) {
    const double level = static_cast<double>(i) / (kLevels - 1);
    response.level.push_back(level);
    response.light.push_back(std::pow(level, response.gamma));
    response.sigma.push_back(level > 0 ? std::abs(response.light.back() * std::log(level)) * sigma : 0);
  }
  return response;
}

}  // namespace fringeslam
