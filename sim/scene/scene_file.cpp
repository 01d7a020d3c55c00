// SPDX-License-Identifier: Apache-2.0
#include <Eigen/Geometry>
#include <cmath>
#include <map>
#include <numbers>

#include "core/rig/rig_file.h"
#include "core/rig/yaml.h"
#include "sim/random.h"
#include "sim/scene/mesh_import.h"
#include "sim/scene/scatter.h"
#include "sim/scene/scene.h"

namespace fringeslam::sim {

namespace {

constexpr Range kLength{1e-4, 100};
constexpr Range kMillimetres{-1e5, 1e5};
constexpr Range kFraction{0, 1};

using Materials = std::map<std::string, Material>;

Grain read_grain(const YamlMap& map) {
  static const std::map<std::string, Grain> grains = {
      {"plain", Grain::plain},       {"cardboard", Grain::cardboard},
      {"concrete", Grain::concrete}, {"paper", Grain::paper},
      {"brick", Grain::brick},       {"metal", Grain::metal},
      {"foam", Grain::foam},         {"wood", Grain::wood},
      {"stone", Grain::stone},       {"checkerboard", Grain::checkerboard},
      {"circles", Grain::circles},   {"asymmetric_circles", Grain::asymmetric_circles}};
  std::vector<std::string> names;
  for (const auto& [name, grain] : grains) names.push_back(name);
  return grains.at(map.choice("grain", names));
}

bool is_board(Grain grain) {
  return grain == Grain::checkerboard || grain == Grain::circles || grain == Grain::asymmetric_circles;
}

Material read_material(const YamlMap& map) {
  Material material;
  if (map.has("texture")) {
    if (map.has("grain")) throw map.error("texture", "give grain or texture, not both");
    const std::filesystem::path file = map.path("texture");
    if (!std::filesystem::exists(file)) throw map.error("texture", file.string() + " does not exist");
    material.texture = file.string();
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
    throw map.error("reflectance", "a metal reflects by its albedo; leave reflectance out");
  material.roughness = map.number_or("roughness", material.roughness, {0.05, 1});
  material.bump_m = map.number_or("bump_m", 0, {0, 0.1});
  material.bump_size_m = map.number_or("bump_size_m", material.bump_size_m, kLength);
  material.emission_lux = map.number_or("emission_lux", 0, {0, 1e7});
  material.temperature_c = map.number_or("temperature_c", material.temperature_c, {-200, 2000});
  material.dust = map.boolean_or("dust", true);
  return material;
}

Materials read_materials(const YamlMap& map) {
  Materials materials;
  for (const std::string& name : map.keys()) {
    const YamlMap entry = map.map(name);
    materials[name] = read_material(entry);
  }
  return materials;
}

Material find_material(const YamlMap& map, const Materials& materials) {
  std::vector<std::string> names;
  for (const auto& [name, material] : materials) names.push_back(name);
  return materials.at(map.choice("material", names));
}

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

std::vector<Object> read_objects(const YamlMap& scene, const Materials& materials, uint64_t seed,
                                 std::vector<std::string>& notes) {
  std::vector<Object> objects;
  uint32_t number = 0;
  for (const YamlMap& entry : scene.maps("objects")) {
    const std::string shape =
        entry.choice("shape", {"plane", "box", "cylinder", "sphere", "rock", "face_mask", "mesh", "scatter"});
    if (shape == "scatter") {
      for (Object& object : scatter_objects(read_scatter(entry, materials), seed, number))
        objects.push_back(std::move(object));
    } else if (const auto shape_seed =
                   static_cast<uint32_t>(Philox(seed, Stream::shape, number).uniform() * 4294967295.0);
               shape == "mesh") {
      for (Object& object : read_mesh(entry, materials, shape_seed, notes)) objects.push_back(std::move(object));
    } else {
      objects.push_back(read_primitive(entry, shape, materials, shape_seed));
    }
    ++number;
  }
  if (objects.empty()) throw scene.error("objects", "the scene has no object; add one under 'objects'");
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
  // What the rig's response bends is bent back beforehand.
  if (map.boolean_or("linearised", false)) {
    if (rig.projector_response.empty())
      throw map.error("linearised",
                      "the rig file has no projector.response to invert; run fringeslam calibrate response");
    sequence.inverse_response = inverse_table(rig.projector_response, 1025);
  }
  return sequence;
}

// Camera poses that look at a flat board in the plane z = 0 from z < 0: distances spread evenly, tilts in all
// directions, the board anywhere in the image. Robot poses are returned.
Trajectory board_views(const YamlMap& map, const RigModel& rig, uint64_t seed, double interval_s) {
  const int count = map.integer("count", {1, 10000});
  const std::vector<double> distance = map.numbers("distance_m", 2, kLength);
  const double tilt = map.number("max_tilt_deg", {0, 70}), roll = map.number_or("max_roll_deg", 20, {0, 180});
  const std::vector<double> extent = map.numbers("extent_m", 2, kLength);
  constexpr double kRadians = std::numbers::pi / 180;
  Philox random(seed, Stream::views, 0);
  Trajectory trajectory;
  for (int i = 0; i < count; ++i) {
    // Neighbours in the list differ in everything; taken together each quantity is spread evenly.
    const double z = distance[0] + (distance[1] - distance[0]) * (std::fmod(i * 0.618034, 1.0) + 0.5 / count);
    const double azimuth = 2 * std::numbers::pi * (i + random.uniform()) / count * 3;
    const double lean = tilt * kRadians * (0.35 + 0.65 * random.uniform());
    const Eigen::Vector3d axis(std::cos(azimuth), std::sin(azimuth), 0);
    Pose camera_from_board;
    camera_from_board.rotation =
        rotation_exp(lean * axis) * rotation_exp({0, 0, roll * kRadians * random.uniform(-1, 1)});
    // Anywhere in the image, as long as the whole board is.
    const auto in_view = [&] {
      for (const double x : {-0.5, 0.5}) {
        for (const double y : {-0.5, 0.5}) {
          const Eigen::Vector3d corner = camera_from_board * Eigen::Vector3d(x * extent[0], y * extent[1], 0);
          if (!rig.camera.contains(rig.camera.project(corner))) return false;
        }
      }
      return true;
    };
    constexpr int kTries = 500;
    for (int attempt = 0; attempt < kTries; ++attempt) {
      const Eigen::Vector2d pixel(rig.camera.width * random.uniform(), rig.camera.height * random.uniform());
      camera_from_board.translation = z * Eigen::Vector3d(rig.camera.undistort(pixel).homogeneous());
      if (in_view()) break;
      if (attempt + 1 == kTries)
        throw map.error(
            "extent_m",
            "a board of this size does not fit into the camera's view; make it smaller or distance_m larger");
    }
    trajectory.push_back({interval_s * i, camera_from_board.inverse() * rig.robot_from_camera.inverse()});
  }
  return trajectory;
}

// Robot poses: a start, then the papers' six numbers for each motion, `previous_from_current`.
Trajectory read_trajectory(const YamlMap& map, const RigModel& rig, uint64_t seed) {
  const double interval = map.number_or("interval_s", 0.5, {1e-3, 1e4});
  if (map.has("board_views")) return board_views(map.map("board_views"), rig, seed, interval);
  Trajectory trajectory(1);
  if (map.has("start")) trajectory[0].world_from_robot = map.pose("start");
  if (!map.has("motions")) return trajectory;  // one view
  for (const YamlMap& entry : map.maps("motions")) {
    SixDof motion;
    motion.translation_mm = entry.vector3("translation_mm", kMillimetres);
    motion.angles_deg = entry.vector3("rotation_deg", {-180, 180});
    const TimedPose& last = trajectory.back();
    trajectory.push_back(
        {interval * static_cast<double>(trajectory.size()), last.world_from_robot * pose_from(motion)});
  }
  return trajectory;
}

Motion read_motion(const YamlMap& map) {
  Motion motion;
  motion.velocity_m_s = 1e-3 * map.vector3_or("velocity_mm_s", Eigen::Vector3d::Zero(), kMillimetres);
  motion.angular_rad_s =
      std::numbers::pi / 180 * map.vector3_or("rotation_deg_s", Eigen::Vector3d::Zero(), {-3600, 3600});
  return motion;
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
  return dust;
}

RigModel read_scene_rig(const YamlMap& map) {
  const std::filesystem::path file = map.path("file");
  if (!std::filesystem::exists(file)) throw map.error("file", file.string() + " does not exist");
  RigModel rig = read_rig(file);
  if (map.has("robot_from_camera")) rig.robot_from_camera = map.pose("robot_from_camera");
  return rig;
}

// The distributions of a scene file, drawn from its seed.
class SceneDraws : public Draws {
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

}  // namespace

Scene load_scene(const std::filesystem::path& file, std::optional<uint64_t> seed) {
  YamlMap map = YamlMap::load(file);
  Scene scene;
  scene.name = map.text("name");
  map.text_or("description", "");
  const uint64_t written_seed = map.has("seed") ? map.seed("seed") : 1;
  scene.seed = seed.value_or(written_seed);
  map.draw_from(std::make_shared<SceneDraws>(scene.seed));
  scene.rig = read_scene_rig(map.map("rig"));
  scene.patterns = read_scene_patterns(map.map("patterns"), scene.rig);
  if (map.has("light")) read_light(map.map("light"), scene);
  if (map.has("air")) scene.air = read_air(map.map("air"));
  if (map.has("dust")) scene.dust = read_dust(map.map("dust"));
  const Materials materials = map.has("materials") ? read_materials(map.map("materials")) : Materials{};
  scene.objects = read_objects(map, materials, scene.seed, scene.notes);
  const YamlMap trajectory = map.map("trajectory");
  scene.commanded = trajectory.boolean_or("commanded", false);
  scene.trajectory = read_trajectory(trajectory, scene.rig, scene.seed);
  if (trajectory.has("while_capturing")) scene.motion = read_motion(trajectory.map("while_capturing"));
  map.finish();
  scene.resolved = map.dump();
  return scene;
}

}  // namespace fringeslam::sim
