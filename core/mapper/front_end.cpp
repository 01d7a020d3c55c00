// SPDX-License-Identifier: Apache-2.0
#include "core/mapper/front_end.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "core/base/constants.h"
#include "core/base/stage_clock.h"
#include "core/decode/exposures.h"
#include "core/decode/texture_flow.h"
#include "core/patterns/patterns.h"

namespace fringeslam {

namespace {

// True if a motion is known accurately enough to skip its estimation from the images.
bool is_known(const MotionPrior& prior) {
  constexpr double kSigma = 4e-3;  // m/s or rad/s: 0.04 px of displacement during three images
  return prior.covariance.diagonal().head<6>().maxCoeff() <= kSigma * kSigma;
}

double least_separation(const std::vector<double>& shifts_rad) {
  double least = kPi;
  for (size_t i = 0; i < shifts_rad.size(); ++i) {
    for (size_t j = 0; j < i; ++j)
      least = std::min(least, std::abs(std::remainder(shifts_rad[i] - shifts_rad[j], kTwoPi)));
  }
  return least;
}

// True if a period with these shifts can be decoded at rest: an even number of steps may be halved by a drift that moves the
// fringes by as much as they are shifted.
bool are_enough(const std::vector<double>& shifts_rad) {
  constexpr size_t kLeast = 3;
  return distinct_shifts(shifts_rad) >= kLeast;
}

// Shifts that become `shifts_rad`, or these in reversed order, by the drift. The order is reversed where the drift would
// leave hardly any difference between the patterns. Unchanged if it leaves too few different ones in both orders.
std::vector<double> anticipated_shifts(const std::vector<double>& shifts_rad, const std::vector<double>& drifts_rad) {
  constexpr double kDistinct_rad = kPi / 4;
  std::vector<double> ordered, reversed;
  for (size_t i = 0; i < shifts_rad.size(); ++i) {
    ordered.push_back(shifts_rad[i] - drifts_rad[i]);
    reversed.push_back(shifts_rad[shifts_rad.size() - 1 - i] - drifts_rad[i]);
  }
  const bool keep = least_separation(ordered) >= std::min(kDistinct_rad, least_separation(reversed));
  const std::vector<double>&first = keep ? ordered : reversed, &second = keep ? reversed : ordered;
  return are_enough(first) ? first : are_enough(second) ? second : shifts_rad;
}

// Takes the fringe orders that `decoded` lacks from another decoding of the same images.
void fill_fringe_orders(DecodedStack& decoded, const DecodedStack& other) {
  decoded.filled_by_prediction = true;
  const cv::Mat missing =
      (decoded.coordinate_px != decoded.coordinate_px) & (other.coordinate_px == other.coordinate_px);
  other.modulation.copyTo(decoded.modulation, missing);
  other.wrapped_phase.copyTo(decoded.wrapped_phase, missing);
  other.fringe_order.copyTo(decoded.fringe_order, missing);
  other.coordinate_px.copyTo(decoded.coordinate_px, missing);
  other.sigma_px.copyTo(decoded.sigma_px, missing);
  other.confidence.copyTo(decoded.confidence, missing);
}

bool differ_in_shifts_only(const PatternSequence& one, const PatternSequence& other) {
  if (one.patterns.size() != other.patterns.size()) return false;
  PatternSequence with_shifts = one;
  for (size_t k = 0; k < one.patterns.size(); ++k) with_shifts.patterns[k].shift_rad = other.patterns[k].shift_rad;
  return with_shifts == other;
}

}  // namespace

struct FringeFrontEnd::Decoding {
  DecodeOptions options;
  std::optional<CoordinatePrior> expected;

  // Takes the fringe orders from an expected depth.
  void unwrap_by(const ExpectedView& view, const RigModel& rig, const PixelRays& rays) {
    expected = predict_coordinate(rig, rays, view.depth_m, view.sigma_m);
    options.unwrapping = Unwrapping::predicted;
  }
};

FringeFrontEnd::FringeFrontEnd(const RigModel& rig, const PatternSequence& sequence, const FrontEndOptions& options)
    : rig_(rig),
      sequence_(sequence),
      finest_(finest_patterns(sequence, Axis::columns)),
      options_(options),
      rays_(pixel_rays(rig.camera)),
      triangulation_(rig_, rays_, options.depth.near_m, options.depth.far_m) {
  check_options(options.decode, "decode");
  check_options(options.depth, "depth");
}

bool FringeFrontEnd::needs_prior(const FringeStack& stack) const {
  return stack.patterns.patterns.size() < sequence_.patterns.size();
}

ReconstructedView FringeFrontEnd::reconstruct(const FringeStack& stack, const ReconstructionPrior& prior) const {
  if (!differ_in_shifts_only(stack.patterns, sequence_) && !differ_in_shifts_only(stack.patterns, finest_))
    throw Error(
        "stack " + std::to_string(stack.index) +
        ": its patterns are neither the whole sequence nor its finest fringes; capture what next_patterns() asks "
        "for");
  Decoding decoding{options_.decode, {}};
  const bool by_map = prior.expected != nullptr && prior.rough == nullptr;
  if (by_map) {
    decoding.unwrap_by(*prior.expected, rig_, rays_);
  } else if (decoding.options.unwrapping == Unwrapping::predicted) {
    decoding.options.unwrapping = Unwrapping::automatic;
  }
  ReconstructedView view;
  view.complete = !by_map && !needs_prior(stack);
  if (options_.at_rest) {
    decode_into(view, stack, decoding, nullptr);
    reconstruct_frame(view);
  } else {
    compensate_motion(view, stack, decoding, prior);
  }
  view.image_interval_s = image_interval_s(stack, rig_.timing);
  return view;
}

std::vector<DepthSlope> FringeFrontEnd::depth_slopes(const FringeStack& stack, const ReconstructedView& view,
                                                     int stride) const {
  if (options_.at_rest || has_exposures(stack.patterns)) return {};
  enter_stage("motion");
  cv::Mat1f depth;
  cv::extractChannel(view.frame.points_m, depth, 2);
  return fringeslam::depth_slopes(stack, rig_, rays_, depth, clip_dn(),
                                  view.motion ? view.motion->motion : CameraMotion{}, view.decoded.finest_period_px,
                                  stride, Axis::columns, options_.decode.steps);
}

double FringeFrontEnd::determined_orders(const ExpectedView& expected) const {
  constexpr double kSigmas = 2.5;  // within half a period
  const CoordinatePrior coordinate = predict_coordinate(rig_, rays_, expected.depth_m, expected.sigma_m);
  const double most_px = finest_.patterns.front().period_px / (2 * kSigmas);
  const int known = cv::countNonZero(coordinate.sigma_px == coordinate.sigma_px);
  return known > 0 ? static_cast<double>(cv::countNonZero(coordinate.sigma_px <= most_px)) / known : 0;
}

PatternSequence FringeFrontEnd::anticipated(const PatternSequence& patterns, const ReconstructedView& last) const {
  constexpr int kStride = 16;
  constexpr double kStep_rad = kTwoPi / 24;
  if (!last.in_motion() || last.motion_unknown()) return patterns;
  if (options_.decode.steps > 0) return patterns;  // other shifts may include no equally spaced ones to select
  const CameraMotion motion{last.motion->motion.angular_rad_s, last.motion->motion.velocity_m_s};
  Timing timing = rig_.timing;
  if (last.image_interval_s > 0) timing.camera_rate_hz = 1 / last.image_interval_s;
  const std::vector<double> times_s = exposure_times_s(0, patterns, timing);
  std::vector<Eigen::Vector3d> points_m;
  for (int row = 0; row < last.frame.height(); row += kStride) {
    for (int col = 0; col < last.frame.width(); col += kStride) {
      const cv::Vec3f p = last.frame.points_m(row, col);
      if (!std::isnan(p[2])) points_m.emplace_back(p[0], p[1], p[2]);
    }
  }
  const auto drift_rad = [&](size_t k, const Pattern& pattern) {
    const Pose exposure_from_reference = motion.at(times_s[k]).inverse();
    std::optional<double> drift_px = median_drift_px(rig_, points_m, exposure_from_reference, pattern.axis);
    // Fringes that drift too fast leave no depth at all.
    if (!drift_px)
      drift_px = median_drift_px(rig_, {{0, 0, rig_.middle_range_m()}}, exposure_from_reference, pattern.axis);
    return kStep_rad * std::round(kTwoPi * drift_px.value_or(0) / pattern.period_px / kStep_rad);
  };
  PatternSequence changed = patterns;
  for (const Axis axis : {Axis::columns, Axis::rows}) {
    for (const FringeGroup& group : fringe_groups(patterns, axis)) {
      std::vector<double> drifts_rad;
      for (const int image : group.images)
        drifts_rad.push_back(drift_rad(static_cast<size_t>(image), patterns.patterns[static_cast<size_t>(image)]));
      const std::vector<double> shifts_rad = anticipated_shifts(group.shifts_rad, drifts_rad);
      for (size_t i = 0; i < group.images.size(); ++i)
        changed.patterns[static_cast<size_t>(group.images[i])].shift_rad = shifts_rad[i];
    }
  }
  return changed;
}

void FringeFrontEnd::decode_into(ReconstructedView& view, const FringeStack& stack, const Decoding& decoding,
                                 const AlignedStack* aligned) const {
  enter_stage("decode");
  DecodeContext context{Axis::columns, decoding.expected ? &*decoding.expected : nullptr};
  context.aligned = aligned;
  view.decoded = decode(stack, rig_, decoding.options, context);
}

void FringeFrontEnd::reconstruct_frame(ReconstructedView& view) const {
  enter_stage("depth");
  view.frame = fringeslam::reconstruct(view.decoded, rig_, triangulation_, options_.depth);
  view.corrected_spread_px2 =
      fringeslam::corrected_spread_px2(view.decoded, triangulation_, options_.depth, rig_.middle_range_m());
}

// Decodes one stack with motions and rough depths that improve each other: the depth needs the motion, but the motion needs
// only a rough depth.
class FringeFrontEnd::Compensation {
 public:
  Compensation(const FringeFrontEnd& front_end, const FringeStack& stack, const Decoding& decoding,
               ReconstructedView& view)
      : front_end_(front_end), stack_(stack), decoding_(decoding), view_(view) {}

  void decode_at_rest() {
    front_end_.decode_into(view_, stack_, decoding_, nullptr);
    aligned_.reset();
  }

  void decode_with(const CameraMotion& motion, const cv::Mat1f& depth_m) {
    front_end_.decode_into(view_, stack_, decoding_, &aligned(motion, depth_m));
  }

  // The same. Takes the fringe orders that the stack does not determine by itself from the depth that the map predicts.
  void decode_with(const CameraMotion& motion, const Frame& rough, const ExpectedView& expected) {
    const RigModel& rig = front_end_.rig_;
    cv::Mat1f depth_m;
    cv::extractChannel(rough.points_m, depth_m, 2);
    expected.depth_m.copyTo(depth_m, depth_m != depth_m);
    decode_with(motion, filled_depth(depth_m, rig.middle_range_m()));
    Decoding by_map = decoding_;
    by_map.unwrap_by(expected, rig, front_end_.rays_);
    ReconstructedView other;
    front_end_.decode_into(other, stack_, by_map, &*aligned_);
    fill_fringe_orders(view_.decoded, other.decoded);
  }

  // Depth of a frame, with its gaps filled.
  cv::Mat1f filled_depth_of(const Frame& frame) const {
    cv::Mat1f depth_m;
    cv::extractChannel(frame.points_m, depth_m, 2);
    return filled_depth(depth_m, front_end_.rig_.middle_range_m());
  }

  // The same of the stack as decoded last.
  cv::Mat1f decoded_depth() const {
    enter_stage("depth");
    Frame frame;
    DepthOptions rough = front_end_.options_.depth;
    rough.texture_correction = false;
    triangulate(frame, view_.decoded, front_end_.triangulation_, rough);
    return filled_depth_of(frame);
  }

  // Estimates the motion from the stack, and decodes the stack with it. `is_prediction`: the prior's motion is more than
  // a guess.
  void estimate(const cv::Mat1f& depth_m, const MotionPrior& prior, bool is_prediction) {
    if (!is_prediction) return estimate_from_texture(depth_m, prior, Start::guess);
    estimate(depth_m, prior, MotionSearch::close, Start::prediction);
    if (view_.motion->converged && agrees(*view_.motion, prior)) return;
    // The robot has accelerated since the prediction. The residuals have several minima then.
    const MotionPrior wide = accelerated(prior);
    ReconstructedView best = view_;  // shares its images
    const auto keep_best = [&] {
      const StackMotion &found = *view_.motion, &before = *best.motion;
      const bool better = !before.converged || found.rms_sigma < before.rms_sigma;
      if (found.converged && better) best = view_;
    };
    estimate(depth_m, wide, MotionSearch::accelerated, Start::contradicted);
    keep_best();
    estimate_from_texture(depth_m, wide, Start::contradicted);
    keep_best();
    view_ = best;
    aligned_.reset();
  }

 private:
  // A search starts from a guess that includes rest, from a prediction, or from a prediction that the stack contradicts.
  enum class Start { guess, prediction, contradicted };

  // A prior for a robot that has begun to accelerate or to brake since the prediction.
  static MotionPrior accelerated(MotionPrior prior) {
    constexpr double kTurn_rad_s = 0.7, kVelocity_m_s = 0.4, kTurn_rad_s2 = 1, kAcceleration_m_s2 = 0.5;
    Vector12d sigmas;
    sigmas << Eigen::Vector3d::Constant(kTurn_rad_s), Eigen::Vector3d::Constant(kVelocity_m_s),
        Eigen::Vector3d::Constant(kTurn_rad_s2), Eigen::Vector3d::Constant(kAcceleration_m_s2);
    prior.covariance.diagonal() += sigmas.cwiseAbs2();
    return prior;
  }

  void estimate_from_texture(const cv::Mat1f& depth_m, MotionPrior prior, Start kind) {
    enter_stage("motion");
    const std::optional<CameraMotion> rough =
        motion_from_texture(stack_, front_end_.rig_, front_end_.rays_, depth_m, prior);
    if (rough) prior.motion = *rough;
    estimate(depth_m, prior, rough ? MotionSearch::close : MotionSearch::wide, kind);
  }

  // Starts at the prior's motion.
  void estimate(cv::Mat1f depth_m, MotionPrior prior, MotionSearch search, Start kind) {
    const RigModel& rig = front_end_.rig_;
    const PixelRays& rays = front_end_.rays_;
    // Shifts that anticipate a motion leave hardly any fringe orders to a decoder that assumes rest.
    if (search == MotionSearch::close) {
      decode_with(prior.motion, depth_m);
      depth_m = decoded_depth();
    }
    // A rough depth with many wrong fringe orders leaves large residuals at the right motion, too; that of the stack
    // decoded with a motion near it is better.
    constexpr int kRounds = 4;
    // A prediction that leaves such residuals is far from the motion.
    constexpr double kImproved = 0.9, kHopeless_rms = 5;
    constexpr double kCertain = 0.9;
    double last_rms = std::numeric_limits<double>::infinity();
    for (int round = 0; round < kRounds; ++round) {
      enter_stage("motion");
      const StackMotion found = estimate_stack_motion(stack_, rig, rays, depth_m, front_end_.clip_dn(), prior, search);
      view_.motion = found;
      search = MotionSearch::close;
      const bool improved = found.residuals > 0 && found.rms_sigma < kImproved * last_rms;
      last_rms = found.rms_sigma;
      if (!found.converged && (!improved || (kind == Start::prediction && found.rms_sigma > kHopeless_rms))) return;
      if (round == 0 && found.converged && kind == Start::guess && probability_of_motion(found) < kCertain) {
        view_.undecided_motion = found;
        view_.motion->motion = {};
        view_.motion->residuals = 0;
        if (aligned_) decode_at_rest();
        return;
      }
      decode_with(found.motion, depth_m);
      if (found.converged && round > 0) return;
      depth_m = decoded_depth();
      if (kind != Start::prediction) prior.motion = found.motion;
    }
  }

  const FringeFrontEnd& front_end_;
  const FringeStack& stack_;
  const Decoding& decoding_;
  ReconstructedView& view_;
  std::optional<AlignedStack> aligned_;

  const AlignedStack& aligned(const CameraMotion& motion, const cv::Mat1f& depth_m) {
    enter_stage("motion");
    return aligned_.emplace(
        align_stack(stack_, front_end_.rig_, front_end_.rays_, depth_m, motion, front_end_.clip_dn()));
  }
};

void FringeFrontEnd::compensate_motion(ReconstructedView& view, const FringeStack& stack, const Decoding& decoding,
                                       const ReconstructionPrior& prior) const {
  Compensation compensation(*this, stack, decoding, view);
  const auto reconstruct_at_rest = [&] {
    compensation.decode_at_rest();
    reconstruct_frame(view);
  };
  // Finds out whether the camera moved, but not how.
  const auto test_motion = [&](const FringeStack& linear, const cv::Mat1f& depth_m) {
    enter_stage("motion");
    view.motion.emplace();
    const std::optional<bool> moves = shows_motion(linear, rig_, rays_, depth_m, clip_dn());
    view.motion->converged = !moves.value_or(false);
    view.motion_untested = !moves;
  };
  if (has_exposures(stack.patterns)) {
    // Several exposures cannot be decoded in motion, but one of them shows it.
    reconstruct_at_rest();
    return test_motion(best_exposure(stack, clip_dn()), compensation.filled_depth_of(view.frame));
  }
  if (view.complete && !decodes_in_motion(stack.patterns, rig_, decoding.options)) {
    if (prior.rough != nullptr) {
      view = *prior.rough;
      return;
    }
    reconstruct_at_rest();
    return test_motion(stack, compensation.filled_depth_of(view.frame));
  }
  const bool predicted = prior.motion && !prior.motion->motion.is_still();
  const auto take_prior = [&] {
    view.motion = StackMotion{prior.motion->motion, prior.motion->covariance, 0, 0, true};
  };
  if (!view.complete) {
    if (prior.motion) take_prior();
    if (predicted)
      compensation.decode_with(prior.motion->motion, filled_depth(prior.expected->depth_m, rig_.middle_range_m()));
    else
      compensation.decode_at_rest();
    return reconstruct_frame(view);
  }
  if (prior.expected != nullptr && prior.motion) {
    take_prior();
    compensation.decode_with(prior.motion->motion, prior.rough->frame, *prior.expected);
    return reconstruct_frame(view);
  }
  if (prior.rough != nullptr) {
    view.decoded = prior.rough->decoded;
    view.frame = prior.rough->frame;
  } else {
    reconstruct_at_rest();
  }
  const cv::Mat1f depth_m = compensation.filled_depth_of(view.frame);
  // Without a prior, only the test is done: the caller may know more.
  if (!prior.motion) return test_motion(stack, depth_m);
  if (prior.motion_is_known || (predicted && is_known(*prior.motion))) {
    take_prior();
    if (!predicted) return;
    compensation.decode_with(prior.motion->motion, depth_m);
    compensation.decode_with(prior.motion->motion, compensation.decoded_depth());
  } else {
    compensation.estimate(depth_m, *prior.motion, predicted);
  }
  reconstruct_frame(view);
}

}  // namespace fringeslam
