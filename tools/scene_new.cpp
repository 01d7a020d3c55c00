// SPDX-License-Identifier: Apache-2.0
// fringeslam scene new NAME --from TEMPLATE
// fringeslam scene generate SCENE --count N --out FOLDER
#include <cstdio>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>

#include "core/io/files.h"
#include "core/io/input_file.h"
#include "core/io/yaml.h"
#include "core/io/yaml_guard.h"
#include "tools/authoring/mesh_scene.h"
#include "tools/output_file.h"
#include "tools/progress.h"
#include "tools/scene_verbs.h"
#include "tools/shell.h"
#include "tools/source.h"

namespace fringeslam::tools {

namespace fs = std::filesystem;

namespace {

// Returns the path of a file, without links in that of its folder.
fs::path located(const fs::path& file) { return fs::weakly_canonical(file.parent_path()) / file.filename(); }

// A scene file, and its place and that of the other files of its folder in the folder of a copy, which need not exist.
class SceneCopy {
 public:
  SceneCopy(const fs::path& scene, const fs::path& target)
      : scene_(located(fs::absolute(scene))), target_(fs::weakly_canonical(fs::absolute(target))) {}

  fs::path source() const { return scene_.parent_path(); }
  // True for an entry of the folder that describes the template, or would have the name of the copied scene file.
  bool leaves_out(const fs::path& entry) const {
    return entry == scene_.filename() || entry == kSceneFile || entry == "README.md" || entry == "overview.png";
  }
  // Returns the contents of the scene file, with another name, and of the included files that are copied, by their paths
  // in the new folder. Paths in them are changed where they would mean other files than before.
  std::map<fs::path, std::string> texts(const std::string& name) const;

 private:
  // Returns the place of the copy of a located file; empty if it is not copied.
  fs::path copy_of(const fs::path& file) const {
    if (file == scene_) return target_ / kSceneFile;
    const fs::path inside = file.lexically_relative(source());
    return *inside.begin() == ".." || leaves_out(inside) ? fs::path() : target_ / inside;
  }
  fs::path scene_, target_;
};

std::map<fs::path, std::string> SceneCopy::texts(const std::string& name) const {
  constexpr size_t kMostFiles = 100, kLongestPath = 4096;
  std::map<fs::path, std::string> texts;
  std::vector<fs::path> left = {scene_};
  bool named = false;
  while (!left.empty()) {
    const fs::path file = left.back(), copy = copy_of(file);
    left.pop_back();
    const auto [text, is_new] = texts.try_emplace(copy.lexically_relative(target_));
    if (!is_new) continue;
    if (texts.size() > kMostFiles) throw Error(file.string() + ": more than 100 included files");
    const auto replacement = [&](const std::string& section, const std::string& value) -> std::optional<std::string> {
      if (file == scene_ && section == "name") {
        named = true;
        return name;
      }
      if (value.empty() || value.front() == '/' || value.size() > kLongestPath) return std::nullopt;
      const fs::path meant = file.parent_path() / value;
      std::error_code ignored;
      if (!fs::is_regular_file(meant, ignored)) return std::nullopt;
      const fs::path found = located(meant), found_copy = copy_of(found);
      const fs::path wanted = found_copy.empty() ? found : found_copy;
      if (section == "include" && !found_copy.empty()) left.push_back(found);
      if ((copy.parent_path() / value).lexically_normal() == wanted) return std::nullopt;
      return wanted.lexically_relative(copy.parent_path()).string();
    };
    text->second = with_replaced_scalars(read_input(file, kMostYamlBytes), file.string(), replacement);
  }
  if (named) return texts;
  // The name is that of an included file, which has to be overridden.
  std::string& text = texts.at(kSceneFile);
  text.insert(0, "name: " + yaml_quoted(name) + "\n");
  try {
    (void)YamlMap::parse(text, scene_.string());
  } catch (const Error&) {
    throw Error(scene_.string() + ": has no name that can be replaced; add a line such as 'name: template'");
  }
  return texts;
}

// Copies a file, or the files of a folder and its subfolders. Folders are followed, links to folders are not: they may form a loop.
void copy_files(const fs::path& from, const fs::path& to) {
  std::error_code failed;
  const fs::file_status status = fs::symlink_status(from, failed);
  if (fs::is_symlink(status) && fs::is_directory(from, failed))
    throw Error(from.string() + ": is a link to a folder, which is not copied; put the folder in its place");
  if (!fs::is_directory(status)) return copy_input(from, to, kMostDataBytes);
  if (!fs::create_directory(to, failed)) throw Error(to.string() + ": cannot be created: " + failed.message());
  fs::directory_iterator entry(from, failed);
  for (const fs::directory_iterator end; !failed && entry != end; entry.increment(failed))
    copy_files(entry->path(), to / entry->path().filename());
  if (failed) throw Error(from.string() + ": cannot be copied: " + failed.message());
}

struct NewArguments {
  std::string name, from, mesh, in = "scenes";
};

// Returns a path without a slash at its end; a bare name is taken relative to the folder of scenes.
fs::path in_folder(const std::string& name, const fs::path& folder) {
  const fs::path path = name.find('/') == std::string::npos ? folder / name : fs::path(name);
  return path.filename().empty() ? path.parent_path() : path;
}

int report_new(const fs::path& target, const Common& common) {
  print_result(common, {{"written", target.string()}},
               "written: " + target.string() + "\nedit " + (target / kSceneFile).string() +
                   ", then: fringeslam scene check " + shell_word(target.string()));
  return 0;
}

int new_scene(const NewArguments& arguments, const Common& common) {
  if (arguments.from.empty() == arguments.mesh.empty())
    throw Error("scene new: give either the scene to copy by --from or a mesh file by --mesh");
  if (!arguments.mesh.empty()) {
    const fs::path target = in_folder(arguments.name, arguments.in);
    create_mesh_scene(arguments.mesh, target, [&](const fs::path& copy) { copy_mesh(arguments.mesh, copy); });
    return report_new(target, common);
  }
  const fs::path from = fs::exists(arguments.from) ? fs::path(arguments.from) : in_folder(arguments.from, arguments.in);
  const fs::path file = scene_file(from);
  if (!fs::is_regular_file(file))
    throw Error(from.string() + ": contains no " + kSceneFile + "; `fringeslam scene list` lists scenes to start from");
  const fs::path target = in_folder(arguments.name, arguments.in);
  const SceneCopy copy(file, target);
  const fs::path inside = fs::weakly_canonical(target).lexically_relative(copy.source());
  if (!inside.empty() && *inside.begin() != "..")
    throw Error(target.string() + ": lies in the scene that is copied, " + copy.source().string() +
                "; choose another place");
  const std::map<fs::path, std::string> texts = copy.texts(target.filename().string());
  StagedFolder staged(target, "");
  for (const auto& entry : fs::directory_iterator(copy.source())) {
    const fs::path part = entry.path().filename();
    if (!copy.leaves_out(part)) copy_files(entry.path(), staged.path() / part);
  }
  for (const auto& [path, text] : texts) write_text(staged.path() / path, text);
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
  std::set<fs::path> inputs;  // that are checked
  StagedFolder staged(arguments.out, "scenes");
  {
    Progress progress("scenes", arguments.count, common.quiet || common.json);
    for (int i = 0; i < arguments.count; ++i) {
      const uint64_t seed = arguments.seed + static_cast<uint64_t>(i);
      char folder[32];
      std::snprintf(folder, sizeof folder, "%06llu", static_cast<unsigned long long>(seed));
      // Paths are written relative to the scene's final folder.
      sim::SceneLoadOptions reading{seed, nullptr, fs::path(arguments.out) / folder};
      std::vector<fs::path> files;
      reading.files = &files;
      const sim::Scene scene = sim::load_scene(file, reading);
      // The files may depend on what is drawn.
      std::erase_if(files, [&](const fs::path& input) { return !inputs.insert(input).second; });
      require_not_an_input(arguments.out, files);
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
