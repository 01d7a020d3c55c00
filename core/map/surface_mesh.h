// SPDX-License-Identifier: Apache-2.0
// The fused surface as triangles, and the files that viewers open.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "core/map/cloud.h"

namespace fringeslam {

struct SurfaceMesh {
  std::vector<CloudPoint> vertices;  // world frame; normals point out of the surface
  // Indices into vertices, counter-clockwise seen from outside.
  std::vector<std::array<uint32_t, 3>> triangles;
};

// Binary PLY: vertices as those of a cloud's file (normal, grey value as colour, sigma), then faces.
std::string to_ply(const SurfaceMesh& mesh);

// glTF 2.0 as one binary file, in the world frame's metres under a node that turns the world's z up into glTF's y up.
// The grey value is the colour, which in glTF is linear like the camera's; sigma is the attribute _SIGMA. Throws Error
// when the mesh is beyond the format's 4 GiB.
std::string to_glb(const SurfaceMesh& mesh);

}  // namespace fringeslam
