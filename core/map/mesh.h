// SPDX-License-Identifier: Apache-2.0
// The surface of one view as triangles (METHOD S23): the camera's pixel grid tells which points are
// neighbours, so there is nothing to search. Each block of 2 x 2 pixels gives two triangles, cut along its shorter
// diagonal, or one where a corner has no point.
//
// Left out are triangles with an edge p q that bridges a step in depth. With d = (p + q) / |p + q|, the ray to the
// edge's middle, a = |(q - p) . d| its extent along the ray and l = sqrt(|q - p|^2 - a^2) across it, an edge is kept if
//
//   a <= l tan(max_slope)   and   a <= max_step
//
// Vertices wind counter-clockwise as the camera sees them: normals (q - p) x (r - p) face the camera.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "core/types/frame.h"
#include "core/types/options.h"

namespace fringeslam {

struct MeshOptions {
  double max_slope_deg = 80;
  double max_step_m = 0.02;

  template <class Visitor>
  void describe(Visitor& v) {
    v.field("max_slope_deg", max_slope_deg, {1, 89.9}, "steepest edge of a triangle, against the plane across the ray");
    v.field("max_step_m", max_step_m, {1e-6, 100}, "largest extent of an edge along the ray, m");
  }
};

struct MeshVertex {
  Eigen::Vector3f position_m;  // camera frame
  uint8_t grey = 0;
};

struct Mesh {
  std::vector<MeshVertex> vertices;                // those of some triangle, in the order of the pixels
  std::vector<std::array<uint32_t, 3>> triangles;  // indices into vertices
};

// Throws Error when options are out of range.
Mesh frame_mesh(const Frame& frame, const MeshOptions& options);

// Binary PLY with the grey value as colour.
std::string to_ply(const Mesh& mesh);

}  // namespace fringeslam
