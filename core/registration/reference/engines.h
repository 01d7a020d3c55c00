// SPDX-License-Identifier: Apache-2.0
// Registration engines by name (docs/method.md, section 7.1), with a common result type.
//
//   point_to_plane     this project's engine, see icp.h
//   besl_mckay         P. Besl and N. McKay, A method for registration of 3-D shapes, PAMI 14 (1992): every point is
//                      paired with the nearest one until the mean square distance converges
//   zhang              Z. Zhang, Iterative point matching for registration of free-form curves and surfaces, IJCV 13
//                      (1994): pairs beyond D_max are dropped; D_max follows from the mean and the standard deviation
//                      of the distances. One point in five in the first rounds, all points in the last
//   pcl_icp, pcl_gicp  engines of the Point Cloud Library
//
// The last four are references. They use every `points_every`-th pixel of every `points_every`-th row; their
// information matrix is that of point pairs with the RMS distance as sigma.
#pragma once

#include <array>
#include <vector>

#include "core/registration/icp.h"
#include "core/types/options.h"

namespace fringeslam {

enum class RegistrationEngine { point_to_plane, besl_mckay, zhang, pcl_icp, pcl_gicp };

constexpr auto choices(RegistrationEngine) {
  using enum RegistrationEngine;
  return std::to_array<Choice<RegistrationEngine>>({{point_to_plane, "point_to_plane"},
                                                    {besl_mckay, "besl_mckay"},
                                                    {zhang, "zhang"},
                                                    {pcl_icp, "pcl_icp"},
                                                    {pcl_gicp, "pcl_gicp"}});
}

// Returns all engines.
inline std::vector<RegistrationEngine> registration_engines() { return choice_values<RegistrationEngine>(); }

// Registers `source` to `target` by one of the engines. Throws Error for options out of range. The result has not
// converged if there are fewer than 100 points or pairs.
IcpResult register_with_engine(RegistrationEngine engine, const Frame& target, const Frame& source,
                               const Pinhole& camera, const Pose& initial, const IcpOptions& options,
                               int points_every = 3);

}  // namespace fringeslam
