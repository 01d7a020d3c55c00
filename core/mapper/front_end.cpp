// SPDX-License-Identifier: Apache-2.0
#include "core/mapper/front_end.h"

#include <utility>

#include "core/base/stage_clock.h"

namespace fringeslam {

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
  decode_and_triangulate(view, stack, decoding, nullptr);
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
  enter_stage("motion");
  const auto rough_depth = [&] {
    cv::Mat1f depth;
    cv::extractChannel(view.frame.points_m, depth, 2);
    if (prior.expected != nullptr) prior.expected->depth_m.copyTo(depth, depth != depth);
    return filled_depth(depth, rig_.middle_range_m());
  };
  cv::Mat1f depth = rough_depth();
  const auto align = [&](const CameraMotion& motion) {
    const AlignedStack aligned = align_stack(stack, rig_, rays_, depth, motion);
    decode_and_triangulate(view, stack, decoding, &aligned);
    enter_stage("motion");
  };
  if (!view.complete) {
    if (prior.motion) view.motion = StackMotion{prior.motion->motion, prior.motion->covariance, 0, 0, true};
    if (prior.motion && !prior.motion->motion.is_still()) align(prior.motion->motion);
    return;
  }
  const bool predicted = prior.motion && !prior.motion->motion.is_still();
  if (!predicted && !shows_motion(stack, rig_, rays_, depth)) {
    view.motion.emplace();
    view.motion->converged = true;
    return;
  }
  MotionPrior start = predicted ? *prior.motion : unknown_motion({});
  for (int round = 0; round < 2; ++round) {
    view.motion = estimate_stack_motion(stack, rig_, rays_, depth, start, predicted || round > 0);
    if (!view.motion->converged) return;
    if (round == 0 && !is_moving(*view.motion)) {
      view.motion->motion = {};
      return;
    }
    align(view.motion->motion);
    depth = rough_depth();
    if (!predicted) start.motion = view.motion->motion;
  }
}

}  // namespace fringeslam
