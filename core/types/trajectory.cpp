// SPDX-License-Identifier: Apache-2.0
#include "core/types/trajectory.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <sstream>

#include "core/types/error.h"

namespace fringeslam {

std::string to_tum(const Trajectory& trajectory) {
  std::string text;
  for (const TimedPose& pose : trajectory) {
    const Eigen::Vector3d& t = pose.world_from_robot.translation;
    const Eigen::Vector4d q = quaternion_xyzw(pose.world_from_robot.rotation);
    char line[256];
    std::snprintf(line, sizeof line, "%.9f %.12g %.12g %.12g %.15g %.15g %.15g %.15g\n", pose.timestamp_s, t.x(), t.y(),
                  t.z(), q.x(), q.y(), q.z(), q.w());
    text += line;
  }
  return text;
}

Trajectory tum_from_text(const std::string& text, const std::string& name) {
  std::istringstream in(text);
  Trajectory trajectory;
  std::string line;
  for (int number = 1; std::getline(in, line); ++number) {
    if (const auto hash = line.find('#'); hash != std::string::npos) line.erase(hash);
    if (line.find_first_not_of(" \t\r") == std::string::npos) continue;
    const std::string where = name + ":" + std::to_string(number) + ": ";
    std::istringstream words(line);
    double v[8];
    std::string rest;
    for (double& value : v) {
      if (!(words >> value) || !std::isfinite(value))
        throw Error(where + "needs eight finite numbers: timestamp tx ty tz qx qy qz qw");
    }
    if (words >> rest) throw Error(where + "has more than eight numbers: '" + rest + "'");
    if (std::max({std::abs(v[1]), std::abs(v[2]), std::abs(v[3])}) > kMostPosition_m)
      throw Error(where + "a position is farther than 1e9 m from the origin; the unit is metres");
    const Eigen::Vector4d q(v[4], v[5], v[6], v[7]);
    if (std::abs(q.norm() - 1) > 1e-3) throw Error(where + "the quaternion is not of unit length");
    if (!trajectory.empty() && v[0] <= trajectory.back().timestamp_s)
      throw Error(where + "timestamps must increase from line to line");
    trajectory.push_back({v[0], {rotation_from_quaternion(q), {v[1], v[2], v[3]}}});
  }
  if (trajectory.empty()) throw Error(name + ": contains no pose");
  return trajectory;
}

}  // namespace fringeslam
