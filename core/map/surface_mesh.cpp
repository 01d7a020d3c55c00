// SPDX-License-Identifier: Apache-2.0
#include "core/map/surface_mesh.h"

#include "core/base/append_bytes.h"
#include "core/types/error.h"
#include "core/types/options.h"

namespace fringeslam {

namespace {

// Constants of the glTF specification.
constexpr uint64_t kFloat = 5126, kByte = 5121, kIndex = 5125, kVertices = 34962, kTriangles = 34963;
constexpr uint32_t kMagic = 0x46546C67, kJsonChunk = 0x4E4F534A, kBinaryChunk = 0x004E4942;

std::string field(const std::string& name, const std::string& value) { return "\"" + name + "\":" + value; }
std::string field(const std::string& name, uint64_t value) { return field(name, std::to_string(value)); }

std::string vector(const Eigen::Vector3f& v) {
  std::string text;
  for (const float x : v) text += (text.empty() ? "[" : ",") + to_text(static_cast<double>(x));
  return text + "]";
}

// The binary chunk and the JSON that describes its parts.
struct Buffer {
  std::string bytes, views, accessors;

  template <class Append>
  void add(uint64_t count, uint64_t component, const std::string& type, uint64_t target, const std::string& more,
           const Append& append) {
    const size_t start = bytes.size();
    append();
    const std::string number = std::to_string(views_++);
    views += (views.empty() ? "{" : ",{") + field("buffer", 0) + "," + field("byteOffset", start) + "," +
             field("byteLength", bytes.size() - start) + "," + field("target", target) + "}";
    accessors += (accessors.empty() ? "{" : ",{") + field("bufferView", number) + "," +
                 field("componentType", component) + "," + field("count", count) + "," +
                 field("type", "\"" + type + "\"") + more + "}";
  }

 private:
  int views_ = 0;
};

Buffer buffer_of(const SurfaceMesh& mesh) {
  const auto for_each = [&](const auto& append) {
    return [&mesh, append] {
      for (const CloudPoint& vertex : mesh.vertices) append(vertex);
    };
  };
  Eigen::Vector3f low = mesh.vertices.front().position_m, high = low;
  for (const CloudPoint& vertex : mesh.vertices) {
    low = low.cwiseMin(vertex.position_m);
    high = high.cwiseMax(vertex.position_m);
  }
  Buffer buffer;
  std::string& bytes = buffer.bytes;
  const uint64_t count = mesh.vertices.size();
  bytes.reserve(count * 32 + mesh.triangles.size() * 12);
  buffer.add(count, kFloat, "VEC3", kVertices, "," + field("min", vector(low)) + "," + field("max", vector(high)),
             for_each([&](const CloudPoint& v) {
               for (int i = 0; i < 3; ++i) append_bytes(bytes, v.position_m[i]);
             }));
  buffer.add(count, kFloat, "VEC3", kVertices, "", for_each([&](const CloudPoint& v) {
               for (int i = 0; i < 3; ++i) append_bytes(bytes, v.normal[i]);
             }));
  // Includes an alpha channel, since attributes must start at multiples of four bytes.
  buffer.add(count, kByte, "VEC4", kVertices, ",\"normalized\":true", for_each([&](const CloudPoint& v) {
               for (int i = 0; i < 3; ++i) append_bytes(bytes, v.grey);
               append_bytes(bytes, uint8_t{255});
             }));
  buffer.add(count, kFloat, "SCALAR", kVertices, "",
             for_each([&](const CloudPoint& v) { append_bytes(bytes, v.sigma_m); }));
  buffer.add(3 * mesh.triangles.size(), kIndex, "SCALAR", kTriangles, "", [&] {
    for (const auto& triangle : mesh.triangles) {
      for (const uint32_t corner : triangle) append_bytes(bytes, corner);
    }
  });
  return buffer;
}

void append_chunk(std::string& file, uint32_t type, std::string content, char padding) {
  content.resize((content.size() + 3) / 4 * 4, padding);
  append_bytes(file, static_cast<uint32_t>(content.size()));
  append_bytes(file, type);
  file += content;
}

}  // namespace

std::string to_glb(const SurfaceMesh& mesh) {
  const uint64_t size = mesh.vertices.size() * 32 + mesh.triangles.size() * 12;
  if (size > UINT32_MAX - 4096)
    throw Error("a mesh of " + std::to_string(size >> 20) + " MiB exceeds the limit of a GLB file; write a PLY file");
  std::string json = R"({"asset":{"version":"2.0","generator":"FringeSLAM"},"scene":0,)";
  std::string binary;
  if (mesh.triangles.empty()) {
    json += R"("scenes":[{}]})";  // glTF does not allow empty meshes
  } else {
    Buffer buffer = buffer_of(mesh);
    json +=
        R"("scenes":[{"nodes":[0]}],"nodes":[{"mesh":0,"rotation":[-0.70710678118654752,0,0,0.70710678118654752]}],)"
        R"("meshes":[{"primitives":[{"attributes":{"POSITION":0,"NORMAL":1,"COLOR_0":2,"_SIGMA":3},"indices":4,)"
        R"("material":0}]}],"materials":[{"doubleSided":true,"pbrMetallicRoughness":)"
        R"({"metallicFactor":0,"roughnessFactor":1}}],)";
    json += field("buffers", "[{" + field("byteLength", buffer.bytes.size()) + "}],");
    json += field("bufferViews", "[" + buffer.views + "],") + field("accessors", "[" + buffer.accessors + "]}");
    binary = std::move(buffer.bytes);
  }
  std::string chunks;
  append_chunk(chunks, kJsonChunk, json, ' ');
  if (!binary.empty()) append_chunk(chunks, kBinaryChunk, std::move(binary), '\0');
  std::string file;
  append_bytes(file, kMagic);
  append_bytes(file, uint32_t{2});
  append_bytes(file, static_cast<uint32_t>(12 + chunks.size()));
  return file + chunks;
}

}  // namespace fringeslam
