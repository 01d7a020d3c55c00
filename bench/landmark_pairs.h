// SPDX-License-Identifier: Apache-2.0
// The first two views of generated scenes, for whatever is asked of landmarks.
#pragma once

#include <string>

#include "core/landmarks/landmarks.h"
#include "core/landmarks/recognition.h"
#include "core/types/truth.h"

namespace fringeslam::bench {

// What a variant of the method may change.
struct LandmarkMethod {
  KeypointOptions keypoints;
  ConditioningOptions conditioning;
  ClusterOptions clusters;
  LandmarkOptions landmarks;
  RecognitionOptions recognition;
};

struct LandmarkView {
  Frame frame;
  TruthFrame truth;
};

struct LandmarkPair {
  RigModel rig;
  PixelRays rays;
  LandmarkView views[2];
};

LandmarkPair rendered_pair(const std::string& scene_name, uint64_t seed);

Landmarks landmarks_of(const LandmarkPair& pair, const LandmarkView& view, const LandmarkMethod& method);

}  // namespace fringeslam::bench
