// SPDX-License-Identifier: Apache-2.0
#include "hw/sequence_check.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <optional>
#include <utility>

#include "core/base/constants.h"
#include "core/types/error.h"
#include "core/types/options.h"

namespace fringeslam {

namespace {

constexpr double kDarkestMean = 0.25, kBrightestMean = 0.75;  // plausible mean of fringes for any response

// Levels, image by image, of the pixels with sufficient contrast between white and black.
struct Levels {
  std::vector<std::vector<float>> of;  // image, pixel
  size_t pixels = 0;
  size_t saturated = 0;  // other pixels, that saturate in white
  // Pixels that lie side by side, and one above the other: some of them, spread over the image.
  std::array<std::vector<std::pair<size_t, size_t>>, 2> neighbors;
};

void find_neighbors(const std::vector<int>& tell, cv::Size size, Levels& levels) {
  constexpr size_t kMost = 1 << 16;  // enough to average the noise
  cv::Mat1i number(size, -1);
  for (size_t p = 0; p < tell.size(); ++p) number(tell[p]) = static_cast<int>(p);
  for (size_t p = 0; p < tell.size(); p += tell.size() / kMost + 1) {
    const int row = tell[p] / size.width, col = tell[p] % size.width;
    if (col + 1 < size.width && number(row, col + 1) >= 0)
      levels.neighbors[0].emplace_back(p, static_cast<size_t>(number(row, col + 1)));
    if (row + 1 < size.height && number(row + 1, col) >= 0)
      levels.neighbors[1].emplace_back(p, static_cast<size_t>(number(row + 1, col)));
  }
}

Levels levels_of(const std::vector<cv::Mat>& images, const cv::Mat& white, const cv::Mat& black,
                 const SequenceCheckOptions& options) {
  cv::Mat1f w, k;
  white.convertTo(w, CV_32F);
  black.convertTo(k, CV_32F);
  const double contrast_dn = options.min_contrast * options.full_scale_dn;
  const double saturated_dn = options.saturation * options.full_scale_dn;
  Levels levels;
  std::vector<int> tell;
  for (int i = 0; i < static_cast<int>(w.total()); ++i) {
    if (w(i) >= saturated_dn)
      ++levels.saturated;
    else if (w(i) - k(i) >= contrast_dn)
      tell.push_back(i);
  }
  levels.pixels = tell.size();
  find_neighbors(tell, w.size(), levels);
  for (const cv::Mat& image : images) {
    cv::Mat1f grey;
    image.convertTo(grey, CV_32F);
    std::vector<float> line;
    line.reserve(tell.size());
    for (const int i : tell) line.push_back((grey(i) - k(i)) / (w(i) - k(i)));
    levels.of.push_back(std::move(line));
  }
  return levels;
}

class Check {
 public:
  Check(const PatternSequence& sequence, const Levels& levels, const SequenceCheckOptions& options)
      : sequence_(sequence), levels_(levels), options_(options) {}

  SequenceVerdict verdict() {
    if (const auto mean = common_mean()) {
      if (*mean < kDarkestMean || *mean > kBrightestMean)
        return {false, "the mean level of the fringes is " + to_text(std::round(100 * *mean)) + " % of white"};
      mean_ = *mean;
      gamma_ = gamma_of_mean(*mean);
    }
    for (const Axis axis : {Axis::columns, Axis::rows}) {
      if (auto fault = fringes(axis)) return {false, *fault, gamma_};
    }
    for (size_t i = 0; i < sequence_.patterns.size(); ++i) {
      if (auto fault = single(i)) return {false, *fault, gamma_};
    }
    if (auto fault = ramp()) return {false, *fault, gamma_};
    return {true, "", gamma_};
  }

 private:
  // The brightness of flat images grows with their level; a repeated image leaves a step of it out.
  std::optional<std::string> ramp() const {
    constexpr double kLeast = 0.01, kShare = 0.05;  // of the steps beside it, which is more than a gamma of 3 causes
    std::vector<std::pair<double, size_t>> flats;
    for (size_t i = 0; i < sequence_.patterns.size(); ++i) {
      if (sequence_.patterns[i].coding == Coding::flat) flats.emplace_back(sequence_.patterns[i].level, i);
    }
    std::sort(flats.begin(), flats.end());
    std::vector<double> steps;
    for (size_t k = 1; k < flats.size(); ++k) {
      if (flats[k].first == flats[k - 1].first) return std::nullopt;  // not a ramp
      steps.push_back(mean_level(flats[k].second) - mean_level(flats[k - 1].second));
    }
    for (size_t k = 0; k < steps.size(); ++k) {
      double beside = 0;
      if (k > 0) beside = std::max(beside, steps[k - 1]);
      if (k + 1 < steps.size()) beside = std::max(beside, steps[k + 1]);
      if (beside > kLeast && steps[k] < kShare * beside)
        return image(flats[k + 1].second) + " should be brighter than image " + std::to_string(flats[k].second) +
               " but is not";
    }
    return std::nullopt;
  }

  double mean_level(size_t i) const {
    double sum = 0;
    for (const float level : levels_.of[i]) sum += level;
    return sum / static_cast<double>(levels_.pixels);
  }

  // True if more pixels violate the condition than allowed.
  template <class Contradicts>
  bool too_many(const Contradicts& contradicts) const {
    size_t count = 0;
    for (size_t p = 0; p < levels_.pixels; ++p) count += contradicts(p);
    return static_cast<double>(count) > options_.max_outliers * static_cast<double>(levels_.pixels);
  }

  static size_t index_of(Axis axis) { return axis == Axis::columns ? 0 : 1; }

  static std::string image(size_t i) { return "image " + std::to_string(i) + " of the sequence"; }

  std::optional<std::string> single(size_t i) const {
    const Pattern& pattern = sequence_.patterns[i];
    const std::vector<float>& level = levels_.of[i];
    if (pattern.coding == Coding::flat && (pattern.level == 0 || pattern.level == 1) &&
        too_many([&](size_t p) { return std::abs(level[p] - pattern.level) > options_.tolerance; }))
      return image(i) + " should be entirely " + (pattern.level > 0 ? "white" : "black") + " but is not";
    if (pattern.coding == Coding::extra || pattern.coding == Coding::product) return single_wave(i);
    if (pattern.coding != Coding::gray) return std::nullopt;
    if (too_many(
            [&](size_t p) { return std::min(std::abs(level[p]), std::abs(1 - level[p])) > 2 * options_.tolerance; }))
      return image(i) + " should show a Gray-code bit but is not black and white";
    for (size_t j = 0; j < sequence_.patterns.size(); ++j) {
      const Pattern& other = sequence_.patterns[j];
      if (j == i || other.coding != Coding::gray) continue;
      Pattern inverted = pattern;
      inverted.inverted = !pattern.inverted;
      const bool inverse = other == inverted;
      if (inverse &&
          too_many([&](size_t p) { return std::abs(level[p] + levels_.of[j][p] - 1) > 2 * options_.tolerance; }))
        return image(i) + " and image " + std::to_string(j) + " should be inverses of each other but are not";
      if (!inverse && !too_many([&](size_t p) { return std::abs(level[p] - levels_.of[j][p]) > 0.5; }) &&
          same_everywhere(i, j) && varies(i))
        return image(i) + " and image " + std::to_string(j) + " show the same bit";
    }
    return std::nullopt;
  }

  bool same_everywhere(size_t i, size_t j) const {
    size_t differ = 0;
    for (size_t p = 0; p < levels_.pixels; ++p) differ += std::abs(levels_.of[i][p] - levels_.of[j][p]) > 0.5f;
    return static_cast<double>(differ) < 0.005 * static_cast<double>(levels_.pixels);
  }

  // True if a difference of levels is nothing but noise. Noise is independent from pixel to pixel, so that the products of
  // neighbors average to the square of the rest: waves are alike at neighbors across them or along them.
  template <class Difference>
  bool only_noise(const Difference& difference, double most_shared = 0.04) const {
    constexpr double kMost = 0.3;  // RMS, as most_shared; two waves differ by 0.5
    double shared = 0, squares = 0;
    size_t count = 0;
    for (const auto& pairs : levels_.neighbors) {
      double sum = 0;
      for (const auto& [p, q] : pairs) {
        const double a = difference(p), b = difference(q);
        sum += a * b;
        squares += 0.5 * (a * a + b * b);
      }
      if (!pairs.empty()) shared = std::max(shared, sum / static_cast<double>(pairs.size()));
      count += pairs.size();
    }
    return count > 0 && shared < most_shared * most_shared && squares < kMost * kMost * static_cast<double>(count);
  }

  // Both values of a bit are in view. On a small object, several coarse bits may be constant and equal; where one of two
  // different bits changes, the other does not.
  bool varies(size_t i) const {
    const auto ones = static_cast<double>(
        std::count_if(levels_.of[i].begin(), levels_.of[i].end(), [](float level) { return level > 0.5f; }));
    const double share = ones / static_cast<double>(levels_.pixels);
    return std::min(share, 1 - share) > 0.005;
  }

  // Checks an image of an extra frequency or of a product of cosines.
  std::optional<std::string> single_wave(size_t i) const {
    constexpr double kCoarsest = 4;  // the noise of the phase of longer periods exceeds the tolerance
    const Pattern& pattern = sequence_.patterns[i];
    const Located& known = located_[index_of(pattern.axis)];
    const double period_px =
        pattern.coding == Coding::product ? std::min(pattern.period_px, pattern.carrier_px) : pattern.period_px;
    const auto seen = [this](size_t of, size_t p) { return static_cast<double>(levels_.of[of][p]); };
    const std::string other = image(i) + " does not show its " +
                              (pattern.coding == Coding::product ? "product of cosines" : "extra frequency") +
                              " of period " + to_text(pattern.period_px) + " px";
    if (known.coordinate_px.empty() || known.period_px > kCoarsest * period_px) {
      for (const double level : {0.0, 1.0}) {  // black or white, which may precede the sequence
        if (only_noise([&](size_t p) { return seen(i, p) - level; })) return other;
      }
      for (size_t j = 0; j < sequence_.patterns.size(); ++j) {
        if (j != i && sequence_.patterns[j] != pattern && only_noise([&](size_t p) { return seen(i, p) - seen(j, p); }))
          return image(i) + " and image " + std::to_string(j) + " show the same pattern";
      }
      return std::nullopt;
    }
    if (too_many([&](size_t p) {
          const double light = std::pow(ideal_intensity(pattern, known.coordinate_px[p]), gamma_);
          return std::abs(seen(i, p) - light) > 2 * options_.tolerance;
        }))
      return other;
    return std::nullopt;
  }

  struct Phases {
    double period_px = 0;
    std::vector<float> turns;  // wrapped, one per pixel
  };

  // Projector coordinates of the pixels, from the finest period whose orders the coarser ones determine.
  struct Located {
    double period_px = 0;
    std::vector<double> coordinate_px;  // empty: unknown
  };

  static Located located(const Phases& phases) {
    Located result{phases.period_px, {}};
    for (const float turns : phases.turns)
      result.coordinate_px.push_back(projector_coordinate(kTwoPi * static_cast<double>(turns), phases.period_px));
    return result;
  }

  // Checks the periods of an axis against each other, and notes the coordinates that they determine.
  std::optional<std::string> fringes(Axis axis) {
    std::optional<Phases> coarser;
    bool ordered = true;
    for (const FringeGroup& group : fringe_groups(sequence_, axis)) {
      const std::string these = "the " + std::to_string(group.images.size()) + " images of period " +
                                to_text(group.period_px) + " px are inconsistent";
      if (evenly_spaced(group) &&
          too_many([&](size_t p) { return std::abs(mean(group, p) - mean_) > options_.mean_tolerance; }))
        return these;
      Phases phases{group.period_px, std::vector<float>(levels_.pixels)};
      std::vector<float> left(levels_.pixels);
      const Waves waves = waves_of(group);
      std::vector<Steps> steps(group.images.size());
      std::vector<double> linear(group.images.size());
      double squares = 0;
      for (size_t p = 0; p < levels_.pixels; ++p) {
        const Fit fit = fit_of(group, waves, p, linear);
        phases.turns[p] = fit.turns;
        left[p] = fit.left;
        squares += static_cast<double>(fit.left) * static_cast<double>(fit.left);
        for (size_t n = 1; n < steps.size(); ++n) steps[n].add(fit.step(waves, n), linear[n] - linear[n - 1]);
      }
      if (evenly_spaced(group)) {
        if (too_many([&](size_t p) { return left[p] > options_.cosine_tolerance; }) && !noisy_cosines(group, waves))
          return these;
        if (auto fault = repeated(group, steps, squares)) return fault;
      }
      // The phase of the coarsest period is absolute; it determines the fringe order of the next finer period, and so
      // on.
      if (coarser) {
        const double ratio = coarser->period_px / phases.period_px;
        std::vector<float> off(levels_.pixels);
        for (size_t p = 0; p < levels_.pixels; ++p) {
          const double turns = ratio * coarser->turns[p] - phases.turns[p], order = std::round(turns);
          off[p] = static_cast<float>(std::abs(turns - order));
          phases.turns[p] += static_cast<float>(order);
        }
        // Tolerance for the noise of the coarser phase times the ratio; above a third of a turn the check is
        // impossible.
        const double most = 0.1 + 0.01 * ratio;
        ordered = ordered && most < 0.33;
        if (most < 0.33 && too_many([&](size_t p) { return off[p] > most; }))
          return "the images of period " + to_text(phases.period_px) + " px are inconsistent with those of " +
                 to_text(coarser->period_px) + " px";
      } else if (phases.period_px < length(axis)) {
        continue;
      }
      if (ordered) located_[index_of(axis)] = located(phases);
      coarser = std::move(phases);
    }
    return std::nullopt;
  }

  double length(Axis axis) const { return axis == Axis::columns ? sequence_.width : sequence_.height; }

  static bool evenly_spaced(const FringeGroup& group) {
    double x = 0, y = 0;
    for (const double shift : group.shifts_rad) x += std::cos(shift), y += std::sin(shift);
    return std::hypot(x, y) < 1e-6;
  }

  double level(int image, size_t p) const { return static_cast<double>(levels_.of[static_cast<size_t>(image)][p]); }

  double mean(const FringeGroup& group, size_t p) const {
    double sum = 0;
    for (const int i : group.images) sum += level(i, p);
    return sum / static_cast<double>(group.images.size());
  }

  // Median over all pixels and periods, which a single bad period hardly affects.
  std::optional<double> common_mean() const {
    std::vector<double> means;
    for (const Axis axis : {Axis::columns, Axis::rows}) {
      for (const FringeGroup& group : fringe_groups(sequence_, axis)) {
        if (!evenly_spaced(group)) continue;
        for (size_t p = 0; p < levels_.pixels; ++p) means.push_back(mean(group, p));
      }
    }
    if (means.empty()) return std::nullopt;
    const auto middle = means.begin() + static_cast<std::ptrdiff_t>(means.size() / 2);
    std::nth_element(means.begin(), middle, means.end());
    return *middle;
  }

  struct Waves {
    std::vector<double> sines, cosines;  // of the shifts
  };
  static Waves waves_of(const FringeGroup& group) {
    Waves waves;
    for (const double shift : group.shifts_rad) {
      waves.sines.push_back(std::sin(shift));
      waves.cosines.push_back(std::cos(shift));
    }
    return waves;
  }

  // Cosine fitted to a pixel's linearised levels.
  struct Fit {
    float turns = 0;              // phase
    float left = 0;               // root of the summed squared residuals
    double sine = 0, cosine = 0;  // amplitudes
    double mean = 0;

    double level(const Waves& waves, size_t n) const {
      return mean + cosine * waves.cosines[n] - sine * waves.sines[n];
    }

    // The cosine's change from the image before the n-th.
    double step(const Waves& waves, size_t n) const { return level(waves, n) - level(waves, n - 1); }
  };
  // Also returns the linearised levels.
  Fit fit_of(const FringeGroup& group, const Waves& waves, size_t p, std::vector<double>& linear) const {
    double sine = 0, cosine = 0, sum = 0, squares = 0;
    for (size_t n = 0; n < group.images.size(); ++n) {
      linear[n] = std::pow(std::clamp(level(group.images[n], p), 0.0, 1.0), 1 / gamma_);
      sine -= linear[n] * waves.sines[n];
      cosine += linear[n] * waves.cosines[n];
      sum += linear[n];
      squares += linear[n] * linear[n];
    }
    const double turns = std::atan2(sine, cosine) / kTwoPi, count = static_cast<double>(group.images.size());
    const double explained = (sum * sum + 2 * (sine * sine + cosine * cosine)) / count;
    return {static_cast<float>(turns - std::floor(turns)),
            static_cast<float>(std::sqrt(std::max(0.0, squares - explained))), 2 * sine / count, 2 * cosine / count,
            sum / count};
  }

  // True if the levels differ from the fitted cosines by noise only, as they do in dark scenes, where the tolerance is small
  // against the noise, and with many images per period. The inverse response biases the darkest levels.
  bool noisy_cosines(const FringeGroup& group, const Waves& waves) const {
    constexpr double kMostShared = 0.08;  // a wrong one of four images differs by 0.12, and by more with more images
    std::vector<std::vector<float>> left(group.images.size(), std::vector<float>(levels_.pixels));
    std::vector<double> linear(group.images.size());
    for (size_t p = 0; p < levels_.pixels; ++p) {
      const Fit fit = fit_of(group, waves, p, linear);
      for (size_t n = 0; n < linear.size(); ++n) left[n][p] = static_cast<float>(linear[n] - fit.level(waves, n));
    }
    return std::all_of(left.begin(), left.end(), [this](const std::vector<float>& of) {
      return only_noise([&of](size_t p) { return static_cast<double>(of[p]); }, kMostShared);
    });
  }

  // Sums, over the pixels, of the change from one image of a period to the next: that of the fitted cosine squared, and
  // times the observed one.
  struct Steps {
    double fitted = 0, both = 0;
    void add(double fit, double observed) { fitted += fit * fit, both += fit * observed; }
  };

  // Finds an image that repeats the one before it. With many images per period, it changes the fit of a single pixel by
  // less than the noise, but all pixels together lack the change that the other images imply.
  std::optional<std::string> repeated(const FringeGroup& group, const std::vector<Steps>& steps, double squares) const {
    constexpr double kShare = 0.5, kSigmas = 5;
    if (steps.size() < 4) return std::nullopt;
    const double variance = squares / (static_cast<double>(levels_.pixels) * static_cast<double>(steps.size() - 3));
    for (size_t n = 1; n < steps.size(); ++n) {
      const double sigma = std::sqrt(2 * variance * steps[n].fitted);  // of the sum of the products
      if (steps[n].both + kSigmas * sigma < kShare * steps[n].fitted)
        return image(static_cast<size_t>(group.images[n])) + " and image " + std::to_string(group.images[n - 1]) +
               " show the same pattern";
    }
    return std::nullopt;
  }

  const PatternSequence& sequence_;
  const Levels& levels_;
  const SequenceCheckOptions& options_;
  double mean_ = 0.5, gamma_ = 1;   // mean level of the fringes; gamma of the response
  std::array<Located, 2> located_;  // columns, rows
};

double mean_of_gamma(double gamma) {
  return std::exp(std::lgamma(2 * gamma + 1) - 2 * std::lgamma(gamma + 1)) * std::pow(4, -gamma);
}

}  // namespace

double gamma_of_mean(double mean) {
  if (!(mean >= kDarkestMean && mean <= kBrightestMean))
    throw Error("the mean level of the fringes, " + to_text(mean) + ", is not within 0.25 to 0.75");
  double low = 0.1, high = 10;  // the mean decreases with gamma
  while (high - low > 1e-9) {
    const double middle = (low + high) / 2;
    (mean_of_gamma(middle) > mean ? low : high) = middle;
  }
  return low;
}

SequenceVerdict check_sequence(const PatternSequence& sequence, const std::vector<cv::Mat>& images,
                               const cv::Mat& white, const cv::Mat& black, const SequenceCheckOptions& options) {
  if (images.size() != sequence.patterns.size())
    throw Error("sequence: " + std::to_string(images.size()) + " images for " +
                std::to_string(sequence.patterns.size()) + " patterns");
  const Levels levels = levels_of(images, white, black, options);
  // The lens mixes pixels beside saturated surfaces with darker ones, so that they are not saturated themselves.
  constexpr double kBesideSaturated = 0.1;
  const auto saturated = static_cast<double>(levels.saturated);
  const double all = static_cast<double>(white.total()), needed = options.min_pixels * all;
  if (static_cast<double>(levels.pixels) < std::max(needed, kBesideSaturated * saturated)) {
    if (saturated >= needed)
      return {false,
              to_text(std::round(100 * saturated / all)) +
                  " % of the pixels are saturated in white, and too few others separate it from black; lower exposure "
                  "or gain, or close the aperture",
              1, true, true};
    return {false, "too few pixels separate white from black; is the projector on, its lens open, the scene lit?", 1,
            true};
  }
  return Check(sequence, levels, options).verdict();
}

}  // namespace fringeslam
