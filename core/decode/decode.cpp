// SPDX-License-Identifier: Apache-2.0
#include "core/decode/decode.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>

#include "core/base/constants.h"
#include "core/base/parallel.h"
#include "core/decode/ensemble.h"
#include "core/decode/exposures.h"
#include "core/decode/gray.h"
#include "core/decode/gray_in_motion.h"
#include "core/decode/micro_phase.h"
#include "core/decode/modulated.h"
#include "core/decode/spatial.h"
#include "core/decode/steps.h"
#include "core/decode/unwrapping_levels.h"
#include "core/patterns/design.h"
#include "core/types/error.h"

namespace fringeslam {

namespace {

constexpr double kHalfPeriod = 0.51;  // widest cells of a complementary Gray code, in periods
constexpr double kGrayEdgePx = 1;     // blur of an edge between Gray cells extends this far into the cells

// Throws Error unless the working range spans less than a period for most rays, as `geometric` requires.
void check_geometric(const RigModel& rig, double period_px, Axis axis) {
  constexpr int kGrid = 12;
  Pinhole coarse = rig.camera;
  coarse.width = coarse.height = kGrid;
  PixelRays rays(kGrid, kGrid);
  for (int row = 0; row < kGrid; ++row) {
    for (int col = 0; col < kGrid; ++col) {
      const Eigen::Vector2d ray = rig.camera.undistort(
          {(col + 0.5) * rig.camera.width / kGrid - 0.5, (row + 0.5) * rig.camera.height / kGrid - 0.5});
      rays(row, col) = {static_cast<float>(ray.x()), static_cast<float>(ray.y())};
    }
  }
  const CoordinatePrior bounds = coordinate_bounds(rig, rays, axis);
  int in_beam = 0, served = 0;
  double widest = 0;
  for (int row = 0; row < kGrid; ++row) {
    for (int col = 0; col < kGrid; ++col) {
      if (std::isnan(bounds.coordinate_px(row, col))) continue;
      const double width = 2.0 * static_cast<double>(bounds.half_width_px(row, col));
      ++in_beam;
      served += width < period_px;
      widest = std::max(widest, width);
    }
  }
  if (2 * served < in_beam || in_beam == 0)
    throw Error("the range " + to_text(rig.near_m) + " to " + to_text(rig.far_m) + " m spans up to " +
                std::to_string(std::lround(widest)) + " px of the projector, more than a period of " +
                to_text(period_px) + " px; use a longer period or a narrower range");
}

bool numbers_periods(const GrayDecoder& decoder, const FringeGroup& group) {
  return decoder.cell_px() <= group.period_px * (1 + 1e-9);
}

// True if neighboring orders differ in more than one bit, of which motion may leave one at an edge.
bool numbers_half_periods(const GrayDecoder& decoder, const FringeGroup& group) {
  return decoder.cell_px() <= kHalfPeriod * group.period_px;
}

std::vector<EnsembleMember> ensemble_members(const PatternSequence& sequence, const RigModel& rig,
                                             const DecodeOptions& options, const DecodeContext& context);

// Returns the reason why a method cannot be used; empty if it can.
std::optional<std::string> obstacle(Unwrapping method, const PatternSequence& sequence, const RigModel& rig,
                                    const DecodeOptions& options, const DecodeContext& context) {
  try {
    // The two fringes of a product are orthogonal to each other only if all images have the same weight.
    const bool several_exposures = has_exposures(sequence);
    if (several_exposures &&
        (method == Unwrapping::gray || method == Unwrapping::micro || method == Unwrapping::modulated))
      throw Error("images of several exposures can be decoded by fringes of several periods, not by this method");
    // The exposures of a pattern are combined to one image.
    const std::vector<FringeGroup> groups =
        select_groups(several_exposures ? at_one_exposure(sequence) : sequence, context.axis, options);
    const int length = length_of(sequence, context.axis);
    if (method == Unwrapping::gray) {
      const StepEstimator any = groups.empty() ? StepEstimator{} : least_squares(groups.back());
      const GrayDecoder decoder(sequence, context.axis, groups.empty() ? nullptr : &any);
      if (!groups.empty() && !numbers_periods(decoder, groups.front()))
        throw Error("the Gray code's cells of " + to_text(decoder.cell_px()) +
                    " px are wider than the longest period, " + to_text(groups.front().period_px) +
                    " px; add finer bits");
      return std::nullopt;
    }
    if (method == Unwrapping::ensemble) {
      if (ensemble_members(sequence, rig, options, context).size() < 2)
        throw Error(
            "an ensemble needs two codings that give fringe orders by themselves, such as two Gray codes "
            "(`gray_xor_px: [0, 8]`) or fringes of several periods and a Gray code");
      return std::nullopt;
    }
    if (method == Unwrapping::modulated) {
      modulated_code(sequence, context.axis, length);
      return std::nullopt;
    }
    if (groups.empty()) throw Error(std::string("the sequence has no fringes along ") + to_string(context.axis));
    if (method == Unwrapping::multifrequency) multifrequency_levels(groups, length);
    if (method == Unwrapping::heterodyne) {
      if (groups.size() < 2) throw Error("a beat needs two fringe periods; the sequence has one");
      heterodyne_levels(groups, length);
    }
    if (method == Unwrapping::micro) MicroDecoder(sequence, context.axis, least_squares(groups.back()), length);
    if (method == Unwrapping::geometric) check_geometric(rig, groups.back().period_px, context.axis);
    if (method == Unwrapping::predicted && !context.expected)
      throw Error("no coordinate is predicted: there is no map to predict from");
  } catch (const Error& e) {
    return e.what();
  }
  return std::nullopt;
}

// The patterns of a sequence that `images` selects.
PatternSequence selected(const PatternSequence& sequence, const std::vector<bool>& images) {
  PatternSequence part{sequence.width, sequence.height, {}, sequence.inverse_response};
  for (size_t i = 0; i < images.size(); ++i) {
    if (images[i]) part.patterns.push_back(sequence.patterns[i]);
  }
  return part;
}

std::vector<EnsembleMember> ensemble_members(const PatternSequence& sequence, const RigModel& rig,
                                             const DecodeOptions& options, const DecodeContext& context) {
  std::vector<EnsembleMember> members = possible_members(sequence, context.axis);
  std::erase_if(members, [&](const EnsembleMember& member) {
    return obstacle(member.method, selected(sequence, member.images), rig, options, context).has_value();
  });
  // Fringes whose longest period covers the projector need no beats.
  const auto is = [](Unwrapping method) {
    return [=](const EnsembleMember& member) { return member.method == method; };
  };
  if (std::any_of(members.begin(), members.end(), is(Unwrapping::multifrequency)))
    std::erase_if(members, is(Unwrapping::heterodyne));
  return members;
}

// True if several Gray codes code the axis: they are projected in order to be compared.
bool has_several_codes(const PatternSequence& sequence, const RigModel& rig, const DecodeOptions& options,
                       const DecodeContext& context) {
  if (gray_codes(sequence, context.axis).size() < 2) return false;
  const std::vector<EnsembleMember> members = ensemble_members(sequence, rig, options, context);
  return std::count_if(members.begin(), members.end(),
                       [](const EnsembleMember& member) { return member.method == Unwrapping::gray; }) > 1;
}

bool is_ensemble(const PatternSequence& sequence, const RigModel& rig, const DecodeOptions& options,
                 const DecodeContext& context) {
  return options.unwrapping == Unwrapping::ensemble ||
         (options.unwrapping == Unwrapping::automatic && has_several_codes(sequence, rig, options, context));
}

// Returns the first method that the sequence supports; empty if there is none.
std::optional<Unwrapping> first_usable_method(const PatternSequence& sequence, const RigModel& rig,
                                              const DecodeOptions& options, const DecodeContext& context) {
  using enum Unwrapping;
  for (const Unwrapping method : {multifrequency, gray, micro, modulated, heterodyne, predicted, geometric}) {
    if (!obstacle(method, sequence, rig, options, context)) return method;
  }
  return std::nullopt;
}

// Returns the method that the reference names; empty for automatic and none.
std::optional<Unwrapping> method_of(SpatialReference reference) {
  switch (reference) {
    case SpatialReference::automatic:
    case SpatialReference::none:
      return std::nullopt;
    case SpatialReference::multifrequency:
      return Unwrapping::multifrequency;
    case SpatialReference::heterodyne:
      return Unwrapping::heterodyne;
    case SpatialReference::gray:
      return Unwrapping::gray;
    case SpatialReference::micro:
      return Unwrapping::micro;
    case SpatialReference::modulated:
      return Unwrapping::modulated;
    case SpatialReference::geometric:
      return Unwrapping::geometric;
    case SpatialReference::predicted:
      return Unwrapping::predicted;
  }
  return std::nullopt;
}

// Returns the method that votes on the fringe orders; empty if they remain relative.
std::optional<Unwrapping> spatial_reference(const PatternSequence& sequence, const RigModel& rig,
                                            const DecodeOptions& options, const DecodeContext& context) {
  if (options.spatial_reference == SpatialReference::automatic)
    return first_usable_method(sequence, rig, options, context);
  const std::optional<Unwrapping> method = method_of(options.spatial_reference);
  if (!method) return std::nullopt;
  if (const auto reason = obstacle(*method, sequence, rig, options, context))
    throw Error(std::string("decode.spatial_reference=") + to_string(*method) + ": " + *reason);
  return method;
}

// The shifts of a group's images relative to the surfaces, by the median drift of each image.
std::vector<double> shifts_after_drift(const FringeGroup& group, const AlignedStack& aligned) {
  constexpr int kStride = 16;
  std::vector<double> shifts_rad = group.shifts_rad;
  for (size_t k = 0; k < group.images.size(); ++k) {
    const cv::Mat1f& drift_px = aligned.drift_px[static_cast<size_t>(group.images[k])];
    std::vector<float> known;
    for (int row = kStride / 2; row < drift_px.rows; row += kStride) {
      for (int col = kStride / 2; col < drift_px.cols; col += kStride) {
        if (!std::isnan(drift_px(row, col))) known.push_back(drift_px(row, col));
      }
    }
    if (known.empty()) continue;
    const auto middle = known.begin() + static_cast<std::ptrdiff_t>(known.size() / 2);
    std::nth_element(known.begin(), middle, known.end());
    shifts_rad[k] += kTwoPi * static_cast<double>(*middle) / group.period_px;
  }
  return shifts_rad;
}

// Corrects a phase for the projector's response. In motion, the drift changes the shifts, and so do those that anticipate a
// motion: the correction is that of the nearest equally spaced ones, and an error remains that grows with the distance from them.
void set_correction(StepEstimator& estimator, FringeGroup group, const PhaseCorrection& correction,
                    const AlignedStack* aligned) {
  const bool usable = !correction.offset_rad.empty() && correction.steps == static_cast<int>(group.images.size());
  if (!usable) return;
  if (!aligned) estimator.correction_turns = correction_of(group, correction);
  if (!estimator.correction_turns.empty()) return;
  const EvenShifts even = nearest_even(aligned ? shifts_after_drift(group, *aligned) : group.shifts_rad);
  group.shifts_rad = even.shifts_rad;
  estimator.correction_turns = correction_of(group, correction);
  double squares = 0;
  for (const float turns : estimator.correction_turns)
    squares += static_cast<double>(turns * turns) / static_cast<double>(estimator.correction_turns.size());
  estimator.error_turns2 = static_cast<float>(even.remaining() * squares);
  if (!even.near()) estimator.correction_turns.clear();
}

// `corrected`: the patterns already compensate for the projector's response. `aligned`: images in motion.
RowPlan make_plan(const std::vector<FringeGroup>& groups, int length_px, const RigModel& rig,
                  const DecodeOptions& options, bool corrected, const AlignedStack* aligned) {
  RowPlan plan;
  for (const FringeGroup& group : groups) {
    plan.groups.push_back(least_squares(group));
    if (!corrected) set_correction(plan.groups.back(), group, rig.phase_correction, aligned);
  }
  plan.period_px = groups.empty() ? 0 : groups.back().period_px;
  plan.length_px = length_px;
  const SensorModel& sensor = rig.sensor;
  plan.noise_constant = static_cast<float>(sensor.variance_dn2(sensor.offset_dn));
  plan.noise_per_dn = static_cast<float>(sensor.gain_dn_per_electron);
  plan.offset_dn = static_cast<float>(sensor.offset_dn);
  plan.clip_dn = static_cast<float>(options.saturation * sensor.saturation_dn());
  plan.min_modulation_dn = static_cast<float>(options.min_modulation_dn);
  plan.min_data_modulation = static_cast<float>(options.min_data_modulation);
  plan.max_sigma_turns = static_cast<float>(options.max_phase_sigma_rad / kTwoPi);
  plan.max_order_failure = static_cast<float>(options.max_order_failure);
  plan.max_residual_sigma = static_cast<float>(options.max_order_residual_sigma);
  return plan;
}

// Provides rows of a stack's images as floats.
class RowReader {
 public:
  RowReader(const FringeStack& stack, const AlignedStack* aligned, const CombinedExposures* combined,
            RowScratch& scratch)
      : stack_(stack), aligned_(aligned), combined_(combined), scratch_(scratch) {
    scratch_.samples.resize(stack.images.size());
    if (combined) scratch_.variances.resize(stack.images.size());
    if (aligned)
      scratch_.drift_px.resize(stack.images.size());
    else if (stack.images.front().depth() != CV_32F)
      converted_.resize(stack.images.size() * static_cast<size_t>(stack.images.front().cols));
  }

  void read(int row) {
    const auto width = static_cast<size_t>(stack_.images.front().cols);
    for (size_t i = 0; i < stack_.images.size(); ++i) {
      if (aligned_) {
        scratch_.samples[i] = aligned_->images[i][row];
        scratch_.drift_px[i] = aligned_->drift_px[i][row];
        continue;
      }
      if (combined_) scratch_.variances[i] = combined_->variance_dn2[i][row];
      const cv::Mat& image = stack_.images[i];
      if (image.depth() == CV_32F) {
        scratch_.samples[i] = image.ptr<float>(row);
        continue;
      }
      float* target = converted_.data() + i * width;
      if (image.depth() == CV_8U)
        std::copy_n(image.ptr<uchar>(row), width, target);
      else
        std::copy_n(image.ptr<ushort>(row), width, target);
      scratch_.samples[i] = target;
    }
  }

 private:
  const FringeStack& stack_;
  const AlignedStack* aligned_;
  const CombinedExposures* combined_;
  RowScratch& scratch_;
  std::vector<float> converted_;
};

void prior_row(const CoordinatePrior& expected, int row, double period_px, RowPrior& anchor) {
  const auto per_turn = static_cast<float>(1 / period_px);
  const float *coordinate = expected.coordinate_px[row], *half_width = expected.half_width_px[row],
              *sigma = expected.sigma_px[row];
  for (size_t i = 0; i < anchor.turns.size(); ++i) {
    anchor.turns[i] = (coordinate[i] + 0.5f) * per_turn;
    anchor.half_width[i] = half_width[i] * per_turn;
    anchor.sigma[i] = sigma[i] * per_turn;
    anchor.failure[i] = 0;
  }
}

// At the edge between two cells, noise may select either neighbour; this is harmless for cells of half a period.
void gray_row(const GrayDecoder& gray, const RowPlan& plan, const float* const* samples, RowPrior& anchor) {
  const double cell = gray.cell_px(), period = plan.period_px;
  const bool neighbours_matter = cell > kHalfPeriod * period;
  for (size_t i = 0; i < anchor.turns.size(); ++i) {
    const GrayDecoder::Reading reading = gray.read(plan, samples, static_cast<int>(i));
    const double failure = reading.far + (neighbours_matter ? reading.neighbour : 0);
    const bool dim = reading.contrast_dn < kLeastGrayContrast * reading.best_contrast_dn;
    anchor.turns[i] = dim ? kNaN : static_cast<float>((reading.cell + 0.5) * cell / period);
    anchor.half_width[i] = static_cast<float>((0.5 * cell + kGrayEdgePx) / period);
    anchor.sigma[i] = 0;
    anchor.failure[i] = static_cast<float>(failure);
  }
}

// Images that a stack without fringes averages for its texture: all but those that decoders ignore.
std::vector<int> averaged_images(const PatternSequence& sequence) {
  std::vector<int> images;
  for (size_t i = 0; i < sequence.patterns.size(); ++i) {
    const Coding coding = sequence.patterns[i].coding;
    if (coding != Coding::extra && coding != Coding::product) images.push_back(static_cast<int>(i));
  }
  return images;
}

// Without fringes, the coordinate is the cell centre with a uniform error over the cell. Bits with cells near the
// resolution of the lenses have low contrast, but reading them wrongly moves the coordinate by only a few cells.
void gray_only_row(const GrayDecoder& gray, const RowPlan& plan, const DecodeOptions& options,
                   const float* const* samples, const std::vector<int>& averaged, int width, const RowOutput& out) {
  const double cell = gray.cell_px();
  const auto least_contrast_dn = static_cast<float>(options.min_modulation_dn);
  for (int i = 0; i < width; ++i) {
    const GrayDecoder::Reading reading = gray.read(plan, samples, i, least_contrast_dn);
    float sum = 0;
    for (const int k : averaged) sum += samples[k][i];
    out.mean[i] = sum / static_cast<float>(averaged.size());
    out.modulation[i] = reading.best_contrast_dn;
    const double coordinate = (reading.cell + 0.5) * cell - 0.5;
    const bool valid = reading.best_contrast_dn >= least_contrast_dn && reading.far <= options.max_order_failure &&
                       coordinate < plan.length_px - 0.5;
    out.wrapped_phase[i] = kNaN;
    out.order[i] = valid ? reading.cell : -1;
    out.coordinate[i] = valid ? static_cast<float>(coordinate) : kNaN;
    out.sigma[i] = valid ? static_cast<float>(cell * std::sqrt(1 / 12.0 + reading.variance_cells2)) : kNaN;
    out.confidence[i] = valid ? static_cast<float>(1 - reading.far) : kNaN;
  }
}

// Assigns the orders of components by vote. A pixel whose own order contradicts that of its component is invalid,
// because one of the two is wrong.
void assign_spatial_orders(DecodedStack& out, const DecodeOptions& options, double length_px) {
  const SpatialOrders spatial =
      options.spatial_order == SpatialOrdering::quality
          ? unwrap_by_quality(out.wrapped_phase, out.sigma_px, options.max_spatial_step_rad, out.fringe_order)
          : unwrap_by_reliability(out.wrapped_phase, options.max_spatial_step_rad, out.fringe_order);
  const std::vector<ComponentOrder> components = vote(spatial, out.fringe_order, options.min_vote);
  out.component = spatial.component;
  out.components.clear();
  for (const ComponentOrder& component : components) out.components.push_back(component.summary);
  out.relative_phase.create(out.wrapped_phase.size());
  const auto turn = static_cast<float>(kTwoPi);
  const auto period = static_cast<float>(out.finest_period_px);
  for_each_row(out.wrapped_phase.rows, [&](int row) {
    for (int col = 0; col < out.wrapped_phase.cols; ++col) {
      const int index = spatial.component(row, col), own = out.fringe_order(row, col);
      out.fringe_order(row, col) = -1;
      out.coordinate_px(row, col) = out.confidence(row, col) = out.relative_phase(row, col) = kNaN;
      if (index < 0) continue;
      const ComponentOrder& component = components[static_cast<size_t>(index)];
      const int order = spatial.order(row, col) + component.shift;
      const float phase = out.wrapped_phase(row, col);
      out.relative_phase(row, col) = phase + turn * static_cast<float>(order);
      const float coordinate = (phase / turn + static_cast<float>(order)) * period - 0.5f;
      const bool agrees = component.summary.absolute && component.summary.pixels >= options.min_component_px &&
                          (own < 0 || own == order) && coordinate >= -1 && coordinate < static_cast<float>(length_px);
      if (!agrees) continue;
      out.fringe_order(row, col) = order;
      out.coordinate_px(row, col) = coordinate;
      out.confidence(row, col) = static_cast<float>(component.summary.agreement);
    }
  });
}

}  // namespace

Unwrapping resolve_unwrapping(const PatternSequence& sequence, const RigModel& rig, const DecodeOptions& options,
                              const DecodeContext& context) {
  check_options(options, "decode");
  require_decoder(sequence, context.axis);
  if (options.unwrapping == Unwrapping::automatic) {
    if (is_ensemble(sequence, rig, options, context)) return Unwrapping::ensemble;
    if (const auto method = first_usable_method(sequence, rig, options, context)) return *method;
    const std::string reason = *obstacle(Unwrapping::multifrequency, sequence, rig, options, context);
    const bool too_short = reason.starts_with("no fringe period covers");
    throw Error("patterns: " + reason +
                (too_short ? ", or a Gray code, or periods whose beat does; decode.unwrapping=spatial gives relative "
                             "phases without any"
                           : ""));
  }
  if (const auto reason = obstacle(options.unwrapping, sequence, rig, options, context))
    throw Error(std::string("decode.unwrapping=") + to_string(options.unwrapping) + ": " + *reason);
  if (options.unwrapping == Unwrapping::spatial) spatial_reference(sequence, rig, options, context);
  return options.unwrapping;
}

bool decodes_in_motion(const PatternSequence& sequence, const RigModel& rig, const DecodeOptions& options,
                       const DecodeContext& context) {
  std::optional<Unwrapping> method = resolve_unwrapping(sequence, rig, options, context);
  if (method == Unwrapping::spatial) method = spatial_reference(sequence, rig, options, context);
  if (method == Unwrapping::gray) {
    const std::vector<FringeGroup> groups = select_groups(sequence, context.axis, options);
    if (groups.empty()) return false;
    const StepEstimator any = least_squares(groups.back());
    return numbers_half_periods(GrayDecoder(sequence, context.axis, &any), groups.back());
  }
  return method != Unwrapping::ensemble && method != Unwrapping::micro && method != Unwrapping::modulated;
}

namespace {

// The images of a stack whose patterns satisfy a condition.
template <class Keep>
FringeStack images_of(const FringeStack& stack, Keep&& keep) {
  FringeStack part;
  part.index = stack.index;
  part.timestamp_s = stack.timestamp_s;
  part.patterns = {stack.patterns.width, stack.patterns.height, {}, stack.patterns.inverse_response};
  for (size_t i = 0; i < stack.images.size(); ++i) {
    if (!keep(stack.patterns.patterns[i])) continue;
    part.patterns.patterns.push_back(stack.patterns.patterns[i]);
    part.images.push_back(stack.images[i]);
    part.exposure_s.push_back(stack.exposure_s[i]);
    part.exposure_time_s.push_back(stack.exposure_time_s[i]);
  }
  return part;
}

// Decodes a Gray code that numbers a coarser period than the finest: first that period, then each finer one as predicted
// by the one before.
void decode_finer_than_gray(DecodedStack& out, const FringeStack& stack, const RigModel& rig,
                            const DecodeOptions& options, const DecodeContext& context,
                            const std::vector<FringeGroup>& groups, size_t numbered) {
  const auto has_period = [&](const Pattern& p, const FringeGroup& group) {
    return p.coding == Coding::fringe && p.axis == context.axis && p.period_px == group.period_px;
  };
  DecodeOptions coarser = options, finer = options;
  coarser.unwrapping = Unwrapping::gray;
  finer.unwrapping = Unwrapping::predicted;
  decode_into(
      out,
      images_of(stack, [&](const Pattern& p) { return p.coding != Coding::fringe || has_period(p, groups[numbered]); }),
      rig, coarser, context);
  for (size_t g = numbered + 1; g < groups.size(); ++g) {
    const CoordinatePrior before{out.coordinate_px.clone(), cv::Mat1f(out.coordinate_px.size(), 0.0f),
                                 out.sigma_px.clone()};
    const cv::Mat1f confidence = out.confidence.clone();
    DecodeContext predicted = context;
    predicted.expected = &before;
    decode_into(out, images_of(stack, [&](const Pattern& p) { return has_period(p, groups[g]); }), rig, finer,
                predicted);
    out.confidence = out.confidence.mul(confidence);
  }
  out.unwrapping = Unwrapping::gray;
}

void decode_ensemble(DecodedStack& out, const FringeStack& stack, const RigModel& rig, const DecodeOptions& options,
                     const DecodeContext& context) {
  if (context.aligned) throw Error("decode: images in motion cannot be decoded by an ensemble of codings");
  std::vector<DecodedStack> decoded;
  for (const EnsembleMember& member : ensemble_members(stack.patterns, rig, options, context)) {
    DecodeOptions single = options;
    single.unwrapping = member.method;
    size_t i = 0;
    decoded.push_back(
        decode(images_of(stack, [&](const Pattern&) { return member.images[i++]; }), rig, single, context));
  }
  out = agreement_of(decoded, options.max_order_residual_sigma);
}

// Decodes a stack with one image per pattern. `taken`: the patterns of the images as taken, of which those of
// `combined`, if any, combine the exposures.
void decode_images(DecodedStack& out, const FringeStack& stack, const PatternSequence& taken,
                   const CombinedExposures* combined, const RigModel& rig, const DecodeOptions& options,
                   const DecodeContext& context) {
  const PatternSequence& sequence = stack.patterns;
  out.unwrapping = resolve_unwrapping(taken, rig, options, context);
  const std::optional<Unwrapping> method =
      out.unwrapping == Unwrapping::spatial ? spatial_reference(taken, rig, options, context) : out.unwrapping;
  const int length = length_of(sequence, context.axis);
  std::vector<FringeGroup> groups = select_groups(sequence, context.axis, options);
  out.omitted_period_px = 0;
  if (context.aligned && groups.size() > 1 &&
      (method == Unwrapping::multifrequency || method == Unwrapping::predicted || method == Unwrapping::gray)) {
    const size_t used = most_accurate_group(*context.aligned, groups) + 1;
    if (used < groups.size()) out.omitted_period_px = groups.back().period_px;
    groups.resize(used);
  }
  // Use only the finest period; coarser images, if any, may have been taken at another pose, or contain indirect light.
  const bool gray_in_motion = method == Unwrapping::gray && context.aligned && !groups.empty();
  if (method == Unwrapping::predicted || method == Unwrapping::micro || gray_in_motion)
    groups.erase(groups.begin(), groups.end() - 1);
  std::vector<UnwrappingLevel> modulated_levels;
  if (method == Unwrapping::modulated) {
    if (context.aligned) throw Error("decode: images in motion cannot be decoded by modulated phase shifting");
    ModulatedCode code = modulated_code(sequence, context.axis, length);
    groups = std::move(code.groups);
    modulated_levels = std::move(code.levels);
  }
  RowPlan plan = make_plan(groups, length, rig, options, !sequence.inverse_response.empty(), context.aligned);
  plan.unwrapping_levels = std::move(modulated_levels);
  if (combined) {
    plan.clip_dn = combined->clip_dn;
    plan.min_modulation_dn /= static_cast<float>(combined->longest);
  }
  if (method == Unwrapping::multifrequency) plan.unwrapping_levels = multifrequency_levels(groups, length);
  if (method == Unwrapping::heterodyne) plan.unwrapping_levels = heterodyne_levels(groups, length);
  std::optional<GrayDecoder> gray;
  if (method == Unwrapping::gray) gray.emplace(sequence, context.axis, groups.empty() ? nullptr : &plan.groups.back());
  std::optional<GrayOrdersInMotion> moving_gray;
  RowPlan wrapped_only;
  if (gray_in_motion) {
    moving_gray.emplace(sequence, context.axis, plan.period_px);
    wrapped_only = plan;
  }
  std::optional<MicroDecoder> micro;
  if (method == Unwrapping::micro) {
    if (context.aligned) throw Error("decode: images in motion cannot be decoded by micro phase shifting");
    micro.emplace(sequence, context.axis, plan.groups.back(), length);
  }
  if (gray_in_motion && !numbers_half_periods(*gray, groups.back()))
    throw Error("decode: images in motion need a Gray code with cells no wider than half of the finest period");
  if (gray && !groups.empty() && !numbers_periods(*gray, groups.back())) {
    size_t numbered = groups.size() - 1;
    while (!numbers_periods(*gray, groups[numbered])) --numbered;
    decode_finer_than_gray(out, stack, rig, options, context, groups, numbered);
    if (options.unwrapping != Unwrapping::spatial) return;
    out.unwrapping = Unwrapping::spatial;
    return assign_spatial_orders(out, options, length);
  }
  CoordinatePrior bounds;
  const CoordinatePrior* expected = context.expected;
  if (method == Unwrapping::geometric && !expected) {
    bounds = coordinate_bounds(rig, pixel_rays(rig.camera), context.axis);
    expected = &bounds;
  }
  if (method != Unwrapping::geometric && method != Unwrapping::predicted) expected = nullptr;
  const cv::Size size = stack.images.front().size();
  if (expected && expected->coordinate_px.size() != size)
    throw Error("decode: the expected coordinates and the images differ in size");
  plan.anchored = !groups.empty() && (gray || micro || expected);
  if (context.aligned &&
      (context.aligned->images.size() != stack.images.size() || context.aligned->images.front().size() != size))
    throw Error("decode: the aligned images do not belong to the stack");

  out.index = stack.index;
  out.timestamp_s = stack.timestamp_s;
  out.full_scale_dn = rig.sensor.max_dn();
  out.finest_period_px = plan.period_px;
  for (cv::Mat1f* image :
       {&out.mean, &out.modulation, &out.wrapped_phase, &out.coordinate_px, &out.sigma_px, &out.confidence})
    image->create(size);
  out.fringe_order.create(size);
  out.component.release();
  out.relative_phase.release();
  out.components.clear();

  const std::vector<int> averaged = averaged_images(sequence);
  for_each_range(size.height, [&](int first, int end) {
    RowScratch scratch;
    RowReader reader(stack, context.aligned, combined, scratch);
    MicroDecoder::Row micro_row;
    micro_row.anchor = &scratch.anchor;
    for (std::vector<float>* values :
         {&scratch.anchor.turns, &scratch.anchor.half_width, &scratch.anchor.sigma, &scratch.anchor.failure})
      values->resize(plan.anchored ? static_cast<size_t>(size.width) : 0);
    for (int row = first; row < end; ++row) {
      reader.read(row);
      const RowOutput target{out.mean[row],     out.modulation[row], out.wrapped_phase[row], out.coordinate_px[row],
                             out.sigma_px[row], out.confidence[row], out.fringe_order[row]};
      if (groups.empty()) {
        gray_only_row(*gray, plan, options, scratch.samples.data(), averaged, size.width, target);
        continue;
      }
      if (moving_gray) {
        decode_row(wrapped_only, size.width, scratch, target, context.instruction_set);
        moving_gray->find(plan, scratch, size.width, target, scratch.anchor);
      } else if (gray) {
        gray_row(*gray, plan, scratch.samples.data(), scratch.anchor);
      }
      if (micro) micro->find_orders(plan, scratch.samples.data(), size.width, context.instruction_set, micro_row);
      if (expected) prior_row(*expected, row, plan.period_px, scratch.anchor);
      decode_row(plan, size.width, scratch, target, context.instruction_set);
      if (micro) micro->refine(plan, size.width, micro_row, target);
    }
  });
  if (out.unwrapping == Unwrapping::spatial) assign_spatial_orders(out, options, length);
}

}  // namespace

DecodedStack decode(const FringeStack& stack, const RigModel& rig, const DecodeOptions& options,
                    const DecodeContext& context) {
  DecodedStack out;
  decode_into(out, stack, rig, options, context);
  return out;
}

void decode_into(DecodedStack& out, const FringeStack& stack, const RigModel& rig, const DecodeOptions& options,
                 const DecodeContext& context) {
  check_stack(stack);
  if (is_ensemble(stack.patterns, rig, options, context)) {
    resolve_unwrapping(stack.patterns, rig, options, context);
    return decode_ensemble(out, stack, rig, options, context);
  }
  if (!has_exposures(stack.patterns)) return decode_images(out, stack, stack.patterns, nullptr, rig, options, context);
  check_options(options, "decode");
  if (context.aligned) throw Error("decode: images of several exposures cannot be decoded in motion");
  const CombinedExposures combined =
      combine_exposures(stack, rig.sensor, options.saturation * rig.sensor.saturation_dn());
  decode_images(out, combined.stack, stack.patterns, &combined, rig, options, context);
}

}  // namespace fringeslam
