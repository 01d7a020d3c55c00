// SPDX-License-Identifier: Apache-2.0
#include <map>

#include "core/io/files.h"
#include "sim/scene/scene_parts.h"

namespace fringeslam::sim {

namespace {

Grain read_grain(const YamlMap& map) {
  static const std::map<std::string, Grain> grains = {
      {"plain", Grain::plain},       {"cardboard", Grain::cardboard},
      {"concrete", Grain::concrete}, {"paper", Grain::paper},
      {"brick", Grain::brick},       {"metal", Grain::metal},
      {"foam", Grain::foam},         {"wood", Grain::wood},
      {"stone", Grain::stone},       {"checkerboard", Grain::checkerboard},
      {"circles", Grain::circles},   {"asymmetric_circles", Grain::asymmetric_circles}};
  std::vector<std::string> names = {"plain"};  // the first replaces an invalid name
  for (const auto& [name, grain] : grains) {
    if (name != names[0]) names.push_back(name);
  }
  return grains.at(map.choice("grain", names));
}

bool is_board(Grain grain) {
  return grain == Grain::checkerboard || grain == Grain::circles || grain == Grain::asymmetric_circles;
}

}  // namespace

Material read_material(const YamlMap& map) {
  Material material;
  if (map.boolean_or("pane", false)) {
    constexpr double kGlass = 0.04;
    material.pane = true;
    material.albedo = 0;
    material.dust = false;
    material.reflectance = map.number_or("reflectance", kGlass, {1e-4, 0.5});
    for (const char* other : {"grain", "texture", "albedo", "metal", "mean_free_path_m", "roughness", "bump_m"}) {
      if (map.has(other)) throw map.error(other, "a pane is clear and smooth; omit " + std::string(other));
    }
    return material;
  }
  if (map.has("texture")) {
    if (map.has("grain")) throw map.error("texture", "give grain or texture, not both");
    material.texture = map.file("texture").string();
    // OpenImageIO reads parts of a texture when they are needed, and would render a damaged one without a message.
    try {
      check_image(material.texture);
    } catch (const Error& e) {
      throw map.error("texture", e.what());
    }
    material.texture_m = map.number_or("texture_m", material.texture_m, kLength);
    material.albedo = map.number_or("albedo", 1, kFraction);
  } else {
    material.grain = read_grain(map);
    material.albedo = map.number("albedo", kFraction);
  }
  if (is_board(material.grain)) {
    material.columns = map.integer("columns", {2, 1000});
    material.rows = map.integer("rows", {2, 1000});
    material.spacing_m = map.number("spacing_m", kLength);
    if (material.grain != Grain::checkerboard) material.diameter_m = map.number("diameter_m", kLength);
    material.print_albedo = map.number_or("print_albedo", 0.1, kFraction);
  } else if (material.texture.empty()) {
    material.contrast = map.number_or("contrast", 0.3, kFraction);
    material.grain_m = map.number_or("grain_m", 0.01, kLength);
  }
  material.metal = map.boolean_or("metal", false);
  material.reflectance = map.number_or("reflectance", 0, kFraction);
  if (material.metal && material.reflectance > 0)
    throw map.error("reflectance", "the reflectance of a metal is its albedo; omit reflectance");
  if (map.has("mean_free_path_m")) {
    material.mean_free_path_m = map.number("mean_free_path_m", {1e-6, 0.1});
    if (material.metal) throw map.error("mean_free_path_m", "a metal is opaque; omit mean_free_path_m");
  }
  material.roughness = map.number_or("roughness", material.roughness, {0.05, 1});
  material.bump_m = map.number_or("bump_m", 0, {0, 0.1});
  material.bump_size_m = map.number_or("bump_size_m", material.bump_size_m, kLength);
  material.emission_lux = map.number_or("emission_lux", 0, {0, 1e7});
  if (map.has("temperature_c") && map.has("warmer_k"))
    throw map.error("warmer_k", "give temperature_c or warmer_k, not both");
  material.warmer_k = map.number_or("warmer_k", 0, {-200, 2000});
  if (map.has("temperature_c")) material.temperature_c = map.number("temperature_c", {-200, 2000});
  material.emissivity = map.number_or("emissivity", material.emissivity, kFraction);
  material.victim = map.boolean_or("victim", false);
  material.dust = map.boolean_or("dust", true);
  return material;
}

Material find_material(const YamlMap& map, const Materials& materials) {
  std::vector<std::string> names;
  for (const auto& [name, material] : materials) names.push_back(name);
  const auto found = materials.find(map.choice("material", names));
  return found == materials.end() ? Material{} : found->second;
}

}  // namespace fringeslam::sim
