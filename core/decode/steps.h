// SPDX-License-Identifier: Apache-2.0
// Which images of a sequence decoding uses, and the estimator of a period's phase from them.
#pragma once

#include <vector>

#include "core/decode/decode.h"
#include "core/decode/row_kernels.h"
#include "core/patterns/patterns.h"

namespace fringeslam {

// The periods of an axis, coarsest first, with as many steps of each as the options want.
std::vector<FringeGroup> used_groups(const PatternSequence& sequence, Axis axis, const DecodeOptions& options);

// Least squares over (1, cos delta_k, sin delta_k).
StepEstimator least_squares(const FringeGroup& group);

}  // namespace fringeslam
