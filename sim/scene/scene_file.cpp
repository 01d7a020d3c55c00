// SPDX-License-Identifier: Apache-2.0
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <set>

#include "core/rig/rig_file.h"
#include "sim/random.h"
#include "sim/scene/scene_files.h"
#include "sim/scene/scene_parts.h"

namespace fringeslam::sim {

namespace {

namespace fs = std::filesystem;

// Draws the values of a scene file's distributions from its seed.
class SceneDraws : public RandomSource {
 public:
  explicit SceneDraws(uint64_t seed) : seed_(seed) {}
  double uniform(uint64_t address, uint32_t attempt) const override { return at(address).uniforms(attempt)[0]; }
  double normal(uint64_t address, uint32_t attempt) const override { return at(address).normal_pair(attempt).first; }

 private:
  Philox at(uint64_t address) const {
    return Philox(seed_, Stream::draws, static_cast<uint32_t>(address), static_cast<uint32_t>(address >> 32));
  }
  uint64_t seed_;
};

// A scene file with its included files. A section is taken from the first file that has it, the scene file itself
// before its includes; materials and objects are merged from all files.
class SceneLayers {
 public:
  SceneLayers(const fs::path& file, const SceneLoadOptions& reading) : reading_(reading) {
    add(file, "", 0);
    // The last one to set a value takes precedence.
    for (size_t i = layers_.size(); i-- > 0;) place_from(i);
    for (const auto& [path, value] : reading_.changes) change(path, value, "", 0);
    seed = reading.seed.value_or(has("seed") ? with("seed").seed("seed") : 1);
    const auto draws = std::make_shared<SceneDraws>(seed);
    for (size_t i = 0; i < layers_.size(); ++i) {
      layers_[i].draw_from(draws, places_[i]);
      if (!reading.values) continue;
      values_.push_back(std::make_shared<std::vector<YamlValue>>());
      layers_[i].record_values(values_.back());
    }
  }

  // Returns the first layer that has the section, else the scene file itself, which then reports it as missing.
  const YamlMap& with(const std::string& section) const {
    const YamlMap* first = nullptr;
    for (const YamlMap& layer : layers_) {
      if (layer.has(section) && !first) first = &layer;
    }
    return first ? *first : layers_.front();
  }
  bool has(const std::string& section) const { return with(section).has(section); }
  YamlMap section(const std::string& name) const { return with(name).map(name); }
  const std::vector<YamlMap>& all() const { return layers_; }

  // Passes on the values that were read, and the files named in the layers.
  ~SceneLayers() {
    for (size_t i = 0; i < values_.size(); ++i) {
      const std::string place = layers_[i].place(), file = place.substr(0, place.rfind(':'));
      for (YamlValue& value : *values_[i]) {
        // Single entries of a list in another file, such as the rig's, cannot be overridden.
        const bool is_entry =
            value.path.find_first_not_of("0123456789", value.path.rfind('.') + 1) == std::string::npos;
        const bool changeable = owner_of(value.path, 0) == &layers_[i] && (!is_entry || value.place.starts_with(file));
        reading_.values->push_back({std::move(value), changeable});
      }
    }
    if (!reading_.files) return;
    for (const YamlMap& layer : layers_) {
      const std::vector<fs::path> asked = layer.asked_files();
      reading_.files->insert(reading_.files->end(), asked.begin(), asked.end());
    }
  }
  SceneLayers(const SceneLayers&) = delete;
  SceneLayers& operator=(const SceneLayers&) = delete;

  void finish() const {
    for (const YamlMap& layer : layers_) layer.finish();
  }

  // Formats an equivalent single file with all values drawn; its paths are relative to `folder`.
  std::string resolved(const fs::path& folder) const;

  uint64_t seed = 1;

 private:
  // Applies the places that a layer gives in its section `placed`, by key path: to the file that includes it, and that
  // file's includes.
  void place_from(size_t index) {
    const YamlMap layer = layers_[index];
    if (!layer.has("placed")) return;
    const YamlMap placed = layer.map("placed");
    for (const std::string& path : placed.keys()) {
      const std::string value = placed.yaml(path), place = placed.place(path);
      try {
        change(path, value, place, includers_[index]);
      } catch (const Error& e) {
        placed.report(std::string_view(e.what()).starts_with(place + ": ") ? e : placed.error(path, e.what()));
      }
    }
  }

  // `from` is the layer whose values the path refers to.
  void change(const std::string& path, const std::string& value, const std::string& place, size_t from) {
    const std::string section = path.substr(0, path.find('.'));
    // These sections are read before any value is replaced, so that the change would have no effect.
    if (section == "include" || section == "placed")
      throw layers_.front().error(section, path + ": '" + section + "' cannot be changed by key path; edit the file");
    if (path == "rig.hardware" || path.starts_with("rig.hardware."))
      throw layers_.front().error("rig",
                                  path + ": scenes have no hardware; edit the file of the rig that is captured with");
    YamlMap* layer = owner_of(path, from);
    if (!layer) throw unknown_material(path);
    layer->set(path, value, place);
  }

  // Returns a layer and those that it includes, also through others, in their order.
  std::set<size_t> with_includes(size_t index) const {
    std::set<size_t> found = {index};
    for (std::vector<size_t> open = {index}; !open.empty();) {
      const std::vector<size_t> included = includes_[open.back()];
      open.pop_back();
      for (const size_t other : included) {
        if (found.insert(other).second) open.push_back(other);
      }
    }
    return found;
  }

  // Returns the layer whose value a key path changes: among the layer `from` and its includes, the first one that has the
  // section or, since materials are merged from all layers, the material; if none has it, among the file that includes them
  // and its includes, and so on. Null for a key of a material that no layer has: setting it would define a material that no
  // object uses. Whole materials can be added.
  YamlMap* owner_of(const std::string& path, size_t from) {
    const auto first_with = [&](const auto& has) -> YamlMap* {
      for (size_t scope = from;; scope = includers_[scope]) {
        for (const size_t i : with_includes(scope)) {
          if (has(layers_[i])) return &layers_[i];
        }
        if (scope == 0) return nullptr;
      }
    };
    const std::string section = path.substr(0, path.find('.'));
    const bool is_material = section == "materials" && section != path;
    if (is_material) {
      const std::string name = material_of(path);
      YamlMap* layer = first_with([&](const YamlMap& each) {
        const std::vector<std::string> names = each.keys_in("materials");
        return std::find(names.begin(), names.end(), name) != names.end();
      });
      const bool whole = path == section + "." + name;
      if (layer || !whole) return layer;
    }
    YamlMap* layer = first_with([&](const YamlMap& each) { return each.contains(section); });
    return layer ? layer : &layers_[from];
  }

  // Second part of a key path.
  static std::string material_of(const std::string& path) {
    const size_t begin = path.find('.') + 1;
    return path.substr(begin, path.find('.', begin) - begin);
  }

  Error unknown_material(const std::string& path) const {
    std::string names;
    for (const YamlMap& layer : layers_) {
      for (const std::string& name : layer.keys_in("materials")) names += (names.empty() ? "" : ", ") + name;
    }
    return layers_.front().error("materials", path + ": there is no material '" + material_of(path) + "'" +
                                                  (names.empty() ? "; the scene has none" : "; there are: " + names));
  }

  void report_missing(const YamlMap& map, const fs::path& file) {
    if (reading_.files) reading_.files->push_back(file);
    std::error_code unknown;
    map.report(
        map.error("include", file.string() + (fs::exists(file, unknown) ? " is not a file" : " does not exist")));
  }

  void add(const fs::path& file, const std::string& place, size_t includer) {
    constexpr size_t kMost = 100;
    if (layers_.size() == kMost) throw Error(file.string() + ": more than 100 included files");
    const size_t index = layers_.size();
    const auto [known, is_new] = files_.emplace(fs::weakly_canonical(file), index);
    if (index > 0) includes_[includer].push_back(known->second);
    if (!is_new) return;
    if (reading_.files) reading_.files->push_back(file);
    const bool given = layers_.empty() && !reading_.text.empty();
    YamlMap map = given ? YamlMap::parse(reading_.text, file.string()) : YamlMap::load(file);
    if (reading_.errors) map.collect_errors(*reading_.errors);
    layers_.push_back(map);
    places_.push_back(place);
    includers_.push_back(includer);
    includes_.emplace_back();
    if (!map.has("include")) return;
    const std::vector<std::string> names = map.texts("include");
    const std::vector<fs::path> files = map.paths("include");
    for (size_t i = 0; i < files.size(); ++i) {
      std::error_code ignored;
      if (fs::is_regular_file(files[i], ignored))
        add(files[i], place + "/" + names[i], index);
      else
        report_missing(map, files[i]);
    }
  }

  SceneLoadOptions reading_;
  std::vector<YamlMap> layers_;
  std::vector<std::shared_ptr<std::vector<YamlValue>>> values_;  // by layer, if wanted
  std::vector<std::string> places_;            // include path of each layer, part of the address of its draws
  std::map<fs::path, size_t> files_;           // number of the layer of each file
  std::vector<size_t> includers_;              // by layer: the one that includes it first; 0 for the scene file itself
  std::vector<std::vector<size_t>> includes_;  // by layer
};

// Prefixes the first line of a text with `first` and indents the other lines by its length.
std::string indented(const std::string& text, const std::string& first) {
  std::string result = first;
  const std::string indent(first.size(), ' ');
  for (size_t i = 0; i < text.size(); ++i) {
    result += text[i];
    if (text[i] == '\n' && i + 1 < text.size()) result += indent;
  }
  return result;
}

std::string SceneLayers::resolved(const fs::path& folder) const {
  const std::set<std::string> composed = {"include", "placed", "seed", "materials", "objects"};
  std::set<std::string> written = composed;
  std::string text;
  for (const YamlMap& layer : layers_) {
    std::vector<std::string> keys;
    for (const std::string& key : layer.keys()) {
      if (written.insert(key).second) keys.push_back(key);
    }
    text += layer.dump(keys, folder);
  }
  text += "seed: " + std::to_string(seed) + "\n";
  std::string materials, objects;
  std::set<std::string> known;
  for (const YamlMap& layer : layers_) {
    if (layer.has("materials")) {
      const YamlMap map = layer.map("materials");
      std::vector<std::string> keys;
      for (const std::string& key : map.keys()) {
        if (known.insert(key).second) keys.push_back(key);
      }
      if (!keys.empty()) materials += indented(map.dump(keys, folder), "  ");
    }
    if (!layer.has("objects")) continue;
    for (const YamlMap& object : layer.maps("objects")) objects += indented(object.dump(object.keys(), folder), "  - ");
  }
  if (!materials.empty()) text += "materials:\n" + materials;
  return text + "objects:\n" + objects;
}

Materials read_materials(const SceneLayers& layers) {
  Materials materials;
  for (const YamlMap& layer : layers.all()) {
    if (!layer.has("materials")) continue;
    const YamlMap map = layer.map("materials");
    for (const std::string& name : map.keys()) {
      const bool first = materials.try_emplace(name).second;  // keep the name known even if reading fails
      const YamlMap entry = map.map(name);
      entry.attempt([&] {
        Material material = read_material(entry);
        material.name = name;
        if (first) materials[name] = material;
      });
    }
  }
  return materials;
}

std::vector<Object> read_all_objects(const SceneLayers& layers, const Materials& materials,
                                     const std::optional<Building>& building, const SceneLimits& limits,
                                     std::vector<std::string>& notes) {
  std::vector<Object> objects;
  uint32_t number = 0, read = 0;
  std::set<const Mesh*> meshes;
  size_t triangles = 0;
  const auto add = [&](std::vector<Object> found, const std::string& place) {
    for (Object& object : found) {
      if (meshes.insert(object.mesh.get()).second) triangles += object.mesh->triangles.size();
      object.place = place;
      objects.push_back(std::move(object));
    }
    ++read;
  };
  // Called outside `attempt`: exceeding a limit stops reading even while errors are being collected.
  const auto check_limits = [&](const auto& error) {
    if (objects.size() > limits.objects)
      throw error("up to here the scene has " + std::to_string(objects.size()) + " objects; at most " +
                  std::to_string(limits.objects) + " are allowed");
    if (triangles > limits.triangles)
      throw error("up to here the scene has " + std::to_string(triangles) + " triangles; at most " +
                  std::to_string(limits.triangles) + " are allowed");
  };
  if (building) {
    add(building_objects(*building, layers.seed), "");
    ++number;
    check_limits([&](const std::string& text) { return layers.with("building").error("building", text); });
  }
  ObjectContext context{materials, layers.seed, notes, limits};
  for (const YamlMap& layer : layers.all()) {
    if (!layer.has("objects")) continue;
    size_t index = 0;  // in the layer
    for (const YamlMap& entry : layer.maps("objects")) {
      const std::string path = &layer == &layers.with("objects") ? "objects." + std::to_string(index) : "";
      ++index;
      entry.attempt([&] {
        const size_t before = objects.size();
        add(read_objects(entry, number, context), entry.place());
        if (objects.size() == before + 1) objects.back().path = path;
      });
      ++number;
      check_limits([&](const std::string& text) { return entry.error(text); });
    }
  }
  const YamlMap& own = layers.all().front();
  if (number == 0)
    own.report(own.error("objects", "the scene has no object; add one under 'objects'"));
  else if (objects.empty() && read == number)
    own.report(own.error("objects", "the scene's entries produce no object; no scattered object fits into its area"));
  for (size_t i = 0; i < objects.size(); ++i) objects[i].name = "object " + std::to_string(i + 1);
  return objects;
}

PatternSequence read_scene_patterns(const YamlMap& map, const RigModel& rig) {
  PatternSequence sequence;
  try {
    sequence = design_sequence(read_design(map, rig));
  } catch (const Error& e) {
    throw map.error(e.what());
  }
  // Compensates the projector response in the patterns.
  if (map.boolean_or("linearised", false)) {
    if (rig.projector_response.empty())
      throw map.error("linearised",
                      "the rig file has no projector.response to invert; run fringeslam calibrate response");
    sequence.inverse_response = invert_table(rig.projector_response, 1025);
  }
  return sequence;
}

CalibrationError read_calibration_error(const YamlMap& map) {
  CalibrationError error;
  error.translation_m = 1e-3 * map.vector3_or("translation_mm", Eigen::Vector3d::Zero(), {-100, 100});
  error.angles_deg = map.vector3_or("rotation_deg", Eigen::Vector3d::Zero(), {-10, 10});
  error.focal = 0.01 * map.number_or("focal_percent", 0, {-10, 10});
  return error;
}

void read_light(const YamlMap& map, Scene& scene) {
  scene.ambient_lux = map.number_or("ambient_lux", 0, {0, 1e6});
  scene.bounces = map.integer_or("bounces", 0, {0, 32});
  scene.auto_exposure = map.boolean_or("auto_exposure", false);
  if (map.has("exposure_s")) {
    if (scene.auto_exposure) throw map.error("exposure_s", "give exposure_s or auto_exposure, not both");
    const double longest = 1 / scene.rig.timing.pattern_rate_hz;
    scene.rig.timing.exposure_s = map.number("exposure_s", {1e-7, longest});
  }
}

Air read_air(const YamlMap& map) {
  Air air;
  air.extinction_per_m = map.number("extinction_per_m", {0, 100});
  air.albedo = map.number_or("albedo", air.albedo, kFraction);
  air.anisotropy = map.number_or("anisotropy", air.anisotropy, {-0.95, 0.95});
  air.infrared_share = map.number_or("infrared_share", air.infrared_share, kFraction);
  return air;
}

Dust read_dust(const YamlMap& map) {
  Dust dust;
  dust.cover = map.number("cover", kFraction);
  dust.albedo = map.number_or("albedo", dust.albedo, kFraction);
  dust.max_slope_deg = map.number_or("max_slope_deg", dust.max_slope_deg, {1, 90});
  const Eigen::Vector3d up = map.vector3_or("up", dust.up, {-1, 1});
  if (up.norm() < 1e-3) throw map.error("up", "'up' has no direction");
  dust.up = up.normalized();
  dust.warmed_share = map.number_or("warmed_share", dust.warmed_share, kFraction);
  return dust;
}

Water read_water(const YamlMap& map) {
  Water water;
  water.cover = map.number("cover", kFraction);
  water.patch_m = map.number_or("patch_m", water.patch_m, {1e-3, 100});
  water.roughness = map.number_or("roughness", water.roughness, {0.05, 1});
  water.puddle_slope_deg = map.number_or("puddle_slope_deg", water.puddle_slope_deg, {0, 90});
  const Eigen::Vector3d up = map.vector3_or("up", water.up, {-1, 1});
  if (up.norm() < 1e-3) throw map.error("up", "'up' has no direction");
  water.up = up.normalized();
  return water;
}

// `instead` replaces the section's rig file, also in the resolved scene; empty: keep it.
RigModel read_scene_rig(YamlMap map, const fs::path& instead) {
  fs::path file = instead;
  if (instead.empty()) {
    file = map.file("file");
  } else {
    (void)map.text("file");  // the section needs it nevertheless
    map.set("file", yaml_quoted(fs::absolute(instead).string()));
    (void)map.path("file");
  }
  const YamlMap changed = YamlMap::load(file).changed_by(map, {"file"});
  const RigModel rig = read_rig(changed);
  changed.finish();
  return rig;
}

}  // namespace

RigModel calibration_of(const Scene& scene) {
  RigModel rig = scene.rig;
  const CalibrationError& error = scene.calibration_error;
  if (error.translation_m.isZero() && error.angles_deg.isZero() && error.focal == 0) return rig;  // bit-exact
  const Pose turned = pose_from({1e3 * error.translation_m, error.angles_deg});
  // The error is defined on camera_from_projector.
  rig.projector_from_camera = (rig.projector_from_camera.inverse() * turned).inverse();
  rig.camera.fx *= 1 + error.focal;
  rig.camera.fy *= 1 + error.focal;
  return rig;
}

Scene load_scene(const fs::path& file, const SceneLoadOptions& reading) {
  const SceneLayers layers(file, reading);
  const auto section = [&](const std::string& name, const auto& read) {
    const YamlMap map = layers.section(name);
    map.attempt([&] { read(map); });
  };
  Scene scene;
  scene.name = layers.with("name").text("name");
  layers.with("description").text_or("description", "");
  scene.seed = layers.seed;
  section("rig", [&](const YamlMap& map) { scene.rig = read_scene_rig(map, reading.rig_file); });
  section("patterns", [&](const YamlMap& map) { scene.patterns = read_scene_patterns(map, scene.rig); });
  if (layers.has("light")) section("light", [&](const YamlMap& map) { read_light(map, scene); });
  if (layers.has("surroundings"))
    section("surroundings", [&](const YamlMap& map) {
      scene.surroundings_c = map.number("temperature_c", {-200, 2000});
    });
  if (layers.has("air")) section("air", [&](const YamlMap& map) { scene.air = read_air(map); });
  if (layers.has("dust")) section("dust", [&](const YamlMap& map) { scene.dust = read_dust(map); });
  if (layers.has("water")) section("water", [&](const YamlMap& map) { scene.water = read_water(map); });
  if (layers.has("calibration_error"))
    section("calibration_error", [&](const YamlMap& map) { scene.calibration_error = read_calibration_error(map); });
  const Materials materials = read_materials(layers);
  std::optional<Building> building;
  if (layers.has("building"))
    section("building", [&](const YamlMap& map) { building = read_building(map, materials, reading.limits); });
  scene.objects = read_all_objects(layers, materials, building, reading.limits, scene.notes);
  section("trajectory", [&](const YamlMap& map) {
    scene.commanded = map.boolean_or("commanded", false);
    read_trajectory(map, reading.limits, building ? std::optional(building->plan) : std::nullopt, scene);
  });
  layers.finish();
  scene.resolved = layers.resolved(reading.resolved_for.empty() ? file.parent_path() : reading.resolved_for);
  return scene;
}

std::vector<fs::path> named_files(const fs::path& scene_file) {
  std::vector<fs::path> files;
  SceneLoadOptions reading;
  reading.files = &files;
  {
    const SceneLayers layers(scene_file, reading);
    // Errors in a section are reported when the scene is loaded.
    const auto ask = [](const auto& section, const char* key) {
      try {
        const YamlMap map = section();
        if (map.has(key)) (void)map.path(key);
      } catch (const Error&) {
      }
    };
    for (const char* name : {"rig", "trajectory"}) {
      if (layers.has(name)) ask([&] { return layers.section(name); }, "file");
    }
    for (const YamlMap& layer : layers.all()) {
      if (layer.has("materials")) {
        const YamlMap materials = layer.map("materials");
        for (const std::string& name : materials.keys()) ask([&] { return materials.map(name); }, "texture");
      }
      if (!layer.has("objects")) continue;
      for (const YamlMap& object : layer.maps("objects")) ask([&] { return object; }, "file");
    }
  }
  return files;
}

}  // namespace fringeslam::sim
