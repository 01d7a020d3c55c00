// SPDX-License-Identifier: Apache-2.0
#include "bench/landmark_method.h"

namespace fringeslam::bench {

Landmarks landmarks_of(const ViewPair& pair, const View& view, const LandmarkMethod& method) {
  return identify_landmarks(view.frame, detect_keypoints(view.frame, pair.rig, pair.rays, method.keypoints), pair.rig,
                            method.keypoints, method.conditioning, method.clusters, method.landmarks);
}

}  // namespace fringeslam::bench
