// SPDX-License-Identifier: Apache-2.0
// PLY files (G. Turk, The PLY polygon file format, 1994) of point clouds and triangle meshes.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "core/base/append_bytes.h"

namespace fringeslam {

struct PlyMap {
  std::vector<Eigen::Vector3d> vertices;   // finite
  std::vector<Eigen::Vector3i> triangles;  // polygons split into triangle fans; empty for a cloud
  // Properties of the vertices; each is empty if the file does not declare it.
  std::vector<Eigen::Vector3f> normals;
  std::vector<std::array<uint8_t, 3>> colours;  // red, green, blue; only those of 8 bits
  std::vector<float> sigma_m;
  size_t dropped = 0;  // number of non-finite vertices removed, together with their faces
};

// True if the first line of the file is the PLY signature.
bool is_ply(const std::filesystem::path& file);

// Reads a PLY file of any system: ASCII or binary of either byte order, coordinates of any numeric type, faces with any
// number of corners or no faces; other elements and properties are skipped. Throws Error with file:line (for binary
// bodies, with the element's number) if the file is malformed or truncated, or if a face refers to a non-existent
// vertex.
PlyMap read_ply(const std::filesystem::path& file);

struct PlyLayout {
  std::string frame;  // frame of the coordinates, for the header's comment
  size_t vertices = 0;
  bool normals = false, sigmas = false;
  std::optional<size_t> triangles;  // none: a cloud
};

// Returns the header of a binary PLY file with position, normal, grey value as colour, sigma and triangles.
std::string ply_header(const PlyLayout& layout);

template <class Vertex>
constexpr bool kHasNormal = requires(const Vertex& v) {
  v.normal;
};
template <class Vertex>
constexpr bool kHasSigma = requires(const Vertex& v) {
  v.sigma_m;
};

template <class Vertex>
void append_ply_vertex(std::string& bytes, const Vertex& vertex) {
  for (int i = 0; i < 3; ++i) append_bytes(bytes, static_cast<float>(vertex.position_m[i]));
  if constexpr (kHasNormal<Vertex>) {
    for (int i = 0; i < 3; ++i) append_bytes(bytes, static_cast<float>(vertex.normal[i]));
  }
  for (int i = 0; i < 3; ++i) append_bytes(bytes, static_cast<uint8_t>(vertex.grey));
  if constexpr (kHasSigma<Vertex>) append_bytes(bytes, static_cast<float>(vertex.sigma_m));
}

template <class Triangle>
void append_ply_triangle(std::string& bytes, const Triangle& triangle) {
  append_bytes(bytes, uint8_t{3});
  for (const auto corner : triangle) append_bytes(bytes, static_cast<int32_t>(corner));
}

// Returns a binary PLY file of points with `position_m`, `grey` and, if they have them, `normal` and `sigma_m`; `frame`
// names the frame of their coordinates.
template <class Vertex>
std::string to_ply(const std::vector<Vertex>& points, const std::string& frame) {
  std::string bytes = ply_header({frame, points.size(), kHasNormal<Vertex>, kHasSigma<Vertex>, std::nullopt});
  for (const Vertex& point : points) append_ply_vertex(bytes, point);
  return bytes;
}

// Returns a binary PLY file of a mesh: `vertices` as above and `triangles` of indices into them.
template <class Mesh>
std::string to_ply(const Mesh& mesh, const std::string& frame) {
  using Vertex = typename decltype(mesh.vertices)::value_type;
  std::string bytes =
      ply_header({frame, mesh.vertices.size(), kHasNormal<Vertex>, kHasSigma<Vertex>, mesh.triangles.size()});
  for (const Vertex& vertex : mesh.vertices) append_ply_vertex(bytes, vertex);
  for (const auto& triangle : mesh.triangles) append_ply_triangle(bytes, triangle);
  return bytes;
}

}  // namespace fringeslam
