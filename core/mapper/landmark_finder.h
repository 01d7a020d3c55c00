// SPDX-License-Identifier: Apache-2.0
// Landmarks of a view and their re-identification in earlier keyframes (docs/method.md, section 5).
#pragma once

#include <functional>
#include <vector>

#include "core/landmarks/keypoints.h"
#include "core/landmarks/landmarks.h"
#include "core/landmarks/recognition.h"

namespace fringeslam {

struct LandmarkFinderOptions {
  KeypointOptions keypoints;
  ConditioningOptions conditioning;
  ClusterOptions clusters;
  LandmarkOptions landmarks;
  RecognitionOptions recognition;
};

struct FoundLandmarks {
  Keypoints keypoints;
  Landmarks landmarks;
  std::vector<Recognition> recognitions;  // earlier_frame is the number of a keyframe
  bool searched() const { return keypoints.detected > 0; }
};

class LandmarkFinder {
 public:
  LandmarkFinder(const RigModel& rig, const LandmarkFinderOptions& options);
  // Finds the landmarks of a frame and re-identifies those of earlier keyframes; searches longer, if asked to, when none is.
  FoundLandmarks find(const Frame& frame, bool longer) const;
  // Searches longer for the landmarks of a frame in which find() re-identified none.
  std::vector<Recognition> search_longer(const Landmarks& landmarks) const;
  void add_keyframe(int keyframe, const KnownLandmarks& landmarks) { database_.add(keyframe, landmarks); }
  // Adds keyframes 0 to count - 1.
  void add_keyframes(int count, const std::function<const KnownLandmarks&(int keyframe)>& landmarks_of) {
    database_.add(0, count, landmarks_of);
  }

 private:
  RigModel rig_;
  LandmarkFinderOptions options_;
  PixelRays rays_;
  LandmarkDatabase database_;
};

}  // namespace fringeslam
