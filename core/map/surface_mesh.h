// SPDX-License-Identifier: Apache-2.0
// The fused surface as triangles, and its export to files.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "core/map/cloud.h"

namespace fringeslam {

struct SurfaceMesh {
  std::vector<CloudPoint> vertices;  // world frame; normals point outwards
  // Indices into vertices, counter-clockwise as seen from outside.
  std::vector<std::array<uint32_t, 3>> triangles;
};

// Returns a glTF 2.0 binary file, in metres in the world frame, under a node that rotates the world's z axis (up) to
// glTF's y axis. The colour is the grey value, linear in glTF as in the camera; sigma is the attribute _SIGMA. Throws
// Error if the mesh exceeds the format's 4 GiB.
std::string to_glb(const SurfaceMesh& mesh);

// Returns whether a GLB file can hold a mesh of this size.
bool fits_glb(uint64_t vertices, uint64_t triangles);

// Converts a mesh written by PlyWriter to such a file, without reading it into memory as a whole. Throws Error if a file
// cannot be read or written, or if the mesh does not fit.
void ply_to_glb(const std::filesystem::path& ply, const std::filesystem::path& glb);

}  // namespace fringeslam
