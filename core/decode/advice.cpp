// SPDX-License-Identifier: Apache-2.0
#include "core/decode/advice.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "core/base/constants.h"
#include "core/decode/gray.h"
#include "core/decode/modulated.h"
#include "core/decode/stack_motion.h"
#include "core/decode/steps.h"
#include "core/decode/unwrapping_levels.h"
#include "core/patterns/design.h"
#include "core/patterns/micro_code.h"
#include "core/types/error.h"

namespace fringeslam {

namespace {

constexpr double kNoLimit = 1e6;  // on the residuals between periods

double upper_tail(double x) { return 0.5 * std::erfc(x / std::sqrt(2.0)); }

double rounded(double value, int digits) {
  if (value == 0) return 0;
  const double scale = std::pow(10.0, digits - 1 - std::floor(std::log10(std::abs(value))));
  return std::round(value * scale) / scale;
}

// Returns the greatest phase sigma at which failures are as rare as permitted; `failure(sigma)` increases.
template <class Failure>
double greatest_sigma_rad(const Failure& failure, const DecodeOptions& options) {
  double low = 0, high = options.max_phase_sigma_rad;
  if (failure(high) <= options.max_order_failure) return high;
  constexpr int kHalvings = 40;
  for (int i = 0; i < kHalvings; ++i) {
    const double middle = (low + high) / 2;
    (failure(middle) <= options.max_order_failure ? low : high) = middle;
  }
  return low;
}

// Greatest phase sigma for which wrong orders of all levels have at most the permitted probability.
double order_sigma_rad(const std::vector<UnwrappingLevel>& levels, const DecodeOptions& options) {
  const auto failure = [&](double sigma_rad) {
    const double turns = std::hypot(sigma_rad, kProjectorSigma_rad) / kTwoPi;
    double sum = 0;
    for (size_t level = 1; level < levels.size(); ++level)
      sum += 2 * upper_tail(1 / (2 * turns * step_noise(levels[level - 1], levels[level])));
    return sum;
  };
  return greatest_sigma_rad(failure, options);
}

// The least chi-square difference that permits an order, with a margin for its own noise, as a phase sigma: two orders
// differ by `distance` I'' in the images, and sigma_phi = sqrt(2 / N) sigma_I / I''.
double micro_sigma_rad(double distance, int steps, const DecodeOptions& options) {
  const double least = -2 * std::log(options.max_order_failure);
  const double sigmas = kCertainSigmas + std::sqrt(kCertainSigmas * kCertainSigmas + least);
  return std::min(options.max_phase_sigma_rad, std::sqrt(2.0 / steps) * distance / sigmas);
}

// Each comparison is of a grey value with the mean of the fringes; a bit combined by XOR depends on two. Noise must neither
// flip a bit nor, in more than 1 % of the pixels, make it look fainter than kLeastGrayContrast of another, which drops the
// pixel: bits combined by XOR are compared with their carrier, others with each other.
double gray_sigma_rad(const std::vector<GrayBit>& bits, int steps, const DecodeOptions& options) {
  constexpr double kDropped = 0.01;
  const auto combined = static_cast<double>(
      std::count_if(bits.begin(), bits.end(), [](const GrayBit& bit) { return bit.carrier_px > 0; }));
  const double plain = static_cast<double>(bits.size()) - combined;
  const double comparisons = plain + 2 * combined, ratios = plain * (plain - 1) + 2 * combined;
  // Noise of |a - m| - c |b - m| for gray values a and b on different sides of the mean m.
  constexpr double c = kLeastGrayContrast;
  const double ratio_sigmas = std::sqrt(1 + c * c + (1 + c) * (1 + c) / steps);
  const auto failure = [&](double sigma_rad) {
    const double sigma_over_modulation = sigma_rad / std::sqrt(2.0 / steps);
    const double flipped = comparisons * upper_tail(1 / (sigma_over_modulation * std::sqrt(1 + 1.0 / steps)));
    const double dropped = ratios * upper_tail((1 - c) / (sigma_over_modulation * ratio_sigmas));
    return std::max(flipped, dropped / kDropped * options.max_order_failure);
  };
  return greatest_sigma_rad(failure, options);
}

// True if no stripe of the bits is much wider than a fringe, so that indirect light is alike in all images.
bool has_narrow_stripes(const std::vector<GrayBit>& bits, double period_px) {
  return std::all_of(bits.begin(), bits.end(), [&](const GrayBit& bit) {
    return bit.code_bits == 0 && (bit.carrier_px > 0 ? bit.carrier_px : bit.cell_px) <= period_px;
  });
}

std::optional<Unwrapping> method_of(const PatternSequence& sequence, const RigModel& rig, const DecodeOptions& options,
                                    Axis axis) {
  try {
    DecodeContext context;
    context.axis = axis;
    const Unwrapping method = resolve_unwrapping(sequence, rig, options, context);
    // The nominal geometry of an uncalibrated rig bounds nothing.
    if (method == Unwrapping::geometric && !rig.calibrated) return std::nullopt;
    return method;
  } catch (const Error&) {
    return std::nullopt;
  }
}

// Returns the least signal that the sequence can be decoded with; empty if it determines no coordinates.
std::optional<SignalDemand> demand_of(const PatternSequence& sequence, const RigModel& rig,
                                      const DecodeOptions& options, Axis axis) {
  const std::optional<Unwrapping> method = method_of(sequence, rig, options, axis);
  if (!method) return std::nullopt;
  const std::vector<FringeGroup> groups = select_groups(sequence, axis, options);
  const int length = length_of(sequence, axis);
  SignalDemand demand{3, options.max_phase_sigma_rad};
  if (!groups.empty()) demand.steps = static_cast<int>(groups.back().images.size());
  if (*method == Unwrapping::multifrequency)
    demand.max_phase_sigma_rad = order_sigma_rad(multifrequency_levels(groups, length), options);
  if (*method == Unwrapping::heterodyne)
    demand.max_phase_sigma_rad = order_sigma_rad(heterodyne_levels(groups, length), options);
  if (*method == Unwrapping::modulated) {
    // Products have half the modulation of their carrier.
    const ModulatedCode code = modulated_code(sequence, axis, length);
    demand.steps = static_cast<int>(code.groups.back().images.size());
    const double product_steps = static_cast<double>(code.groups.front().images.size());
    const double sigma_ratio =
        code.groups.size() % 2 == 0 ? 1 : 2 * std::sqrt(static_cast<double>(demand.steps) / product_steps);
    demand.max_phase_sigma_rad = order_sigma_rad(code.levels, options) / sigma_ratio;
  }
  if (*method == Unwrapping::gray)
    demand.max_phase_sigma_rad = gray_sigma_rad(gray_bits(sequence, axis), demand.steps, options);
  if (*method == Unwrapping::micro) {
    std::vector<double> others;
    for (const Pattern& pattern : sequence.patterns) {
      if (pattern.coding == Coding::extra && pattern.axis == axis) others.push_back(pattern.period_px);
    }
    demand.max_phase_sigma_rad =
        micro_sigma_rad(micro_code_distance(groups.back().period_px, others, length).distance, demand.steps, options);
  }
  return demand;
}

SequenceDesign empty_design(const PatternSequence& sequence) {
  SequenceDesign design;
  design.width = sequence.width, design.height = sequence.height;
  design.columns = codes_axis(sequence, Axis::columns), design.rows = codes_axis(sequence, Axis::rows);
  design.bits = sequence.patterns.front().bits;
  return design;
}

// The design of a sequence of fringes or of micro phase shifting; without periods for other sequences.
SequenceDesign design_of(const PatternSequence& sequence, const std::vector<FringeGroup>& groups, Axis axis) {
  const SequenceDesign none = empty_design(sequence);
  if (groups.empty()) return none;
  SequenceDesign fringes = none;
  fringes.steps = static_cast<int>(groups.back().images.size());
  SequenceDesign micro = fringes;
  for (const FringeGroup& group : groups) fringes.periods_px.push_back(group.period_px);
  micro.micro_period_px = groups.back().period_px;
  const auto extra = std::count_if(sequence.patterns.begin(), sequence.patterns.end(), [&](const Pattern& pattern) {
    return pattern.coding == Coding::extra && pattern.axis == axis;
  });
  micro.micro_images = micro.steps + static_cast<int>(extra);
  const auto equals = [&](const SequenceDesign& design) {
    return design_sequence(design).patterns == sequence.patterns;
  };
  if (extra == 0) return equals(fringes) ? fringes : none;
  try {
    return equals(micro) ? micro : none;
  } catch (const Error&) {  // too few images
    return none;
  }
}

constexpr double kOrdersOfShort = 62;  // 16.5 px of 1024

double typical_period_px(int length) { return rounded(length / kOrdersOfShort, 3); }

// Three steps of periods in equal ratios, from one that covers the projector with a gap of a short period.
SequenceDesign periods_design(const PatternSequence& sequence, int periods, double finest_px, int length) {
  SequenceDesign design = empty_design(sequence);
  const double longest_px = std::ceil(length + std::max(finest_px, typical_period_px(length)));
  for (int i = 0; i + 1 < periods; ++i)
    design.periods_px.push_back(
        rounded(longest_px * std::pow(finest_px / longest_px, i / (periods - 1.0)), i == 0 ? 5 : 3));
  design.periods_px.push_back(finest_px);
  return design;
}

// Three steps of three periods near the finest, whose beats have equal ratios.
SequenceDesign heterodyne_design(const PatternSequence& sequence, double finest_px, int length) {
  const double longest_px = std::ceil(length + finest_px), middle_px = std::sqrt(longest_px * finest_px);
  SequenceDesign design = empty_design(sequence);
  for (const double beat_px : {middle_px, longest_px})
    design.periods_px.push_back(rounded(finest_px * beat_px / (beat_px - finest_px), 6));
  design.periods_px.push_back(finest_px);
  return design;
}

bool has_short_periods(const std::vector<FringeGroup>& groups) {
  constexpr double kNear = 1.5;  // indirect light hardly differs between periods in this ratio
  return !groups.empty() && groups.front().period_px <= kNear * groups.back().period_px;
}

// The codings to choose from: the present one, and those that decoders support, with the finest period of the images.
std::vector<CodingChoice> codings(const PatternSequence& taken, const RigModel& rig, const DecodeOptions& options,
                                  Axis axis) {
  constexpr int kFewestPeriods = 2, kMostPeriods = 4;
  const PatternSequence sequence = at_one_exposure(taken);
  const int length = length_of(sequence, axis);
  std::vector<CodingChoice> all;
  const std::vector<FringeGroup> groups = select_groups(sequence, axis, options);
  const double typical_px = typical_period_px(length),
               finest_px = groups.empty() ? typical_px : groups.back().period_px,
               short_px = std::min(finest_px, typical_px);
  const auto add = [&](CodingChoice choice) {
    const PatternSequence designed = design_sequence(choice.design);
    const std::optional<SignalDemand> demand = demand_of(designed, rig, options, axis);
    if (!demand) return;
    choice.demand = *demand;
    choice.images = static_cast<int>(designed.patterns.size());
    all.push_back(std::move(choice));
  };
  if (const std::optional<SignalDemand> demand = demand_of(sequence, rig, options, axis)) {
    CodingChoice present;
    const Unwrapping method = *method_of(sequence, rig, options, axis);
    const bool periods = method == Unwrapping::multifrequency || method == Unwrapping::heterodyne;
    present.name = to_string(method);
    present.design = empty_design(sequence);
    present.images = static_cast<int>(sequence.patterns.size());
    present.demand = *demand;
    present.current = true;
    present.decodes_exposures = periods;
    present.decodes_motion = periods;
    present.resists_indirect = method == Unwrapping::micro || method == Unwrapping::modulated ||
                               (method == Unwrapping::heterodyne && has_short_periods(groups)) ||
                               (method == Unwrapping::gray && !groups.empty() &&
                                has_narrow_stripes(gray_bits(sequence, axis), groups.back().period_px));
    present.design = design_of(sequence, groups, axis);
    all.push_back(present);
  }
  for (int periods = kFewestPeriods; periods <= kMostPeriods; ++periods) {
    CodingChoice choice;
    choice.name = "multifrequency";
    choice.decodes_exposures = choice.decodes_motion = true;
    choice.design = periods_design(sequence, periods, finest_px, length);
    add(std::move(choice));
  }
  for (const int images : {7, 9, 12}) {
    CodingChoice micro;
    micro.name = "micro";
    micro.resists_indirect = true;
    micro.design = empty_design(sequence);
    micro.design.micro_period_px = short_px;
    micro.design.micro_images = images;
    try {
      add(std::move(micro));
    } catch (const Error&) {  // no code of these periods
    }
  }
  CodingChoice heterodyne;
  heterodyne.name = "heterodyne";
  heterodyne.decodes_exposures = heterodyne.decodes_motion = heterodyne.resists_indirect = true;
  heterodyne.design = heterodyne_design(sequence, short_px, length);
  add(std::move(heterodyne));
  CodingChoice gray;
  gray.name = "gray";
  gray.resists_indirect = true;
  gray.design = empty_design(sequence);
  gray.design.periods_px = {short_px};
  gray.design.steps = 4;  // four steps also test the noise model
  gray.design.gray = GrayCode::complementary;
  gray.design.gray_xor_px = gray.design.periods_px;
  add(std::move(gray));
  return all;
}

// The exposure that decodes the wanted number of pixels, or else most: the rig's, if that will do, or else the nearest that
// does. It must not lose more than the share 1 - `kept` of the pixels that the rig's exposure decodes.
int single_exposure(const ExposureIntervals& intervals, int first, int last, int64_t wanted, double kept) {
  const int present = std::clamp(ExposureGrid::nearest(1), first, last);
  const auto least = static_cast<int64_t>(kept * static_cast<double>(intervals.covered({present})));
  std::vector<int> allowed;  // the nearest first
  for (int apart = 0; apart <= last - first; ++apart) {
    for (const int step : {present - apart, present + apart}) {
      if (step >= first && step <= last && intervals.common(present, step) >= least) allowed.push_back(step);
    }
  }
  int64_t most = 0;
  for (const int step : allowed) most = std::max(most, intervals.covered({step}));
  for (const int step : allowed) {
    if (intervals.covered({step}) >= std::min(wanted, most)) return step;
  }
  return present;
}

// The exposures that decode the wanted number of pixels, with the shortest longest one; if there are none, those that decode
// most.
std::vector<int> shortest_enough(const ExposureIntervals& intervals, int count, int first, int last, int64_t wanted) {
  const std::vector<int> best = intervals.best(count, first, last);
  if (best.empty()) return best;
  const int64_t enough = std::min(wanted, intervals.covered(best));
  for (int longest = first; longest < best.back(); ++longest) {
    const std::vector<int> steps = intervals.best(count, first, longest);
    if (!steps.empty() && intervals.covered(steps) >= enough) return steps;
  }
  return best;
}

double share(int64_t part, int64_t all) { return all > 0 ? static_cast<double>(part) / static_cast<double>(all) : 0; }

}  // namespace

PatternSequence advised_sequence(const Advice& advice, const PatternSequence& taken) {
  if (!advice.coding.current) {
    SequenceDesign design = advice.coding.design;
    if (advice.exposures.size() > 1) design.exposures = advice.exposures;
    return design_sequence(design);
  }
  PatternSequence sequence = at_one_exposure(taken);
  if (advice.exposures.size() < 2) return sequence;
  const std::vector<Pattern> once = std::move(sequence.patterns);
  sequence.patterns.clear();
  for (Pattern pattern : once) {
    for (const double exposure : advice.exposures) {
      pattern.exposure = exposure;
      sequence.patterns.push_back(pattern);
    }
  }
  return sequence;
}

ObservedMotion observed_motion(const FringeStack& stack, const RigModel& rig, const PixelRays& rays,
                               const cv::Mat1f& depth_m, Axis axis) {
  if (has_exposures(stack.patterns) || fringe_groups(stack.patterns, axis).size() < 2) return ObservedMotion::unknown;
  const double clip_dn = DecodeOptions().saturation * rig.sensor.saturation_dn();
  if (!shows_motion(stack, rig, rays, depth_m, clip_dn, axis).value_or(false)) return ObservedMotion::none;
  // Indirect light makes the periods disagree, too, but no motion explains it.
  const StackMotion found =
      estimate_stack_motion(stack, rig, rays, depth_m, clip_dn, unknown_motion({}), MotionSearch::wide, axis);
  return found.converged && is_moving(found) ? ObservedMotion::moving : ObservedMotion::none;
}

PatternSequence period_test_patterns(const PatternSequence& taken) {
  constexpr int kPeriods = 3;
  const PatternSequence sequence = at_one_exposure(taken);
  const Axis axis = advice_axis(sequence);
  const std::vector<FringeGroup> groups = fringe_groups(sequence, axis);
  const int length = length_of(sequence, axis);
  return design_sequence(
      periods_design(sequence, kPeriods, groups.empty() ? typical_period_px(length) : groups.back().period_px, length));
}

ExposureChoice present_exposures(const Advice& advice, double wanted) {
  const auto present = std::find_if(advice.alternatives.begin(), advice.alternatives.end(),
                                    [](const CodingChoice& choice) { return choice.current; });
  if (present == advice.alternatives.end() || present->covered.empty())
    throw Error("its patterns determine no coordinates");
  const std::vector<double>& covered = present->covered;
  const double most = *std::max_element(covered.begin(), covered.end());
  const auto enough =
      std::find_if(covered.begin(), covered.end(), [&](double share) { return share >= wanted * most; });
  return {present->exposures[static_cast<size_t>(enough - covered.begin())], *enough};
}

Axis advice_axis(const PatternSequence& sequence) {
  for (const Axis axis : {Axis::columns, Axis::rows}) {
    if (codes_axis(sequence, axis)) return axis;
  }
  for (const Axis axis : {Axis::columns, Axis::rows}) require_decoder(sequence, axis);
  throw Error("its patterns code neither columns nor rows");
}

ViewEvidence examine(const FringeStack& stack, const RigModel& rig, const DecodeOptions& options, Axis axis) {
  ViewEvidence view;
  view.index = stack.index;
  view.light = survey_light(stack, rig.sensor, options, axis);
  DecodeContext context;
  context.axis = axis;
  DecodeOptions decoding = options;
  const std::optional<Unwrapping> method = method_of(stack.patterns, rig, options, axis);
  if (!method) {
    decoding.unwrapping = Unwrapping::spatial;
    decoding.spatial_reference = SpatialReference::none;
  }
  const bool fringes = !select_groups(at_one_exposure(stack.patterns), axis, options).empty();
  DecodedStack& decoded = view.decoded;
  if (method || fringes) decoded = decode(stack, rig, decoding, context);
  if (method) {
    decoding.max_order_residual_sigma = kNoLimit;
    view.agreement =
        compare_periods(stack, rig.sensor, options, axis, decode(stack, rig, decoding, context), view.light);
  }
  const SignalDemand demand = demand_of(at_one_exposure(stack.patterns), rig, options, axis).value_or(SignalDemand{});
  const SignalLimits limits(rig.sensor, options, demand, view.light.noise_ratio);
  std::vector<float> modulations, sigmas;
  const PixelLight& light = view.light;
  for (int row = 0; row < light.state.rows; ++row) {
    for (int col = 0; col < light.state.cols; ++col) {
      ++view.pixels;
      const LightState state = light.at(row, col);
      const bool valid =
          decoded.unwrapping && !std::isnan(method ? decoded.coordinate_px(row, col) : decoded.wrapped_phase(row, col));
      view.valid += valid;
      if (valid && decoded.finest_period_px > 0)
        sigmas.push_back(decoded.sigma_px(row, col) * static_cast<float>(kTwoPi / decoded.finest_period_px));
      view.hidden += state == LightState::hidden;
      view.saturated += state == LightState::hidden || state == LightState::estimated;
      view.unlit += state == LightState::unlit;
      if (state != LightState::lit) continue;
      ++view.lit;
      modulations.push_back(light.modulation_dn(row, col));
      if (valid) continue;
      const bool noisy = limits.too_dark(static_cast<double>(light.mean_dn(row, col)),
                                         static_cast<double>(light.modulation_dn(row, col)), light.longest);
      ++(noisy ? view.noisy : view.rejected);
    }
  }
  const auto quantile = [](std::vector<float>& values, double q) {
    if (values.empty()) return std::numeric_limits<double>::quiet_NaN();
    const auto at = values.begin() + static_cast<std::ptrdiff_t>(q * static_cast<double>(values.size() - 1));
    std::nth_element(values.begin(), at, values.end());
    return static_cast<double>(*at);
  };
  for (size_t i = 0; i < kModulationQuantiles.size(); ++i)
    view.modulation_dn[i] = quantile(modulations, kModulationQuantiles[i]);
  view.phase_sigma_rad = quantile(sigmas, 0.5);
  return view;
}

void add_look(ViewEvidence& view, const FringeStack& look, const RigModel& rig, const DecodeOptions& options,
              Axis axis) {
  add_look(view.light, survey_light(look, rig.sensor, options, axis));
}

Advice advise(const std::vector<ViewEvidence>& views, const PatternSequence& sequence, const RigModel& rig,
              const DecodeOptions& decoding, const AdviceOptions& options, ObservedMotion motion) {
  check_options(options, "advice");
  const Axis axis = advice_axis(sequence);
  const bool moving = motion == ObservedMotion::moving;
  Advice advice;
  advice.motion = motion;

  // Indirect light.
  int64_t tested = 0, biased = 0, hidden = 0;
  double ripple_rad = 0, sigma_rad = 0, shortest = options.longest;
  for (const ViewEvidence& view : views) {
    shortest = std::min(shortest, view.light.shortest);
    if (!view.agreement || view.agreement->tested == 0) continue;
    tested += view.agreement->tested;
    biased += view.agreement->biased;
    ripple_rad = std::max(ripple_rad, view.agreement->ripple_rad);
    sigma_rad = std::max(sigma_rad, view.agreement->sigma_rad);
  }
  const double tolerated = 1 - options.covered;
  advice.biased_share = share(biased, tested);
  // After removal of its ripple, a nonlinear projector leaves errors that look like indirect light.
  constexpr double kStrongRipple = 4;
  advice.ripple_rad = ripple_rad;
  advice.nonlinear = motion != ObservedMotion::moving && ripple_rad > kStrongRipple * sigma_rad;
  if (motion != ObservedMotion::moving && !advice.nonlinear && tested > 0)
    advice.indirect = advice.biased_share > tolerated ? ObservedIndirect::present : ObservedIndirect::none;

  // Codings, by the exposures that they need.
  std::vector<CodingChoice> all = codings(sequence, rig, decoding, axis);
  if (all.empty())
    throw Error("no coding is known for its projector of " + std::to_string(length_of(sequence, axis)) + " px");
  const int first = ExposureGrid::nearest(options.shortest), last = ExposureGrid::nearest(options.longest);
  double range = 1;
  int64_t most = 0, lit_pixels = 0;
  std::vector<ExposureIntervals> demanded(all.size());
  for (size_t c = 0; c < all.size(); ++c) {
    ExposureIntervals& intervals = demanded[c];
    for (const ViewEvidence& view : views) {
      // Residuals of a moving stack are no noise.
      PixelLight light = view.light;
      if (motion == ObservedMotion::moving || advice.nonlinear) light.noise_ratio = 1;
      intervals.add(light, rig.sensor, decoding, all[c].demand);
    }
    lit_pixels = intervals.decodable() + intervals.hopeless() + intervals.hidden();
    hidden = intervals.hidden();
    most = std::max(most, intervals.decodable());
    range = std::max(range, intervals.median_range());
  }
  if (most == 0)
    throw Error(
        "no pixel can be decoded at any exposure: each is dark or saturated; check the light, the exposure and "
        "what the camera sees");
  const auto wanted_pixels = static_cast<int64_t>(std::ceil(options.covered * static_cast<double>(most)));
  for (size_t c = 0; c < all.size(); ++c) {
    CodingChoice& choice = all[c];
    const int count = choice.decodes_exposures && !moving ? options.most_exposures : 1;
    int64_t before = 0;
    for (int k = 1; k <= count && before < wanted_pixels; ++k) {
      // Longer exposures blur moving images.
      const std::vector<int> steps =
          moving   ? std::vector<int>{ExposureGrid::nearest(1)}
          : k == 1 ? std::vector<int>{single_exposure(demanded[c], first, last, wanted_pixels, options.covered)}
                   : shortest_enough(demanded[c], k, first, last, wanted_pixels);
      if (steps.empty()) break;
      const int64_t covered = demanded[c].covered(steps);
      // One more exposure must be worth its images.
      if (k > 1 && static_cast<double>(covered - before) < tolerated * static_cast<double>(most)) break;
      before = covered;
      std::vector<double> exposures;
      for (const int step : steps) exposures.push_back(rounded(ExposureGrid::exposure(step), 3));
      choice.exposures.push_back(exposures);
      choice.covered.push_back(share(covered, lit_pixels));
    }
  }
  // The shortest capture that decodes the wanted share of what any coding decodes; else the largest share.
  const double wanted = share(wanted_pixels, lit_pixels);
  const bool indirect = advice.indirect == ObservedIndirect::present;
  const bool kept =
      advice.indirect == ObservedIndirect::unknown && !moving && all.front().current && all.front().resists_indirect;
  const bool must_resist = indirect || kept;
  const CodingChoice* chosen = nullptr;
  size_t exposures = 0;
  // Duration of the exposures of a view, where the present exposure is the display time of a pattern.
  const auto duration = [](const CodingChoice& choice, size_t k) {
    double sum = 0;
    for (const double exposure : choice.exposures[k]) sum += std::max(1.0, exposure);
    return sum * choice.images;
  };
  for (const CodingChoice& choice : all) {
    // Without indirect light, other codings than the present one need not resist it; where it is unknown, a coding that
    // resists it is kept.
    if (must_resist && !moving ? !choice.resists_indirect : choice.resists_indirect && !choice.current) continue;
    if (moving && !choice.decodes_motion) continue;
    // The periods of a moving stack determine its motion, and a nonlinear response must be corrected first.
    if ((moving || advice.nonlinear) && chosen && chosen->current) break;
    for (size_t k = 0; k < choice.covered.size(); ++k) {
      const bool enough = choice.covered[k] >= wanted, chosen_enough = chosen && chosen->covered[exposures] >= wanted;
      const bool better = !chosen || (enough && !chosen_enough) ||
                          (enough && duration(choice, k) < duration(*chosen, exposures)) ||
                          (!enough && !chosen_enough && choice.covered[k] > chosen->covered[exposures]);
      if (!better) continue;
      chosen = &choice;
      exposures = k;
    }
  }
  if (!chosen) chosen = &all.front();
  advice.coding = *chosen;
  advice.exposures = chosen->exposures[exposures];
  advice.images = chosen->images * static_cast<int>(exposures + 1);
  advice.covered = chosen->covered[exposures];
  advice.alternatives = all;
  advice.hidden_share = share(hidden, lit_pixels);
  if (advice.hidden_share > tolerated) {
    constexpr double kLeastRatio = 4;
    advice.look_first = rounded(shortest / std::max(kLeastRatio, std::exp2(std::floor(std::log2(range)))), 3);
  }
  return advice;
}

}  // namespace fringeslam
