// SPDX-License-Identifier: Apache-2.0
// What counts of trials allow to say.
#pragma once

#include <cstdint>
#include <vector>

namespace fringeslam::studies {

struct Interval {
  double low = 0, high = 0;
};

// The 95 % interval of a probability, of which `successes` of `trials` came out (Wilson 1927). [0, 1] of none.
Interval wilson(int successes, int trials);

struct SobolIndex {
  double first = 0,
         total = 0;  // share of the output's variance: by the parameter alone; and with all that it takes part in
  Interval first_95, total_95;  // by bootstrap over the rows
};

// Of one parameter from the rows of a saltelli design (Saltelli et al. 2010, table 2 b and f): outputs of A, of B, and
// of A with that parameter from B. NaN when the output does not vary.
SobolIndex sobol(const std::vector<double>& a, const std::vector<double>& b, const std::vector<double>& a_with_b,
                 uint64_t seed = 1);

// The first-order index from independent trials: the variance of the mean over `bins` classes of equally many trials
// that are alike in the parameter, less what chance alone gives, over the whole variance. total stays NaN.
SobolIndex first_order(const std::vector<double>& parameter, const std::vector<double>& output, int bins = 12,
                       uint64_t seed = 1);

}  // namespace fringeslam::studies
