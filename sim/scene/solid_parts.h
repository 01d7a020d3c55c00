// SPDX-License-Identifier: Apache-2.0
// Building blocks for solids and furniture: closed surfaces built from rings or lattice cells, and convex polytopes
// that enclose them. Lengths in m; surfaces are oriented outwards.
#pragma once

#include <Eigen/Core>
#include <array>
#include <functional>
#include <span>
#include <vector>

#include "sim/scene/solids.h"

namespace fringeslam::sim {

using Points3d = std::vector<Eigen::Vector3d>;

// Builds a closed surface through rings with equal numbers of points, each counter-clockwise seen from the side of the
// following rings. Triangle fans around the means of the end rings close it.
Mesh loft(const std::vector<Points3d>& rings);

// Builds a closed surface through the rings with the last ring joined to the first.
Mesh loft_closed(const std::vector<Points3d>& rings);

// Builds a ring around each point of a curve. `section` returns the offset of a ring point at an angle, in the normal,
// binormal and tangent directions of a frame transported along the curve without twist; the normal starts near `up`.
std::vector<Points3d> rings_along(const Points3d& curve, int sides, const Eigen::Vector3d& up,
                                  const std::function<Eigen::Vector3d(size_t ring, double angle)>& section);

// Concatenates the points of all rings.
Points3d joined(std::span<const Points3d> rings);

// Builds the surface of the filled cells of a rectilinear lattice. Filled cells must not touch along an edge only.
using Ticks = std::array<std::vector<double>, 3>;
Mesh cells_mesh(const Ticks& ticks, const std::function<bool(const Eigen::Vector3d& cell_centre)>& filled);
Mesh cells_mesh(const Ticks& ticks);  // all cells filled

// Returns `cells` + 1 equally spaced ticks over [-size / 2, size / 2].
std::vector<double> even_ticks(double size, int cells);

// Returns ticks at the ascending `breaks`, two more within `border` on either side of each inner break (on one side of
// the first and last), and cells of at most `cell` in between.
std::vector<double> bordered_ticks(const std::vector<double>& breaks, double cell, double border);

// Appends the triangles of `part` to `mesh`.
void append(Mesh& mesh, const Mesh& part);
void transform(Points3d& points, const Eigen::Transform<double, 3, Eigen::Isometry>& pose);

// Scales (per axis) and translates the mesh so that its bounding box is centred and has this size.
void fit(Mesh& mesh, const Eigen::Vector3d& size);

// Returns the centroid of the enclosed volume; overlapping parts each count.
Eigen::Vector3d centroid(const Mesh& mesh);

// Evaluates the Catmull-Rom cubic from `from` (t = 0) to `to` (t = 1).
double catmull_rom(double before, double from, double to, double after, double t);

// Returns the eight corners of a centred box.
Points3d box_corners(const Eigen::Vector3d& size);

// Returns the corners of a convex polytope that encloses all points, which must not be coplanar: their convex hull if
// it has at most `max_corners` corners, else the hull of the most significant points, scaled about an interior point
// until it encloses the rest.
Points3d convex_cover(const Points3d& points, size_t max_corners = 64);

// Returns the corners of a regular prism with `sides` sides along `axis` that encloses all points.
Points3d prism_cover(const Points3d& points, const Eigen::Vector3d& axis, int sides);

// Splits the mesh's vertices into parts by the part index of each triangle's centre; convex covers of all parts
// together cover the surface. Parts without triangles are omitted.
std::vector<Points3d> split(const Mesh& mesh, int parts,
                            const std::function<int(const Eigen::Vector3d& triangle_centre)>& part_of);

// Returns the convex cover of each part.
std::vector<Points3d> covers(const std::vector<Points3d>& parts, size_t max_corners = 64);

// Translates mesh and hulls so that the mesh's centroid is at the origin.
Solid centred(Mesh mesh, std::vector<Points3d> hulls);

}  // namespace fringeslam::sim
