// SPDX-License-Identifier: Apache-2.0
// glTF 2.0 binary files of triangle meshes, in metres in the world frame, under a node that rotates the world's z axis (up)
// to glTF's y axis. The colour is the grey value, linear in glTF as in the camera; sigma is the attribute _SIGMA.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <string>

#include "core/base/append_bytes.h"

namespace fringeslam {

// Returns whether a GLB file can hold a mesh of this size; it is limited to 4 GiB.
bool fits_glb(uint64_t vertices, uint64_t triangles);

struct MeshExtent {
  uint64_t vertices = 0, triangles = 0;
  Eigen::Vector3f low = Eigen::Vector3f::Constant(std::numeric_limits<float>::infinity()), high = -low;

  void add(const Eigen::Vector3f& position_m) {
    low = low.cwiseMin(position_m);
    high = high.cwiseMax(position_m);
  }
};

// Returns the beginning of a file; the positions, normals, colours and sigmas of all vertices and the triangles follow, or
// nothing if there are no triangles. Throws Error if the mesh does not fit.
std::string glb_head(const MeshExtent& extent);

// The colour has an alpha channel, since attributes must start at multiples of four bytes.
inline std::array<uint8_t, 4> glb_colour(uint8_t grey) { return {grey, grey, grey, 255}; }

// Returns the file of a mesh: `vertices` with `position_m`, `normal`, `grey` and `sigma_m`, and `triangles` of indices into
// them. Throws Error if the mesh does not fit.
template <class Mesh>
std::string to_glb(const Mesh& mesh) {
  MeshExtent extent{mesh.vertices.size(), mesh.triangles.size()};
  for (const auto& vertex : mesh.vertices) extent.add(vertex.position_m);
  std::string file = glb_head(extent);
  if (mesh.triangles.empty()) return file;
  const auto append = [&](const auto& values) {
    for (const auto value : values) append_bytes(file, value);
  };
  for (const auto& vertex : mesh.vertices) append(vertex.position_m);
  for (const auto& vertex : mesh.vertices) append(vertex.normal);
  for (const auto& vertex : mesh.vertices) append(glb_colour(vertex.grey));
  for (const auto& vertex : mesh.vertices) append_bytes(file, vertex.sigma_m);
  for (const auto& triangle : mesh.triangles) append(triangle);
  return file;
}

// Converts a mesh written by PlyWriter to such a file, without reading it into memory as a whole. Throws Error if a file
// cannot be read or written, or if the mesh does not fit.
void ply_to_glb(const std::filesystem::path& ply, const std::filesystem::path& glb);

}  // namespace fringeslam
