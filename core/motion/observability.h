// SPDX-License-Identifier: Apache-2.0
// Directions of motion that a registration leaves undetermined: sliding along a bare plane, or turning about a single
// line.
//
// In the tangent (omega, v) of retract() a point x of the scene moves by omega x (x - t) + v. With c the centroid of
// the points, s their spread and u = omega x (c - t) + v the motion of c, z = (s omega, u) measures the displacement
// of the scene in m. Eigenvectors of the information of z with eigenvalues below max_displacement_sigma_m^-2 span the
// unconstrained subspace. Eigenvectors of equal eigenvalues are arbitrary combinations, so the subspace gets a
// well-defined basis: first its intersection with the translations; then, with u orthogonal to those, its principal
// screws (R. S. Ball, A treatise on the theory of screws, 1900), which are pure rotations if they do not advance along
// their axis. Where axes are ambiguous, those nearest to the frame's axes are chosen. No matrix is inverted: the
// information may be singular.
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
            "largest sigma of the scene's position in a determined direction, m");
  }
};

enum class FreeKind { translation, rotation, screw };

struct UnobservableDirection {
  FreeKind kind = FreeKind::translation;
  Eigen::Vector3d axis = Eigen::Vector3d::Zero();     // unit
  Eigen::Vector3d point_m = Eigen::Vector3d::Zero();  // on the axis of a rotation or screw, near the centroid
  double pitch_m = 0;                                 // of a screw: advance along the axis per radian
  double sigma = 0;                                   // m for translations, else rad; infinite if unconstrained
};

// Returns e.g. "slides along (0.00, 1.00, 0.00)" or "turns about (0.00, 0.00, 1.00) through (0.100, 0.000, 0.800) m".
std::string to_string(const UnobservableDirection& direction);

// Returns the unconstrained directions, in the target's frame. `information` refers to the tangent of retract() at
// `target_from_source`; `centre_m` is the points' centroid in the target's frame and `spread_m` their RMS distance
// from it (0: 1 m is used for rotations). A rotation about a point farther away than 20 spreads counts as a
// translation; a screw needs an advance of at least spread / 20 per radian. Throws Error if an argument is not finite.
std::vector<UnobservableDirection> unobservable_directions(const Matrix6d& information, const Pose& target_from_source,
                                                           const Eigen::Vector3d& centre_m, double spread_m,
                                                           const ObservabilityOptions& options);

}  // namespace fringeslam
