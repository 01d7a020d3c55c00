// SPDX-License-Identifier: Apache-2.0
#include "core/mapper/front_end.h"

#include <utility>

#include "core/base/stage_clock.h"

namespace fringeslam {

namespace {

// True if a motion is known so well that the images need not determine it.
bool is_known(const MotionPrior& prior) {
  constexpr double kSigma = 4e-3;  // m/s or rad/s: 0.04 px of displacement during three images
  return prior.covariance.diagonal().head<6>().maxCoeff() <= kSigma * kSigma;
}

}  // namespace

struct FringeFrontEnd::Decoding {
  DecodeOptions options;
  std::optional<CoordinatePrior> expected;
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
  if (!(stack.patterns == sequence_) && !(stack.patterns == finest_))
    throw Error(
        "stack " + std::to_string(stack.index) +
        ": its patterns are neither the whole sequence nor its finest fringes; capture what next_patterns() asks "
        "for");
  Decoding decoding{options_.decode, {}};
  if (prior.expected != nullptr) {
    decoding.expected = predict_coordinate(rig_, rays_, prior.expected->depth_m, prior.expected->sigma_m);
    decoding.options.unwrapping = Unwrapping::predicted;
  } else if (decoding.options.unwrapping == Unwrapping::predicted) {
    decoding.options.unwrapping = Unwrapping::automatic;
  }
  ReconstructedView view;
  view.complete = !needs_prior(stack);
  compensate_motion(view, stack, decoding, prior);
  return view;
}

std::vector<DepthSlope> FringeFrontEnd::depth_slopes(const FringeStack& stack, const ReconstructedView& view,
                                                     int stride) const {
  enter_stage("motion");
  cv::Mat1f depth;
  cv::extractChannel(view.frame.points_m, depth, 2);
  return fringeslam::depth_slopes(stack, rig_, rays_, depth, view.motion ? view.motion->motion : CameraMotion{},
                                  stride);
}

void FringeFrontEnd::decode_and_triangulate(ReconstructedView& view, const FringeStack& stack, const Decoding& decoding,
                                            const AlignedStack* aligned) const {
  enter_stage("decode");
  DecodeContext context{Axis::columns, decoding.expected ? &*decoding.expected : nullptr};
  context.aligned = aligned;
  view.decoded = decode(stack, rig_, decoding.options, context);
  enter_stage("depth");
  view.frame = fringeslam::reconstruct(view.decoded, rig_, triangulation_, options_.depth);
}

// The depth needs the motion, but the motion needs only a rough depth: two rounds suffice.
void FringeFrontEnd::compensate_motion(ReconstructedView& view, const FringeStack& stack, const Decoding& decoding,
                                       const ReconstructionPrior& prior) const {
  const auto align = [&](const cv::Mat1f& depth, const CameraMotion& motion) {
    enter_stage("motion");
    const AlignedStack aligned = align_stack(stack, rig_, rays_, depth, motion);
    decode_and_triangulate(view, stack, decoding, &aligned);
  };
  const auto rough_depth = [&] {
    cv::Mat1f depth;
    cv::extractChannel(view.frame.points_m, depth, 2);
    return filled_depth(depth, rig_.middle_range_m());
  };
  const bool predicted = prior.motion && !prior.motion->motion.is_still();
  if (!view.complete) {
    if (prior.motion) view.motion = StackMotion{prior.motion->motion, prior.motion->covariance, 0, 0, true};
    if (predicted)
      align(filled_depth(prior.expected->depth_m, rig_.middle_range_m()), prior.motion->motion);
    else
      decode_and_triangulate(view, stack, decoding, nullptr);
    return;
  }
  decode_and_triangulate(view, stack, decoding, nullptr);
  if (predicted && is_known(*prior.motion)) {
    view.motion = StackMotion{prior.motion->motion, prior.motion->covariance, 0, 0, true};
    for (int round = 0; round < 2; ++round) align(rough_depth(), prior.motion->motion);
    return;
  }
  enter_stage("motion");
  cv::Mat1f depth = rough_depth();
  if (!prior.motion) {
    // Without a prior, only the test is done: the caller may know more.
    view.motion.emplace();
    view.motion->converged = !shows_motion(stack, rig_, rays_, depth);
    return;
  }
  MotionPrior start = *prior.motion;
  for (int round = 0; round < 2; ++round) {
    view.motion = estimate_stack_motion(stack, rig_, rays_, depth, start, predicted || round > 0);
    if (!view.motion->converged) return;
    if (round == 0 && !is_moving(*view.motion)) {
      view.motion->motion = {};
      view.motion->residuals = 0;
      return;
    }
    align(depth, view.motion->motion);
    depth = rough_depth();
    if (!predicted) start.motion = view.motion->motion;
  }
}

}  // namespace fringeslam
