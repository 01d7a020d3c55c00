// SPDX-License-Identifier: Apache-2.0
// Statistics of trials.
#pragma once

#include <cstdint>
#include <vector>

namespace fringeslam::studies {

struct Interval {
  double low = 0, high = 0;
};

// Returns the 95 % interval of a probability with `successes` in `trials` (Wilson 1927); [0, 1] for no trials.
Interval wilson(int successes, int trials);

struct SobolIndex {
  double first = 0,
         total = 0;             // shares of the output's variance: of the parameter alone; and including interactions
  Interval first_95, total_95;  // by bootstrap over the rows
};

// Returns the indices of a parameter from the rows of a saltelli design (Saltelli et al. 2010, table 2 b and f):
// outputs of A, of B, and of A with that parameter from B. NaN if the output does not vary.
SobolIndex sobol(const std::vector<double>& a, const std::vector<double>& b, const std::vector<double>& a_with_b,
                 uint64_t seed = 1);

// Returns the first-order index from independent trials: the variance of the output's mean over `bins` equally large
// classes of similar parameter values, corrected for chance, relative to the total variance. `total` stays NaN.
SobolIndex first_order(const std::vector<double>& parameter, const std::vector<double>& output, int bins = 12,
                       uint64_t seed = 1);

}  // namespace fringeslam::studies
