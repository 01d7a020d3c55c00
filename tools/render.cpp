// SPDX-License-Identifier: Apache-2.0
// fringeslam render SCENE --out DATASET
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>

#include "core/rig/dataset.h"
#include "core/rig/files.h"
#include "tools/board_file.h"
#include "tools/progress.h"
#include "tools/source.h"
#include "tools/verbs.h"

namespace fringeslam::tools {

Verb add_render(CLI::App& app, const Common& common) {
  struct Arguments {
    std::string scene, out;
    std::vector<std::string> sets;
    SceneVariant variant;
  };
  auto arguments = std::make_shared<Arguments>();
  CLI::App* verb = app.add_subcommand("render", "Render a scene's fringe images and their truth into a dataset");
  verb->add_option("scene", arguments->scene, "Scene file, or a folder with scene.yaml")->required();
  verb->add_option("--out", arguments->out, "Dataset folder to write")->required();
  arguments->variant.add_to(*verb);
  verb->add_option("--set", arguments->sets, "render.key=value; see `run --help`");
  return [arguments, &common] {
    const Settings settings = parse_settings(arguments->sets);
    const auto source = open_source(arguments->scene, arguments->variant, settings, false);
    StagedFolder folder(arguments->out, "dataset");
    const auto rig = source->open(folder.path());
    RecordingRig recording(*rig, folder.path());
    Progress progress("rendering", source->stacks(), common.quiet || common.json);
    while (recording.capture(source->sequence())) progress.step();
    recording.finish(source->name(), source->seed(), source->has_truth());
    if (std::filesystem::exists(source->board_file()))
      std::filesystem::copy_file(source->board_file(), folder.path() / kBoardFile);
    folder.commit();
    if (common.json)
      std::printf("%s\n", nlohmann::json{{"dataset", arguments->out}, {"stacks", source->stacks()}}.dump().c_str());
    else if (!common.quiet)
      std::printf("dataset: %s\n", arguments->out.c_str());
    return 0;
  };
}

}  // namespace fringeslam::tools
