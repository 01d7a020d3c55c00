// SPDX-License-Identifier: Apache-2.0
#include "bench/pose_judge.h"

#include <cmath>
#include <cstdio>
#include <vector>

#include "bench/row.h"
#include "core/types/linear_algebra.h"

namespace fringeslam::bench {

double displacement_m(const Pose& found, const Pose& truth, const RigModel& rig) {
  const Pinhole& camera = rig.camera;
  const double z = rig.middle_range_m();
  const double x = z * 0.5 * camera.width / camera.fx, y = z * 0.5 * camera.height / camera.fy;
  std::vector<double> distances_m;
  for (const Eigen::Vector3d& point : {Eigen::Vector3d(0, 0, z), Eigen::Vector3d(x, y, z), Eigen::Vector3d(-x, y, z),
                                       Eigen::Vector3d(x, -y, z), Eigen::Vector3d(-x, -y, z)})
    distances_m.push_back((found * point - truth * point).norm());
  return greatest_of(distances_m);
}

Count& Count::operator+=(const Count& other) {
  found += other.found;
  right += other.right;
  wrong += other.wrong;
  ambiguous += other.ambiguous;
  return *this;
}

void judge(const ViewRegistration& registration, const Pose& truth, const RigModel& rig, const std::string& name,
           double overlap, Count& count) {
  constexpr double kOff_m = 1e-3, kSigmas = 10;
  count.ambiguous += registration.ambiguous;
  if (!registration.found) return;
  ++count.found;
  const double off_m = displacement_m(registration.earlier_from_current, truth, rig);
  if (off_m <= kOff_m) {
    ++count.right;
    return;
  }
  const Vector6d error = difference(registration.earlier_from_current, truth);
  const double sigmas = std::sqrt(error.dot(solve_symmetric(registration.covariance, error)));
  const bool wrong = !(sigmas <= kSigmas);
  count.wrong += wrong;
  const IcpResult& icp = registration.icp;
  std::fprintf(stderr,
               "  %s: %s, overlap %.0f %%, %.1f mm and %.1f sigmas off; keypoints %d of %d%s, overlap %.2f, "
               "consistency %.2f, RMS %.2f sigmas, %.1f if reopened\n",
               wrong ? "WRONG" : "unsure", name.c_str(), 100 * overlap, 1e3 * off_m, sigmas,
               registration.motion.inliers, registration.motion.pairs,
               registration.refined ? "" : ", not confirmed by depth", icp.overlap, icp.consistency, icp.rms_sigma,
               icp.reopened_sigma);
}

}  // namespace fringeslam::bench
