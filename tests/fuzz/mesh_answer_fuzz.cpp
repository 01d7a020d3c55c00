// SPDX-License-Identifier: Apache-2.0
// Fuzz target (libFuzzer, run by tools/fuzz): arbitrary bytes as the answer of the process that reads a mesh file, which that
// file may have taken over, must give a valid mesh or a one-line Error that names the file. assimp itself is not under test:
// its process is sandboxed.
#include <cmath>

#include "sim/scene/mesh_import.h"
#include "sim/scene/mesh_reader.h"
#include "tests/fuzz/fuzzing.h"

namespace fringeslam::sim {

namespace {

std::string& answer() {
  static std::string bytes;
  return bytes;
}

}  // namespace

// Replaces the library's function at link time.
RawModel read_model(const std::filesystem::path& file, double, double) {
  try {
    return unpacked(answer());
  } catch (const Error& e) {
    throw Error(file.string() + ": " + e.what());
  }
}

// The name of an overloaded function has no address: fails to compile if the library's function gets other parameters.
[[maybe_unused]] constexpr auto* kReadModel = &read_model;

namespace {

using fuzz::require;

void check(const MeshImport& mesh) {
  require(!mesh.parts.empty() && mesh.triangles > 0, "a mesh without triangles");
  require(mesh.low.allFinite() && mesh.high.allFinite(), "a mesh without bounds");
  for (const ImportedPart& part : mesh.parts) {
    require(part.world_from_part.is_finite(), "a non-finite pose");
    require(part.albedo >= 0 && part.albedo <= 1, "an invalid albedo");
    const auto count = static_cast<int>(part.mesh->vertices.size());
    for (const Eigen::Vector3d& vertex : part.mesh->vertices) require(vertex.allFinite(), "a non-finite vertex");
    for (const Eigen::Vector3i& triangle : part.mesh->triangles)
      require(triangle.minCoeff() >= 0 && triangle.maxCoeff() < count, "a triangle with an invalid vertex index");
    for (const auto& place : part.mesh->texture_coordinates)
      require(place.allFinite(), "a non-finite texture coordinate");
    require(
        part.mesh->texture_coordinates.empty() || part.mesh->texture_coordinates.size() == part.mesh->vertices.size(),
        "another number of texture coordinates");
  }
}

void write_seeds(const std::filesystem::path& seeds) {
  RawModel model;
  model.meshes.push_back({"triangle", 0, {0, 0, 0, 1, 0, 0, 0, 1, 0}, {0, 0, 1, 0, 0, 1}, {0, 1, 2}});
  model.instances.push_back({"node", 0, {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1}});
  fuzz::write(seeds / "plain", packed(model));
  model.unit_m = 0.01, model.y_up = 1;
  model.instances.push_back({"mirrored", 0, {-1, 0, 0, 5, 0, 2, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1}});
  model.materials = {{"paint", "*0", {0.5f, 0.4f, 0.3f}}, {"paper", "paper.png", {1, 1, 1}}};
  model.textures = {{"", 2, {1, 2, 3, 4, 5, 6, 7, 8}}, {"png", 0, {1, 2}}};
  fuzz::write(seeds / "materials", packed(model));
}

}  // namespace

}  // namespace fringeslam::sim

extern "C" int LLVMFuzzerInitialize(int* argc, char*** argv) {
  return fringeslam::fuzz::seeds_on_request(*argc, *argv, fringeslam::sim::write_seeds);
}

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace fringeslam;
  static const std::filesystem::path file = fuzz::folder() / "mesh.obj";
  // Not a folder, so that embedded images cannot be stored; messages name it.
  [[maybe_unused]] static const bool ready = (fuzz::write(file, ""), setenv("FRINGESLAM_CACHE", file.c_str(), 1) == 0);
  sim::answer() = fuzz::text_of(data, size);
  fuzz::read_or_refuse(file, [] { sim::check(sim::import_mesh(file)); });
  return 0;
}
