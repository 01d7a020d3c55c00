// SPDX-License-Identifier: Apache-2.0
#include "core/decode/light_survey.h"

#include <Eigen/Core>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <opencv2/imgproc.hpp>
#include <optional>

#include "core/base/constants.h"
#include "core/base/parallel.h"
#include "core/decode/exposures.h"
#include "core/decode/steps.h"
#include "core/types/error.h"
#include "core/types/grey_value.h"

namespace fringeslam {

namespace {

constexpr int kBlock_px = 8;         // faint pixels are judged together
constexpr int kFewestInBlock = 16;   // of them
constexpr double kBlockSigmas = 4;   // a block counts as lit above
constexpr double kClearSignal = 25;  // I''^2 over its variance, above which a pixel is judged by itself

// The images of a stack, one per pattern, at the rig's exposure.
struct Samples {
  const std::vector<cv::Mat>* images;
  const std::vector<cv::Mat1f>* variances;  // null: by the noise model
  float clip_dn;

  float grey(int image, int row, int col) const { return grey_value((*images)[static_cast<size_t>(image)], row, col); }
};

struct Fringes {
  std::vector<FringeGroup> groups;  // the finest last
  std::vector<StepEstimator> estimators;
  std::vector<int> coded;      // images that must not be saturated
  int white = -1, black = -1;  // used without fringes
};

Fringes fringes_of(const PatternSequence& sequence, Axis axis, const DecodeOptions& options) {
  Fringes fringes;
  fringes.groups = select_groups(sequence, axis, options);
  for (const FringeGroup& group : fringes.groups) fringes.estimators.push_back(least_squares(group));
  for (size_t i = 0; i < sequence.patterns.size(); ++i) {
    const Pattern& pattern = sequence.patterns[i];
    if (pattern.coding == Coding::flat) {
      if (pattern.level == 1) fringes.white = static_cast<int>(i);
      if (pattern.level == 0) fringes.black = static_cast<int>(i);
    } else if (pattern.axis == axis && pattern.coding != Coding::product) {
      fringes.coded.push_back(static_cast<int>(i));
    }
  }
  if (fringes.groups.empty() && (fringes.white < 0 || fringes.black < 0))
    throw Error("its patterns have neither fringes nor a white and a black image, so the brightness is unknown");
  if (fringes.groups.empty()) fringes.coded = {fringes.white};
  return fringes;
}

// I' above the black level, I'' cos phi, I'' sin phi and their variances.
struct Estimate {
  double mean = 0, cosine = 0, sine = 0, mean_variance = 0, cosine_variance = 0, sine_variance = 0;
  double squared() const { return cosine * cosine + sine * sine; }
  double noise() const { return cosine_variance + sine_variance; }
};

class Pixel {
 public:
  Pixel(const Samples& samples, const SensorModel& sensor, int row, int col)
      : samples_(samples), sensor_(sensor), row_(row), col_(col) {}

  double grey(int image) const { return static_cast<double>(samples_.grey(image, row_, col_)); }
  bool saturated(int image) const { return samples_.grey(image, row_, col_) >= samples_.clip_dn; }
  double variance(int image) const {
    return samples_.variances ? static_cast<double>((*samples_.variances)[static_cast<size_t>(image)](row_, col_))
                              : sensor_.variance_dn2(grey(image));
  }

  Estimate estimate(const StepEstimator& e) const {
    Estimate result;
    for (size_t k = 0; k < e.images.size(); ++k) {
      const double y = grey(e.images[k]) - sensor_.offset_dn, v = variance(e.images[k]);
      const auto wm = static_cast<double>(e.mean[k]), wc = static_cast<double>(e.cosine[k]),
                 ws = static_cast<double>(e.sine[k]);
      result.mean += wm * y, result.cosine += wc * y, result.sine += ws * y;
      result.mean_variance += wm * wm * v, result.cosine_variance += wc * wc * v, result.sine_variance += ws * ws * v;
    }
    return result;
  }

 private:
  const Samples& samples_;
  const SensorModel& sensor_;
  int row_, col_;
};

double median_in_place(std::vector<double>& values) {
  if (values.empty()) return std::numeric_limits<double>::quiet_NaN();
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

// The square of a unit normal variable, if the noise model is right: the residual of the first step of a period with more
// than three steps, or else the difference of the means of two periods.
std::optional<double> squared_residual(const Pixel& pixel, const Fringes& fringes) {
  for (size_t g = 0; g < fringes.groups.size(); ++g) {
    const FringeGroup& group = fringes.groups[g];
    const StepEstimator& e = fringes.estimators[g];
    if (group.images.size() < 4) continue;
    const double cosine = std::cos(group.shifts_rad[0]), sine = std::sin(group.shifts_rad[0]);
    double residual = 0, variance = 0;
    for (size_t k = 0; k < group.images.size(); ++k) {
      const double weight = (k == 0 ? 1.0 : 0.0) - static_cast<double>(e.mean[k]) -
                            static_cast<double>(e.cosine[k]) * cosine + static_cast<double>(e.sine[k]) * sine;
      residual += weight * pixel.grey(group.images[k]);
      variance += weight * weight * pixel.variance(group.images[k]);
    }
    return residual * residual / variance;
  }
  if (fringes.groups.size() < 2) return std::nullopt;
  const Estimate a = pixel.estimate(fringes.estimators[fringes.groups.size() - 2]),
                 b = pixel.estimate(fringes.estimators.back());
  const double difference = a.mean - b.mean;
  return difference * difference / (a.mean_variance + b.mean_variance);
}

// The tenth with the largest residuals, which edges may cause, is left out. Medians would suffer from rounding.
double measured_noise_ratio(const cv::Mat1b& state, const Samples& samples, const SensorModel& sensor,
                            const Fringes& fringes) {
  constexpr size_t kFewest = 200;
  constexpr double kUsed = 0.9, kMeanOfUsed = 0.623;  // of chi-square of one degree of freedom below its quantile
  std::vector<double> squares;
  for (int row = 0; row < state.rows; row += 2) {
    for (int col = 0; col < state.cols; col += 2) {
      if (state(row, col) != static_cast<uchar>(LightState::lit)) continue;
      if (const auto square = squared_residual(Pixel(samples, sensor, row, col), fringes)) squares.push_back(*square);
    }
  }
  if (squares.size() < kFewest) return std::numeric_limits<double>::quiet_NaN();
  const auto used = static_cast<std::ptrdiff_t>(kUsed * static_cast<double>(squares.size()));
  std::nth_element(squares.begin(), squares.begin() + used, squares.end());
  return std::sqrt(std::accumulate(squares.begin(), squares.begin() + used, 0.0) / static_cast<double>(used) /
                   kMeanOfUsed);
}

// I' of a group from its two unsaturated samples, with I'' = ratio I'; NaN: none.
double mean_from_two(const double y[2], const double shift[2], double ratio) {
  // y_i = x + a cos d_i - b sin d_i is linear in (a, b) for each x: a = a0 + a1 x, b = b0 + b1 x, a^2 + b^2 = (ratio x)^2.
  const double determinant = -std::cos(shift[0]) * std::sin(shift[1]) + std::sin(shift[0]) * std::cos(shift[1]);
  if (std::abs(determinant) < 0.1) return std::numeric_limits<double>::quiet_NaN();
  const auto solved = [&](double r0, double r1, double& a, double& b) {
    a = (-r0 * std::sin(shift[1]) + r1 * std::sin(shift[0])) / determinant;
    b = (std::cos(shift[0]) * r1 - std::cos(shift[1]) * r0) / determinant;
  };
  double a0 = 0, b0 = 0, a1 = 0, b1 = 0;
  solved(y[0], y[1], a0, b0);
  solved(-1, -1, a1, b1);
  const double p = a1 * a1 + b1 * b1 - ratio * ratio, q = a0 * a1 + b0 * b1, r = a0 * a0 + b0 * b0;
  const double root = q * q - p * r;
  if (root < 0 || std::abs(p) < 1e-9) return std::numeric_limits<double>::quiet_NaN();
  const double larger = std::max((-q + std::sqrt(root)) / p, (-q - std::sqrt(root)) / p);
  return larger > 0 ? larger : std::numeric_limits<double>::quiet_NaN();
}

// I' and I'' of a group with saturated samples; NaN where the others do not determine them.
struct Brightness {
  double mean = std::numeric_limits<double>::quiet_NaN(), modulation = std::numeric_limits<double>::quiet_NaN();
};

Brightness partly_saturated(const Pixel& pixel, const FringeGroup& group, const SensorModel& sensor, double ratio) {
  constexpr double kMostRelativeSigma = 0.1;
  std::vector<double> y, shift, variance;
  for (size_t k = 0; k < group.images.size(); ++k) {
    if (pixel.saturated(group.images[k])) continue;
    y.push_back(pixel.grey(group.images[k]) - sensor.offset_dn);
    shift.push_back(group.shifts_rad[k]);
    variance.push_back(pixel.variance(group.images[k]));
  }
  if (y.size() < 2) return {};
  if (y.size() == 2) {
    const double mean = mean_from_two(y.data(), shift.data(), ratio);
    return {mean, ratio * mean};
  }
  Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
  Eigen::Vector3d right = Eigen::Vector3d::Zero();
  for (size_t k = 0; k < y.size(); ++k) {
    const Eigen::Vector3d row(1, std::cos(shift[k]), -std::sin(shift[k]));
    normal += row * row.transpose() / variance[k];
    right += row * y[k] / variance[k];
  }
  const Eigen::Matrix3d covariance = normal.inverse();
  const Eigen::Vector3d solution = covariance * right;
  if (!solution.allFinite() || !(std::sqrt(covariance(0, 0)) < kMostRelativeSigma * solution[0])) return {};
  return {solution[0], solution.tail<2>().norm()};
}

// Writes the modulation of faint pixels: the root mean square over their block, if it is significant.
void judge_blocks(PixelLight& light, const cv::Mat1f& squared, const cv::Mat1f& noise, double dark_variance_dn2) {
  // Where the camera's noise is less than a digital number, a grey value near the middle between two has the variance 1/4,
  // and the fringes of a dark pixel cannot make it vary.
  constexpr double kRounding_dn2 = 0.25;
  constexpr int kEdge_px = 2;
  const double known = std::isnan(light.noise_ratio) ? 1 : light.noise_ratio * light.noise_ratio;
  const double scale = std::max({1.0, known, kRounding_dn2 / dark_variance_dn2});
  const auto unlit = static_cast<uchar>(LightState::unlit), lit = static_cast<uchar>(LightState::lit);
  // A pixel beside a bright one sees a part of that surface. It says nothing about the others of its block.
  cv::Mat1b bright;
  cv::dilate(light.state != unlit, bright, cv::Mat1b(2 * kEdge_px + 1, 2 * kEdge_px + 1, uchar{1}));
  const int block_rows = (light.state.rows + kBlock_px - 1) / kBlock_px;
  for_each_row(block_rows, [&](int block_row) {
    for (int left = 0; left < light.state.cols; left += kBlock_px) {
      const cv::Rect block =
          cv::Rect(left, block_row * kBlock_px, kBlock_px, kBlock_px) & cv::Rect({0, 0}, light.state.size());
      double sum = 0, noise_sum = 0;
      int n = 0;
      for (int row = block.y; row < block.y + block.height; ++row) {
        for (int col = left; col < left + block.width; ++col) {
          if (bright(row, col)) continue;
          sum += static_cast<double>(squared(row, col));
          noise_sum += scale * static_cast<double>(noise(row, col));
          ++n;
        }
      }
      // The squared modulation of noise alone is exponential: its standard deviation is its mean.
      if (n < kFewestInBlock || !(sum - noise_sum > kBlockSigmas * noise_sum / std::sqrt(n))) continue;
      const auto modulation = static_cast<float>(std::sqrt((sum - noise_sum) / n));
      for (int row = block.y; row < block.y + block.height; ++row) {
        for (int col = left; col < left + block.width; ++col) {
          if (bright(row, col)) continue;
          light.state(row, col) = lit;
          light.modulation_dn(row, col) = modulation;
          light.peak_dn(row, col) = std::max(light.mean_dn(row, col), 0.0f) + modulation;
        }
      }
    }
  });
}

PixelLight survey(const Samples& samples, const Fringes& fringes, const SensorModel& sensor) {
  const cv::Size size = samples.images->front().size();
  PixelLight light;
  for (cv::Mat1f* image : {&light.mean_dn, &light.modulation_dn, &light.peak_dn}) *image = cv::Mat1f(size, 0.0f);
  light.state = cv::Mat1b(size, uchar{0});
  cv::Mat1f squared(size, 0.0f), noise(size, 0.0f);
  const auto saturated = [&](const Pixel& pixel) {
    return std::any_of(fringes.coded.begin(), fringes.coded.end(), [&](int image) { return pixel.saturated(image); });
  };
  for_each_row(size.height, [&](int row) {
    for (int col = 0; col < size.width; ++col) {
      const Pixel pixel(samples, sensor, row, col);
      if (saturated(pixel)) {
        light.state(row, col) = static_cast<uchar>(LightState::hidden);
        continue;
      }
      double mean = 0, strongest = 0;
      Estimate finest;
      if (fringes.groups.empty()) {
        finest.cosine = (pixel.grey(fringes.white) - pixel.grey(fringes.black)) / 2;
        finest.cosine_variance = (pixel.variance(fringes.white) + pixel.variance(fringes.black)) / 4;
        mean = (pixel.grey(fringes.white) + pixel.grey(fringes.black)) / 2 - sensor.offset_dn;
      }
      for (const StepEstimator& estimator : fringes.estimators) {
        finest = pixel.estimate(estimator);  // the last is the finest
        mean += finest.mean / static_cast<double>(fringes.estimators.size());
        strongest = std::max(strongest, finest.squared() - finest.noise());
      }
      const double modulation_squared = finest.squared() - finest.noise();
      squared(row, col) = static_cast<float>(finest.squared());
      noise(row, col) = static_cast<float>(finest.noise());
      light.mean_dn(row, col) = static_cast<float>(mean);
      if (!(finest.squared() > kClearSignal * finest.noise())) continue;
      light.state(row, col) = static_cast<uchar>(LightState::lit);
      light.modulation_dn(row, col) = static_cast<float>(std::sqrt(modulation_squared));
      light.peak_dn(row, col) = static_cast<float>(mean + std::sqrt(std::max(strongest, modulation_squared)));
    }
  });
  light.noise_ratio = measured_noise_ratio(light.state, samples, sensor, fringes);
  judge_blocks(light, squared, noise, sensor.variance_dn2(sensor.offset_dn));

  std::vector<double> ratios;
  for (int row = 0; row < size.height; ++row) {
    for (int col = 0; col < size.width; ++col) {
      if (light.at(row, col) == LightState::lit && light.mean_dn(row, col) > 0 &&
          squared(row, col) > static_cast<float>(kClearSignal) * noise(row, col))
        ratios.push_back(static_cast<double>(light.modulation_dn(row, col) / light.mean_dn(row, col)));
    }
  }
  const double ratio = median_in_place(ratios);
  if (std::isnan(ratio)) return light;
  for_each_row(size.height, [&](int row) {
    for (int col = 0; col < size.width; ++col) {
      if (light.at(row, col) != LightState::hidden) continue;
      const Pixel pixel(samples, sensor, row, col);
      std::vector<double> means, modulations;
      for (const FringeGroup& group : fringes.groups) {
        const Brightness found = partly_saturated(pixel, group, sensor, ratio);
        if (std::isnan(found.mean)) continue;
        means.push_back(found.mean);
        modulations.push_back(found.modulation);
      }
      if (means.empty()) continue;
      light.mean_dn(row, col) = static_cast<float>(median_in_place(means));
      light.modulation_dn(row, col) = static_cast<float>(median_in_place(modulations));
      light.peak_dn(row, col) = light.mean_dn(row, col) + light.modulation_dn(row, col);
      light.state(row, col) = static_cast<uchar>(LightState::estimated);
    }
  });
  return light;
}

// Calls use(samples, patterns) with one image per pattern.
template <class Use>
auto with_samples(const FringeStack& stack, const SensorModel& sensor, const DecodeOptions& options, Use&& use) {
  check_stack(stack);
  const double clip_dn = options.saturation * sensor.saturation_dn();
  if (!has_exposures(stack.patterns))
    return use(Samples{&stack.images, nullptr, static_cast<float>(clip_dn)}, stack.patterns);
  const CombinedExposures combined = combine_exposures(stack, sensor, clip_dn);
  return use(Samples{&combined.stack.images, &combined.variance_dn2, combined.clip_dn}, combined.stack.patterns);
}

}  // namespace

PixelLight survey_light(const FringeStack& stack, const SensorModel& sensor, const DecodeOptions& options, Axis axis) {
  PixelLight light = with_samples(stack, sensor, options, [&](const Samples& samples, const PatternSequence& patterns) {
    return survey(samples, fringes_of(patterns, axis, options), sensor);
  });
  light.shortest = light.longest = stack.patterns.patterns.front().exposure;
  for (const Pattern& pattern : stack.patterns.patterns) {
    light.shortest = std::min(light.shortest, pattern.exposure);
    light.longest = std::max(light.longest, pattern.exposure);
  }
  return light;
}

namespace {

// Residual of a period's phase at a pixel, and what a nonlinear projector adds to it.
struct Residual {
  double value, sigma, cosine, sine;
  int block;
};

// True if the coordinate is smooth around a pixel: no edge lies within two pixels.
bool is_smooth(const DecodedStack& decoded, int row, int col) {
  constexpr int kApart = 2;
  constexpr float kMostBend_px = 1, kSigmas = 4;
  const cv::Mat1f& u = decoded.coordinate_px;
  if (row < kApart || col < kApart || row + kApart >= u.rows || col + kApart >= u.cols) return false;
  const float most = kMostBend_px + kSigmas * decoded.sigma_px(row, col);
  return std::abs(u(row, col - kApart) - 2 * u(row, col) + u(row, col + kApart)) <= most &&
         std::abs(u(row - kApart, col) - 2 * u(row, col) + u(row + kApart, col)) <= most;
}

struct Ripple {
  double cosine = 0, sine = 0;
};

// Fits value = a cosine + b sine robustly.
Ripple ripple_of(const std::vector<Residual>& residuals) {
  constexpr int kRounds = 3;
  constexpr double kClipped = 3;
  Ripple ripple;
  for (int round = 0; round < kRounds; ++round) {
    double cc = 0, cs = 0, ss = 0, cv = 0, sv = 0;
    std::vector<double> sizes;
    const auto rest = [&](const Residual& r) {
      return std::abs(r.value - ripple.cosine * r.cosine - ripple.sine * r.sine);
    };
    for (const Residual& r : residuals) sizes.push_back(rest(r));
    const double limit = kClipped * 1.4826 * median_in_place(sizes);
    for (const Residual& r : residuals) {
      if (rest(r) > limit) continue;
      cc += r.cosine * r.cosine, cs += r.cosine * r.sine, ss += r.sine * r.sine;
      cv += r.cosine * r.value, sv += r.sine * r.value;
    }
    const double determinant = cc * ss - cs * cs;
    if (!(determinant > 0)) return {};
    ripple = {(ss * cv - cs * sv) / determinant, (cc * sv - cs * cv) / determinant};
  }
  return ripple;
}

PeriodAgreement compared(const Samples& samples, const Fringes& fringes, const SensorModel& sensor,
                         const DecodedStack& decoded, const PixelLight& light) {
  constexpr double kBiasSigmas = 4;
  PeriodAgreement result;
  result.unmodulated = std::numeric_limits<double>::quiet_NaN();
  if (fringes.groups.empty()) return result;
  const double noise_ratio = std::isnan(light.noise_ratio) ? 1 : std::max(1.0, light.noise_ratio);
  const int blocks_across = (light.state.cols + kBlock_px - 1) / kBlock_px;
  std::vector<double> unmodulated;
  for (int row = 0; row < light.state.rows; row += 2) {
    for (int col = 0; col < light.state.cols; col += 2) {
      const float modulation = light.modulation_dn(row, col);
      if (light.at(row, col) == LightState::lit && modulation > 0)
        unmodulated.push_back(static_cast<double>(light.mean_dn(row, col) / modulation) - 1);
    }
  }
  result.unmodulated = median_in_place(unmodulated);
  std::vector<double> biases, sigmas;
  // A nonlinear projector adds the same ripple to all periods. Over few turns, other errors could be mistaken for it.
  constexpr double kFewestTurns = 3;
  Ripple ripple;
  for (size_t g = fringes.groups.size() - 1; g-- > 0;) {
    const FringeGroup& group = fringes.groups[g];
    const auto harmonic = static_cast<double>(group.images.size());
    std::vector<Residual> residuals;
    float least_px = std::numeric_limits<float>::max(), most_px = 0;
    for (int row = 0; row < light.state.rows; ++row) {
      for (int col = 0; col < light.state.cols; ++col) {
        const float coordinate = decoded.coordinate_px(row, col);
        if (light.at(row, col) != LightState::lit || !(coordinate >= 0) || !is_smooth(decoded, row, col)) continue;
        const Estimate estimate = Pixel(samples, sensor, row, col).estimate(fringes.estimators[g]);
        if (!(estimate.squared() > kClearSignal * estimate.noise())) continue;
        const double measured = std::atan2(estimate.sine, estimate.cosine),
                     expected = absolute_phase(static_cast<double>(coordinate), group.period_px);
        const double fine_rad = kTwoPi * static_cast<double>(decoded.sigma_px(row, col)) / group.period_px;
        const double variance =
            noise_ratio * noise_ratio * (estimate.noise() / 2 / estimate.squared() + fine_rad * fine_rad) +
            kProjectorSigma_rad * kProjectorSigma_rad;
        residuals.push_back({std::remainder(measured - expected, kTwoPi), std::sqrt(variance),
                             std::cos(harmonic * measured), std::sin(harmonic * measured),
                             row / kBlock_px * blocks_across + col / kBlock_px});
        least_px = std::min(least_px, coordinate);
        most_px = std::max(most_px, coordinate);
      }
    }
    if (residuals.empty()) continue;
    if (g + 2 == fringes.groups.size() && static_cast<double>(most_px - least_px) > kFewestTurns * group.period_px) {
      ripple = ripple_of(residuals);
      result.ripple_rad = std::hypot(ripple.cosine, ripple.sine);
    }
    for (Residual& r : residuals) r.value -= ripple.cosine * r.cosine + ripple.sine * r.sine;
    std::stable_sort(residuals.begin(), residuals.end(),
                     [](const Residual& a, const Residual& b) { return a.block < b.block; });
    int64_t tested = 0, biased = 0;
    for (size_t begin = 0, end = 0; begin < residuals.size(); begin = end) {
      std::vector<double> values, of_pixels;
      for (; end < residuals.size() && residuals[end].block == residuals[begin].block; ++end) {
        values.push_back(residuals[end].value);
        of_pixels.push_back(residuals[end].sigma);
      }
      if (values.size() < static_cast<size_t>(kFewestInBlock)) continue;
      const auto pixels = static_cast<int64_t>(values.size());
      const double bias = std::abs(median_in_place(values)), sigma = median_in_place(of_pixels);
      tested += pixels;
      sigmas.push_back(sigma);
      if (bias <= kBiasSigmas * sigma) continue;
      biased += pixels;
      biases.push_back(bias);
    }
    // The period that shows most.
    if (tested == 0 || biased * std::max<int64_t>(1, result.tested) < result.biased * tested) continue;
    result.tested = tested;
    result.biased = biased;
  }
  if (!biases.empty()) result.bias_rad = median_in_place(biases);
  if (!sigmas.empty()) result.sigma_rad = median_in_place(sigmas);
  return result;
}

}  // namespace

PeriodAgreement compare_periods(const FringeStack& stack, const SensorModel& sensor, const DecodeOptions& options,
                                Axis axis, const DecodedStack& decoded, const PixelLight& light) {
  return with_samples(stack, sensor, options, [&](const Samples& samples, const PatternSequence& patterns) {
    return compared(samples, fringes_of(patterns, axis, options), sensor, decoded, light);
  });
}

void add_look(PixelLight& light, const PixelLight& look) {
  if (light.state.size() != look.state.size()) throw Error("advice: the looks at a view differ in size");
  for (int row = 0; row < light.state.rows; ++row) {
    for (int col = 0; col < light.state.cols; ++col) {
      const LightState before = light.at(row, col), now = look.at(row, col);
      const bool revealed = (before == LightState::hidden || before == LightState::estimated) && now == LightState::lit;
      const bool better = before == LightState::unlit && now == LightState::lit && look.longest > light.longest;
      const bool estimated = before == LightState::hidden && now == LightState::estimated;
      if (!revealed && !better && !estimated) continue;
      light.mean_dn(row, col) = look.mean_dn(row, col);
      light.modulation_dn(row, col) = look.modulation_dn(row, col);
      light.peak_dn(row, col) = look.peak_dn(row, col);
      light.state(row, col) = look.state(row, col);
    }
  }
  light.shortest = std::min(light.shortest, look.shortest);
  light.longest = std::max(light.longest, look.longest);
}

double ExposureGrid::exposure(int step) { return std::exp2((step - kSteps / 2) / 4.0); }

int ExposureGrid::nearest(double exposure) {
  return std::clamp(static_cast<int>(std::lround(4 * std::log2(exposure))) + kSteps / 2, 0, kSteps - 1);
}

SignalLimits::SignalLimits(const SensorModel& sensor, const DecodeOptions& options, const SignalDemand& demand,
                           double noise_ratio)
    : sensor_(sensor),
      options_(options),
      demand_(demand),
      noise_ratio_(std::isnan(noise_ratio) ? 1 : std::max(1.0, noise_ratio)) {}

bool SignalLimits::saturates(double peak_dn, double exposure) const {
  const double brightest = sensor_.offset_dn + exposure * peak_dn;
  return brightest + kCertainSigmas * noise_ratio_ * std::sqrt(sensor_.variance_dn2(brightest)) >=
         options_.saturation * sensor_.saturation_dn();
}

bool SignalLimits::too_dark(double mean_dn, double modulation_dn, double exposure) const {
  const double mean = sensor_.offset_dn + exposure * mean_dn, modulation = exposure * modulation_dn;
  // Shot noise makes the variance of three steps depend on the phase: sum sin^2(x_k) (v + K I'' cos x_k) over x_k = phi +
  // 2 pi k / 3 is 3/2 v - 3/4 K I'' cos 3 phi. More steps have no such term.
  const double uneven_dn2 = demand_.steps == 3 ? sensor_.gain_dn_per_electron * modulation / 2 : 0;
  const double sigma_dn = noise_ratio_ * std::sqrt(2 * (sensor_.variance_dn2(mean) + uneven_dn2) / demand_.steps);
  const double least = modulation - kCertainSigmas * sigma_dn;
  return least < options_.min_modulation_dn || least < options_.min_data_modulation * mean ||
         sigma_dn > demand_.max_phase_sigma_rad * least;
}

void ExposureIntervals::add(const PixelLight& light, const SensorModel& sensor, const DecodeOptions& options,
                            const SignalDemand& demand) {
  const SignalLimits limits(sensor, options, demand, light.noise_ratio);
  for (int row = 0; row < light.state.rows; ++row) {
    for (int col = 0; col < light.state.cols; ++col) {
      const LightState state = light.at(row, col);
      hidden_ += state == LightState::hidden;
      if (state != LightState::lit && state != LightState::estimated) continue;
      const auto mean = std::max(0.0, static_cast<double>(light.mean_dn(row, col))),
                 modulation = static_cast<double>(light.modulation_dn(row, col)),
                 peak = static_cast<double>(light.peak_dn(row, col));
      // Both limits are monotonic in the exposure.
      int first = 0, end = ExposureGrid::kSteps;
      while (first < end) {
        const int middle = (first + end) / 2;
        if (limits.too_dark(mean, modulation, ExposureGrid::exposure(middle)))
          first = middle + 1;
        else
          end = middle;
      }
      int last = -1, beyond = ExposureGrid::kSteps;
      while (beyond - last > 1) {
        const int middle = (last + beyond) / 2;
        (limits.saturates(peak, ExposureGrid::exposure(middle)) ? beyond : last) = middle;
      }
      if (first > last) {
        ++hopeless_;
        continue;
      }
      ++decodable_;
      ++counts_[static_cast<size_t>(first * ExposureGrid::kSteps + last)];
    }
  }
}

int64_t ExposureIntervals::newly_covered(int before, int step) const {
  int64_t sum = 0;
  for (int first = before + 1; first <= step; ++first) {
    for (int last = step; last < ExposureGrid::kSteps; ++last) sum += at(first, last);
  }
  return sum;
}

int64_t ExposureIntervals::covered(const std::vector<int>& steps) const {
  int64_t sum = 0;
  int before = -1;
  for (const int step : steps) {
    sum += newly_covered(before, step);
    before = step;
  }
  return sum;
}

int64_t ExposureIntervals::common(int step, int other) const {
  int64_t sum = 0;
  for (int first = 0; first <= std::min(step, other); ++first) {
    for (int last = std::max(step, other); last < ExposureGrid::kSteps; ++last) sum += at(first, last);
  }
  return sum;
}

std::vector<int> ExposureIntervals::best(int count, int first, int last) const {
  constexpr int n = ExposureGrid::kSteps;
  // most[k][s]: pixels covered by k + 1 exposures, the last of which is s.
  std::vector<std::vector<int64_t>> most(static_cast<size_t>(count), std::vector<int64_t>(n, -1));
  std::vector<std::vector<int>> from(static_cast<size_t>(count), std::vector<int>(n, -1));
  for (int step = first; step <= last; ++step) {
    most[0][static_cast<size_t>(step)] = newly_covered(-1, step);
    for (int before = first; before < step; ++before) {
      const int64_t more = newly_covered(before, step);
      for (size_t k = 1; k < static_cast<size_t>(count); ++k) {
        const int64_t least = most[k - 1][static_cast<size_t>(before)];
        if (least < 0 || least + more <= most[k][static_cast<size_t>(step)]) continue;
        most[k][static_cast<size_t>(step)] = least + more;
        from[k][static_cast<size_t>(step)] = before;
      }
    }
  }
  const std::vector<int64_t>& totals = most.back();
  const int64_t best_total = *std::max_element(totals.begin(), totals.end());
  if (best_total < 0) return {};  // fewer steps than exposures
  std::vector<int> ties;
  for (int step = first; step <= last; ++step) {
    if (totals[static_cast<size_t>(step)] == best_total) ties.push_back(step);
  }
  std::vector<int> chosen;
  int step = ties[ties.size() / 2];
  for (size_t k = static_cast<size_t>(count); k-- > 0;) {
    chosen.insert(chosen.begin(), step);
    step = from[k][static_cast<size_t>(step)];
  }
  return chosen;
}

double ExposureIntervals::median_range() const {
  std::vector<int64_t> by_width(ExposureGrid::kSteps);
  for (int first = 0; first < ExposureGrid::kSteps; ++first) {
    for (int last = first; last < ExposureGrid::kSteps; ++last)
      by_width[static_cast<size_t>(last - first)] += at(first, last);
  }
  int64_t below = 0;
  for (int width = 0; width < ExposureGrid::kSteps; ++width) {
    below += by_width[static_cast<size_t>(width)];
    if (2 * below >= decodable_ && decodable_ > 0) return std::exp2(width / 4.0);
  }
  return 1;
}

}  // namespace fringeslam
