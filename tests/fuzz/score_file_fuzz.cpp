// SPDX-License-Identifier: Apache-2.0
// Fuzz target (libFuzzer, run by tools/fuzz): arbitrary bytes as a trajectory or map of another system must give finite
// numbers or a one-line Error that names the file.
#include <cmath>

#include "core/io/ply.h"
#include "core/score/trajectory_file.h"
#include "tests/fuzz/fuzzing.h"

namespace fringeslam::fuzz {

namespace {

void check(const PlyMap& map) {
  for (const Eigen::Vector3d& vertex : map.vertices) require(vertex.allFinite(), "a non-finite vertex");
  const auto count = static_cast<int>(map.vertices.size());
  for (const Eigen::Vector3i& triangle : map.triangles)
    require(triangle.minCoeff() >= 0 && triangle.maxCoeff() < count, "a triangle with an invalid vertex index");
}

void check(const Trajectory& trajectory) {
  require(!trajectory.empty(), "a trajectory without poses");
  for (size_t i = 0; i < trajectory.size(); ++i) {
    const TimedPose& pose = trajectory[i];
    require(pose.world_from_robot.is_finite() && std::isfinite(pose.timestamp_s), "a non-finite pose");
    const Eigen::Matrix3d& rotation = pose.world_from_robot.rotation;
    require((rotation.transpose() * rotation - Eigen::Matrix3d::Identity()).norm() < 1e-6, "an invalid rotation");
    require(i == 0 || trajectory[i - 1].timestamp_s < pose.timestamp_s, "timestamps that do not increase");
  }
}

}  // namespace

}  // namespace fringeslam::fuzz

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace fringeslam;
  static const std::filesystem::path file = fuzz::folder() / "file";
  fuzz::write(file, fuzz::text_of(data, size));
  // Selects the reader as `fringeslam score` does.
  fuzz::read_or_refuse(file, [] { is_ply(file) ? fuzz::check(read_ply(file)) : fuzz::check(read_trajectory(file)); });
  return 0;
}
