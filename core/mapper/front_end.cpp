// SPDX-License-Identifier: Apache-2.0
#include "core/mapper/front_end.h"

#include "core/base/stage_clock.h"

namespace fringeslam {

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
  DecodeOptions decoding = options_.decode;
  std::optional<CoordinatePrior> expected;
  if (prior.expected != nullptr) {
    expected = predict_coordinate(rig_, rays_, prior.expected->depth_m, prior.expected->sigma_m);
    decoding.unwrapping = Unwrapping::predicted;
  } else if (decoding.unwrapping == Unwrapping::predicted) {
    decoding.unwrapping = Unwrapping::automatic;
  }
  ReconstructedView view;
  view.complete = !needs_prior(stack);
  enter_stage("decode");
  view.decoded = decode(stack, rig_, decoding, {Axis::columns, expected ? &*expected : nullptr});
  enter_stage("depth");
  view.frame = fringeslam::reconstruct(view.decoded, rig_, triangulation_, options_.depth);
  if (prior.twist) {
    // The drift of the coordinate depends on the surface's slope, hence on a first reconstruction.
    compensate_motion(view.decoded, stack, decoding, coordinate_rate(view.frame, rig_, rays_, *prior.twist));
    view.frame = fringeslam::reconstruct(view.decoded, rig_, triangulation_, options_.depth);
  }
  return view;
}

}  // namespace fringeslam
