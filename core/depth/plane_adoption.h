// SPDX-License-Identifier: Apache-2.0
// A pixel near an edge, where no window of its own is a plane, takes the normal of a window beside it on whose plane it
// lies.
#pragma once

#include "core/depth/plane_fit.h"

namespace fringeslam {

// Of the windows about the pixels of `fitted` that lie `radius` px off in one of eight directions, the normal of the
// one on whose plane each `wanted` pixel (-1, else 0) of a row lies best, within 2.5 sigmas of the noise of both. Its
// four neighbours have to lie on that plane, too: then the pixel itself holds no edge. What is found joins `normals`,
// and is wanted no more.
void adopt_normals(const FitImage& image, const NormalImages& fitted, int row, int radius, int32_t* wanted,
                   NormalImages& normals, InstructionSet set = widest_instruction_set());

}  // namespace fringeslam
