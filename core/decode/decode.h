// SPDX-License-Identifier: Apache-2.0
// Fringe images -> wrapped phase -> absolute projector coordinate, with validity and sigma.
//
// One period, N >= 3 steps [C eq. 1-3; METHOD S2]: I_k = I' + I'' cos(phi + delta_k) is linear in
// (I', I'' cos phi, -I'' sin phi) over the basis (1, cos delta_k, sin delta_k); least squares gives all
// three, and for delta = (-alpha, 0, alpha), alpha = 2 pi/3 exactly the paper's formulas. With the
// estimator's weights and the camera's noise model, sigma_phi follows by propagation.
//
// The order K of the finest period, Phi = phi + 2 pi K, by one of (METHOD S3):
//   multifrequency  the coarsest period covers the projector; each finer one is unwrapped by the one before,
//                   K = round((R Phi_low - phi_high) / 2 pi), R = p_low / p_high, which fails with probability
//                   erfc(pi / (sqrt 2 sqrt(R^2 sigma_low^2 + sigma_high^2)))
//   heterodyne      the same, begun by beats: the difference of two phases has the period p1 p2 / (p2 - p1), and
//                   beats of beats longer ones, until one covers the projector
//   gray            a Gray code tells the cell of the coordinate, cells being no wider than the finest period
//   geometric       the depth range bounds the coordinate of each pixel; its bounds must be less than a period apart
//   predicted       an expected coordinate and its sigma, from a map and a predicted pose
//   spatial         along connected pixels whose phases differ by less than half a turn; the order of each component
//                   by vote of the best of the above that the sequence serves, or else only relative
#pragma once

#include <string>

#include "core/decode/row_kernels.h"
#include "core/patterns/patterns.h"
#include "core/types/decoded_stack.h"
#include "core/types/frame.h"
#include "core/types/fringe_stack.h"
#include "core/types/options.h"
#include "core/types/rig_model.h"

namespace fringeslam {

struct DecodeOptions {
  std::string unwrapping = "auto";
  std::string spatial_order = "quality";
  std::string spatial_reference = "auto";
  int steps = 0;                      // 0: all
  double min_modulation_dn = 3;       // I''
  double min_data_modulation = 0.05;  // I'' / I'
  double saturation = 0.98;           // of full scale; any sample above it makes the pixel invalid
  double max_phase_sigma_rad = 0.35;
  double max_order_failure = 1e-4;      // predicted probability of a wrong fringe order
  double max_order_residual_sigma = 4;  // disagreement of two periods; pixels that see two surfaces disagree
  double max_spatial_step_rad = 1.6;
  double min_vote = 0.8;
  int min_component_px = 30;

  template <class Visitor>
  void describe(Visitor& v) {
    v.field("unwrapping", unwrapping,
            {"auto", "multifrequency", "heterodyne", "gray", "geometric", "predicted", "spatial"},
            "where fringe orders come from; auto: the first that the patterns serve");
    v.field("spatial_order", spatial_order, {"quality", "reliability"},
            "spatial: least sigma first (flood), or Herraez' reliability");
    v.field("spatial_reference", spatial_reference,
            {"auto", "multifrequency", "heterodyne", "gray", "geometric", "predicted", "none"},
            "spatial: who votes on a component's order");
    v.field("steps", steps, {0, 1000}, "use this many equally spaced steps of each period; 0: all");
    v.field("min_modulation_dn", min_modulation_dn, {0, 65535}, "least fringe amplitude I'', grey values");
    v.field("min_data_modulation", min_data_modulation, {0, 1}, "least data modulation I''/I'");
    v.field("saturation", saturation, {0.1, 1}, "share of full scale above which a sample counts as clipped");
    v.field("max_phase_sigma_rad", max_phase_sigma_rad, {0, 3}, "largest predicted phase sigma, rad");
    v.field("max_order_failure", max_order_failure, {0, 1}, "largest predicted probability of a wrong fringe order");
    v.field("max_order_residual_sigma", max_order_residual_sigma, {0.1, 1e6},
            "largest disagreement of two periods, sigmas");
    v.field("max_spatial_step_rad", max_spatial_step_rad, {0.01, 3.1}, "spatial: largest step between neighbours, rad");
    v.field("min_vote", min_vote, {0.5, 1}, "spatial: least agreement of a component's votes");
    v.field("min_component_px", min_component_px, {1, 1000000}, "spatial: least size of a component, px");
  }
};

// Where in the projector the light of each pixel is expected to come from: within +- half_width_px of coordinate_px,
// up to a normal error of sigma_px. NaN: nothing is expected. All H x W.
struct ExpectedCoordinate {
  cv::Mat1f coordinate_px, half_width_px, sigma_px;
};

// From the depth that a map and a predicted pose let expect: depth_m and sigma_m are H x W, NaN where unknown.
ExpectedCoordinate expected_coordinate(const RigModel& rig, const PixelRays& rays, const cv::Mat1f& depth_m,
                                       const cv::Mat1f& sigma_m, Axis axis = Axis::columns);

// From the rig's working range alone (`geometric`): what of each ray between near_m and far_m lies in the beam.
ExpectedCoordinate coordinate_bounds(const RigModel& rig, const PixelRays& rays, Axis axis = Axis::columns);

struct DecodeContext {
  Axis axis = Axis::columns;
  const ExpectedCoordinate* expected = nullptr;  // for `predicted`; for `geometric` too, which else works it out anew
  InstructionSet instruction_set = widest_instruction_set();
};

// The unwrapping that decode() would use ("spatial" stays "spatial"). Throws Error saying what the sequence lacks for
// the one asked for; for "auto", for any.
std::string resolve_unwrapping(const PatternSequence& sequence, const RigModel& rig, const DecodeOptions& options,
                               const DecodeContext& context = {});

// Throws Error when the stack does not fit the sequence or the sequence cannot serve the unwrapping.
DecodedStack decode(const FringeStack& stack, const PatternSequence& sequence, const RigModel& rig,
                    const DecodeOptions& options, const DecodeContext& context = {});

// The same into images that are used again when they have the right size.
void decode_into(DecodedStack& out, const FringeStack& stack, const PatternSequence& sequence, const RigModel& rig,
                 const DecodeOptions& options, const DecodeContext& context = {});

}  // namespace fringeslam
