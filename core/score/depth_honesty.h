// SPDX-License-Identifier: Apache-2.0
// Depth that is present, and depth that is confidently wrong.
#pragma once

#include <algorithm>

#include "core/types/frame.h"
#include "core/types/truth.h"

namespace fringeslam {

// Pixels in the beam, neither in shadow nor mixed.
struct DepthHonesty {
  int lit = 0;
  int measured = 0;   // with a depth
  int dishonest = 0;  // off by more than 4 sigmas

  // Adds a view. Only points_m and sigma_m of the frame are used.
  void add(const Frame& frame, const TruthFrame& truth);
  double measured_share() const { return static_cast<double>(measured) / std::max(1, lit); }
  double honest_share() const { return static_cast<double>(measured - dishonest) / std::max(1, lit); }
  double dishonest_share() const { return static_cast<double>(dishonest) / std::max(1, measured); }  // of the measured
};

}  // namespace fringeslam
