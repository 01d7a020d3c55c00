// SPDX-License-Identifier: Apache-2.0
// Fixed obstacles and screens of test scenes. Lengths in m, object frame: they stand on z = 0, centred in x and y.
// Closed meshes, oriented outwards.
#pragma once

#include <Eigen/Core>

#include "sim/scene/mesh.h"

namespace fringeslam::sim {

// A ramp that rises along +x from z = 0 to size.z.
Mesh wedge_mesh(const Eigen::Vector3d& size);

// Equal steps that rise along +x; the first is size.z / steps high, the last ends at size.z.
Mesh stairs_mesh(const Eigen::Vector3d& size, int steps);

// A Venetian blind in the plane of x and z: slats along x, turned about it, between two posts. At angle 0 they lie flat
// and one looks through; at pi / 2 they stand upright and leave gaps of one thickness. Its depth is height / slats.
Mesh blinds_mesh(double width, double height, int slats, double slat_angle_rad, double thickness);

// A plate with a grid of holes, square where size_x / columns = size_y / rows, one in the middle of each cell. The
// holes' share of the area, in (0, 1), is what one looks through.
Mesh lattice_mesh(double size_x, double size_y, double thickness, int columns, int rows, double hole_share);

}  // namespace fringeslam::sim
