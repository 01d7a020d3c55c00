// SPDX-License-Identifier: Apache-2.0
// Scores maps against the true surface. Accuracy is the distance from the map's points to the true surface;
// completeness is the distance from the surface points seen by the sensor to the map. Precision and recall are shares
// within a tolerance, and F is their harmonic mean (A. Knapitsch et al., Tanks and Temples, 2017). The caller computes
// the distances, for example with `sim/nearest_surface.h`.
#pragma once

#include <cmath>
#include <vector>

#include "core/types/frame.h"
#include "core/types/rig_model.h"
#include "core/types/truth.h"

namespace fringeslam {

// Appends the surface points that the sensor can see in one view, world frame, m. Samples every fourth pixel of every
// fourth row and keeps those whose only mask bits are kTruthSurface and kTruthInBeam (lit, unmixed), whose depth is
// within the working range, and which the camera's and the projector's rays meet at less than 80 degrees to the normal.
// `rays` are those of rig.camera. Throws Error if the images do not have their size.
void append_visible_surface(const TruthFrame& truth, const RigModel& rig, const PixelRays& rays,
                            std::vector<Eigen::Vector3d>& seen);

struct DistanceStatistics {
  size_t points = 0;
  double mean_m = NAN, median_m = NAN, p90_m = NAN, rms_m = NAN;  // p90: 90th percentile
};

struct MapScore {
  double threshold_m = 0;
  DistanceStatistics accuracy, completeness;
  double precision = 0, recall = 0;  // shares within the threshold
  double f_score() const { return precision + recall > 0 ? 2 * precision * recall / (precision + recall) : 0; }
};

// Computes the scores from the distances of map points to the true surface and of seen surface points to the map.
MapScore score_map(const std::vector<double>& map_to_truth_m, const std::vector<double>& truth_to_map_m,
                   double threshold_m);

}  // namespace fringeslam
