// SPDX-License-Identifier: Apache-2.0
// Raw assimp output for a mesh file, not validated, and the bytes by which a child process returns it.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace fringeslam::sim {

struct RawMesh {
  std::string name;
  uint32_t material = 0;
  std::vector<float> positions;    // x y z
  std::vector<float> coordinates;  // texture u v; empty: none
  std::vector<uint32_t> indices;   // three per triangle
};
struct RawInstance {
  std::string name;
  uint32_t mesh = 0;
  std::array<double, 16> transform{};  // world from mesh, row-major
};
struct RawMaterial {
  std::string name, texture;
  std::array<float, 3> colour{};
};
// An image embedded in the file; materials refer to the first one as *0.
struct RawTexture {
  std::string format;          // png, jpg … if encoded; empty: raw texels
  uint32_t width = 0;          // of raw texels, px
  std::vector<uint8_t> bytes;  // encoded image, or raw texels (blue green red alpha)
};
struct RawFile {
  std::string path;
};
struct RawModel {
  std::vector<RawMesh> meshes;
  std::vector<RawInstance> instances;
  std::vector<RawMaterial> materials;
  std::vector<RawTexture> textures;
  std::vector<RawFile> files;  // that were read: the file itself and those to which it refers, but for images
  double unit_m = 0;           // 0: not specified in the file
  uint32_t y_up = 0;           // nonzero if the coordinates are y-up after reading
};

std::string packed(const RawModel& model);

// Throws Error if the bytes are not those of a model. Only their structure is checked.
RawModel unpacked(std::string_view bytes);

}  // namespace fringeslam::sim
