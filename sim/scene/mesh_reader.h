// SPDX-License-Identifier: Apache-2.0
// What assimp reads from a mesh file, as it stands there: nothing of it has been checked.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace fringeslam::sim {

struct RawMesh {
  std::string name;
  uint32_t material = 0;
  std::vector<float> positions;    // x y z
  std::vector<float> coordinates;  // u v of the texture; empty: none
  std::vector<uint32_t> indices;   // three a triangle
};
struct RawInstance {
  std::string name;
  uint32_t mesh = 0;
  std::array<double, 16> transform{};  // world from mesh, by rows
};
struct RawMaterial {
  std::string name, texture;
  std::array<float, 3> colour{};
};
// A picture inside the file; materials name the first one *0.
struct RawTexture {
  std::string format;          // of an encoded one: png, jpg …; empty: texels
  uint32_t width = 0;          // of texels
  std::vector<uint8_t> bytes;  // texels: blue green red alpha
};
struct RawModel {
  std::vector<RawMesh> meshes;
  std::vector<RawInstance> instances;
  std::vector<RawMaterial> materials;
  std::vector<RawTexture> textures;
  double unit_m = 0;  // 0: the file does not say
  uint32_t y_up = 0;  // whether the coordinates are y up after reading
};

// Reads in a child process. Throws Error with assimp's message, or saying that it crashed, took too long or too much
// memory.
RawModel read_model(const std::filesystem::path& file, double time_limit_s, double memory_limit_gib);

}  // namespace fringeslam::sim
