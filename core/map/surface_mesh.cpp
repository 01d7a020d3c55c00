// SPDX-License-Identifier: Apache-2.0
#include "core/map/surface_mesh.h"

#include <cstring>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>
#include <numbers>

#include "core/io/ply.h"
#include "core/io/ply_writer.h"
#include "core/types/error.h"

namespace fringeslam {

namespace fs = std::filesystem;

namespace {

constexpr uint64_t kMaxDescription = 4096;  // bytes of a GLB file that are not vertices or triangles

struct MeshExtent {
  uint64_t vertices = 0, triangles = 0;
  Eigen::Vector3f low = Eigen::Vector3f::Constant(std::numeric_limits<float>::infinity()), high = -low;

  void add(const Eigen::Vector3f& position_m) {
    low = low.cwiseMin(position_m);
    high = high.cwiseMax(position_m);
  }
};

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

// Returns everything before the vertices' positions; the other attributes and the triangles follow them.
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

// Layout of a vertex in a file of PlyWriter.
constexpr size_t kPlyVertex = 31, kPlyNormal = 12, kPlyGrey = 24, kPlySigma = 27, kPlyTriangle = 13;

// Reads the elements of a PLY file block by block.
class PlyBlocks {
 public:
  explicit PlyBlocks(const fs::path& file) : path_(file), stream_(file, std::ios::binary) {
    std::string line;
    while (std::getline(stream_, line) && line != "end_header") {
      constexpr const char *kVertices = "element vertex ", *kFaces = "element face ";
      if (line.starts_with(kVertices)) vertices_ = std::stoull(line.substr(std::strlen(kVertices)));
      if (line.starts_with(kFaces)) triangles_ = std::stoull(line.substr(std::strlen(kFaces)));
    }
    if (!stream_) throw Error(path_.string() + ": is not a mesh written by fringeslam");
    start_ = stream_.tellg();
  }
  uint64_t vertices() const { return vertices_; }
  uint64_t triangles() const { return triangles_; }

  // Calls use(bytes of an element) for each.
  template <class Use>
  void for_each_vertex(const Use& use) {
    for_each(0, vertices_, kPlyVertex, use);
  }
  template <class Use>
  void for_each_triangle(const Use& use) {
    for_each(vertices_ * kPlyVertex, triangles_, kPlyTriangle, use);
  }

 private:
  template <class Use>
  void for_each(uint64_t offset, uint64_t count, size_t size, const Use& use) {
    constexpr uint64_t kBlockOfElements = 1 << 15;
    std::vector<char> block(kBlockOfElements * size);
    stream_.clear();
    stream_.seekg(start_ + static_cast<std::streamoff>(offset));
    for (uint64_t first = 0; first < count; first += kBlockOfElements) {
      const uint64_t number = std::min(kBlockOfElements, count - first);
      stream_.read(block.data(), static_cast<std::streamsize>(number * size));
      if (!stream_) throw Error(path_.string() + ": is truncated");
      for (uint64_t i = 0; i < number; ++i) use(block.data() + i * size);
    }
  }

  fs::path path_;
  std::ifstream stream_;
  std::streamoff start_ = 0;
  uint64_t vertices_ = 0, triangles_ = 0;
};

// Collects small pieces for a file.
class Buffered {
 public:
  explicit Buffered(OutputFile& file) : file_(file) {}
  void write(const char* bytes, size_t size) {
    bytes_.append(bytes, size);
    if (bytes_.size() > kMost) flush();
  }
  void flush() {
    file_.write(bytes_);
    bytes_.clear();
  }

 private:
  static constexpr size_t kMost = 1 << 20;
  OutputFile& file_;
  std::string bytes_;
};

std::array<uint8_t, 4> colour_of(uint8_t grey) { return {grey, grey, grey, 255}; }

}  // namespace

bool fits_glb(uint64_t vertices, uint64_t triangles) {
  uint64_t size = triangles * kTriangles.bytes;
  for (const GlbArray& array : kAttributes) size += vertices * array.bytes;
  return size <= UINT32_MAX - kMaxDescription;
}

std::string to_glb(const SurfaceMesh& mesh) {
  MeshExtent extent{mesh.triangles.empty() ? 0 : mesh.vertices.size(), mesh.triangles.size()};
  for (const CloudPoint& vertex : mesh.vertices) extent.add(vertex.position_m);
  std::string file = glb_head(extent);
  if (mesh.triangles.empty()) return file;
  const auto append = [&](const auto& value) {
    file.append(reinterpret_cast<const char*>(value.data()), value.size() * sizeof(*value.data()));
  };
  for (const CloudPoint& vertex : mesh.vertices) append(vertex.position_m);
  for (const CloudPoint& vertex : mesh.vertices) append(vertex.normal);
  for (const CloudPoint& vertex : mesh.vertices) append(colour_of(vertex.grey));
  for (const CloudPoint& vertex : mesh.vertices) append_bytes(file, vertex.sigma_m);
  for (const auto& triangle : mesh.triangles) append(triangle);
  return file;
}

void ply_to_glb(const fs::path& ply, const fs::path& glb) {
  PlyBlocks blocks(ply);
  MeshExtent extent{blocks.triangles() > 0 ? blocks.vertices() : 0, blocks.triangles()};
  blocks.for_each_vertex([&](const char* vertex) {
    Eigen::Vector3f position_m;
    std::memcpy(position_m.data(), vertex, kPlyNormal);
    extent.add(position_m);
  });
  OutputFile file(glb);
  file.write(glb_head(extent));
  if (extent.triangles > 0) {
    Buffered out(file);
    blocks.for_each_vertex([&](const char* vertex) { out.write(vertex, kPlyNormal); });
    blocks.for_each_vertex([&](const char* vertex) { out.write(vertex + kPlyNormal, kPlyGrey - kPlyNormal); });
    blocks.for_each_vertex([&](const char* vertex) {
      const std::array<uint8_t, 4> colour = colour_of(static_cast<uint8_t>(vertex[kPlyGrey]));
      out.write(reinterpret_cast<const char*>(colour.data()), colour.size());
    });
    blocks.for_each_vertex([&](const char* vertex) { out.write(vertex + kPlySigma, sizeof(float)); });
    blocks.for_each_triangle([&](const char* triangle) { out.write(triangle + 1, kTriangles.bytes); });
    out.flush();
  }
  file.close();
}

}  // namespace fringeslam
