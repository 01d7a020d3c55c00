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

#include <string>
#include <vector>

#include "core/registration/icp.h"

namespace fringeslam {

// Returns the names of the engines.
const std::vector<std::string>& registration_engines();

// Registers `source` to `target` by the named engine. Throws Error for an unknown name or options out of range. The
// result has not converged if there are fewer than 100 points or pairs.
IcpResult register_by(const std::string& engine, const Frame& target, const Frame& source, const Pinhole& camera,
                      const Pose& initial, const IcpOptions& options, int points_every = 3);

}  // namespace fringeslam
