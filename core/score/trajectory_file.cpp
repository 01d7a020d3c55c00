// SPDX-License-Identifier: Apache-2.0
#include "core/score/trajectory_file.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <sstream>

#include "core/io/input_file.h"
#include "core/types/error.h"

namespace fringeslam {

namespace {

constexpr double kNanosecondsBeyond = 1e14;
constexpr double kSecondsPerNanosecond = 1e-9;

// True if the first line with content other than a comment contains a comma.
bool has_commas(const std::string& text) {
  std::istringstream in(text);
  for (std::string line; std::getline(in, line);) {
    line.erase(std::min(line.find('#'), line.size()));
    if (line.find_first_not_of(" \t\r") != std::string::npos) return line.find(',') != std::string::npos;
  }
  return false;
}

// Parses a finite number surrounded only by blanks.
bool read_number(std::string text, double& value) {
  text.erase(0, std::min(text.find_first_not_of(" \t+"), text.size()));
  text.erase(text.find_last_not_of(" \t\r") + 1);
  const char* end = text.data() + text.size();
  const auto [stop, error] = std::from_chars(text.data(), end, value);
  return error == std::errc() && stop == end && std::isfinite(value);
}

Trajectory read_euroc(const std::string& text, const std::filesystem::path& file) {
  std::istringstream in(text);
  Trajectory trajectory;
  std::string line;
  for (int number = 1; std::getline(in, line); ++number) {
    line.erase(std::min(line.find('#'), line.size()));
    if (line.find_first_not_of(" \t\r") == std::string::npos) continue;
    const std::string where = file.string() + ":" + std::to_string(number) + ": ";
    double v[8];
    size_t begin = 0;
    for (double& value : v) {
      const size_t end = std::min(line.find(',', begin), line.size());
      if (begin > line.size() || !read_number(line.substr(begin, end - begin), value))
        throw Error(where + "needs eight finite numbers separated by commas: timestamp_ns,x,y,z,qw,qx,qy,qz");
      begin = end + 1;
    }
    if (std::max({std::abs(v[1]), std::abs(v[2]), std::abs(v[3])}) > kMostPosition_m)
      throw Error(where + "a position is farther than 1e9 m from the origin; the unit is metres");
    const Eigen::Vector4d xyzw(v[5], v[6], v[7], v[4]);
    if (std::abs(xyzw.norm() - 1) > 1e-3) throw Error(where + "the quaternion is not of unit length");
    const double timestamp_s = v[0] / 1e9;
    if (!trajectory.empty() && timestamp_s <= trajectory.back().timestamp_s)
      throw Error(where + "timestamps must increase from line to line");
    trajectory.push_back({timestamp_s, {rotation_from_quaternion(xyzw), {v[1], v[2], v[3]}}});
  }
  return trajectory;
}

}  // namespace

Trajectory read_trajectory(const std::filesystem::path& file) {
  const std::string text = read_input(file);
  if (has_commas(text)) return read_euroc(text, file);
  Trajectory trajectory = tum_from_text(text, file.string());
  if (trajectory.front().timestamp_s > kNanosecondsBeyond) {
    for (TimedPose& pose : trajectory) pose.timestamp_s *= kSecondsPerNanosecond;
  }
  return trajectory;
}

}  // namespace fringeslam
