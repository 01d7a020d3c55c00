// SPDX-License-Identifier: Apache-2.0
#include "core/map/surface_mesh.h"

#include <tiny_gltf.h>

#include <cstring>
#include <numbers>
#include <sstream>
#include <type_traits>

#include "core/types/error.h"

namespace fringeslam {

namespace {

constexpr uint64_t kMaxDescription = 4096;  // bytes of a GLB file that are not vertices or triangles

// Appends of(item) for each item to the file's buffer; returns the number of the accessor that describes them.
template <class Item, class Of>
int append(tinygltf::Model& model, const std::vector<Item>& items, int component, int type, int target, const Of& of) {
  using Value = std::invoke_result_t<Of, const Item&>;
  std::vector<unsigned char>& bytes = model.buffers.front().data;
  tinygltf::BufferView view;
  view.buffer = 0;
  view.byteOffset = bytes.size();
  view.byteLength = items.size() * sizeof(Value);
  view.target = target;
  bytes.resize(bytes.size() + view.byteLength);
  unsigned char* next = bytes.data() + view.byteOffset;
  for (const Item& item : items) {
    const Value value = of(item);
    std::memcpy(next, &value, sizeof value);
    next += sizeof value;
  }
  tinygltf::Accessor accessor;
  accessor.bufferView = static_cast<int>(model.bufferViews.size());
  accessor.componentType = component;
  accessor.type = type;
  accessor.count = view.byteLength / static_cast<size_t>(tinygltf::GetComponentSizeInBytes(component) *
                                                         tinygltf::GetNumComponentsInType(type));
  model.bufferViews.push_back(std::move(view));
  model.accessors.push_back(std::move(accessor));
  return static_cast<int>(model.accessors.size()) - 1;
}

tinygltf::Primitive append(tinygltf::Model& model, const SurfaceMesh& mesh) {
  const auto append_to_vertices = [&](int component, int type, const auto& of) {
    return append(model, mesh.vertices, component, type, TINYGLTF_TARGET_ARRAY_BUFFER, of);
  };
  tinygltf::Primitive primitive;
  primitive.mode = TINYGLTF_MODE_TRIANGLES;
  const int position = append_to_vertices(TINYGLTF_COMPONENT_TYPE_FLOAT, TINYGLTF_TYPE_VEC3,
                                          [](const CloudPoint& v) { return v.position_m; });
  Eigen::Vector3f low = mesh.vertices.front().position_m, high = low;
  for (const CloudPoint& vertex : mesh.vertices) {
    low = low.cwiseMin(vertex.position_m);
    high = high.cwiseMax(vertex.position_m);
  }
  model.accessors[static_cast<size_t>(position)].minValues.assign(low.begin(), low.end());
  model.accessors[static_cast<size_t>(position)].maxValues.assign(high.begin(), high.end());
  primitive.attributes["POSITION"] = position;
  primitive.attributes["NORMAL"] = append_to_vertices(TINYGLTF_COMPONENT_TYPE_FLOAT, TINYGLTF_TYPE_VEC3,
                                                      [](const CloudPoint& v) { return v.normal; });
  // Includes an alpha channel, since attributes must start at multiples of four bytes.
  const int colour =
      append_to_vertices(TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE, TINYGLTF_TYPE_VEC4, [](const CloudPoint& v) {
        return std::array<uint8_t, 4>{v.grey, v.grey, v.grey, 255};
      });
  model.accessors[static_cast<size_t>(colour)].normalized = true;
  primitive.attributes["COLOR_0"] = colour;
  primitive.attributes["_SIGMA"] = append_to_vertices(TINYGLTF_COMPONENT_TYPE_FLOAT, TINYGLTF_TYPE_SCALAR,
                                                      [](const CloudPoint& v) { return v.sigma_m; });
  primitive.indices = append(model, mesh.triangles, TINYGLTF_COMPONENT_TYPE_UNSIGNED_INT, TINYGLTF_TYPE_SCALAR,
                             TINYGLTF_TARGET_ELEMENT_ARRAY_BUFFER, [](const auto& triangle) { return triangle; });
  return primitive;
}

}  // namespace

std::string to_glb(const SurfaceMesh& mesh) {
  const uint64_t size = mesh.vertices.size() * 32 + mesh.triangles.size() * 12;
  if (size > UINT32_MAX - kMaxDescription)
    throw Error("a mesh of " + std::to_string(size >> 20) + " MiB exceeds the limit of a GLB file; write a PLY file");
  tinygltf::Model model;
  model.asset.version = "2.0";
  model.asset.generator = "FringeSLAM";
  model.scenes.resize(1);
  model.scenes[0].name = "surface";
  model.defaultScene = 0;
  if (!mesh.triangles.empty()) {  // glTF does not allow empty meshes
    model.buffers.resize(1);
    model.buffers[0].data.reserve(size);
    model.meshes.resize(1);
    model.meshes[0].primitives = {append(model, mesh)};
    model.meshes[0].primitives[0].material = 0;
    model.materials.resize(1);
    model.materials[0].doubleSided = true;
    model.materials[0].pbrMetallicRoughness.metallicFactor = 0;
    model.nodes.resize(1);
    model.nodes[0].mesh = 0;
    model.nodes[0].rotation = {-std::numbers::sqrt2 / 2, 0, 0, std::numbers::sqrt2 / 2};
    model.scenes[0].nodes = {0};
  }
  std::string file;
  file.reserve(size + kMaxDescription);  // saves the stream from copying the file whenever it grows
  std::ostringstream stream(std::move(file));
  constexpr bool kPretty = false, kBinary = true;
  tinygltf::TinyGLTF().WriteGltfSceneToStream(&model, stream, kPretty, kBinary);
  return std::move(stream).str();
}

}  // namespace fringeslam
