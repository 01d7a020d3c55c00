// SPDX-License-Identifier: Apache-2.0
// Fixed obstacles and screens for test scenes. Lengths in m; object frame: standing on z = 0, centred in x and y. The
// meshes are closed and oriented outwards.
#pragma once

#include <Eigen/Core>

#include "sim/scene/mesh.h"

namespace fringeslam::sim {

// Builds a ramp that rises along +x from z = 0 to size.z.
Mesh wedge_mesh(const Eigen::Vector3d& size);

// Builds a bowl that opens upwards: paraboloids inside and outside, a tenth of size.z apart along z.
Mesh bowl_mesh(const Eigen::Vector3d& size);

// Builds equal steps that rise along +x; the first step is size.z / steps high, the last ends at size.z.
Mesh stairs_mesh(const Eigen::Vector3d& size, int steps);

// Builds a Venetian blind in the xz plane: slats along x, rotated about x, between two posts. At angle 0 the slats are
// horizontal and the blind is open; at pi / 2 they are vertical and leave gaps of one thickness. Its depth is
// height / slats.
Mesh blinds_mesh(double width, double height, int slats, double slat_angle_rad, double thickness);

// Builds a plate in the xy plane with a rectangular hole centred in each grid cell; the holes are square if
// size_x / columns = size_y / rows. `hole_share`, in (0, 1), is the holes' fraction of the plate's area.
Mesh lattice_mesh(double size_x, double size_y, double thickness, int columns, int rows, double hole_share);

}  // namespace fringeslam::sim
