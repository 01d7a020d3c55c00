// SPDX-License-Identifier: Apache-2.0
// Landmarks of a frame (docs/method.md, sections 5.1 to 5.3): outlines come from clusters of depth keypoints or from
// foreground regions; the texture keypoints inside an outline form a landmark.
#pragma once

#include <array>

#include "core/landmarks/conditioning.h"
#include "core/landmarks/keypoints.h"
#include "core/landmarks/reference/clusters.h"
#include "core/types/frame.h"
#include "core/types/landmark.h"
#include "core/types/options.h"
#include "core/types/rig_model.h"

namespace fringeslam {

// Source of the outlines: the papers' clusters of depth keypoints, or connected foreground regions bounded by edges.
enum class OutlineSource { clusters, regions };

constexpr auto choices(OutlineSource) {
  using enum OutlineSource;
  return std::to_array<Choice<OutlineSource>>({{clusters, "clusters"}, {regions, "regions"}});
}

struct LandmarkOptions {
  OutlineSource outlines = OutlineSource::regions;
  int min_keypoints = 20;
  int min_area_px = 600;
  int bridge_px = 6;
  double margin_px = 4;
  bool within_foreground = true;

  template <class Visitor>
  void describe(Visitor& v) {
    v.field("outlines", outlines,
            "source of the outlines: the papers' clusters of depth keypoints, or connected foreground regions bounded "
            "by edges");
    v.field("min_area_px", min_area_px, {1, 1000000}, "smallest area of a region, pixels");
    v.field("bridge_px", bridge_px, {0, 100},
            "half the width of the widest bridge that does not join two regions, pixels");
    v.field("min_keypoints", min_keypoints, {1, 10000}, "least number of texture keypoints of a landmark");
    v.field("margin_px", margin_px, {0, 100}, "how far outside the outline a texture keypoint may lie, pixels");
    v.field("within_foreground", within_foreground, "treat the background as a boundary of clusters, like edges");
  }
};

// Intermediate results, for figures and tests.
struct LandmarkStages {
  cv::Mat1b levels;  // depth image with holes filled
  Conditioned conditioned;
};

// Extracts the landmarks of a frame from its texture keypoints and its depth. Frames without depth, or with background
// only, have none. Throws Error for options out of range.
Landmarks extract_landmarks(const Frame& frame, Keypoints keypoints, const RigModel& rig,
                            const KeypointOptions& keypoint_options, const ConditioningOptions& conditioning,
                            const ClusterOptions& clusters, const LandmarkOptions& options,
                            LandmarkStages* stages = nullptr);

}  // namespace fringeslam
