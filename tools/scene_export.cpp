// SPDX-License-Identifier: Apache-2.0
// fringeslam scene export SCENE --format FORMAT --out FILE
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>

#include "core/types/error.h"
#include "sim/scene/mesh_export.h"
#include "tools/output_file.h"
#include "tools/scene_verbs.h"
#include "tools/source.h"

namespace fringeslam::tools {

namespace {

const std::map<std::string, sim::MeshFormat> kFormats = {
    {"gltf", sim::MeshFormat::gltf}, {"ply", sim::MeshFormat::ply}, {"obj", sim::MeshFormat::obj}};

struct SceneExportArguments {
  std::string scene, format, out;
  std::optional<uint64_t> seed;
};

int export_scene(const SceneExportArguments& arguments, const Common& common) {
  if (!arguments.format.empty() && sim::mesh_format_of(arguments.out) != kFormats.at(arguments.format))
    throw Error(arguments.out + ": does not match the format " + arguments.format +
                "; glTF files end in .glb or .gltf, PLY files in .ply, OBJ files in .obj");
  std::vector<std::filesystem::path> files;
  sim::SceneLoadOptions reading{arguments.seed};
  reading.files = &files;
  const sim::Scene scene = sim::load_scene(scene_file(arguments.scene), reading);
  require_not_an_input(arguments.out, files);
  const sim::MeshExport written = sim::export_mesh(scene, arguments.out, files);
  print_result(common,
               {{"written", arguments.out},
                {"objects", written.objects},
                {"meshes", written.meshes},
                {"triangles", written.triangles}},
               "written: " + arguments.out + ": " + std::to_string(written.objects) + " objects, " +
                   std::to_string(written.meshes) + " meshes, " + std::to_string(written.triangles) + " triangles");
  return 0;
}

}  // namespace

Verb add_scene_export(Command group, const Common& common) {
  auto arguments = std::make_shared<SceneExportArguments>();
  std::vector<std::string> formats;
  for (const auto& [name, format] : kFormats) formats.push_back(name);
  const Command verb =
      group.add_subcommand("export", "Export the objects as a mesh file, for Blender, MeshLab and others");
  verb.add_option("scene", arguments->scene, "Scene file, or a folder with scene.yaml").required();
  verb.add_option("--out", arguments->out, "File to write: .glb, .gltf, .ply or .obj").required();
  verb.add_option("--format", arguments->format, "gltf, ply or obj (default: by the file name's extension)")
      .check_one_of(formats);
  verb.add_option("--seed", arguments->seed, "Seed; overrides the scene's").check_non_negative();
  return [arguments, &common] { return export_scene(*arguments, common); };
}

}  // namespace fringeslam::tools
