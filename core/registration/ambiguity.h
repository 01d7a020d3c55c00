// SPDX-License-Identifier: Apache-2.0
// Registrations that explain two views nearly as well as the one found (docs/method.md, section 7.3).
//
// On repetitive structure, poses that are whole periods apart fit equally well, and no covariance around one of them
// shows it. Alternatives are searched along the dominant plane of the target, by correlation of heights and texture over
// all shifts (and over the rotations that a lattice can have), refined by depth and texture, and compared with the
// registration by log-likelihood over the same evidence: depth residuals, surfaces that one view sees through the
// other's, and texture.
#pragma once

#include <functional>
#include <vector>

#include "core/types/frame.h"
#include "core/types/options.h"
#include "core/types/pinhole.h"
#include "core/types/pose.h"

namespace fringeslam {

struct AmbiguityOptions {
  bool detect = true;
  double min_difference = 25;
  double min_structure = 0.4;
  double min_explained = 0.5;

  template <class Visitor>
  void describe(Visitor& v) {
    v.field("detect", detect, "search for other registrations that explain the views as well");
    v.field("min_difference", min_difference, {0, 1e6},
            "least log-likelihood by which a registration must exceed its alternatives, plus three sigmas");
    v.field("min_structure", min_structure, {0, 1},
            "least structure explained by an alternative, as a share of that explained by the registration");
    v.field("min_explained", min_explained, {0, 1}, "least share of the structure in the overlap that a pose explains");
  }
};

struct AlternativePose {
  Pose target_from_source;
  double log_likelihood = 0;  // minus that of the registration
};

struct AmbiguityReport {
  // Share of the structure in the overlap, relief and texture, that the registration explains. Computed only if
  // everything is searched or similar places exist; otherwise 1.
  double explained = 1;
  bool contradicted = false;                  // explained < min_explained
  std::vector<AlternativePose> alternatives;  // not significantly less likely; the most likely first
};

// True for poses that may be alternatives, for instance those in the neighbourhood of a prediction.
using Admissible = std::function<bool(const Pose& target_from_source)>;

// Searches alternatives to the registration `target_from_source` that differ from it by more than least_period_m():
// everywhere, or among the poses that are `admissible`, which then exclude turns by a symmetry of a lattice. Throws Error
// for options out of range.
AmbiguityReport find_alternatives(const Frame& target, const Frame& source, const Pinhole& camera,
                                  const Pose& target_from_source, const AmbiguityOptions& options,
                                  const Admissible& admissible = {});

// Returns the smallest displacement between alternatives in views of surfaces about `distance_m` away: 6 pixels, and at
// least 1 mm.
double least_period_m(const Pinhole& camera, double distance_m);

// Agreement of two depth images at a pose that is known to within `tolerance_m`, at points with normals.
struct DepthAgreement {
  double overlap = 0;  // share of the source's points that fall on a target point
  double agrees = 0;   // share of those within the tolerance whose normals differ by less than 60 degrees
};

DepthAgreement depth_agreement(const Frame& target, const Frame& source, const Pinhole& camera,
                               const Pose& target_from_source, double tolerance_m);

}  // namespace fringeslam
