// SPDX-License-Identifier: Apache-2.0
#include "bench/pose_judge.h"

#include <cstdio>

#include "core/score/pose_honesty.h"

namespace fringeslam::bench {

Count& Count::operator+=(const Count& other) {
  found += other.found;
  right += other.right;
  wrong += other.wrong;
  ambiguous += other.ambiguous;
  return *this;
}

void judge(const ViewRegistration& registration, const Pose& truth, const RigModel& rig, const std::string& name,
           double overlap, Count& count) {
  constexpr double kRight_m = 1e-3;
  count.ambiguous += registration.ambiguous;
  if (!registration.found) return;
  ++count.found;
  const PoseHonesty honesty = pose_honesty(registration.earlier_from_current, truth, registration.covariance, rig);
  if (honesty.off_m <= kRight_m) {
    ++count.right;
    return;
  }
  const bool wrong = honesty.confidently_wrong();
  count.wrong += wrong;
  const IcpResult& icp = registration.icp;
  std::fprintf(stderr,
               "  %s: %s, overlap %.0f %%, %.1f mm and %.1f sigmas off; keypoints %d of %d%s, overlap %.2f, "
               "consistency %.2f, RMS %.2f sigmas, %.1f if reopened\n",
               wrong ? "WRONG" : "unsure", name.c_str(), 100 * overlap, 1e3 * honesty.off_m, honesty.sigmas(),
               registration.motion.inliers, registration.motion.pairs,
               registration.refined ? "" : ", not confirmed by depth", icp.overlap, icp.consistency, icp.rms_sigma,
               icp.reopened_sigma);
}

}  // namespace fringeslam::bench
