// SPDX-License-Identifier: Apache-2.0
// Building blocks of the solids and of the furniture: closed surfaces made of rings and of lattice cells, and convex
// polytopes around them. Lengths in m; surfaces are oriented outwards.
#pragma once

#include <Eigen/Core>
#include <array>
#include <functional>
#include <span>
#include <vector>

#include "sim/scene/solids.h"

namespace fringeslam::sim {

using Points3d = std::vector<Eigen::Vector3d>;

// A closed surface through rings of equal size, each counter-clockwise seen from the side to which the rings lead. Fans
// about the means of the end rings close it.
Mesh loft(const std::vector<Points3d>& rings);

// The same, with the last ring joined to the first.
Mesh loft_around(const std::vector<Points3d>& rings);

// Rings about the points of a curve. `section` gives the offset from the curve of a ring's point at an angle: along
// normal, binormal and tangent of a frame that does not twist; the normal starts near `up`.
std::vector<Points3d> rings_along(const Points3d& curve, int sides, const Eigen::Vector3d& up,
                                  const std::function<Eigen::Vector3d(size_t ring, double angle)>& section);

// The points of all the rings.
Points3d joined(std::span<const Points3d> rings);

// The surface of the filled cells of a rectilinear lattice. Filled cells must not touch along an edge only.
using Ticks = std::array<std::vector<double>, 3>;
Mesh cells_mesh(const Ticks& ticks, const std::function<bool(const Eigen::Vector3d& cell_centre)>& filled);
Mesh cells_mesh(const Ticks& ticks);  // all of them filled

// `cells` + 1 equal steps over [-size / 2, size / 2].
std::vector<double> even_ticks(double size, int cells);

// Ticks at the ascending `breaks`, two more within `border` on either side of each, and cells of at most `cell`
// between.
std::vector<double> bordered_ticks(const std::vector<double>& breaks, double cell, double border);

void append(Mesh& mesh, const Mesh& part);
void transform(Points3d& points, const Eigen::Transform<double, 3, Eigen::Isometry>& pose);

// Scaled along the axes and moved so that the bounding box is centred and has this size.
void fit(Mesh& mesh, const Eigen::Vector3d& size);

// Of the enclosed volume; parts that overlap count once each.
Eigen::Vector3d centroid(const Mesh& mesh);

// The cubic from `from` (t = 0) to `to` (t = 1) whose slopes are those between the neighbours' neighbours.
double catmull_rom(double before, double from, double to, double after, double t);

// The eight corners of a centred box.
Points3d box_corners(const Eigen::Vector3d& size);

// Corners of a convex polytope around all the points, which must not lie in one plane: the points' convex hull where
// that has few corners, else the hull of those that matter most, enlarged about its middle until it covers the others.
Points3d convex_cover(const Points3d& points, size_t max_corners = 64);

// A regular prism of `sides` sides around all the points, along `axis`.
Points3d prism_cover(const Points3d& points, const Eigen::Vector3d& axis, int sides);

// The vertices of the triangles of each part, by a triangle's centre; a cover of each covers the surface. Parts without
// triangles are left out.
std::vector<Points3d> split(const Mesh& mesh, int parts,
                            const std::function<int(const Eigen::Vector3d& triangle_centre)>& part_of);

// Convex covers of such parts.
std::vector<Points3d> covers(const std::vector<Points3d>& parts, size_t max_corners = 64);

// Mesh and hulls moved so that the origin is the mesh's centroid.
Solid centred(Mesh mesh, std::vector<Points3d> hulls);

}  // namespace fringeslam::sim
