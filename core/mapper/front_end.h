// SPDX-License-Identifier: Apache-2.0
// The front end: fringe images -> one reconstructed view. This is the seam for other decoders: derive from FrontEnd and
// pass it to Pipeline, and the mapper works on your frames. FringeFrontEnd is the project's own
// (docs/method.md, sections 3 and 4).
#pragma once

#include <optional>

#include "core/decode/decode.h"
#include "core/decode/stack_motion.h"
#include "core/depth/depth.h"
#include "core/map/expected_view.h"
#include "core/types/fringe_stack.h"

namespace fringeslam {

// One view as the mapper takes it. Only `frame` is required: points, sigma, normals and texture of the camera's pixels.
struct ReconstructedView {
  Frame frame;
  DecodedStack decoded;  // empty images if the front end does not decode fringes
  bool complete = true;  // false: surfaces that the map did not predict may be missing
  // Camera motion during the stack, for which the frame is compensated; not converged: unknown, and the frame is
  // compensated for its prediction at best. Empty: not estimated.
  std::optional<StackMotion> motion = {};
  // Motion that the frame is not compensated for: estimated, and not significantly different from rest; or, if the stack cannot
  // show motion, assumed by the mapper.
  std::optional<StackMotion> undecided_motion = {};
  double image_interval_s = 0;  // between the exposures of the stack; 0: not known
  // Variance of the camera's point spread, px^2, for which points beside texture are corrected. Empty: they are not, so that the
  // errors of views from different directions differ by more.
  std::optional<double> corrected_spread_px2 = {};
  bool motion_untested = false;  // the stack cannot show whether the camera moved, as with a single fringe period

  bool in_motion() const { return motion && !motion->motion.is_still(); }
  bool motion_unknown() const { return motion && !motion->converged; }
};

// Knowledge about a view before it is reconstructed.
struct ReconstructionPrior {
  // Depth predicted from the map; null: unknown. Fringe orders are taken from it. With `rough` and `motion`, a whole
  // sequence takes only those from it that it does not determine itself.
  const ExpectedView* expected = nullptr;
  std::optional<MotionPrior> motion;         // prediction; empty: motion is only detected, not estimated
  bool motion_is_known = false;              // decode with this motion instead of estimating it from the stack
  const ReconstructedView* rough = nullptr;  // the same stack, reconstructed without a prior; null: not yet
};

class FrontEnd {
 public:
  virtual ~FrontEnd() = default;
  // Returns true if the stack can only be reconstructed with a prior from the map.
  virtual bool needs_prior(const FringeStack&) const { return false; }
  // Reconstructs a view. May be called from several threads at a time; the result depends on the arguments only. Throws
  // Error if the stack cannot be decoded.
  virtual ReconstructedView reconstruct(const FringeStack& stack, const ReconstructionPrior& prior) const = 0;
  // Returns how the depth of every `stride`-th pixel in every `stride`-th row depends on the motion during the stack.
  // Empty if the front end does not compensate motion: the mapper then does not estimate it.
  virtual std::vector<DepthSlope> depth_slopes(const FringeStack&, const ReconstructedView&, int) const { return {}; }
  // Returns the share of the pixels with an expected depth whose fringe order that depth determines.
  virtual double determined_orders(const ExpectedView&) const { return 1; }
  // Returns the patterns for the next stack of a camera that moves on as during the view `last`.
  virtual PatternSequence anticipated(const PatternSequence& patterns, const ReconstructedView&) const {
    return patterns;
  }
};

struct FrontEndOptions {
  DecodeOptions decode;
  DepthOptions depth;
  bool at_rest = false;  // during each stack: motion is not detected
};

// Decodes and triangulates phase-shifted fringes. With `decode.unwrapping=predicted`, stacks of the finest fringes alone
// need a prior, and whole sequences are unwrapped by the patterns' own codes.
class FringeFrontEnd : public FrontEnd {
 public:
  // `sequence` holds all patterns of a complete stack. Throws Error if an option is out of range.
  FringeFrontEnd(const RigModel& rig, const PatternSequence& sequence, const FrontEndOptions& options);
  bool needs_prior(const FringeStack& stack) const override;
  // Throws Error if the stack's patterns are neither the whole sequence nor its finest fringes.
  ReconstructedView reconstruct(const FringeStack& stack, const ReconstructionPrior& prior) const override;
  std::vector<DepthSlope> depth_slopes(const FringeStack& stack, const ReconstructedView& view,
                                       int stride) const override;
  double determined_orders(const ExpectedView& expected) const override;
  // Changes the phase shifts so that those of the aligned images are as in `patterns`: drifting fringes would otherwise
  // move them together (docs/method.md, section 9.2). Shifts are multiples of 15 degrees, so that a projector can store
  // all patterns.
  PatternSequence anticipated(const PatternSequence& patterns, const ReconstructedView& last) const override;

 private:
  RigModel rig_;
  PatternSequence sequence_, finest_;
  FrontEndOptions options_;
  PixelRays rays_;
  Triangulation triangulation_;

  struct Decoding;
  class Compensation;
  double clip_dn() const { return options_.decode.saturation * rig_.sensor.saturation_dn(); }
  void decode_into(ReconstructedView& view, const FringeStack& stack, const Decoding& decoding,
                   const AlignedStack* aligned) const;
  void reconstruct_frame(ReconstructedView& view) const;
  void compensate_motion(ReconstructedView& view, const FringeStack& stack, const Decoding& decoding,
                         const ReconstructionPrior& prior) const;
};

}  // namespace fringeslam
