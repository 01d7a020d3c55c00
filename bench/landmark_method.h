// SPDX-License-Identifier: Apache-2.0
// Landmarks of a view by a variant of the method, and registration from them.
#pragma once

#include <vector>

#include "bench/view_pairs.h"
#include "core/landmarks/landmarks.h"
#include "core/landmarks/recognition.h"
#include "core/mapper/view_registration.h"

namespace fringeslam::bench {

// What a variant of the method may change.
struct LandmarkMethod {
  KeypointOptions keypoints;
  ConditioningOptions conditioning;
  ClusterOptions clusters;
  LandmarkOptions landmarks;
  RecognitionOptions recognition;
};

Landmarks landmarks_of(const Views& views, const View& view, const LandmarkMethod& method);
std::vector<Landmarks> landmarks_of(const Views& views, const LandmarkMethod& method);

// Two views as the pipeline registers them that has seen no others, from what was recognised of the earlier one.
ViewRegistration registered(const Views& views, const std::vector<Landmarks>& landmarks, int earlier, int current,
                            const std::vector<Recognition>& recognitions);

}  // namespace fringeslam::bench
