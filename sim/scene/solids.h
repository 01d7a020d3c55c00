// SPDX-License-Identifier: Apache-2.0
// Rubble pieces as pure functions: the same arguments give the same solid. Lengths in m, angles in rad, object frame;
// the origin is the centroid of the volume, z is the long or the upward axis. Meshes are closed (some consist of
// several overlapping closed parts) and oriented outwards; the seed selects the individual shape.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "sim/scene/mesh.h"

namespace fringeslam::sim {

// A piece of a pile: a mesh for rendering and convex hulls for collision. The union of the hulls covers the mesh.
struct Solid {
  Mesh mesh;
  std::vector<std::vector<Eigen::Vector3d>> hulls;  // corners of convex parts; at most 64 per part
};

Solid box_solid(const Eigen::Vector3d& size);

// Builds a broken stone with this bounding box and 20 * 4^detail triangles. Roughness 0 gives smooth fractures, 0.3
// rugged ones.
Solid rock_solid(const Eigen::Vector3d& size, int detail, double roughness, uint32_t seed);

// Builds a brick with worn, chipped edges, never larger than `size`.
Solid brick_solid(const Eigen::Vector3d& size, uint32_t seed);

// Builds a piece of a concrete slab with this bounding box: irregular convex outline, flat top and bottom, broken
// edges.
Solid slab_solid(const Eigen::Vector3d& size, uint32_t seed);

// Builds packaging foam with this bounding box: an L or U section in the xy plane, extruded along z, with a recess in
// its base.
Solid foam_solid(const Eigen::Vector3d& size, uint32_t seed);

// Builds a hollow pipe along z, open at both ends, with at least 3 sides.
Solid pipe_solid(double outer_radius, double wall, double length, int sides);

// Builds a ribbed bar with one or two bends of about `bend` each. The radius excludes the ribs; the length is measured
// along the bar, which starts along z.
Solid rebar_solid(double radius, double length, double bend, uint32_t seed);

// Builds a tangle of one wire that makes about `loops` loops within a bounding cube of edge `extent`.
Solid wire_solid(double radius, double extent, int loops, uint32_t seed);

// Builds a mannequin's forearm, cut off at the elbow, with its hand; fingers towards +z, palm towards -y.
Solid arm_solid(double length, uint32_t seed);

// Builds a board with its length along z, width along x and thickness along y: bowed along y (by at most 0.01 of its
// length) and splintered at +z.
Solid plank_solid(const Eigen::Vector3d& size, uint32_t seed);

// Builds a sheet of paper, 0.3 mm thick, with a few folds, curled by about `curl` in total along x (above 4 it would
// intersect itself). Its centre lies in the xy plane.
Solid paper_solid(double size_x, double size_y, double curl, uint32_t seed);

// Builds a cardboard box of 3 mm panels, open at the top and closed at the bottom. `size` excludes the four flaps,
// whose angles are drawn from the given range: 0 closes the box, pi / 2 is upright, pi is horizontal outwards, 3 pi / 2
// hangs down.
Solid carton_solid(const Eigen::Vector3d& size, double min_flap_angle, double max_flap_angle, uint32_t seed);

// Builds a filled plastic bag with this bounding box, creased and gathered at its neck.
Solid bag_solid(const Eigen::Vector3d& size, uint32_t seed);

}  // namespace fringeslam::sim
