// SPDX-License-Identifier: Apache-2.0
// Landmarks of a view by a variant of the method, and registration based on them.
#pragma once

#include <vector>

#include "bench/view_pairs.h"
#include "core/landmarks/landmarks.h"
#include "core/landmarks/recognition.h"
#include "core/mapper/view_registration.h"

namespace fringeslam::bench {

// The options that a variant may change.
struct LandmarkMethod {
  KeypointOptions keypoints;
  ConditioningOptions conditioning;
  ClusterOptions clusters;
  LandmarkOptions landmarks;
  RecognitionOptions recognition;
};

Landmarks landmarks_of(const Views& views, const View& view, const LandmarkMethod& method);
std::vector<Landmarks> landmarks_of(const Views& views, const LandmarkMethod& method);

// Registers two views from the re-identified landmarks, as the pipeline does if it has seen no others.
ViewRegistration registered(const Views& views, const std::vector<Landmarks>& landmarks, int earlier, int current,
                            const std::vector<Recognition>& recognitions);

}  // namespace fringeslam::bench
