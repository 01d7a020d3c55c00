// SPDX-License-Identifier: Apache-2.0
#include "core/mapper/landmark_finder.h"

#include "core/base/stage_clock.h"

namespace fringeslam {

LandmarkFinder::LandmarkFinder(const RigModel& rig, const LandmarkFinderOptions& options)
    : rig_(rig), options_(options), rays_(pixel_rays(rig.camera)), database_(rig.camera, options.recognition) {
  check_options(options.keypoints, "keypoints");
  check_options(options.conditioning, "conditioning");
  check_options(options.clusters, "clusters");
  check_options(options.landmarks, "landmarks");
  check_options(options.recognition, "recognition");
}

FoundLandmarks LandmarkFinder::find(const Frame& frame, bool longer) const {
  enter_stage("landmarks");
  FoundLandmarks found;
  found.keypoints = detect_keypoints(frame, rig_, rays_, options_.keypoints);
  found.landmarks = extract_landmarks(frame, found.keypoints, rig_, options_.keypoints, options_.conditioning,
                                      options_.clusters, options_.landmarks);
  found.recognitions = database_.reidentify(found.landmarks, longer);
  return found;
}

std::vector<Recognition> LandmarkFinder::search_longer(const Landmarks& landmarks) const {
  enter_stage("landmarks");
  return database_.reidentify(landmarks, true);
}

}  // namespace fringeslam
