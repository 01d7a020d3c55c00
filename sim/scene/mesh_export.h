// SPDX-License-Identifier: Apache-2.0
// A scene's objects as a mesh file for other programs, through assimp: glTF 2.0, PLY or OBJ.
//
//   glTF  .glb is one file; .gltf has its vertices in a .bin beside it. A node an object, under a root node that turns
//   our
//         z-up world into glTF's y-up one; objects of one mesh and material refer to one mesh. Materials with albedo,
//         metal, roughness, emission and texture.
//   PLY   one mesh in our frame, the albedo as the vertices' colour (sRGB).
//   OBJ   a group an object, in our frame, with normals of the faces; the materials in a .mtl beside it.
//
// Lengths are metres. Textures come along where the mesh says how they lie on it; elsewhere, and for grains, the mean
// albedo stands for them. Two sides of a triangle are the same here: materials are two-sided.
#pragma once

#include <filesystem>

#include "sim/scene/scene.h"

namespace fringeslam::sim {

enum class MeshFormat { gltf, ply, obj };

// By the end of the file's name: .gltf or .glb, .ply, .obj. Throws Error on another one.
MeshFormat mesh_format_of(const std::filesystem::path& file);

struct MeshExport {
  size_t objects = 0, triangles = 0;
  size_t meshes = 0;  // that the file holds
};

// All files or none. Throws Error when the file's name is of no format, or it cannot be written.
MeshExport export_mesh(const Scene& scene, const std::filesystem::path& file);

}  // namespace fringeslam::sim
