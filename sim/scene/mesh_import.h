// SPDX-License-Identifier: Apache-2.0
// Mesh import through assimp: OBJ, PLY, STL, glTF, COLLADA, FBX and its other formats. Because broken files can make
// assimp crash, hang or return invalid data, it runs in a child process with time and memory limits, and its output is
// validated here.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "core/types/options.h"
#include "core/types/pose.h"
#include "sim/scene/mesh.h"

namespace fringeslam::sim {

enum class UpAxis { x, y, z };

constexpr auto choices(UpAxis) {
  return std::to_array<Choice<UpAxis>>({{UpAxis::x, "x"}, {UpAxis::y, "y"}, {UpAxis::z, "z"}});
}

struct MeshImportOptions {
  std::optional<double> unit_m;  // length of one file unit, overriding the file's; default: the file's unit, else 1 m
  std::optional<UpAxis> up;      // file axis mapped to world z, overriding the format's default
  double time_limit_s = 60;
  double memory_limit_gib = 4;         // of the process that reads the file, and of the imported parts
  size_t most_triangles = 30'000'000;  // of all its meshes, counted again at each scale
};

// Vertices, and triangles, that the nodes of a file may have together, each node with all those of its mesh: a small file can
// use one large mesh in very many nodes.
constexpr uint64_t kMostVerticesOfNodes = 200'000'000;

// The geometry of one node of the file: triangles of one material, in m, z up. Nodes that use the same mesh at the same
// scale share it.
struct ImportedPart {
  std::string name, material;
  std::shared_ptr<const Mesh> mesh;
  Pose world_from_part;
  double albedo = 0.5;                 // luminance of the diffuse colour
  std::filesystem::path texture = {};  // empty: none
};

struct MeshImport {
  std::vector<ImportedPart> parts;
  double unit_m = 1;
  UpAxis up = UpAxis::z;
  size_t triangles = 0, degenerate = 0;   // degenerate triangles are dropped
  size_t meshes = 0;                      // distinct meshes
  std::set<std::filesystem::path> files;  // that were read: the file itself, those to which it refers, its textures
  Eigen::Vector3d low = Eigen::Vector3d::Zero(), high = Eigen::Vector3d::Zero();

  // Formats a one-line summary, e.g.
  // "house.dae: unit 0.0254 m, z up; 12 parts, 3210 triangles (4 degenerate dropped), 12.1 x 9.3 x 6 m".
  std::string summary(const std::filesystem::path& file) const;
};

// Imports a mesh file into the z-up world frame (m). Throws Error naming the file if it cannot be read, contains no
// non-degenerate triangle, contains invalid indices or non-finite coordinates, or exceeds the limits.
MeshImport import_mesh(const std::filesystem::path& file, const MeshImportOptions& options = {});

struct RawModel;

// The same for a model that was read from the file.
MeshImport import_model(const std::filesystem::path& file, const RawModel& model,
                        const MeshImportOptions& options = {});

}  // namespace fringeslam::sim
