// SPDX-License-Identifier: Apache-2.0
// Waveform of projected fringes behind a nonlinear response, and the phase error that it causes (docs/method.md, section
// 3.3).
#pragma once

#include <vector>

#include "core/types/rig_model.h"

namespace fringeslam {

// Returns true if the shifts are k 2 pi / N for k = 0 ... N - 1 in any order, up to a common offset.
bool equally_spaced(const std::vector<double>& shifts_rad);

// Returns by how many turns the first of equally spaced shifts lies before that of steps centred on zero: tables over the
// phase of centred steps are read at the phase plus this.
double turns_from_centred(const std::vector<double>& shifts_rad);

// Returns the table of a power law, light = level^gamma, with equally spaced levels from 0 to 1.
std::vector<double> gamma_table(double gamma, int entries = 257);

// Returns outer(inner(x)) as a table with as many entries as `inner` has; tables over [0, 1], an empty one is the identity.
std::vector<double> composed_table(const std::vector<double>& outer, const std::vector<double>& inner);

// Returns the phase error of `steps` equally spaced steps of a sinusoid that is projected through a response (light at
// equally spaced levels from 0 to 1). Zero for a linear response. Throws Error for fewer than three steps.
PhaseCorrection phase_correction_of(const std::vector<double>& response, int steps);

// Returns how the mean of `steps` equally spaced images behind a response deviates from its average over the phase, relative
// to the modulation, at equally spaced true phases from 0; steps centred on zero. Empty for a linear response.
std::vector<double> mean_ripple_of(const std::vector<double>& response, int steps);

// Largest magnitude of the correction, rad.
double largest_offset_rad(const PhaseCorrection& correction);

}  // namespace fringeslam
