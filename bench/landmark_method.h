// SPDX-License-Identifier: Apache-2.0
// Landmarks of a view by a variant of the method.
#pragma once

#include "bench/view_pairs.h"
#include "core/landmarks/landmarks.h"
#include "core/landmarks/recognition.h"

namespace fringeslam::bench {

// What a variant of the method may change.
struct LandmarkMethod {
  KeypointOptions keypoints;
  ConditioningOptions conditioning;
  ClusterOptions clusters;
  LandmarkOptions landmarks;
  RecognitionOptions recognition;
};

Landmarks landmarks_of(const ViewPair& pair, const View& view, const LandmarkMethod& method);

}  // namespace fringeslam::bench
