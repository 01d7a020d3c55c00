// SPDX-License-Identifier: Apache-2.0
#include "tools/authoring/mesh_scene.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <map>
#include <numbers>

#include "core/io/files.h"
#include "core/io/input_file.h"
#include "core/io/staged.h"
#include "core/io/yaml.h"
#include "core/types/error.h"
#include "core/types/options.h"
#include "sim/scene/data_folder.h"
#include "sim/scene/mesh_import.h"
#include "sim/scene/mesh_reader.h"
#include "sim/scene/scene.h"

namespace fringeslam::tools {

namespace fs = std::filesystem;

namespace {

constexpr const char* kRigFile = "rig.yaml";

std::string numbers(const Eigen::Vector3d& values) {
  // Tenths of a millimeter are finer than anything that depends on them.
  const auto text = [](double value) { return to_text(std::round(1e4 * value) / 1e4 + 0.0); };
  return "[" + text(values.x()) + ", " + text(values.y()) + ", " + text(values.z()) + "]";
}

std::string replaced_all(std::string text, const std::string& old, const std::string& with) {
  for (size_t at = 0; (at = text.find(old, at)) != std::string::npos; at += with.size())
    text.replace(at, old.size(), with);
  return text;
}

// Imports the copy of a mesh. Messages name the mesh, since the copy is gone when they are read.
sim::MeshImport imported_copy(const fs::path& copy, const std::string& mesh) {
  try {
    return sim::import_mesh(copy);
  } catch (const Error& failure) {
    throw Error(replaced_all(failure.what(), copy.string(), mesh));
  }
}

bool lacks_texture(const sim::ImportedPart& part) {
  std::error_code unknown;
  return !part.texture.empty() && !fs::exists(part.texture, unknown);
}

// The mesh as the scene imports it.
struct Placed {
  std::string unit;  // line of its entry; empty: that of the file
  Eigen::Vector3d low, high;
};

Placed placed(const sim::MeshImport& mesh) {
  constexpr double kLargest_m = 10, kMillimeter_m = 1e-3;
  if (mesh.unit_m != 1 || (mesh.high - mesh.low).maxCoeff() <= kLargest_m) return {"", mesh.low, mesh.high};
  return {", unit_m: 0.001", kMillimeter_m * mesh.low, kMillimeter_m * mesh.high};
}

}  // namespace

std::string scene_name_of(const fs::path& mesh) {
  std::string name = mesh.stem().string();
  for (char& letter : name) {
    const auto code = static_cast<unsigned char>(letter);
    if (code >= 128 || (!std::isalnum(code) && letter != '-' && letter != '_')) letter = '_';
  }
  return name.empty() ? "mesh" : name;
}

void copy_mesh(const fs::path& mesh, const fs::path& copy) {
  const fs::path folder = fs::absolute(mesh).parent_path().lexically_normal();
  // Below `root`: where in the folder of the copy a file has to be.
  const auto below = [&](const fs::path& file, const fs::path& root) {
    const fs::path inside = file.lexically_relative(root.lexically_normal());
    return inside.empty() || *inside.begin() == ".." ? fs::path() : inside;
  };
  const sim::MeshImport original = sim::import_mesh(mesh);
  for (const sim::ImportedPart& part : original.parts) {
    if (lacks_texture(part))
      throw Error(mesh.string() + ": has the texture " + part.texture.string() +
                  ", which does not exist; put it there, or remove it from the mesh");
  }
  copy_input(mesh, copy, sim::kMostMeshBytes);
  std::map<fs::path, fs::path> sources;  // by the files in the folder of the copy
  for (const fs::path& read : original.files) {
    const fs::path file = fs::absolute(read).lexically_normal();
    std::error_code unknown;
    if (!fs::exists(file, unknown) || fs::equivalent(file, mesh, unknown)) continue;
    fs::path inside = below(file, folder);
    for (const char* textures : {"../materials/textures", "../textures"}) {
      if (inside.empty()) inside = below(file, folder / textures);
    }
    // A mesh from elsewhere must not bring the user's other files into a folder that is given away.
    if (inside.empty())
      throw Error(mesh.string() + ": refers to " + file.string() + ", which is not copied; put it beside the mesh");
    if (inside == sim::kSceneFile || inside == kRigFile)
      throw Error(mesh.string() + ": refers to " + file.string() +
                  ", which has the name of another file of the scene; rename it");
    const fs::path target = (copy.parent_path() / inside).lexically_normal();
    const auto [source, is_new] = sources.try_emplace(target, file);
    if (!is_new && source->second == file) continue;
    if (!is_new || fs::exists(target))
      throw Error(mesh.string() + ": refers to two files named " + target.filename().string() + "; rename one of them");
    fs::create_directories(target.parent_path());
    copy_input(file, target, sim::kMostMeshBytes);
  }
  const sim::MeshImport copied = imported_copy(copy, mesh.string());
  if (copied.files.size() < original.files.size())
    throw Error(mesh.string() + ": refers to files that are not found by the name of its copy, " +
                copy.filename().string() + "; name them in the mesh");
}

void create_mesh_scene(const fs::path& mesh, const fs::path& folder,
                       const std::function<void(const fs::path&)>& write_mesh) {
  constexpr double kElevation = 55 * std::numbers::pi / 180, kRange_m = 1, kThesisField_m = 0.24;
  if (fs::exists(folder)) throw Error(folder.string() + ": exists already; choose another name");
  const fs::path data = sim::data_folder();
  if (data.empty())
    throw Error("the rigs of the project are not found; set FRINGESLAM_DATA to the folder with scenes/");
  std::string extension = mesh.extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(),
                 [](unsigned char letter) { return static_cast<char>(std::tolower(letter)); });
  StagedFolder staged(folder, "");
  const std::string file = "mesh" + extension;
  write_mesh(staged.path() / file);
  const sim::MeshImport imported = imported_copy(staged.path() / file, mesh.string());
  const Placed shown = placed(imported);
  // The page for scenes receives the mesh alone.
  const bool is_plain = std::any_of(imported.parts.begin(), imported.parts.end(), lacks_texture);
  const Eigen::Vector3d size = shown.high - shown.low, middle = 0.5 * (shown.low + shown.high);
  const std::string rig = size.head<2>().maxCoeff() <= kThesisField_m ? "thesis" : "wide";
  fs::copy_file(data / "scenes" / "rigs" / (rig + ".yaml"), staged.path() / kRigFile);
  constexpr double kLargestFloor_m = 100;
  const double floor_m = std::clamp(4 * size.head<2>().maxCoeff(), 1.0, kLargestFloor_m);
  const std::string name = folder.filename().string();
  const double height_m = size.z() / 2 + kRange_m * std::sin(kElevation), radius_m = kRange_m * std::cos(kElevation);
  write_text(staged.path() / sim::kSceneFile,
             "name: " + yaml_quoted(name) + "\ndescription: " + yaml_quoted(mesh.filename().string() + " on a floor") +
                 "\nseed: 1\n"
                 "rig: {file: " +
                 std::string(kRigFile) +
                 "}\n"
                 "patterns: {axis: columns, steps: 3, periods_px: [1040, 131, 16.5]}\n"
                 "light: {ambient_lux: 100}\n"
                 "materials:\n"
                 "  floor: {grain: concrete, albedo: 0.4, contrast: 0.35, grain_m: 0.03}\n" +
                 (is_plain ? "  plain: {albedo: 0.5}\n" : "") +
                 "objects:\n"
                 "  - {shape: plane, size_m: [" +
                 to_text(floor_m) + ", " + to_text(floor_m) + "], material: floor}\n" +
                 (is_plain ? "  # Put the mesh's textures beside it, and remove `material` to use them.\n"
                           : "  # Without `material`, the mesh has the colors and textures of its file.\n") +
                 "  - {shape: mesh, file: " + yaml_quoted(file) + shown.unit + (is_plain ? ", material: plain" : "") +
                 ", pose: {translation_m: " + numbers({-middle.x(), -middle.y(), -shown.low.z()}) +
                 "}}\n"
                 "trajectory:\n"
                 "  orbit: {centre_m: " +
                 numbers({0, 0, size.z() / 2}) + ", radius_m: " + to_text(std::round(1e3 * radius_m) / 1e3) +
                 ", height_m: " + to_text(std::round(1e3 * height_m) / 1e3) +
                 ", from_deg: 0, to_deg: 60, count: 7}\n"
                 "  interval_s: 0.5\n");
  // A mesh that can be read can still have more triangles than a scene may have, or a texture that cannot be read.
  try {
    (void)sim::load_scene(staged.path() / sim::kSceneFile);
  } catch (const Error& failure) {
    throw Error(mesh.string() +
                ": makes no valid scene: " + replaced_all(failure.what(), (staged.path() / "").string(), ""));
  }
  staged.commit();
}

}  // namespace fringeslam::tools
