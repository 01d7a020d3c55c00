// SPDX-License-Identifier: Apache-2.0
// Bodies dropped onto level ground until they lie still: rigid bodies with friction (Bullet), each a union of convex
// hulls. The ground is z = 0, up is z; lengths in m.
//
// The same bodies, area and seed give the same poses, to the last bit: the steps are of one length, bodies are taken
// in their order, and the solver is the one that does not ask what the processor can do.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "core/types/pose.h"

namespace fringeslam::sim {

using Hull = std::vector<Eigen::Vector3d>;  // corner points of a convex body

struct Body {
  std::vector<Hull> hulls;  // of its own frame
  double density_kg_m3 = 1000;
  double friction = 0.6;
};

struct DropArea {
  double size_x = 1, size_y = 1;  // about the origin
  double wall_height = 0;         // of unseen walls around the area, without an end while bodies fall; 0: none at all
};

struct Settled {
  std::vector<Pose> ground_from_body;
  double energy_j_per_kg = 0;  // greatest kinetic energy of a body by its mass
  double penetration_m = 0;    // deepest of two bodies, or of one and the ground; negative: a gap everywhere
  double time_s = 0;           // simulated, from the first drop to rest
  int dropped_again = 0;       // bodies that had come to rest within others, or not at all
};

// Throws Error when they do not come to rest.
Settled settle(const std::vector<Body>& bodies, const DropArea& area, uint64_t seed);

// How far each body's centre of mass moves when all are put at these poses, still, and left alone for so long (m): what
// rests stays, but for the millimetre a second that the solver's contacts creep.
std::vector<double> drifts_m(const std::vector<Body>& bodies, const DropArea& area,
                             const std::vector<Pose>& ground_from_body, double seconds);

}  // namespace fringeslam::sim
