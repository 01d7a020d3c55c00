// SPDX-License-Identifier: Apache-2.0
// Landmarks against exact truth (METHOD section 2). World points of keypoints are where their viewing rays truly meet
// the scene.
#pragma once

#include <vector>

#include "core/types/landmark.h"
#include "core/types/pinhole.h"
#include "core/types/truth.h"

namespace fringeslam {

// What was found in a view, and what is true of it.
struct JudgedView {
  const Landmarks* landmarks = nullptr;
  const TruthFrame* truth = nullptr;
  Pose world_from_camera;  // true
};

struct LandmarkScore {
  int landmarks = 0;           // of the current view
  int covisible = 0;           // at least half of the keypoints truly show, lit, in one of the earlier views
  int recognised = 0;          // of those, by at least four right matches
  int repeated = 0;            // of those, whose outline overlaps one of that view's landmarks by half of both together
  int false_recognitions = 0;  // with fewer than four right matches
  int matches = 0, right = 0;  // of keypoints in recognitions; right: their true points coincide within the sum of
                               // their sigmas and half a pixel's footprint
  std::vector<double> purity;  // of each landmark, the share of its keypoints that are on its commonest object
};

// `earlier[i]` is the view that recognitions call frame i.
LandmarkScore score_landmarks(const std::vector<JudgedView>& earlier, const JudgedView& current,
                              const std::vector<Recognition>& recognitions, const Pinhole& camera);

// Whether a match's two points are truly one.
bool is_right(const JudgedView& earlier, const JudgedView& current, const KeypointMatch& match, const Pinhole& camera);

}  // namespace fringeslam
