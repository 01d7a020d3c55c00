// SPDX-License-Identifier: Apache-2.0
// Clouds and meshes that other systems wrote as PLY (G. Turk, The PLY polygon file format, 1994): ascii, and binary of
// either byte order; coordinates of any numeric type; faces of any number of corners, or none. What else the file holds
// is skipped.
#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <vector>

namespace fringeslam {

struct PlyMap {
  std::vector<Eigen::Vector3d> vertices;   // finite
  std::vector<Eigen::Vector3i> triangles;  // polygons as fans; none of a cloud
  size_t dropped = 0;                      // vertices that were not finite; faces at them are gone as well
};

// Whether the file begins as PLY files do.
bool is_ply(const std::filesystem::path& file);

// Throws Error with file:line (in a binary body, with the element's number) on what is missing, cut off or no number,
// on corners that are no vertex, and when there is no vertex.
PlyMap read_ply(const std::filesystem::path& file);

}  // namespace fringeslam
