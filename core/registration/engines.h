// SPDX-License-Identifier: Apache-2.0
// Registration engines by name (METHOD S22): ours, the papers' and PCL's, with one result for all.
//
//   point_to_plane  ours, see icp.h
//   besl_mckay      P. Besl and N. McKay, A method for registration of 3-D shapes, PAMI 14 (1992): every point pairs
//   with
//                   the nearest one, until the mean square distance settles
//   zhang           Z. Zhang, Iterative point matching for registration of free-form curves and surfaces, IJCV 13
//   (1994):
//                   pairs beyond D_max are dropped; D_max follows from the mean and the spread of the distances. One
//                   point in five in the first rounds, all in the last
//   pcl_icp, pcl_gicp   of the Point Cloud Library
//
// The last four are references. They take every `points_every`-th pixel of every such row; their information is that of
// point pairs with the RMS distance as sigma.
#pragma once

#include <string>
#include <vector>

#include "core/registration/icp.h"

namespace fringeslam {

const std::vector<std::string>& registration_engines();

// Throws Error for an unknown name. Not converged where there are fewer than 100 points or pairs.
IcpResult register_by(const std::string& engine, const Frame& target, const Frame& source, const Pinhole& camera,
                      const Pose& initial, const IcpOptions& options, int points_every = 3);

}  // namespace fringeslam
