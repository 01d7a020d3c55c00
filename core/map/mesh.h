// SPDX-License-Identifier: Apache-2.0
// The surface of one view as triangles (docs/method.md, section 8.3), with the neighbourhood given by the camera's
// pixel grid. Each block of 2 x 2 pixels gives two triangles, split along its shorter diagonal, or one if a corner has
// no point.
//
// Triangles with an edge p q that bridges a depth step are omitted. With d = (p + q) / |p + q|, the ray to the edge's
// midpoint, a = |(q - p) . d| its extent along the ray and l = sqrt(|q - p|^2 - a^2) its extent across the ray, an
// edge is kept if
//
//   a <= l tan(max_slope)   and   a <= max_step
//
// Vertices are ordered counter-clockwise as seen by the camera: normals (q - p) x (r - p) face the camera.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "core/types/frame.h"
#include "core/types/options.h"

namespace fringeslam {

struct MeshOptions {
  double max_slope_deg = 80;
  double max_step_m = 0.02;

  template <class Visitor>
  void describe(Visitor& v) {
    v.field("max_slope_deg", max_slope_deg, {1, 89.9},
            "largest slope of a triangle's edge relative to the plane perpendicular to the ray, degrees");
    v.field("max_step_m", max_step_m, {1e-6, 100}, "largest extent of an edge along the ray, m");
  }
};

struct MeshVertex {
  Eigen::Vector3f position_m;  // camera frame
  uint8_t grey = 0;
};

struct Mesh {
  std::vector<MeshVertex> vertices;                // only those of triangles, in pixel order
  std::vector<std::array<uint32_t, 3>> triangles;  // indices into vertices
};

// Meshes a frame. Throws Error if options are out of range.
Mesh frame_mesh(const Frame& frame, const MeshOptions& options);

}  // namespace fringeslam
