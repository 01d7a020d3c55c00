// SPDX-License-Identifier: Apache-2.0
// Meshes made elsewhere, through assimp: OBJ, PLY, STL, glTF, COLLADA, FBX and what else it reads. Broken files make
// assimp crash, hang or return nonsense: it works in a child process with limits on time and memory, and what comes
// back is checked here.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/types/pose.h"
#include "sim/scene/mesh.h"

namespace fringeslam::sim {

struct MeshImportOptions {
  std::optional<double> unit_m;   // of a file without units; metres when nothing is said
  std::optional<std::string> up;  // "x", "y" or "z": the file's axis that becomes our z
  double time_limit_s = 60;
  double memory_limit_gib = 4;
};

// What one node of the file shows: triangles of one material, world-sized, z up. Nodes that show the same mesh in the
// same size share it.
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
  std::string up;
  size_t triangles = 0, degenerate = 0;  // the latter were dropped
  size_t meshes = 0;                     // different ones
  Eigen::Vector3d low = Eigen::Vector3d::Zero(), high = Eigen::Vector3d::Zero();

  // "house.dae: 0.0254 m a unit, z up; 12 parts, 3210 triangles (4 degenerate ones dropped), 12.10 x 9.30 x 6.00 m"
  std::string summary(const std::filesystem::path& file) const;
};

// Throws Error naming the file when it cannot be read, holds no triangle, or holds indices or coordinates that are
// none.
MeshImport import_mesh(const std::filesystem::path& file, const MeshImportOptions& options = {});

}  // namespace fringeslam::sim
