// SPDX-License-Identifier: Apache-2.0
// Which motions a registration leaves undetermined, by name: along a bare plane it slides, about a lone line it turns.
//
// In the tangent (omega, v) of retract() a point x of the scene moves by omega x (x - t) + v. With c the centre of the
// points, s their spread and u = omega x (c - t) + v the motion of c, z = (s omega, u) is how far the scene is moved,
// in m. Eigenvectors of the information of z with eigenvalues below max_displacement_sigma_m^-2 span what is free.
// Those of equal eigenvalues are arbitrary combinations, so the span gets a basis of its own: first what it shares with
// the translations; then, with u orthogonal to those, its principal screws (R. S. Ball, A treatise on the theory of
// screws, 1900), which are turns about a line when nothing advances along it. Axes are chosen nearest to those of the
// frame where there is a choice. Nothing is inverted: the information may be singular.
#pragma once

#include <string>
#include <vector>

#include "core/types/options.h"
#include "core/types/pose.h"

namespace fringeslam {

struct ObservabilityOptions {
  double max_displacement_sigma_m = 0.01;

  template <class Visitor>
  void describe(Visitor& v) {
    v.field("max_displacement_sigma_m", max_displacement_sigma_m, {1e-9, 100},
            "largest sigma of the scene's place in a determined direction, m");
  }
};

enum class FreeKind { translation, rotation, screw };

struct FreeDirection {
  FreeKind kind = FreeKind::translation;
  Eigen::Vector3d axis = Eigen::Vector3d::Zero();     // unit
  Eigen::Vector3d point_m = Eigen::Vector3d::Zero();  // on the axis of a rotation or screw, near the scene's centre
  double pitch_m = 0;                                 // of a screw: advance along the axis per radian
  double sigma = 0;                                   // m, of rotations and screws rad; infinite when nothing holds it
};

// "slides along (0.00, 1.00, 0.00)", "turns about (0.00, 0.00, 1.00) through (0.100, 0.000, 0.800) m".
std::string to_string(const FreeDirection& direction);

// `information` holds in the tangent of retract() at `target_from_source`; `centre_m` of the points is in the target's
// frame, where the directions are given too, and `spread_m` their RMS distance from it (0: rotations count as if it
// were 1 m). A turn about a point farther than 20 spreads is a slide; an advance below spread / 20 a radian makes no
// screw. Throws Error when an argument is not finite.
std::vector<FreeDirection> free_directions(const Matrix6d& information, const Pose& target_from_source,
                                           const Eigen::Vector3d& centre_m, double spread_m,
                                           const ObservabilityOptions& options);

}  // namespace fringeslam
