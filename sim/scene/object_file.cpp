// SPDX-License-Identifier: Apache-2.0
#include <map>

#include "sim/random.h"
#include "sim/scene/mesh_import.h"
#include "sim/scene/scatter.h"
#include "sim/scene/scene_parts.h"

namespace fringeslam::sim {

namespace {

Shape read_shape(const std::string& name) {
  static const std::map<std::string, Shape> shapes = {{"plane", Shape::plane},       {"box", Shape::box},
                                                      {"cylinder", Shape::cylinder}, {"sphere", Shape::sphere},
                                                      {"rock", Shape::rock},         {"face_mask", Shape::face_mask}};
  return shapes.at(name);
}

Object read_primitive(const YamlMap& map, const std::string& shape, const Materials& materials, uint32_t seed) {
  Object object;
  Mesh mesh;
  switch (read_shape(shape)) {
    case Shape::plane: {
      const std::vector<double> size = map.numbers("size_m", 2, kLength);
      mesh = plane_mesh(size[0], size[1]);
      break;
    }
    case Shape::box:
      mesh = box_mesh(map.vector3("size_m", kLength));
      break;
    case Shape::cylinder:
      mesh = cylinder_mesh(map.number("radius_m", kLength), map.number("length_m", kLength), 96);
      break;
    case Shape::sphere:
      mesh = sphere_mesh(map.number("radius_m", kLength), 5);
      break;
    case Shape::face_mask:
      mesh = face_mask_mesh(map.vector3("size_m", kLength), 60);
      break;
    case Shape::rock:
      mesh = rock_mesh(map.vector3("size_m", kLength), 4, map.number_or("roughness", 0.25, {0, 0.5}), seed);
      break;
  }
  object.mesh = std::make_shared<const Mesh>(std::move(mesh));
  if (map.has("pose")) object.world_from_object = map.pose("pose");
  object.material = find_material(map, materials);
  object.texture_seed = seed;
  return object;
}

Scatter read_scatter(const YamlMap& map, const Materials& materials) {
  Scatter scatter;
  scatter.count = map.integer("count", {1, 100000});
  const std::vector<double> area = map.numbers("area_m", 2, kLength);
  scatter.area_x = area[0];
  scatter.area_y = area[1];
  scatter.max_height = map.number("max_height_m", kLength);
  if (map.has("pose")) scatter.world_from_area = map.pose("pose");
  for (const YamlMap& entry : map.maps("items")) {
    ScatterItem item;
    item.shape = read_shape(entry.choice("shape", {"box", "cylinder", "sphere", "rock"}));
    item.size_min = entry.vector3("size_min_m", kLength);
    item.size_max = entry.vector3("size_max_m", kLength);
    if ((item.size_max.array() < item.size_min.array()).any())
      throw entry.error("size_max_m", "size_max_m must not be smaller than size_min_m");
    item.material = find_material(entry, materials);
    item.weight = entry.number_or("weight", 1, {1e-6, 1e6});
    scatter.items.push_back(item);
  }
  if (scatter.items.empty()) throw map.error("items", "'items' is empty; say what to scatter");
  return scatter;
}

// The parts of a mesh file, each an object; `material` replaces those of the file.
std::vector<Object> read_mesh(const YamlMap& map, const Materials& materials, uint32_t seed,
                              std::vector<std::string>& notes) {
  const std::filesystem::path file = map.path("file");
  if (!std::filesystem::exists(file)) throw map.error("file", file.string() + " does not exist");
  MeshImportOptions options;
  if (map.has("unit_m")) options.unit_m = map.number("unit_m", {1e-6, 1e6});
  if (map.has("up")) options.up = map.choice("up", {"x", "y", "z"});
  const std::optional<Material> material =
      map.has("material") ? std::optional(find_material(map, materials)) : std::nullopt;
  const Pose pose = map.has("pose") ? map.pose("pose") : Pose{};
  MeshImport import;
  try {
    import = import_mesh(file, options);
  } catch (const Error& e) {
    throw map.error("file", e.what());
  }
  notes.push_back(import.summary(file));
  std::vector<Object> objects;
  for (ImportedPart& part : import.parts) {
    Object object;
    object.mesh = std::move(part.mesh);
    object.world_from_object = pose * part.world_from_part;
    object.material.albedo = part.albedo;
    if (!part.texture.empty() && !material) {
      if (!std::filesystem::exists(part.texture))
        throw map.error("file", part.texture.string() + ", its texture, does not exist; give a material");
      object.material.texture = part.texture.string();
      object.material.albedo = 1;
    }
    if (material) object.material = *material;
    object.texture_seed = seed + static_cast<uint32_t>(objects.size());
    objects.push_back(std::move(object));
  }
  return objects;
}

}  // namespace

std::vector<Object> read_objects(const YamlMap& entry, uint32_t number, const ObjectContext& context) {
  const std::string shape =
      entry.choice("shape", {"plane", "box", "cylinder", "sphere", "rock", "face_mask", "mesh", "scatter"});
  if (shape == "scatter") return scatter_objects(read_scatter(entry, context.materials), context.seed, number);
  const auto shape_seed = static_cast<uint32_t>(Philox(context.seed, Stream::shape, number).uniform() * 4294967295.0);
  if (shape == "mesh") return read_mesh(entry, context.materials, shape_seed, context.notes);
  return {read_primitive(entry, shape, context.materials, shape_seed)};
}

}  // namespace fringeslam::sim
