// SPDX-License-Identifier: Apache-2.0
// The same scene, camera and fringes in Blender's Cycles: direct light, equal samples, the same number of threads.
#include <unistd.h>

#include <Eigen/Geometry>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <opencv2/core/utility.hpp>

#include "bench/row.h"
#include "bench/speed/rubble.h"
#include "bench/speed/turns.h"
#include "core/io/files.h"
#include "core/types/error.h"

namespace fringeslam::bench {

namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

// Writes a glTF 2.0 binary: one mesh and node per object, positions and triangles in world coordinates.
void write_glb(const sim::Scene& scene, const fs::path& file) {
  constexpr int kFloat = 5126, kUnsigned = 5125, kVertices = 34962, kIndices = 34963;
  std::string bytes;
  Json gltf = {{"asset", {{"version", "2.0"}}}, {"scene", 0}, {"scenes", {{{"nodes", Json::array()}}}}};
  for (const sim::Object& object : scene.objects) {
    const size_t index = gltf["nodes"].size(), vertices_at = bytes.size();
    Eigen::Vector3f low = Eigen::Vector3f::Constant(1e9f), high = -low;
    for (const Eigen::Vector3d& v : object.mesh->vertices) {
      const Eigen::Vector3f p = (object.world_from_object * v).cast<float>();
      low = low.cwiseMin(p), high = high.cwiseMax(p);
      bytes.append(reinterpret_cast<const char*>(p.data()), 12);
    }
    const size_t indices_at = bytes.size();
    for (const Eigen::Vector3i& t : object.mesh->triangles) bytes.append(reinterpret_cast<const char*>(t.data()), 12);
    gltf["bufferViews"].push_back(
        {{"buffer", 0}, {"byteOffset", vertices_at}, {"byteLength", indices_at - vertices_at}, {"target", kVertices}});
    gltf["bufferViews"].push_back(
        {{"buffer", 0}, {"byteOffset", indices_at}, {"byteLength", bytes.size() - indices_at}, {"target", kIndices}});
    gltf["accessors"].push_back({{"bufferView", 2 * index},
                                 {"componentType", kFloat},
                                 {"type", "VEC3"},
                                 {"count", object.mesh->vertices.size()},
                                 {"min", {low.x(), low.y(), low.z()}},
                                 {"max", {high.x(), high.y(), high.z()}}});
    gltf["accessors"].push_back({{"bufferView", 2 * index + 1},
                                 {"componentType", kUnsigned},
                                 {"type", "SCALAR"},
                                 {"count", 3 * object.mesh->triangles.size()}});
    gltf["meshes"].push_back(
        {{"primitives", {{{"attributes", {{"POSITION", 2 * index}}}, {"indices", 2 * index + 1}}}}});
    gltf["nodes"].push_back({{"mesh", index}});
    gltf["scenes"][0]["nodes"].push_back(index);
  }
  gltf["buffers"] = {{{"byteLength", bytes.size()}}};
  std::string text = gltf.dump();
  text.resize((text.size() + 3) / 4 * 4, ' ');
  std::ofstream out(file, std::ios::binary);
  const auto word = [&](size_t value) {
    const auto number = static_cast<uint32_t>(value);
    out.write(reinterpret_cast<const char*>(&number), 4);
  };
  word(0x46546C67), word(2), word(12 + 8 + text.size() + 8 + bytes.size());
  word(text.size()), word(0x4E4F534A), out << text;
  word(bytes.size()), word(0x004E4942), out << bytes;
}

Json matrix(const Pose& pose) {
  Json rows = Json::array();
  for (int i = 0; i < 3; ++i)
    rows.push_back({pose.rotation(i, 0), pose.rotation(i, 1), pose.rotation(i, 2), pose.translation[i]});
  rows.push_back({0, 0, 0, 1});
  return rows;
}

std::vector<Row> cycles_rows(const Context& context) {
  const sim::Scene scene = rubble(4);
  const Pose camera = scene.trajectory.front().world_from_robot * scene.rig.robot_from_camera;
  const fs::path folder = fs::temp_directory_path() / ("fringeslam-cycles-" + std::to_string(::getpid()));
  fs::create_directories(folder);
  write_glb(scene, folder / "scene.glb");
  const int images = context.quick ? 2 : 9;
  const Json view = {{"size", {scene.rig.camera.width, scene.rig.camera.height}},
                     {"samples", 4},
                     {"threads", cv::getNumThreads()},
                     {"images", images},
                     {"period_px", 16.5},
                     {"camera", {{"fx", scene.rig.camera.fx}, {"world_from_device", matrix(camera)}}},
                     {"projector",
                      {{"fx", scene.rig.projector.fx},
                       {"world_from_device", matrix(camera * scene.rig.projector_from_camera.inverse())}}}};
  write_text(folder / "view.json", view.dump());
  const std::string command = std::string(FRINGESLAM_BENCH_SCRIPTS) + "/cycles.sh " + folder.string();
  if (std::system(command.c_str()) != 0) throw Error("cycles.sh printed no result; see its message above");
  const auto theirs = Json::parse(std::ifstream(folder / "seconds.json")).get<std::vector<double>>();
  if (const char* keep = std::getenv("FRINGESLAM_KEEP"); keep) fs::copy(folder, keep, fs::copy_options::recursive);
  fs::remove_all(folder);

  sim::RenderOptions direct;
  direct.effects = sim::Effects::none();
  Stack three(scene, 3, direct, false), nine(scene, 9, direct, false);
  const auto ours = take_turns({[&] { three(); }, [&] { nine(); }}, static_cast<int>(theirs.size()));
  std::fprintf(stderr, "  Cycles %.2f s per image; ours %.3f s for three, %.3f s for nine, including camera noise\n",
               median(theirs), median(ours[0]), median(ours[1]));
  std::vector<double> ratio3, ratio9;
  for (size_t i = 0; i < theirs.size(); ++i) {
    ratio3.push_back(3 * theirs[i] / ours[0][i]);
    ratio9.push_back(9 * theirs[i] / ours[1][i]);
  }
  return {median_row("speed.cycles.three", ratio3, "x", 30, Limit::least),
          median_row("speed.cycles.nine", ratio9, "x", 90, Limit::least)};
}

}  // namespace

std::vector<Item> cycles_items() {
  return {{{"speed.cycles.three", "speed.cycles.nine"},
           "three and nine images relative to Blender's Cycles (installs Blender)",
           cycles_rows,
           true}};
}

}  // namespace fringeslam::bench
