// SPDX-License-Identifier: Apache-2.0
#include "tools/report/ply_reader.h"

#include <algorithm>
#include <charconv>
#include <cstring>

#include "core/io/files.h"
#include "core/map/ply.h"
#include "core/types/error.h"

namespace fringeslam::tools {

namespace {

constexpr size_t kPointBytes = 6 * sizeof(float) + 3 + sizeof(float);
constexpr size_t kFaceBytes = 1 + 3 * sizeof(uint32_t);

// Returns the number after "element NAME " in a header; 0 if there is no such element.
size_t element_count(const std::string& header, const std::string& name) {
  const std::string key = "\nelement " + name + " ";
  const size_t place = header.find(key);
  if (place == std::string::npos) return 0;
  size_t count = 0;
  std::from_chars(header.data() + place + key.size(), header.data() + header.size(), count);
  return count;
}

template <class Value>
Value take(const char*& bytes) {
  Value value;
  std::memcpy(&value, bytes, sizeof value);
  bytes += sizeof value;
  return value;
}

}  // namespace

SurfaceMesh read_ply(const std::filesystem::path& file) {
  std::error_code ignored;
  if (!std::filesystem::exists(file, ignored)) throw Error(file.string() + ": is missing");
  const std::string bytes = read_bytes(file);
  const std::string end = "end_header\n";
  const size_t body = bytes.find(end);
  const std::string header = bytes.substr(0, body);
  if (body == std::string::npos || !header.starts_with("ply\nformat binary_little_endian 1.0\n") ||
      header.find(kPlyPoint) == std::string::npos)
    throw Error(file.string() + ": is not a map written by fringeslam run");
  const size_t points = element_count(header, "vertex"), faces = element_count(header, "face");
  const size_t held = bytes.size() - body - end.size();
  if (points > held / kPointBytes || faces > (held - points * kPointBytes) / kFaceBytes)
    throw Error(file.string() + ": is truncated");

  SurfaceMesh mesh;
  mesh.vertices.resize(points);
  mesh.triangles.resize(faces);
  const char* at = bytes.data() + body + end.size();
  for (CloudPoint& point : mesh.vertices) {
    for (int i = 0; i < 3; ++i) point.position_m[i] = take<float>(at);
    for (int i = 0; i < 3; ++i) point.normal[i] = take<float>(at);
    point.grey = take<uint8_t>(at);
    at += 2;  // green and blue are the same
    point.sigma_m = take<float>(at);
  }
  for (auto& triangle : mesh.triangles) {
    ++at;
    for (uint32_t& corner : triangle) corner = take<uint32_t>(at);
    if (std::any_of(triangle.begin(), triangle.end(), [&](uint32_t corner) { return corner >= points; }))
      throw Error(file.string() + ": is damaged: a triangle refers to a vertex that does not exist");
  }
  return mesh;
}

}  // namespace fringeslam::tools
