// SPDX-License-Identifier: Apache-2.0
// Pile simulation: drops rigid bodies with friction (Bullet), each a union of convex hulls, onto level ground until
// they come to rest. The ground is z = 0, z is up; lengths in m.
//
// The result is deterministic to the last bit for the same bodies, area and seed: the time step is fixed, bodies are
// processed in order, and the solver does not depend on the processor's instruction set.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "core/types/pose.h"

namespace fringeslam::sim {

using Hull = std::vector<Eigen::Vector3d>;  // vertices of a convex body

struct Body {
  std::vector<Hull> hulls;  // in the body frame
  double density_kg_m3 = 1000;
  double friction = 0.6;
};

struct DropArea {
  double size_x = 1, size_y = 1;  // centred on the origin
  double wall_height = 0;         // of invisible walls around the area, unbounded while bodies fall; 0: no walls
};

struct Settled {
  std::vector<Pose> ground_from_body;
  double energy_j_per_kg = 0;  // largest kinetic energy of a body per unit mass
  double penetration_m = 0;    // deepest, between bodies or with the ground; negative: gaps everywhere
  double time_s = 0;           // simulated time, from the first drop to rest
  int redrop_count = 0;        // re-drops of bodies that had not come to rest or had penetrated others
};

// Drops the bodies and simulates until all are at rest; `stream` selects the random numbers. Throws Error if they do not come
// to rest.
Settled settle(const std::vector<Body>& bodies, const DropArea& area, uint64_t seed, uint32_t stream = 0);

// Returns how far (m) each body's centre of mass moves in `seconds` of simulation when all start at rest at the given
// poses; settled bodies drift only by contact creep of the solver, about 1 mm/s.
std::vector<double> drifts_m(const std::vector<Body>& bodies, const DropArea& area,
                             const std::vector<Pose>& ground_from_body, double seconds);

}  // namespace fringeslam::sim
