// SPDX-License-Identifier: Apache-2.0
// The front end: fringe images -> one reconstructed view. This is the seam for other decoders: derive from FrontEnd and
// pass it to Pipeline, and the mapper works on your frames. FringeFrontEnd is ours (docs/method.md, sections 3 and 4).
#pragma once

#include <optional>

#include "core/decode/decode.h"
#include "core/decode/motion_compensation.h"
#include "core/depth/depth.h"
#include "core/map/expected_view.h"
#include "core/types/fringe_stack.h"

namespace fringeslam {

// One view as the mapper takes it. Only `frame` is required: points, sigma, normals and texture of the camera's pixels.
struct ReconstructedView {
  Frame frame;
  DecodedStack decoded;  // empty images if the front end does not decode fringes
  bool complete = true;  // false: surfaces that the map did not predict may be missing
};

// Knowledge about a view before it is reconstructed.
struct ReconstructionPrior {
  const ExpectedView* expected = nullptr;  // depth predicted from the map; null: unknown
  std::optional<CameraTwist> twist;        // of the camera during the stack; empty: unknown or at rest
};

class FrontEnd {
 public:
  virtual ~FrontEnd() = default;
  // Returns true if the stack can only be reconstructed with a prior from the map.
  virtual bool needs_prior(const FringeStack&) const { return false; }
  // Reconstructs a view. May be called from several threads at a time; the result depends on the arguments only. Throws
  // Error if the stack cannot be decoded.
  virtual ReconstructedView reconstruct(const FringeStack& stack, const ReconstructionPrior& prior) const = 0;
};

struct FrontEndOptions {
  DecodeOptions decode;
  DepthOptions depth;
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

 private:
  RigModel rig_;
  PatternSequence sequence_, finest_;
  FrontEndOptions options_;
  PixelRays rays_;
  Triangulation triangulation_;
};

}  // namespace fringeslam
