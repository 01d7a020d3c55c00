// SPDX-License-Identifier: Apache-2.0
// The things that rubble is made of, as pure functions: the same arguments give the same solid. Lengths in m, angles in
// rad, object frame; the origin is the centroid of the volume, and z the length or the upward axis. Meshes are closed
// (some are several closed parts that overlap) and oriented outwards; a seed names the individual.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "sim/scene/mesh.h"

namespace fringeslam::sim {

// A thing that can lie in a pile: what is seen of it, and what it is bumped against. The hulls' union covers the mesh.
struct Solid {
  Mesh mesh;
  std::vector<std::vector<Eigen::Vector3d>> hulls;  // corner points of convex parts; each at most 64
};

Solid box_solid(const Eigen::Vector3d& size);

// A broken stone of this bounding box: 20 * 4^detail triangles. Roughness 0 is a stone with smooth fractures, 0.3
// rugged.
Solid rock_solid(const Eigen::Vector3d& size, int detail, double roughness, uint32_t seed);

// A brick with worn edges, from which some chips are missing. Never larger than `size`.
Solid brick_solid(const Eigen::Vector3d& size, uint32_t seed);

// A piece of a concrete slab of this bounding box: an irregular convex outline, flat top and bottom, broken edges.
Solid slab_solid(const Eigen::Vector3d& size, uint32_t seed);

// Packaging foam: an L or a U section in x and y, along z, with a recess in its base. Of this bounding box.
Solid foam_solid(const Eigen::Vector3d& size, uint32_t seed);

// Hollow and open at both ends, along z; 3 sides or more.
Solid pipe_solid(double outer_radius, double wall, double length, int sides);

// A ribbed bar bent once or twice by about `bend` each time. The radius is without ribs, the length along the bar,
// which starts along z.
Solid rebar_solid(double radius, double length, double bend, uint32_t seed);

// A tangle of one piece of wire that goes round about `loops` times within a bounding cube of edge `extent`.
Solid wire_solid(double radius, double extent, int loops, uint32_t seed);

// A mannequin's forearm, cut off at the elbow, and its hand, fingers towards +z, palm towards -y.
Solid arm_solid(double length, uint32_t seed);

// A board along z, its width along x and its thickness along y: slightly bowed across its thickness (at most by 0.01 of
// its length), and broken off in splinters at +z.
Solid plank_solid(const Eigen::Vector3d& size, uint32_t seed);

// A sheet of paper, 0.3 mm thick, with a few folds, that turns by about `curl` along its x (beyond 4 it would meet
// itself). The middle lies in x and y.
Solid paper_solid(double size_x, double size_y, double curl, uint32_t seed);

// A cardboard box of 3 mm panels, open at the top, closed at the bottom. `size` is without the four flaps, whose angles
// lie in this range: 0 closes the box, pi / 2 stands up, pi lies outwards, 3 pi / 2 hangs down.
Solid carton_solid(const Eigen::Vector3d& size, double min_flap_angle, double max_flap_angle, uint32_t seed);

// A filled plastic bag of this bounding box, creased, gathered at its neck.
Solid bag_solid(const Eigen::Vector3d& size, uint32_t seed);

}  // namespace fringeslam::sim
