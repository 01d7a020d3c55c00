// SPDX-License-Identifier: Apache-2.0
// Fuzz target (libFuzzer, run by tools/fuzz): arbitrary bytes as a scene file must give a valid scene or a one-line
// Error that names the file. A second reading, which collects errors, must report errors exactly if the file is
// refused. Scene::resolved, which is written with a run, must be readable in turn.
#include <cmath>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "sim/scene/mesh_reader.h"
#include "sim/scene/scene.h"
#include "sim/scene/settle.h"
#include "tests/fuzz/fuzzing.h"

namespace fringeslam::sim {

namespace fs = std::filesystem;

using fuzz::fail;
using fuzz::require;
using fuzz::write;

// Replace the library's functions at link time: assimp in a child process and the rigid-body simulation are not under
// test and would slow the target by a factor of a hundred. Every mesh file is a triangle, every pile a row.
RawModel read_model(const fs::path& file, double, double) {
  if (file.extension() != ".obj") throw Error(file.string() + ": is not a readable mesh");
  RawModel model;
  model.meshes.push_back({"triangle", 0, {0, 0, 0, 1, 0, 0, 0, 1, 0}, {}, {0, 1, 2}});
  model.instances.push_back({"node", 0, {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1}});
  return model;
}

Settled settle(const std::vector<Body>& bodies, const DropArea& area, uint64_t, uint32_t) {
  Settled settled;
  for (const Body& body : bodies) {
    for (const Hull& hull : body.hulls) require(!hull.empty(), "a body with an empty hull");
    settled.ground_from_body.push_back({Eigen::Matrix3d::Identity(), {area.size_x, area.size_y, 0}});
  }
  return settled;
}

std::vector<double> drifts_m(const std::vector<Body>& bodies, const DropArea&, const std::vector<Pose>&, double) {
  return std::vector<double>(bodies.size());
}

// Names of overloaded functions have no address: these fail to compile if the library's functions get other parameters.
[[maybe_unused]] constexpr auto* kReadModel = &read_model;
[[maybe_unused]] constexpr auto* kSettle = &settle;
[[maybe_unused]] constexpr auto* kDrifts = &drifts_m;

namespace {

// Provides the files that a scene file may name: rigs next to its folder, files of other kinds in it.
class Workplace {
 public:
  Workplace() {
    fs::create_directories(root_ / "scene");
    for (const std::string folder : {"rigs", "common"}) {
      fs::create_directories(root_ / folder);
      for (const auto& entry : fs::directory_iterator(FRINGESLAM_SOURCE_DIR "/scenes/" + folder)) {
        // Strips the distortion of rigs, whose check takes longer than reading a scene.
        std::ifstream in(entry.path());
        std::string text;
        for (std::string line; std::getline(in, line);) {
          if (line.find("distortion") == std::string::npos) text += line + "\n";
        }
        write(root_ / folder / entry.path().filename(), text);
      }
    }
    write(root_ / "scene/mesh.obj", "");
    write(root_ / "scene/texture.png", "");
    write(root_ / "scene/route.tum", "0 0 0 1 0 0 0 1\n0.5 0.1 0 1 0 0 0 1\n");
    setenv("FRINGESLAM_CACHE", (root_ / "scene/mesh.obj").c_str(), 1);  // not a folder, which disables the cache
  }
  // Writes the scene file. Bytes after a line `===` become another file, part.yaml, for use as include or rig.
  void lay_out(std::string_view bytes) const {
    constexpr std::string_view kCut = "\n===\n";
    const size_t cut = bytes.find(kCut);
    write(scene(), bytes.substr(0, cut));
    write(root_ / "scene/part.yaml", cut == std::string_view::npos ? "" : bytes.substr(cut + kCut.size()));
  }
  fs::path scene() const { return root_ / "scene/scene.yaml"; }
  const fs::path& root() const { return root_; }

 private:
  const fs::path& root_ = fuzz::folder();
};

void check_scene(const Scene& scene) {
  require(!scene.name.empty(), "a scene without a name");
  require(!scene.objects.empty(), "a scene without objects");
  require(!scene.trajectory.empty(), "a scene without views");
  require(!scene.patterns.patterns.empty(), "a scene without patterns");
  for (const TimedPose& pose : scene.trajectory)
    require(pose.world_from_robot.is_finite() && std::isfinite(pose.timestamp_s), "a non-finite view");
  std::set<const Mesh*> seen;
  for (const Object& object : scene.objects) {
    require(object.world_from_object.is_finite(), "a non-finite object pose");
    require(object.mesh != nullptr, "an object without a mesh");
    if (!seen.insert(object.mesh.get()).second) continue;
    const auto vertices = static_cast<int>(object.mesh->vertices.size());
    require(!object.mesh->triangles.empty(), "a mesh without triangles");
    bool finite = true, there = true;
    for (const Eigen::Vector3d& v : object.mesh->vertices) finite &= std::isfinite(v[0] + v[1] + v[2]);
    for (const Eigen::Vector3i& t : object.mesh->triangles) {
      for (int corner = 0; corner < 3; ++corner) there &= t[corner] >= 0 && t[corner] < vertices;
    }
    require(finite, "a non-finite vertex");
    require(there, "a triangle with an invalid vertex index");
  }
}

// Limits like the default ones, but reached quickly.
constexpr SceneLimits kSmall{50, 10, 100'000, 100};

// The file written with a run must describe the same scene.
void check_resolved(const Scene& scene, const Workplace& place, const SceneLoadOptions& reading) {
  write(place.scene(), scene.resolved);
  try {
    const Scene again = load_scene(place.scene(), reading);
    require(again.objects.size() == scene.objects.size() && again.trajectory.size() == scene.trajectory.size() &&
                again.seed == scene.seed,
            "the resolved scene differs:\n" + scene.resolved);
  } catch (const Error& error) {
    fail("the resolved scene is refused: " + std::string(error.what()) + "\n" + scene.resolved);
  }
}

// Reads the scene file and returns the error for which it is refused; empty if it is accepted.
std::string refusal(const Workplace& place, std::vector<std::string>* errors) {
  SceneLoadOptions reading;
  reading.errors = errors;
  reading.limits = kSmall;
  try {
    const Scene scene = load_scene(place.scene(), reading);
    if (!errors) {
      check_scene(scene);
      check_resolved(scene, place, reading);
    }
  } catch (const Error& error) {
    require(*error.what() != 0, "an empty error message");
    return error.what();
  }
  return errors && !errors->empty() ? errors->front() : "";
}

void check_message(const std::string& message, const Workplace& place) {
  require(message.find(place.root().string()) != std::string::npos, "a message without the file name: " + message);
  require(message.find('\n') == std::string::npos, "a message of several lines: " + message);
}

}  // namespace

}  // namespace fringeslam::sim

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace fringeslam::sim;
  static const Workplace place;
  place.lay_out({reinterpret_cast<const char*>(data), size});
  std::vector<std::string> errors;
  const std::string collected = refusal(place, &errors);
  const std::string plain = refusal(place, nullptr);  // must come last, since it overwrites the file
  require(plain.empty() == collected.empty(),
          "plain reading: '" + plain + "'; while collecting errors: '" + collected + "'");
  if (!plain.empty()) check_message(plain, place);
  for (const std::string& error : errors) check_message(error, place);
  return 0;
}

extern "C" size_t LLVMFuzzerCustomMutator(uint8_t* data, size_t size, size_t max_size, unsigned seed) {
  return fringeslam::fuzz::mutate_yaml(data, size, max_size, seed);
}
