// SPDX-License-Identifier: Apache-2.0
#include "bench/frame_pairs.h"

#include <cmath>
#include <numbers>
#include <random>
#include <utility>

#include "bench/view_pairs.h"

namespace fringeslam::bench {

FramePair rendered_frames(const std::string& scene_name, uint64_t seed, const Pose& target_from_source) {
  ViewPair pair = rendered_pair(scene_name, seed, target_from_source);
  return {pair.rig, std::move(pair.views[0].frame), std::move(pair.views[1].frame), target_from_source};
}

Pose random_motion(double degrees, double metres, double middle_m, uint64_t seed) {
  std::mt19937_64 random(seed);
  const auto uniform = [&] { return 2 * static_cast<double>(random() >> 11) / 9007199254740992.0 - 1; };
  const auto direction = [&] {
    for (;;) {
      const double x = uniform(), y = uniform(), z = uniform(), square = x * x + y * y + z * z;
      if (square < 1 && square > 1e-4) return Eigen::Vector3d(Eigen::Vector3d(x, y, z) / std::sqrt(square));
    }
  };
  const Pose to_middle{Eigen::Matrix3d::Identity(), {0, 0, middle_m}};
  const Eigen::Vector3d axis = direction(), shift = direction();
  const Pose motion{rotation_exp(degrees * std::numbers::pi / 180 * axis), metres * shift};
  return to_middle * motion * to_middle.inverse();
}

}  // namespace fringeslam::bench
