// SPDX-License-Identifier: Apache-2.0
#include "bench/landmark_method.h"

namespace fringeslam::bench {

Landmarks landmarks_of(const Views& views, const View& view, const LandmarkMethod& method) {
  return extract_landmarks(view.frame, detect_keypoints(view.frame, views.rig, views.rays, method.keypoints), views.rig,
                           method.keypoints, method.conditioning, method.clusters, method.landmarks);
}

std::vector<Landmarks> landmarks_of(const Views& views, const LandmarkMethod& method) {
  std::vector<Landmarks> all;
  for (const View& view : views.views) all.push_back(landmarks_of(views, view, method));
  return all;
}

ViewRegistration registered(const Views& views, const std::vector<Landmarks>& landmarks, int earlier, int current,
                            const std::vector<Recognition>& recognitions) {
  const auto known = [&](int view) -> SeenView {
    return {views.views[static_cast<size_t>(view)].frame, landmarks[static_cast<size_t>(view)].keypoints};
  };
  const double middle_m = 0.5 * (views.rig.near_m + views.rig.far_m);
  return locate_view(known, earlier, known(current), recognitions, views.rig.camera, middle_m, {}).registration;
}

}  // namespace fringeslam::bench
