// SPDX-License-Identifier: Apache-2.0
// The fused surface as triangles.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "core/map/cloud.h"

namespace fringeslam {

struct SurfaceMesh {
  std::vector<CloudPoint> vertices;  // world frame; normals point outwards
  // Indices into vertices, counter-clockwise as seen from outside.
  std::vector<std::array<uint32_t, 3>> triangles;
};

}  // namespace fringeslam
