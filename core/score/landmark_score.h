// SPDX-License-Identifier: Apache-2.0
// Scores landmarks against exact ground truth (docs/method.md, section 13). A keypoint's true 3D point is where its
// viewing ray meets the scene.
#pragma once

#include <vector>

#include "core/types/landmark.h"
#include "core/types/pinhole.h"
#include "core/types/truth.h"

namespace fringeslam {

// Landmarks detected in a view, with the view's ground truth.
struct ScoredView {
  const Landmarks* landmarks = nullptr;
  const TruthFrame* truth = nullptr;
  Pose world_from_camera;  // ground truth
};

struct LandmarkScore {
  int landmarks = 0;   // of the current view
  int covisible = 0;   // at least half of the keypoints are visible and lit in one of the earlier views
  int recognised = 0;  // covisible landmarks with at least four correct matches
  int repeated = 0;    // covisible landmarks whose outline overlaps a landmark of that view, IoU at least 0.5
  int false_reidentifications = 0;  // recognitions with fewer than four correct matches
  int matches = 0, right = 0;  // keypoint matches in recognitions; right: their true points coincide within the sum of
                               // their sigmas and half a pixel's footprint
  std::vector<double> purity;  // per landmark: share of its keypoints on its most frequent object
};

// Scores the landmarks of `current` and their recognitions; `earlier[i]` is the view that recognitions call frame i.
LandmarkScore score_landmarks(const std::vector<ScoredView>& earlier, const ScoredView& current,
                              const std::vector<Recognition>& recognitions, const Pinhole& camera);

// True if the true 3D points of a match's two keypoints coincide within their sigmas and half a pixel's footprint.
bool is_correct_match(const ScoredView& earlier, const ScoredView& current, const KeypointMatch& match,
                      const Pinhole& camera);

}  // namespace fringeslam
