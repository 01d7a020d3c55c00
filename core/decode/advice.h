// SPDX-License-Identifier: Apache-2.0
// Advice on how to capture a scene, from images of it alone: coding, number of images and exposures
// (docs/method.md, section 3.4). Ground truth plays no part.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "core/decode/light_survey.h"
#include "core/patterns/design.h"

namespace fringeslam {

struct AdviceOptions {
  double covered = 0.99;
  int most_exposures = 4;
  double shortest = 1.0 / 256, longest = 256;

  template <class Visitor>
  void describe(Visitor& v) {
    v.field("covered", covered, {0.5, 1}, "share of the lit pixels that the advised patterns must decode");
    v.field("most_exposures", most_exposures, {1, 8}, "maximum number of exposures per pattern");
    v.field("shortest", shortest, {1e-3, 1}, "shortest exposure to consider, relative to the rig's");
    v.field("longest", longest, {1, 1e3}, "longest exposure to consider, relative to the rig's");
  }
};

// Evidence from the images of one view.
struct ViewEvidence {
  int index = 0;
  int64_t pixels = 0;
  int64_t saturated = 0;  // some pattern is saturated at all its exposures
  int64_t hidden = 0;     // of these, the brightness is unknown
  int64_t unlit = 0;      // no modulation above the noise
  int64_t lit = 0;        // modulation above the noise, not saturated
  int64_t valid = 0;      // with a coordinate
  int64_t noisy = 0;      // lit, without a coordinate: the modulation is too low for the coding
  int64_t rejected = 0;   // lit with enough modulation, without a coordinate: the images contradict each other
  std::array<double, 5> modulation_dn = {};  // quantiles 0.01, 0.1, 0.5, 0.9, 0.99 of the lit pixels
  double phase_sigma_rad = 0;                // predicted for the finest period: the median of the valid pixels
  PixelLight light;
  std::optional<PeriodAgreement> agreement;  // empty: the patterns determine no coordinates
  DecodedStack decoded;                      // empty if there are no fringes to decode
};

inline constexpr std::array<double, 5> kModulationQuantiles = {0.01, 0.1, 0.5, 0.9, 0.99};

// Motion of the camera or the scene during the stacks.
enum class ObservedMotion { unknown, none, moving };

constexpr auto choices(ObservedMotion) {
  using enum ObservedMotion;
  return std::to_array<Choice<ObservedMotion>>({{unknown, "unknown"}, {none, "none"}, {moving, "moving"}});
}

// Indirect light that disturbs the phases.
enum class ObservedIndirect { unknown, none, present };

constexpr auto choices(ObservedIndirect) {
  using enum ObservedIndirect;
  return std::to_array<Choice<ObservedIndirect>>({{unknown, "unknown"}, {none, "none"}, {present, "present"}});
}

// A coding that could be used, and the share of the lit pixels that it decodes by the number of exposures, from 1.
struct CodingChoice {
  std::string name;
  SequenceDesign design;  // without exposures
  int images = 0;         // at one exposure
  SignalDemand demand;
  bool decodes_exposures = false, decodes_motion = false, resists_indirect = false;
  bool current = false;  // the patterns of the images
  std::vector<std::vector<double>> exposures;
  std::vector<double> covered;
};

struct Advice {
  ObservedMotion motion = ObservedMotion::unknown;
  ObservedIndirect indirect = ObservedIndirect::unknown;
  double biased_share = 0;  // of the tested pixels; see PeriodAgreement
  double ripple_rad = 0;    // likewise
  bool nonlinear = false;   // the projector's response, so strongly that indirect light cannot be judged
  CodingChoice coding;
  std::vector<CodingChoice> alternatives;
  std::vector<double> exposures;  // relative to the rig's
  int images = 0;
  double covered = 0;                // share of the lit pixels that the advised patterns are predicted to decode
  double hidden_share = 0;           // of the lit pixels: brighter than the images show
  std::optional<double> look_first;  // exposure that shows them
};

// Returns the patterns of the advice; `taken` are those of the images. A single exposure is not part of them: it is the
// rig's.
PatternSequence advised_sequence(const Advice& advice, const PatternSequence& taken);

// Exposures, relative to the rig's, and the share of the lit pixels that patterns decode at them.
struct ExposureChoice {
  std::vector<double> exposures;
  double covered = 0;
};

// Returns the fewest exposures at which the patterns of the images decode `wanted` of the pixels that they can decode, or
// most of them. Throws Error if they determine no coordinates.
ExposureChoice present_exposures(const Advice& advice, double wanted);

// Returns the axis that the advice refers to: columns, or rows if only they are coded. Throws Error if neither is.
Axis advice_axis(const PatternSequence& sequence);

// Surveys a stack. Throws Error if its patterns show no brightness.
ViewEvidence examine(const FringeStack& stack, const RigModel& rig, const DecodeOptions& options, Axis axis);

// Returns patterns of three periods that show indirect light, with the finest period of `taken`.
PatternSequence period_test_patterns(const PatternSequence& taken);

// Decides whether a stack shows motion. `depth_m` is a rough depth image without unknown pixels (filled_depth()).
ObservedMotion observed_motion(const FringeStack& stack, const RigModel& rig, const PixelRays& rays,
                               const cv::Mat1f& depth_m, Axis axis);

// Adds a look at the same view at another exposure.
void add_look(ViewEvidence& view, const FringeStack& look, const RigModel& rig, const DecodeOptions& options,
              Axis axis);

// Advises from the evidence of all views, which were captured with `sequence`.
Advice advise(const std::vector<ViewEvidence>& views, const PatternSequence& sequence, const RigModel& rig,
              const DecodeOptions& decoding, const AdviceOptions& options, ObservedMotion motion);

}  // namespace fringeslam
