// SPDX-License-Identifier: Apache-2.0
#include "core/patterns/design.h"

#include <algorithm>
#include <cmath>

#include "core/patterns/micro_code.h"
#include "core/types/error.h"

namespace fringeslam {

namespace {

// Cell width of the Gray code's finest bit; 0: no Gray code.
double finest_cell_px(const SequenceDesign& design) {
  if (design.gray_cell_px > 0 || design.gray == GrayCode::none) return design.gray_cell_px;
  if (design.periods_px.empty())
    throw Error("patterns: a Gray code numbers fringe periods, but there are none; add periods_px or gray_cell_px");
  const double period = *std::min_element(design.periods_px.begin(), design.periods_px.end());
  return design.gray == GrayCode::complementary ? period / 2 : period;
}

std::vector<Pattern> gray_code(const SequenceDesign& design, Axis axis) {
  std::vector<Pattern> patterns;
  const double finest_px = finest_cell_px(design);
  if (finest_px == 0) {
    if (!design.gray_xor_px.empty() || design.gray_long_runs)
      throw Error(
          "patterns: gray_xor_px and gray_long_runs change a Gray code, but there is none; add gray or gray_cell_px");
    return patterns;
  }
  const int length = axis == Axis::columns ? design.width : design.height;
  const auto add = [&](const std::vector<Pattern>& code) {
    for (Pattern pattern : code) {
      if (std::find(patterns.begin(), patterns.end(), pattern) != patterns.end()) continue;
      patterns.push_back(pattern);
      pattern.inverted = true;
      if (design.gray_inverted) patterns.push_back(pattern);
    }
  };
  for (const double stripe_px : design.gray_xor_px)
    add(gray_patterns(axis, finest_px, length, design.bits, 0.5 * stripe_px));
  if (design.gray_long_runs) add(long_run_patterns(axis, finest_px, length, design.bits));
  if (patterns.empty()) add(gray_patterns(axis, finest_px, length, design.bits));
  return patterns;
}

std::vector<Pattern> extra_patterns(const SequenceDesign& design, Axis axis, const std::vector<double>& periods_px) {
  std::vector<Pattern> patterns;
  for (const double period : periods_px)
    patterns.push_back({.axis = axis, .period_px = period, .bits = design.bits, .coding = Coding::extra});
  return patterns;
}

std::vector<Pattern> micro_patterns(const SequenceDesign& design, Axis axis) {
  if (design.micro_period_px == 0) {
    if (design.micro_images > 0) throw Error("patterns: micro_images needs micro_period_px, the period of the fringes");
    return {};
  }
  constexpr int kFewestOthers = 2, kDefaultOthers = 4;
  const int others = design.micro_images == 0 ? kDefaultOthers : design.micro_images - design.steps;
  if (others < kFewestOthers)
    throw Error("patterns: micro phase shifting with " + std::to_string(design.steps) + " phase steps needs at least " +
                std::to_string(design.steps + kFewestOthers) + " images; micro_images is " +
                std::to_string(design.micro_images));
  const int length = axis == Axis::columns ? design.width : design.height;
  std::vector<Pattern> patterns =
      phase_shift_sequence(design.width, design.height, {design.micro_period_px}, design.steps, axis, design.bits)
          .patterns;
  for (const Pattern& pattern : extra_patterns(design, axis, micro_periods(design.micro_period_px, others, length)))
    patterns.push_back(pattern);
  return patterns;
}

std::vector<Pattern> products(const SequenceDesign& design, Axis axis, const std::vector<double>& periods_px,
                              double carrier_px) {
  const auto fringes = [&](const std::vector<double>& of_periods_px) {
    return phase_shift_sequence(design.width, design.height, of_periods_px, design.steps, axis, design.bits).patterns;
  };
  std::vector<Pattern> patterns;
  for (Pattern pattern : fringes(periods_px)) {
    pattern.coding = Coding::product;
    pattern.carrier_px = carrier_px;
    for (const Pattern& carrier : fringes({carrier_px})) {
      pattern.carrier_shift_rad = carrier.shift_rad;
      patterns.push_back(pattern);
    }
  }
  return patterns;
}

// The two fringes of a product beat with half its period. The longest beat covers the projector with a margin for noise;
// the others divide the way to the carrier evenly.
std::vector<double> modulated_periods(double carrier_px, int length_px) {
  constexpr double kGap_px = 16, kHighestRatio = 8;
  const double longest_px = length_px + kGap_px;
  const int levels =
      std::max(1, static_cast<int>(std::ceil(std::log(longest_px / carrier_px) / std::log(kHighestRatio))));
  const double ratio = std::pow(longest_px / carrier_px, 1.0 / levels);
  std::vector<double> periods_px;
  for (int level = 0; level < levels; ++level) periods_px.push_back(2 * longest_px / std::pow(ratio, level));
  return periods_px;
}

std::vector<Pattern> modulated_patterns(const SequenceDesign& design, Axis axis) {
  if (design.modulated_period_px == 0) return {};
  const double carrier_px = design.modulated_period_px;
  const int length = axis == Axis::columns ? design.width : design.height;
  std::vector<Pattern> patterns =
      phase_shift_sequence(design.width, design.height, {carrier_px}, design.steps, axis, design.bits).patterns;
  for (const Pattern& pattern : products(design, axis, modulated_periods(carrier_px, length), carrier_px))
    patterns.push_back(pattern);
  return patterns;
}

void check_carrier(const SequenceDesign& design) {
  if (design.carrier_px > 0 && design.product_periods_px.empty())
    throw Error("patterns: carrier_px is the second period of products, but there are none; add product_periods_px");
  if (design.carrier_px == 0 && !design.product_periods_px.empty())
    throw Error("patterns: the second period of the products of product_periods_px is missing; add carrier_px");
}

Pattern flat_pattern(double level, int bits) {
  Pattern pattern;
  pattern.coding = Coding::flat;
  pattern.level = level;
  pattern.bits = bits;
  return pattern;
}

}  // namespace

std::vector<Pattern> at_exposures(const std::vector<Pattern>& patterns, const std::vector<double>& exposures) {
  if (exposures.empty()) return patterns;
  for (size_t i = 0; i < exposures.size(); ++i) {
    if (!(exposures[i] > 0) || std::count(exposures.begin(), exposures.end(), exposures[i]) > 1)
      throw Error("patterns: exposures must be positive and differ from each other; one of them is " +
                  to_text(exposures[i]));
  }
  std::vector<Pattern> all;
  for (Pattern pattern : patterns) {
    for (const double exposure : exposures) {
      pattern.exposure = exposure;
      all.push_back(pattern);
    }
  }
  return all;
}

PatternSequence design_sequence(const SequenceDesign& design) {
  PatternSequence sequence{design.width, design.height, {}};
  std::vector<Pattern>& all = sequence.patterns;
  const auto append = [&](const std::vector<Pattern>& more) { all.insert(all.end(), more.begin(), more.end()); };
  check_carrier(design);
  for (const Axis axis : {Axis::columns, Axis::rows}) {
    if (!(axis == Axis::columns ? design.columns : design.rows)) continue;
    append(micro_patterns(design, axis));
    append(modulated_patterns(design, axis));
    append(
        phase_shift_sequence(design.width, design.height, design.periods_px, design.steps, axis, design.bits).patterns);
    append(gray_code(design, axis));
    append(extra_patterns(design, axis, design.extra_periods_px));
    append(products(design, axis, design.product_periods_px, design.carrier_px));
  }
  if (design.white_black) append({flat_pattern(1, design.bits), flat_pattern(0, design.bits)});
  for (int i = 0; i < design.ramp_levels; ++i)
    all.push_back(flat_pattern(static_cast<double>(i) / std::max(1, design.ramp_levels - 1), design.bits));
  if (all.empty())
    throw Error(
        "patterns: the sequence is empty; specify periods_px, micro_period_px, modulated_period_px, gray_cell_px, "
        "extra_periods_px, product_periods_px or ramp_levels");
  for (Pattern& pattern : all)
    pattern.dithered = design.dithered && pattern.coding != Coding::gray && pattern.coding != Coding::flat;
  all = at_exposures(all, design.exposures);
  return sequence;
}

PatternSequence default_sequence(int width, int height) {
  const double widest = width + 16;
  return phase_shift_sequence(width, height, {widest, widest / 8, widest / 64}, 3, Axis::columns, 8);
}

cv::Mat3b packed_image(const std::vector<cv::Mat1b>& images, const std::string& order) {
  std::string sorted = order;
  std::sort(sorted.begin(), sorted.end());
  if (sorted != "BGR") throw Error("packing order '" + order + "' must name each of R, G and B once, such as RGB");
  if (images.size() != 3) throw Error("packing needs exactly three images");
  std::vector<cv::Mat1b> channels(3);
  for (size_t i = 0; i < 3; ++i) channels[std::string("BGR").find(order[i])] = images[i];
  cv::Mat3b packed;
  cv::merge(std::vector<cv::Mat>(channels.begin(), channels.end()), packed);
  return packed;
}

PatternSequence at_one_exposure(const PatternSequence& sequence) {
  PatternSequence one = sequence;
  one.patterns.clear();
  for (Pattern pattern : sequence.patterns) {
    pattern.exposure = 1;
    if (std::find(one.patterns.begin(), one.patterns.end(), pattern) == one.patterns.end())
      one.patterns.push_back(pattern);
  }
  return one;
}

}  // namespace fringeslam
