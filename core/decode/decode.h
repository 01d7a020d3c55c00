// SPDX-License-Identifier: Apache-2.0
// Fringe images -> wrapped phase -> absolute projector coordinate, with validity and sigma.
//
// One period, N >= 3 steps [C eq. 1-3; METHOD S2]: I_k = I' + I'' cos(phi + delta_k) is linear in
// (I', I'' cos phi, -I'' sin phi) over the basis (1, cos delta_k, sin delta_k); least squares gives all
// three, and for delta = (-alpha, 0, alpha), alpha = 2 pi/3 exactly the paper's formulas. With the
// estimator's weights and the camera's noise model, sigma_phi follows by propagation.
//
// Several periods (METHOD S3, `multifrequency`): the coarsest period covers the projector; each finer
// phase is unwrapped by K = round((R Phi_low - phi_high) / 2 pi), R = p_low / p_high, which fails with
// probability erfc(pi / (sqrt 2 sqrt(R^2 sigma_low^2 + sigma_high^2))).
#pragma once

#include "core/patterns/patterns.h"
#include "core/types/decoded_stack.h"
#include "core/types/fringe_stack.h"
#include "core/types/options.h"
#include "core/types/rig_model.h"

namespace fringeslam {

struct DecodeOptions {
  double min_modulation_dn = 3;       // I''
  double min_data_modulation = 0.05;  // I'' / I'
  double saturation = 0.98;           // of full scale; any sample above it makes the pixel invalid
  double max_phase_sigma_rad = 0.35;
  double max_order_failure = 1e-4;      // predicted probability of a wrong fringe order
  double max_order_residual_sigma = 4;  // disagreement of two periods; pixels that see two surfaces disagree

  template <class Visitor>
  void describe(Visitor& v) {
    v.field("min_modulation_dn", min_modulation_dn, {0, 65535}, "least fringe amplitude I'', grey values");
    v.field("min_data_modulation", min_data_modulation, {0, 1}, "least data modulation I''/I'");
    v.field("saturation", saturation, {0.1, 1}, "share of full scale above which a sample counts as clipped");
    v.field("max_phase_sigma_rad", max_phase_sigma_rad, {0, 3}, "largest predicted phase sigma, rad");
    v.field("max_order_failure", max_order_failure, {0, 1}, "largest predicted probability of a wrong fringe order");
    v.field("max_order_residual_sigma", max_order_residual_sigma, {0.1, 1e6},
            "largest disagreement of two periods, sigmas");
  }
};

// Throws Error when decode() could make nothing of stacks of this sequence.
void check_decodable(const PatternSequence& sequence, Axis axis = Axis::columns);

// Throws Error when the stack does not fit the sequence, or when the sequence has no period of the
// axis that covers the projector (no absolute phase without it).
DecodedStack decode(const FringeStack& stack, const PatternSequence& sequence, const SensorModel& sensor,
                    const DecodeOptions& options, Axis axis = Axis::columns);

}  // namespace fringeslam
