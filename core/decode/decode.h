// SPDX-License-Identifier: Apache-2.0
// Fringe images -> wrapped phase -> absolute projector coordinate, with validity and sigma.
//
// One period with N >= 3 steps [C eq. 1-3; docs/method.md, section 3.1]: I_k = I' + I'' cos(phi + delta_k) is linear in
// (I', I'' cos phi, -I'' sin phi) over the basis (1, cos delta_k, sin delta_k). Least squares estimates all three; for
// delta = (-alpha, 0, alpha), alpha = 2 pi/3, the result equals the paper's formulas. sigma_phi follows by propagating
// the camera's noise model through the estimator's weights.
//
// The order K of the finest period, Phi = phi + 2 pi K, is found by one of (docs/method.md, section 3.2):
//   multifrequency  the coarsest period covers the projector; each finer one is unwrapped by the previous one,
//                   K = round((R Phi_low - phi_high) / 2 pi), R = p_low / p_high, which fails with probability
//                   erfc(pi / (sqrt 2 sqrt(R^2 sigma_low^2 + sigma_high^2)))
//   heterodyne      like multifrequency, but starting from beats: the difference of two phases has the period
//                   p1 p2 / (p2 - p1); beats of beats are longer, until one covers the projector
//   gray            a Gray code with cells no wider than the longest period gives the cell of the coordinate; finer
//                   periods are each unwrapped by the one before
//   micro           single images of further, similar periods distinguish the orders (core/decode/micro_phase.h); indirect
//                   light, which all periods see alike, changes neither orders nor phases
//   modulated       products of low-frequency cosines and a high-frequency carrier (core/decode/modulated.h)
//   ensemble        several of the above and several Gray codes, each by itself; pixels at which two or more agree
//   geometric       the depth range bounds the coordinate of each pixel to an interval shorter than a period
//   predicted       a predicted coordinate and its sigma, from a map and a predicted pose
//   spatial         along connected pixels whose phases differ by less than half a turn; the order of each component
//                   is voted by the best of the above methods that the sequence supports, or remains relative
#pragma once

#include <array>

#include "core/decode/motion_alignment.h"
#include "core/decode/row_kernels.h"
#include "core/patterns/patterns.h"
#include "core/types/decoded_stack.h"
#include "core/types/frame.h"
#include "core/types/fringe_stack.h"
#include "core/types/options.h"
#include "core/types/rig_model.h"
#include "core/types/selected_instruction_set.h"

namespace fringeslam {

// Order in which `spatial` visits the pixels: by lowest sigma, or by Herraez' reliability.
enum class SpatialOrdering { quality, reliability };

constexpr auto choices(SpatialOrdering) {
  using enum SpatialOrdering;
  return std::to_array<Choice<SpatialOrdering>>({{quality, "quality"}, {reliability, "reliability"}});
}

// Method that votes on the fringe orders of `spatial`; none: they remain relative.
enum class SpatialReference {
  automatic,
  multifrequency,
  heterodyne,
  gray,
  micro,
  modulated,
  geometric,
  predicted,
  none
};

constexpr auto choices(SpatialReference) {
  using enum SpatialReference;
  return std::to_array<Choice<SpatialReference>>({{automatic, "auto"},
                                                  {multifrequency, "multifrequency"},
                                                  {heterodyne, "heterodyne"},
                                                  {gray, "gray"},
                                                  {micro, "micro"},
                                                  {modulated, "modulated"},
                                                  {geometric, "geometric"},
                                                  {predicted, "predicted"},
                                                  {none, "none"}});
}

struct DecodeOptions {
  Unwrapping unwrapping = Unwrapping::automatic;
  SpatialOrdering spatial_order = SpatialOrdering::quality;
  SpatialReference spatial_reference = SpatialReference::automatic;
  int steps = 0;                      // 0: all
  double min_modulation_dn = 3;       // I''
  double min_data_modulation = 0.05;  // I'' / I'
  double saturation = 0.98;           // fraction of full scale; a sample above it makes the pixel invalid
  double max_phase_sigma_rad = 0.35;
  double max_order_failure = 1e-4;      // predicted probability of a wrong fringe order
  double max_order_residual_sigma = 4;  // between two periods; rejects pixels that see two surfaces
  double max_spatial_step_rad = 1.6;
  double min_vote = 0.8;
  int min_component_px = 30;

  template <class Visitor>
  void describe(Visitor& v) {
    v.field("unwrapping", unwrapping, "unwrapping method; auto: the first one that the patterns support");
    v.field("spatial_order", spatial_order, "spatial: flood fill by lowest sigma, or Herraez' reliability sorting");
    v.field("spatial_reference", spatial_reference, "spatial: method that votes on the fringe order of a component");
    v.field("steps", steps, {0, 1000}, "number of equally spaced phase steps used per period; 0: all");
    v.field("min_modulation_dn", min_modulation_dn, {0, 65535}, "minimum modulation I'', DN");
    v.field("min_data_modulation", min_data_modulation, {0, 1}, "minimum data modulation I''/I'");
    v.field("saturation", saturation, {0.1, 1}, "fraction of full scale above which a sample counts as saturated");
    v.field("max_phase_sigma_rad", max_phase_sigma_rad, {0, 3}, "maximum predicted phase sigma, rad");
    v.field("max_order_failure", max_order_failure, {0, 1}, "maximum predicted probability of a wrong fringe order");
    v.field("max_order_residual_sigma", max_order_residual_sigma, {0.1, 1e6},
            "maximum residual between two periods, sigmas");
    v.field("max_spatial_step_rad", max_spatial_step_rad, {0.01, 3.1},
            "spatial: maximum phase step between neighbours, rad");
    v.field("min_vote", min_vote, {0.5, 1}, "spatial: minimum agreement of a component's votes");
    v.field("min_component_px", min_component_px, {1, 1000000}, "spatial: minimum component size, px");
  }
};

// Predicted projector coordinate of each pixel: within +- half_width_px of coordinate_px, with a normal error of
// sigma_px. NaN: no prediction. All are H x W.
struct CoordinatePrior {
  cv::Mat1f coordinate_px, half_width_px, sigma_px;
};

// Prediction from the depth that a map and a predicted pose yield: depth_m and sigma_m are H x W, NaN where unknown.
CoordinatePrior predict_coordinate(const RigModel& rig, const PixelRays& rays, const cv::Mat1f& depth_m,
                                   const cv::Mat1f& sigma_m, Axis axis = Axis::columns);

// Bounds from the rig's working range only (`geometric`): the part of each ray between near_m and far_m that lies in
// the projector's field.
CoordinatePrior coordinate_bounds(const RigModel& rig, const PixelRays& rays, Axis axis = Axis::columns);

struct DecodeContext {
  Axis axis = Axis::columns;
  const CoordinatePrior* expected = nullptr;  // required by `predicted`; replaces the bounds of `geometric`
  InstructionSet instruction_set = selected_instruction_set();
  // Images aligned with the stack's reference time, if the camera moved; replaces the images of the stack.
  const AlignedStack* aligned = nullptr;
};

// Returns the unwrapping method that decode() would use (`spatial` remains `spatial`). Throws Error stating what the
// sequence lacks for the requested method or, for `auto`, for any method.
Unwrapping resolve_unwrapping(const PatternSequence& sequence, const RigModel& rig, const DecodeOptions& options,
                              const DecodeContext& context = {});

// True if decode() can decode images that are aligned for a motion. Throws Error as resolve_unwrapping() does.
bool decodes_in_motion(const PatternSequence& sequence, const RigModel& rig, const DecodeOptions& options,
                       const DecodeContext& context = {});

// Decodes a fringe stack. Throws Error if check_stack() does or if the patterns do not support the unwrapping method.
DecodedStack decode(const FringeStack& stack, const RigModel& rig, const DecodeOptions& options,
                    const DecodeContext& context = {});

// Like decode(), but reuses the images of `out` if they have the right size.
void decode_into(DecodedStack& out, const FringeStack& stack, const RigModel& rig, const DecodeOptions& options,
                 const DecodeContext& context = {});

}  // namespace fringeslam
