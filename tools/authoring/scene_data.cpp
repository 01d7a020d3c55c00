// SPDX-License-Identifier: Apache-2.0
#include "tools/authoring/scene_data.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <numbers>
#include <optional>
#include <tuple>

#include "core/io/json_text.h"
#include "sim/preview/viewpoint.h"
#include "sim/scene/cache.h"
#include "tools/authoring/placed_file.h"
#include "tools/authoring/sensor_picture.h"
#include "tools/authoring/surface_tile.h"
#include "tools/report/simplify_mesh.h"

namespace fringeslam::tools {

namespace {

using Json = nlohmann::ordered_json;

constexpr int kPathSteps = 400;  // of a continuous path

Json pose_json(const Pose& pose) {
  Json list = Json::array();
  for (const double value : pose.translation) list.push_back(value);
  for (const double value : quaternion_xyzw(pose.rotation)) list.push_back(value);
  return list;
}

Json corners_of(const Pinhole& device) {
  Json list = Json::array();
  for (const Eigen::Vector3d& corner : sim::image_corners(device, 1)) list.push_back({corner.x(), corner.y()});
  return list;
}

Json place(const RigModel& rig, double time_s, const Pose& world_from_robot) {
  const Pose camera = world_from_robot * rig.robot_from_camera;
  return {{"time_s", time_s},
          {"camera", pose_json(camera)},
          {"projector", pose_json(camera * rig.projector_from_camera.inverse())}};
}

Trajectory path_of(const sim::Scene& scene) {
  if (!scene.path) return scene.trajectory;
  Trajectory path;
  for (int i = 0; i <= kPathSteps; ++i) {
    const double time_s = scene.path->duration_s() * i / kPathSteps;
    path.push_back({time_s, scene.path->at(time_s)});
  }
  return path;
}

Json path_json(const RigModel& rig, const Trajectory& path) {
  Json list = Json::array();
  for (const TimedPose& pose : path) list.push_back(place(rig, pose.timestamp_s, pose.world_from_robot));
  return list;
}

std::string text_of(const Pattern& pattern) {
  const std::string axis = to_string(pattern.axis), period = to_text(pattern.period_px) + " px";
  const auto turn = [](double shift_rad) {
    return std::to_string(std::lround(shift_rad * 180 / std::numbers::pi)) + "°";
  };
  std::string text;
  switch (pattern.coding) {
    case Coding::fringe:
      text = axis + ", period " + period + ", shift " + turn(pattern.shift_rad);
      break;
    case Coding::extra:
      text = axis + ", single period " + period;
      break;
    case Coding::gray:
      text = axis + ", Gray code, cell " + period +
             (pattern.carrier_px > 0 ? ", XOR cell " + to_text(pattern.carrier_px) + " px" : "") +
             (pattern.code_bits > 0 ? ", bit " + std::to_string(pattern.code_bit + 1) + " of " +
                                          std::to_string(pattern.code_bits) + " with long runs"
                                    : "") +
             (pattern.inverted ? ", inverted" : "");
      break;
    case Coding::flat:
      text = "level " + to_text(pattern.level);
      break;
    case Coding::product:
      text = axis + ", periods " + period + " and " + to_text(pattern.carrier_px) + " px, shifts " +
             turn(pattern.shift_rad) + " and " + turn(pattern.carrier_shift_rad);
      break;
  }
  return pattern.exposure == 1 ? text : text + ", exposure ×" + to_text(pattern.exposure);
}

Json patterns_json(const PatternSequence& sequence) {
  Json list = Json::array();
  for (const Pattern& pattern : sequence.patterns) list.push_back(text_of(pattern));
  return list;
}

Json pictures_json(const sim::Scene& scene) {
  Json list = Json::array();
  for (const SensorPicture picture : pictures_of(scene)) list.push_back(to_string(picture));
  return list;
}

// True for a coordinate of what can be dragged.
bool is_coordinate(const sim::SceneValue& value) {
  return value.changeable && is_position(value.path.substr(0, value.path.rfind('.')));
}

Json values_json(const std::vector<sim::SceneValue>& values) {
  constexpr double kUnlimited = 1e9;  // limits from here on only reject infinity
  Json list = Json::array();
  size_t numbers = 0;
  for (const sim::SceneValue& value : values) {
    if (value.distribution.empty() && ++numbers > kMostNumbers && !is_coordinate(value)) continue;
    const auto end = [&](double limit) { return std::abs(limit) < kUnlimited ? Json(limit) : Json(); };
    list.push_back({{"path", value.path},
                    {"text", value.text},
                    {"distribution", value.distribution},
                    {"place", value.place},
                    {"number", value.range.has_value()},
                    {"low", value.range ? end(value.range->low) : Json()},
                    {"high", value.range ? end(value.range->high) : Json()},
                    {"whole", value.whole},
                    {"changeable", value.changeable}});
  }
  return list;
}

void append(std::string& bytes, const auto& value) {
  bytes.append(reinterpret_cast<const char*>(&value), sizeof value);
}

SurfaceMesh surface_of(const sim::Mesh& mesh) {
  SurfaceMesh surface;
  for (const Eigen::Vector3d& vertex : mesh.vertices)
    surface.vertices.push_back({vertex.cast<float>(), Eigen::Vector3f::Zero()});
  for (const Eigen::Vector3i& corner : mesh.triangles)
    surface.triangles.push_back(
        {static_cast<uint32_t>(corner[0]), static_cast<uint32_t>(corner[1]), static_cast<uint32_t>(corner[2])});
  return surface;
}

std::string bytes_of(const SurfaceMesh& mesh, const std::vector<Eigen::Vector2f>& texture_coordinates) {
  std::string bytes;
  append(bytes, static_cast<uint32_t>(mesh.vertices.size()));
  append(bytes, static_cast<uint32_t>(mesh.triangles.size()));
  append(bytes, static_cast<uint32_t>(!texture_coordinates.empty()));
  for (const CloudPoint& vertex : mesh.vertices) {
    for (const float value : vertex.position_m) append(bytes, value);
  }
  for (const auto& triangle : mesh.triangles) append(bytes, triangle);
  for (const Eigen::Vector2f& coordinate : texture_coordinates) append(bytes, coordinate);
  return bytes;
}

// The tiles of a scene's materials.
class Tiles {
 public:
  // Adds the tiles' pictures to `pictures`, by name.
  explicit Tiles(std::map<std::string, std::string>& pictures) : pictures_(pictures) {}

  // Returns the number of an object's tile; -1: none.
  int of(const sim::Object& object, bool has_texture_coordinates) {
    // A texture of lost coordinates lies nowhere.
    const bool lost = !object.material.texture.empty() && !object.mesh->texture_coordinates.empty();
    if (lost && !has_texture_coordinates) return -1;
    const sim::Material& m = object.material;
    const auto key =
        std::tuple(m.texture, m.texture_m, m.grain, m.grain_m, m.albedo, m.contrast, m.print_albedo, m.name);
    const auto [known, added] = numbers_.try_emplace(key, -1);
    if (!added) return known->second;
    std::optional<SurfaceTile> tile = surface_tile(m, textures_);
    if (!tile) return -1;
    const std::string name = sim::content_hash(tile->png);
    pictures_.emplace(name, std::move(tile->png));
    list_.push_back({{"picture", name},
                     {"size_m", tile->size_m},
                     {"scale", tile->scale},
                     {"centered", tile->centered},
                     {"edge", to_string(tile->edge)}});
    return known->second = static_cast<int>(list_.size()) - 1;
  }

  const Json& json() const { return list_; }

 private:
  using Key = std::tuple<std::string, double, sim::Grain, double, double, double, double, std::string>;
  std::map<std::string, std::string>& pictures_;
  sim::TextureImages textures_;
  std::map<Key, int> numbers_;
  Json list_ = Json::array();
};

}  // namespace

SceneData scene_data(const sim::Scene& scene, const std::vector<sim::SceneValue>& values, size_t max_triangles) {
  size_t triangles = 0, drawn_triangles = 0;
  for (const sim::Object& object : scene.objects) triangles += object.mesh->triangles.size();
  // Small meshes stay whole: thinned boxes would lose their shape and save nothing.
  constexpr size_t kSmall = 500;
  const double share =
      triangles > max_triangles ? static_cast<double>(max_triangles) / static_cast<double>(triangles) : 1;
  struct Drawn {
    std::string name;
    size_t triangles = 0;
    bool has_texture_coordinates = false;
  };
  std::map<const sim::Mesh*, Drawn> drawn;
  SceneData data;
  data.path = path_of(scene);
  Json objects = Json::array();
  Tiles tiles(data.tiles);
  for (const sim::Object& object : scene.objects) {
    const auto [found, added] = drawn.try_emplace(object.mesh.get());
    Drawn& mesh = found->second;
    if (added) {
      SurfaceMesh surface = surface_of(*object.mesh);
      bool thinner = false;
      if (share < 1 && surface.vertices.size() > kSmall) {
        const double wanted = share * static_cast<double>(surface.vertices.size());
        surface = thinned(surface, std::max(kSmall, static_cast<size_t>(wanted))).mesh;
        thinner = true;
      }
      // Thinning merges vertices, which then have no texture coordinates.
      const auto coordinates = thinner ? std::vector<Eigen::Vector2f>() : object.mesh->texture_coordinates;
      std::string bytes = bytes_of(surface, coordinates);
      mesh = {sim::content_hash(bytes), surface.triangles.size(), !coordinates.empty()};
      data.meshes.emplace(mesh.name, std::move(bytes));
    }
    drawn_triangles += mesh.triangles;
    objects.push_back({{"name", object.name},
                       {"place", object.place},
                       {"path", object.path},
                       {"mesh", mesh.name},
                       {"material", object.material.name},
                       {"albedo", object.material.albedo},
                       {"tile", tiles.of(object, mesh.has_texture_coordinates)},
                       {"pose", pose_json(object.world_from_object)}});
  }
  const auto [low_c, high_c] = temperature_range_c(scene);
  data.json = json_text(Json{{"name", scene.name},
                             {"seed", std::to_string(scene.seed)},  // may exceed the exact integers of JavaScript
                             {"notes", scene.notes},
                             {"triangles", triangles},
                             {"drawn_triangles", drawn_triangles},
                             {"continuous", scene.path.has_value()},
                             {"rig",
                              {{"near_m", scene.rig.near_m},
                               {"far_m", scene.rig.far_m},
                               {"width_px", scene.rig.camera.width},
                               {"height_px", scene.rig.camera.height},
                               {"camera_corners", corners_of(scene.rig.camera)},
                               {"projector_corners", corners_of(scene.rig.projector)}}},
                             {"patterns", patterns_json(scene.patterns)},
                             {"pictures", pictures_json(scene)},
                             {"temperature_c", {low_c, high_c}},
                             {"objects", objects},
                             {"tiles", tiles.json()},
                             {"values", values_json(values)},
                             {"path", path_json(scene.rig, data.path)}});
  return data;
}

}  // namespace fringeslam::tools
