// SPDX-License-Identifier: Apache-2.0
// Assigns normals near edges: a pixel whose own window is not a plane takes the normal of a neighbouring window on
// whose plane it lies.
#pragma once

#include "core/depth/plane_fit.h"
#include "core/types/selected_instruction_set.h"

namespace fringeslam {

// For each `wanted` pixel (-1, else 0) of a row, considers the windows of `fitted` centred `radius` px away in eight
// directions, and takes the normal of the window whose plane fits it best, within 2.5 sigmas of the noise of both. Its
// four neighbours must lie on that plane as well, which excludes pixels that contain an edge. Normals found are stored
// in `normals` and their `wanted` flags are cleared.
void propagate_normals(const FitImage& image, const NormalImages& fitted, int row, int radius, int32_t* wanted,
                       NormalImages& normals, InstructionSet set = selected_instruction_set());

}  // namespace fringeslam
