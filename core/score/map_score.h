// SPDX-License-Identifier: Apache-2.0
// Maps against the true surface: accuracy is how far the map's points are from it, completeness how far what the sensor
// saw of it is from the map. With a tolerance t, precision and recall are the shares within t, and F their harmonic
// mean (A. Knapitsch et al., Tanks and Temples, 2017). Distances are the caller's: those of `sim/nearest_surface.h`.
#pragma once

#include <cmath>
#include <vector>

#include "core/types/frame.h"
#include "core/types/rig_model.h"
#include "core/types/truth.h"

namespace fringeslam {

// Adds, in the world frame, what a view's sensor can see: of every fourth pixel of every fourth row lit surface within
// the working range that is all of its pixel, met by the camera's and the projector's ray at less than 80 degrees to
// its normal. `rays` are those of rig.camera.
void append_seen(const TruthFrame& truth, const RigModel& rig, const PixelRays& rays,
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

// Distances from each point of the map to the true surface, and from each seen point of that to the map.
MapScore score_map(const std::vector<double>& map_to_truth_m, const std::vector<double>& truth_to_map_m,
                   double threshold_m);

}  // namespace fringeslam
