// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <map>
#include <numbers>
#include <set>

#include "core/io/files.h"
#include "sim/random.h"
#include "sim/scene/cache.h"
#include "sim/scene/furniture.h"
#include "sim/scene/mesh_import.h"
#include "sim/scene/pile.h"
#include "sim/scene/scatter.h"
#include "sim/scene/scene_parts.h"

namespace fringeslam::sim {

namespace {

constexpr Range kDetail{0, 7};  // 20 * 4^7 triangles

Shape read_shape(const std::string& name) {
  static const std::map<std::string, Shape> shapes = {
      {"box", Shape::box}, {"cylinder", Shape::cylinder}, {"sphere", Shape::sphere}, {"rock", Shape::rock}};
  return shapes.at(name);
}

using MeshReader = std::function<Mesh(const YamlMap&, uint32_t seed)>;

Eigen::Vector3d read_size(const YamlMap& map) { return map.vector3("size_m", kLength); }

// Readers for shapes that are not piece kinds: each parses its keys and builds the mesh.
const std::map<std::string, MeshReader>& mesh_readers() {
  static const std::map<std::string, MeshReader> readers = {
      {"plane",
       [](const YamlMap& map, uint32_t) {
         const std::vector<double> size = map.numbers("size_m", 2, kLength);
         return plane_mesh(size[0], size[1]);
       }},
      {"box", [](const YamlMap& map, uint32_t) { return box_mesh(read_size(map)); }},
      {"cylinder",
       [](const YamlMap& map, uint32_t) {
         return cylinder_mesh(map.number("radius_m", kLength), map.number("length_m", kLength), 96);
       }},
      {"sphere", [](const YamlMap& map, uint32_t) { return sphere_mesh(map.number("radius_m", kLength), 5); }},
      {"face_mask", [](const YamlMap& map, uint32_t) { return face_mask_mesh(read_size(map), 60); }},
      {"rock",
       [](const YamlMap& map, uint32_t seed) {
         return rock_mesh(read_size(map), map.integer_or("detail", 4, kDetail),
                          map.number_or("roughness", 0.25, {0, 0.5}), seed);
       }},
      {"wedge", [](const YamlMap& map, uint32_t) { return wedge_mesh(read_size(map)); }},
      {"bowl", [](const YamlMap& map, uint32_t) { return bowl_mesh(read_size(map)); }},
      {"stairs",
       [](const YamlMap& map, uint32_t) {
         return stairs_mesh(read_size(map), map.integer("steps", {1, 1000}));
       }},
      {"blinds",
       [](const YamlMap& map, uint32_t) {
         const std::vector<double> size = map.numbers("size_m", 2, kLength);
         const int slats = map.integer("slats", {1, 1000});
         const double angle = map.number("slat_angle_deg", {-90, 90}) * std::numbers::pi / 180;
         const double thickness = map.number_or("thickness_m", 0.002, kLength);
         if (thickness * slats >= 0.5 * size[1]) throw map.error("slats", "too many slats for this height");
         return blinds_mesh(size[0], size[1], slats, angle, thickness);
       }},
      {"lattice", [](const YamlMap& map, uint32_t) {
         const Eigen::Vector3d size = read_size(map);
         return lattice_mesh(size.x(), size.y(), size.z(), map.integer("columns", {1, 500}),
                             map.integer("rows", {1, 500}), map.number("hole_share", {0.01, 0.95}));
       }}};
  return readers;
}

// Reads a single object whose shape is a piece kind (pile.h) without a reader above.
Mesh read_piece(const YamlMap& map, const std::string& kind, uint32_t seed) {
  const int detail = kind == "stone" ? map.integer_or("detail", 4, kDetail) : 0;
  return make_piece(kind, read_size(map), detail, seed).mesh;
}

Object read_single(const YamlMap& map, const std::string& shape, const Materials& materials, uint32_t seed) {
  Object object;
  const auto reader = mesh_readers().find(shape);
  object.mesh = std::make_shared<const Mesh>(reader != mesh_readers().end() ? reader->second(map, seed)
                                                                            : read_piece(map, shape, seed));
  if (map.has("pose")) object.world_from_object = map.pose("pose");
  object.material = find_material(map, materials);
  object.texture_seed = seed;
  return object;
}

const std::vector<std::string>& shape_names() {
  static const std::vector<std::string> all = [] {
    std::set<std::string> names = {"mesh", "scatter", "pile"};
    for (const auto& [name, reader] : mesh_readers()) names.insert(name);
    names.insert(piece_kinds().begin(), piece_kinds().end());
    return std::vector<std::string>(names.begin(), names.end());
  }();
  return all;
}

// Reads the keys common to scatter and pile items: size range, material and weight.
template <class Item>
void read_item(const YamlMap& map, const Materials& materials, Item& item) {
  item.size_min = map.vector3("size_min_m", kLength);
  item.size_max = map.vector3("size_max_m", kLength);
  if ((item.size_max.array() < item.size_min.array()).any())
    throw map.error("size_max_m", "size_max_m must not be smaller than size_min_m");
  item.material = find_material(map, materials);
  item.weight = map.number_or("weight", 1, {1e-6, 1e6});
}

std::vector<ScatterItem> read_scatter_items(const YamlMap& map, const Materials& materials) {
  std::vector<ScatterItem> items;
  for (const YamlMap& entry : map.maps("items")) {
    ScatterItem& item = items.emplace_back();
    item.shape = read_shape(entry.kind("shape", {"box", "cylinder", "sphere", "rock"}));
    read_item(entry, materials, item);
    item.variants = entry.integer_or("variants", 0, {0, 100000});
  }
  if (items.empty()) throw map.error("items", "'items' is empty; list the objects to scatter");
  return items;
}

Scatter read_scatter(const YamlMap& map, const Materials& materials, int most) {
  Scatter scatter;
  scatter.count = map.integer("count", {1, static_cast<double>(most)});
  const std::vector<double> area = map.numbers("area_m", 2, kLength);
  scatter.area_x = area[0];
  scatter.area_y = area[1];
  scatter.max_height = map.number("max_height_m", kLength);
  if (map.has("pose")) scatter.world_from_area = map.pose("pose");
  scatter.items = read_scatter_items(map, materials);
  return scatter;
}

// Estimates the number of triangles of the pile's stones; other pieces have bounded triangle counts.
double stone_triangles(const Pile& pile) {
  double weights = 0, triangles = 0;
  for (const PileItem& item : pile.items) weights += item.weight;
  for (const PileItem& item : pile.items) {
    const double pieces = pile.count * item.weight / weights;
    const double all = pieces + item.exactly.value_or(0);
    const double different = item.variants == 0 ? all : std::min<double>(all, item.variants);
    if (item.kind == "stone") triangles += different * 20 * std::pow(4, item.detail);
  }
  return triangles;
}

Pile read_pile(const YamlMap& map, const Materials& materials, const SceneLimits& limits) {
  Pile pile;
  const std::vector<double> area = map.numbers("area_m", 2, kLength);
  pile.area = {area[0], area[1], map.number_or("walls_m", 0, {0, 100})};
  if (map.has("count") == map.has("per_m2")) throw map.error("give either count or per_m2");
  const Range pieces{1, std::min(5000.0, static_cast<double>(limits.scattered))};
  if (map.has("count")) {
    pile.count = map.integer("count", pieces);
  } else {
    const double wanted = std::round(map.number("per_m2", {1e-3, 1e7}) * area[0] * area[1]);
    if (!pieces.contains(wanted)) throw map.error("per_m2", range_error("pieces on this area", wanted, pieces));
    pile.count = static_cast<int>(wanted);
  }
  if (map.has("pose")) pile.world_from_area = map.pose("pose");
  for (const YamlMap& entry : map.maps("items")) {
    PileItem& item = pile.items.emplace_back();
    item.kind = entry.kind("shape", piece_kinds());
    read_item(entry, materials, item);
    item.variants = entry.integer_or("variants", 0, {0, 100000});
    if (entry.has("exactly")) {
      if (entry.has("weight")) throw entry.error("exactly", "give exactly or weight, not both");
      item.exactly = entry.integer("exactly", {0, 1000});
      item.after = entry.number_or("after", 0, kFraction);
      item.weight = 0;
    }
    if (item.kind == "stone") item.detail = entry.integer_or("detail", item.detail, kDetail);
  }
  if (pile.items.empty()) throw map.error("items", "'items' is empty; list the pieces of the pile");
  if (std::all_of(pile.items.begin(), pile.items.end(), [](const PileItem& item) { return item.exactly.has_value(); }))
    throw map.error("items", "every item has 'exactly'; at least one needs a weight to supply the pieces of 'count'");
  // Checked before the meshes are built, which could exhaust memory.
  if (const double triangles = stone_triangles(pile); triangles > static_cast<double>(limits.triangles))
    throw map.error("items", "the stones of the pile have about " + to_text(std::round(triangles)) +
                                 " triangles; at most " + std::to_string(limits.triangles) +
                                 " are allowed: use variants or less detail");
  return pile;
}

std::vector<Object> read_pile_objects(const YamlMap& map, uint32_t number, ObjectContext& context) {
  const Pile pile = read_pile(map, context.materials, context.limits);
  PileObjects result;
  try {
    result = pile_objects(pile, context.seed, number, context.piles++);
  } catch (const Error& e) {
    throw map.error(e.what());
  }
  if (!result.from_cache) {
    char text[128];
    std::snprintf(text, sizeof text, "pile of %d pieces settled in %.1f s of simulated time; cached in %s", pile.count,
                  result.settled.time_s, cache_folder().c_str());
    context.notes.push_back(text);
  }
  return std::move(result.objects);
}

void check_texture(const YamlMap& map, const std::filesystem::path& texture) {
  std::error_code ignored;
  if (!std::filesystem::exists(texture, ignored))
    throw map.error("file", texture.string() + ", the mesh's texture, does not exist; give a material");
  try {
    check_image(texture);
  } catch (const Error& e) {
    throw map.error("file", std::string("the mesh's texture ") + e.what());
  }
}

// Imports a mesh file, one object per part; `material` overrides the file's materials.
std::vector<Object> read_mesh(const YamlMap& map, const Materials& materials, uint32_t seed, const SceneLimits& limits,
                              std::vector<std::string>& notes) {
  const std::filesystem::path file = map.file("file");
  MeshImportOptions options;
  options.most_triangles = limits.triangles;
  if (map.has("unit_m")) options.unit_m = map.number("unit_m", {1e-6, 1e6});
  if (map.has("up")) options.up = map.choice<UpAxis>("up");
  const std::optional<Material> material =
      map.has("material") ? std::optional(find_material(map, materials)) : std::nullopt;
  const Pose pose = map.has("pose") ? map.pose("pose") : Pose{};
  MeshImport import;
  try {
    import = import_mesh(file, options);
  } catch (const Error& e) {
    throw map.error("file", e.what());
  }
  for (const std::filesystem::path& read : import.files) map.note_file(read);
  notes.push_back(import.summary(file));
  std::vector<Object> objects;
  std::set<std::filesystem::path> checked;  // textures, which any number of parts can share
  for (ImportedPart& part : import.parts) {
    Object object;
    object.mesh = std::move(part.mesh);
    object.world_from_object = pose * part.world_from_part;
    object.material.albedo = part.albedo;
    if (!part.texture.empty() && !material) {
      if (checked.insert(part.texture).second) check_texture(map, part.texture);
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

Building read_building(const YamlMap& map, const Materials& materials, const SceneLimits& limits) {
  Building building;
  BuildingPlan& plan = building.plan;
  plan.storeys = map.integer_or("storeys", plan.storeys, {1, 20});
  plan.rooms = map.integer_or("rooms", plan.rooms, {2, 50});
  if (map.has("room_m")) {
    const std::vector<double> size = map.numbers("room_m", 2, {2.4, 20});
    plan.room_x = size[0];
    plan.room_y = size[1];
  }
  plan.corridor = map.number_or("corridor_m", plan.corridor, {1.4, 5});
  plan.storey = map.number_or("storey_m", plan.storey, {2.3, 5});
  plan.wall = map.number_or("wall_m", plan.wall, {0.05, 0.5});
  plan.door = map.number_or("door_m", plan.door, {0.7, 1.2});
  building.wall = find_material(map.map("walls"), materials);
  building.floor = find_material(map.map("floors"), materials);
  building.rubble_per_m2 = map.number_or("rubble_per_m2", 0, {0, 100});
  building.max_height = map.number_or("max_height_m", building.max_height, {0.02, 1});
  if (building.rubble_per_m2 == 0) return building;
  building.items = read_scatter_items(map, materials);
  const double area = (plan.rooms * plan.room_x + 2 * plan.corridor) * (2 * plan.room_y + plan.corridor) * plan.storeys;
  const double pieces = building.rubble_per_m2 * area;
  if (pieces > static_cast<double>(limits.objects))
    throw map.error("rubble_per_m2", "the building has about " + to_text(std::round(pieces)) + " pieces; at most " +
                                         std::to_string(limits.objects) + " objects are allowed");
  if (building.rubble_per_m2 * std::max(plan.room_x * plan.room_y, plan.rooms * plan.room_x * plan.corridor) >
      limits.scattered)
    throw map.error("rubble_per_m2",
                    "a room or corridor has more than " + std::to_string(limits.scattered) + " pieces");
  return building;
}

std::vector<Object> read_objects(const YamlMap& entry, uint32_t number, ObjectContext& context) {
  const std::string shape = entry.kind("shape", shape_names());
  if (shape == "scatter")
    return scatter_objects(read_scatter(entry, context.materials, context.limits.scattered), context.seed, number);
  if (shape == "pile") return read_pile_objects(entry, number, context);
  const uint32_t shape_seed = Philox(context.seed, Stream::shape, number).seed();
  if (shape == "mesh") return read_mesh(entry, context.materials, shape_seed, context.limits, context.notes);
  return {read_single(entry, shape, context.materials, shape_seed)};
}

}  // namespace fringeslam::sim
