// SPDX-License-Identifier: Apache-2.0
// Triangle meshes and geometric primitives for scenes. Lengths in m, object frame.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

namespace fringeslam::sim {

struct Mesh {
  std::vector<Eigen::Vector3d> vertices;
  std::vector<Eigen::Vector3i> triangles;  // counter-clockwise seen from outside
  std::vector<Eigen::Vector2f> texture_coordinates =
      {};  // per vertex, v upwards; empty: textures are projected along the axes
};

Mesh plane_mesh(double size_x, double size_y);                // z = 0, centred
Mesh box_mesh(const Eigen::Vector3d& size);                   // centred
Mesh cylinder_mesh(double radius, double length, int sides);  // along z, centred
Mesh sphere_mesh(double radius, int subdivisions);            // subdivided icosahedron

// Builds a sphere displaced by fractal noise and scaled by `size` / 2 along each axis.
Mesh rock_mesh(const Eigen::Vector3d& size, int subdivisions, double roughness, uint32_t seed);

// Builds a face mask lying on z = 0, chin towards -y: a half ellipsoid with brows, eye sockets, nose and lips
// ([T] 5.2.1).
Mesh face_mask_mesh(const Eigen::Vector3d& size, int rings);

}  // namespace fringeslam::sim
