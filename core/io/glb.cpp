// SPDX-License-Identifier: Apache-2.0
#include "core/io/glb.h"

#include <cstring>
#include <nlohmann/json.hpp>
#include <numbers>

#include "core/io/ply_blocks.h"
#include "core/io/ply_writer.h"
#include "core/types/error.h"

namespace fringeslam {

namespace fs = std::filesystem;

namespace {

constexpr uint64_t kMaxDescription = 4096;  // bytes of a GLB file that are not vertices or triangles

// An attribute of a vertex, or the triangles.
struct GlbArray {
  const char* name;
  int component;
  const char* type;
  uint64_t bytes;  // per vertex or triangle
};
constexpr int kFloat = 5126, kByte = 5121, kUnsigned = 5125;
// The colour has an alpha channel, since attributes must start at multiples of four bytes.
constexpr GlbArray kAttributes[] = {{"POSITION", kFloat, "VEC3", 12},
                                    {"NORMAL", kFloat, "VEC3", 12},
                                    {"COLOR_0", kByte, "VEC4", 4},
                                    {"_SIGMA", kFloat, "SCALAR", 4}};
constexpr GlbArray kTriangles = {"indices", kUnsigned, "SCALAR", 12};

std::string chunk_head(uint64_t size, const char* type) {
  std::string bytes;
  append_bytes(bytes, static_cast<uint32_t>(size));
  return bytes + std::string(type, 4);
}

}  // namespace

bool fits_glb(uint64_t vertices, uint64_t triangles) {
  uint64_t size = triangles * kTriangles.bytes;
  for (const GlbArray& array : kAttributes) size += vertices * array.bytes;
  return size <= UINT32_MAX - kMaxDescription;
}

std::string glb_head(const MeshExtent& extent) {
  if (!fits_glb(extent.vertices, extent.triangles))
    throw Error("a mesh of " + std::to_string(extent.vertices) + " vertices and " + std::to_string(extent.triangles) +
                " triangles exceeds the 4 GiB of a GLB file; write a PLY file");
  nlohmann::ordered_json json = {
      {"asset", {{"version", "2.0"}, {"generator", "FringeSLAM"}}}, {"scene", 0}, {"scenes", {{{"name", "surface"}}}}};
  uint64_t size = 0;
  if (extent.triangles > 0) {  // glTF does not allow empty meshes
    json["scenes"][0]["nodes"] = {0};
    json["nodes"] = {{{"mesh", 0}, {"rotation", {-std::numbers::sqrt2 / 2, 0, 0, std::numbers::sqrt2 / 2}}}};
    json["materials"] = {{{"doubleSided", true}, {"pbrMetallicRoughness", {{"metallicFactor", 0}}}}};
    nlohmann::ordered_json attributes;
    const auto add = [&](const GlbArray& array, uint64_t items, uint64_t count, int target) {
      json["bufferViews"].push_back(
          {{"buffer", 0}, {"byteOffset", size}, {"byteLength", items * array.bytes}, {"target", target}});
      const size_t number = json["bufferViews"].size() - 1;
      json["accessors"].push_back(
          {{"bufferView", number}, {"componentType", array.component}, {"count", count}, {"type", array.type}});
      size += items * array.bytes;
      return number;
    };
    constexpr int kArrayBuffer = 34962, kElementArrayBuffer = 34963;
    for (const GlbArray& array : kAttributes)
      attributes[array.name] = add(array, extent.vertices, extent.vertices, kArrayBuffer);
    json["accessors"][0]["min"] = {extent.low.x(), extent.low.y(), extent.low.z()};
    json["accessors"][0]["max"] = {extent.high.x(), extent.high.y(), extent.high.z()};
    json["accessors"][2]["normalized"] = true;
    const size_t triangles = add(kTriangles, extent.triangles, 3 * extent.triangles, kElementArrayBuffer);
    json["meshes"] = {
        {{"primitives", {{{"attributes", attributes}, {"indices", triangles}, {"material", 0}, {"mode", 4}}}}}};
    json["buffers"] = {{{"byteLength", size}}};
  }
  std::string text = json.dump();
  text.resize((text.size() + 3) / 4 * 4, ' ');
  const std::string binary = size > 0 ? chunk_head(size, "BIN") : "";
  std::string head = "glTF";
  append_bytes(head, uint32_t{2});
  append_bytes(head, static_cast<uint32_t>(12 + 8 + text.size() + binary.size() + size));
  return head + chunk_head(text.size(), "JSON") + text + binary;
}

void ply_to_glb(const fs::path& ply, const fs::path& glb) {
  PlyBlocks blocks(ply);
  MeshExtent extent{blocks.vertices(), blocks.triangles()};
  blocks.for_each_vertex([&](const char* vertex) {
    Eigen::Vector3f position_m;
    std::memcpy(position_m.data(), vertex, PlyBlocks::kNormal);
    extent.add(position_m);
  });
  OutputFile file(glb);
  file.write(glb_head(extent));
  if (extent.triangles > 0) {
    blocks.for_each_vertex([&](const char* vertex) { file.write(vertex, PlyBlocks::kNormal); });
    blocks.for_each_vertex(
        [&](const char* vertex) { file.write(vertex + PlyBlocks::kNormal, PlyBlocks::kGrey - PlyBlocks::kNormal); });
    blocks.for_each_vertex([&](const char* vertex) {
      const std::array<uint8_t, 4> colour = glb_colour(static_cast<uint8_t>(vertex[PlyBlocks::kGrey]));
      file.write(reinterpret_cast<const char*>(colour.data()), colour.size());
    });
    blocks.for_each_vertex([&](const char* vertex) { file.write(vertex + PlyBlocks::kSigma, sizeof(float)); });
    blocks.for_each_triangle([&](const char* triangle) { file.write(triangle + 1, kTriangles.bytes); });
  }
  file.close();
}

}  // namespace fringeslam
