// SPDX-License-Identifier: Apache-2.0
// Reads PLY point clouds and meshes written by other systems (G. Turk, The PLY polygon file format, 1994): ASCII or
// binary of either byte order, coordinates of any numeric type, faces with any number of corners or no faces. Other
// elements and properties are skipped.
#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <vector>

namespace fringeslam {

struct PlyMap {
  std::vector<Eigen::Vector3d> vertices;   // finite
  std::vector<Eigen::Vector3i> triangles;  // polygons split into triangle fans; empty for a cloud
  size_t dropped = 0;                      // number of non-finite vertices removed, together with their faces
};

// True if the first line of the file is the PLY signature.
bool is_ply(const std::filesystem::path& file);

// Reads a PLY file. Throws Error with file:line (for binary bodies, with the element's number) if the file is malformed
// or truncated, if a face refers to a non-existent vertex, or if no finite vertex remains.
PlyMap read_ply(const std::filesystem::path& file);

}  // namespace fringeslam
