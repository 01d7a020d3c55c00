// SPDX-License-Identifier: Apache-2.0
// Fuzz target (libFuzzer, run by tools/fuzz): arbitrary bytes as a trajectory or map of another system must give finite
// numbers or a one-line Error that names the file.
#include <unistd.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <string>

#include "core/io/ply.h"
#include "core/score/trajectory_file.h"
#include "core/types/error.h"

namespace fringeslam {

namespace {

namespace fs = std::filesystem;

void require(bool holds, const std::string& what) {
  if (holds) return;
  std::fprintf(stderr, "score_file_fuzz: %s\n", what.c_str());
  std::abort();
}

fs::path place() {
  static const fs::path file = fs::temp_directory_path() / ("fringeslam-score-" + std::to_string(::getpid()));
  return file;
}

template <class Read>
void refused_or(const Read& read) {
  try {
    read();
  } catch (const Error& error) {
    const std::string message = error.what();
    require(message.starts_with(place().string()), "a message that does not begin with the file: " + message);
    require(message.find('\n') == std::string::npos, "a message of several lines: " + message);
  }
}

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

}  // namespace fringeslam

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace fringeslam;
  std::ofstream out(place(), std::ios::binary);
  out.write(reinterpret_cast<const char*>(data), static_cast<std::streamsize>(size));
  out.close();
  require(bool(out), place().string() + " cannot be written");
  // Selects the reader as `fringeslam score` does.
  if (is_ply(place()))
    refused_or([] { check(read_ply(place())); });
  else
    refused_or([] { check(read_trajectory(place())); });
  return 0;
}
