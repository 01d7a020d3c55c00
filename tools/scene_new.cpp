// SPDX-License-Identifier: Apache-2.0
// fringeslam scene new NAME --from TEMPLATE
// fringeslam scene generate SCENE --count N --out FOLDER
#include <cstdio>
#include <fstream>
#include <iterator>
#include <memory>
#include <nlohmann/json.hpp>
#include <regex>

#include "core/io/files.h"
#include "core/io/yaml.h"
#include "tools/authoring/mesh_scene.h"
#include "tools/progress.h"
#include "tools/scene_verbs.h"
#include "tools/source.h"

namespace fringeslam::tools {

namespace fs = std::filesystem;

namespace {

std::string read_text(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

// Adapts relative paths to files outside the template's folder to the new folder. Comments are left unchanged.
std::string with_moved_paths(const std::string& text, const fs::path& from, const fs::path& to) {
  static const std::regex word("#[^\\n]*|\"[^\"\\n]*\"|'[^'\\n]*'|[^\\s\\[\\]{},:#\"']+");
  std::string result;
  auto rest = text.cbegin();
  for (std::sregex_iterator it(text.begin(), text.end(), word), end; it != end; ++it) {
    std::string found = it->str(), quote;
    result.append(rest, (*it)[0].first);
    rest = (*it)[0].second;
    if (found.size() > 2 && (found[0] == '"' || found[0] == '\'')) {
      quote = found[0];
      found = found.substr(1, found.size() - 2);
    }
    std::error_code ignored;
    if (found.starts_with("../") && fs::is_regular_file(from / found, ignored))
      found = fs::absolute(from / found)
                  .lexically_normal()
                  .lexically_relative(fs::absolute(to).lexically_normal())
                  .string();
    result += quote + found + quote;
  }
  return result.append(rest, text.cend());
}

std::string with_name(std::string text, const std::string& name) {
  static const std::regex line("(^|\\n)name:[^\\n]*");
  return std::regex_replace(text, line, "$1name: " + yaml_quoted(name), std::regex_constants::format_first_only);
}

struct NewArguments {
  std::string name, from, mesh, in = "scenes";
};

// Returns a path unchanged; a bare name is taken relative to the folder of scenes.
fs::path in_folder(const std::string& name, const fs::path& folder) {
  return name.find('/') == std::string::npos ? folder / name : fs::path(name);
}

int report_new(const fs::path& target, const Common& common) {
  print_result(common, {{"written", target.string()}},
               "written: " + target.string() + "\nedit " + (target / kSceneFile).string() +
                   ", then: fringeslam scene check " + target.string());
  return 0;
}

int new_scene(const NewArguments& arguments, const Common& common) {
  if (arguments.from.empty() == arguments.mesh.empty())
    throw Error("scene new: give either the scene to copy by --from or a mesh file by --mesh");
  if (!arguments.mesh.empty()) {
    const fs::path target = in_folder(arguments.name, arguments.in);
    create_mesh_scene(arguments.mesh, target, [&](const fs::path& copy) { fs::copy_file(arguments.mesh, copy); });
    return report_new(target, common);
  }
  const fs::path from = fs::exists(arguments.from) ? fs::path(arguments.from) : in_folder(arguments.from, arguments.in);
  const fs::path file = scene_file(from);
  if (!fs::is_regular_file(file))
    throw Error(from.string() + ": contains no " + kSceneFile + "; `fringeslam scene list` lists scenes to start from");
  fs::path target = in_folder(arguments.name, arguments.in);
  if (target.filename().empty()) target = target.parent_path();
  const std::string name = target.filename().string();
  const fs::path source = file.parent_path();
  const fs::path inside = fs::weakly_canonical(target).lexically_relative(fs::weakly_canonical(source));
  if (!inside.empty() && *inside.begin() != "..")
    throw Error(target.string() + ": lies in the scene that is copied, " + source.string() + "; choose another place");
  StagedFolder staged(target, "");
  write_text(staged.path() / kSceneFile, with_name(with_moved_paths(read_text(file), source, target), name));
  for (const auto& entry : fs::directory_iterator(source)) {
    const fs::path part = entry.path().filename();
    if (part == file.filename() || part == "README.md" || part == "overview.png") continue;
    fs::copy(entry.path(), staged.path() / part, fs::copy_options::recursive);
  }
  staged.commit();
  return report_new(target, common);
}

struct GenerateArguments {
  std::string scene, out;
  int count = 1;
  uint64_t seed = 1;
};

int generate(const GenerateArguments& arguments, const Common& common) {
  const fs::path file = scene_file(arguments.scene);
  StagedFolder staged(arguments.out, "scenes");
  {
    Progress progress("scenes", arguments.count, common.quiet || common.json);
    for (int i = 0; i < arguments.count; ++i) {
      const uint64_t seed = arguments.seed + static_cast<uint64_t>(i);
      char folder[32];
      std::snprintf(folder, sizeof folder, "%06llu", static_cast<unsigned long long>(seed));
      // Paths are written relative to the scene's final folder.
      const sim::Scene scene = sim::load_scene(file, {seed, nullptr, fs::path(arguments.out) / folder});
      fs::create_directory(staged.path() / folder);
      write_text(staged.path() / folder / kSceneFile, scene.resolved);
      progress.step();
    }
  }
  staged.commit();
  print_result(common, {{"written", arguments.out}, {"scenes", arguments.count}},
               "written: " + arguments.out + ": " + std::to_string(arguments.count) + " scenes");
  return 0;
}

}  // namespace

Verb add_scene_new(Command group, const Common& common) {
  auto arguments = std::make_shared<NewArguments>();
  const Command verb = group.add_subcommand("new", "Create a new scene from an existing one or from a mesh");
  verb.add_option("name", arguments->name, "Name in the folder of scenes, or a path").required();
  verb.add_option("--from", arguments->from, "Scene to copy");
  verb.add_option("--mesh", arguments->mesh, "Mesh file to show on a floor instead").check_existing_file();
  verb.add_option("--in", arguments->in, "Folder of scenes").capture_default_str();
  return [arguments, &common] { return new_scene(*arguments, common); };
}

Verb add_scene_generate(Command group, const Common& common) {
  auto arguments = std::make_shared<GenerateArguments>();
  const Command verb =
      group.add_subcommand("generate", "Generate scenes from one by drawing its distributions with consecutive seeds");
  verb.add_option("scene", arguments->scene, "Scene file, or a folder with scene.yaml").required();
  verb.add_option("--count", arguments->count, "Number of scenes").required().check_range(1, 1000000);
  verb.add_option("--out", arguments->out, "Folder to write").required();
  verb.add_option("--seed", arguments->seed, "Seed of the first scene").capture_default_str();
  return [arguments, &common] { return generate(*arguments, common); };
}

}  // namespace fringeslam::tools
