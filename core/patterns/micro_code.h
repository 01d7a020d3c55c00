// SPDX-License-Identifier: Apache-2.0
// Choice of the periods of micro phase shifting: further periods within a narrow band about the first one, whose single
// images distinguish the orders of its fringes (Gupta and Nayar, CVPR 2012).
#pragma once

#include <vector>

namespace fringeslam {

// Number of fringe orders of a period over a projector of this length.
int micro_orders(double period_px, int length_px);

struct MicroCodeDistance {
  // Least distance between the images of two orders at the same phase: root of the sum of squared differences, relative
  // to the modulation.
  double distance = 0;
  int apart = 0;  // difference between these orders
};

// Compares all orders of `period_px` over `length_px` that images of the other periods have to distinguish.
MicroCodeDistance micro_code_distance(double period_px, const std::vector<double>& other_periods_px, int length_px);

// Returns `count` periods within a tenth of `period_px` whose images distinguish its orders best, by a seeded random
// search. Throws Error if no periods do.
std::vector<double> micro_periods(double period_px, int count, int length_px);

}  // namespace fringeslam
