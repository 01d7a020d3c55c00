// SPDX-License-Identifier: Apache-2.0
// Exports a scene's objects to a mesh file through assimp: glTF 2.0, PLY or OBJ.
//
//   glTF  .glb is a single file; .gltf stores its vertices in a .bin beside it. One node per object, under a root node
//         that rotates the z-up world frame to glTF's y-up frame; objects with the same mesh and material share one
//         mesh. Materials carry albedo, metalness, roughness, emission and texture.
//   PLY   one mesh in the world frame, with the albedo as vertex colour (sRGB).
//   OBJ   one group per object, in the world frame, with face normals; materials in a .mtl beside it.
//
// Lengths in m. Textures are exported only where the mesh has texture coordinates; otherwise, and for grains, the mean
// albedo is used. All materials are two-sided, as in the simulator.
#pragma once

#include <filesystem>

#include "sim/scene/scene.h"

namespace fringeslam::sim {

enum class MeshFormat { gltf, ply, obj };

// Determines the format from the file extension: .gltf or .glb, .ply, .obj. Throws Error on any other extension.
MeshFormat mesh_format_of(const std::filesystem::path& file);

struct MeshExport {
  size_t objects = 0, triangles = 0;
  size_t meshes = 0;  // in the file
};

// Writes `scene` to `file` and its companion files atomically (all or none); returns the counts. Throws Error if the
// extension is unknown or a file cannot be written, or if a companion file would replace one of the `inputs`, or a file to which
// the earlier export at `file` does not refer.
MeshExport export_mesh(const Scene& scene, const std::filesystem::path& file,
                       const std::vector<std::filesystem::path>& inputs = {});

}  // namespace fringeslam::sim
