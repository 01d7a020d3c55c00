// SPDX-License-Identifier: Apache-2.0
// The landmarks of a frame (METHOD S6-S17): depth keypoints in the foreground are clustered, a cluster's outline is
// laid on the texture, and gathers the texture's keypoints in it.
#pragma once

#include "core/landmarks/conditioning.h"
#include "core/landmarks/keypoints.h"
#include "core/landmarks/reference/clusters.h"
#include "core/types/frame.h"
#include "core/types/landmark.h"
#include "core/types/rig_model.h"

namespace fringeslam {

struct LandmarkOptions {
  std::string outlines = "regions";
  int min_keypoints = 20;
  int min_area_px = 600;
  int bridge_px = 6;
  double margin_px = 4;
  bool within_foreground = true;

  template <class Visitor>
  void describe(Visitor& v) {
    v.field("outlines", outlines, {"clusters", "regions"},
            "what gathers texture keypoints: the clusters of depth keypoints as in the papers, or the connected pieces "
            "of the foreground between edges");
    v.field("min_area_px", min_area_px, {1, 1000000}, "smallest region");
    v.field("bridge_px", bridge_px, {0, 100}, "half the width of a bridge between regions that does not join them");
    v.field("min_keypoints", min_keypoints, {1, 10000}, "texture keypoints without which an outline is no landmark");
    v.field("margin_px", margin_px, {0, 100}, "how far outside the outline a texture keypoint may lie");
    v.field("within_foreground", within_foreground, "whether background bounds clusters as edges do");
  }
};

// What was seen on the way, for pictures and tests.
struct LandmarkStages {
  cv::Mat1b levels;  // the depth image, without holes
  Conditioned conditioned;
};

// From the frame and its texture keypoints. A frame without depth, or all background, has no landmarks.
Landmarks identify_landmarks(const Frame& frame, Keypoints keypoints, const RigModel& rig,
                             const KeypointOptions& keypoint_options, const ConditioningOptions& conditioning,
                             const ClusterOptions& clusters, const LandmarkOptions& options,
                             LandmarkStages* stages = nullptr);

}  // namespace fringeslam
