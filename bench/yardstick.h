// SPDX-License-Identifier: Apache-2.0
// How fast this machine is at the moment, for the limits of rows that are times or rates: machines of the same kind differ
// by a factor of two, and other load comes on top.
#pragma once

#include "bench/row.h"

namespace fringeslam::bench {

// Measures a fixed mix of a memory copy, multiply-adds and a gather on all cores: the time it takes, divided by that of the
// machine for which the limits were set. 2: this machine is half as fast. Takes a third of a second.
double measure_yardstick();

// True if the row is a time or a rate, which depends on the machine.
bool depends_on_machine(const Row& row);

// Notes the value on the machine for which the limit was set, and compares that with the limit.
void scale(Row& row, double yardstick);

}  // namespace fringeslam::bench
