// SPDX-License-Identifier: Apache-2.0
// fringeslam render SCENE --out DATASET [--format tum-rgbd]
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>

#include "core/io/files.h"
#include "core/io/input_file.h"
#include "core/io/json_text.h"
#include "core/rig/dataset.h"
#include "tools/board_file.h"
#include "tools/progress.h"
#include "tools/source.h"
#include "tools/tum_rgbd.h"
#include "tools/verbs.h"

namespace fringeslam::tools {

Verb add_render(Command app, const Common& common) {
  struct RenderArguments {
    std::string scene, out;
    std::vector<std::string> sets;
    SceneVariant variant;
    std::string format = "fringes";
    TumRgbdOptions rgbd;
  };
  auto arguments = std::make_shared<RenderArguments>();
  const Command verb =
      app.add_subcommand("render", "Render a scene's fringe images and their ground truth to a dataset");
  verb.add_option("scene", arguments->scene, "Scene file, or a folder with scene.yaml").required();
  verb.add_option("--out", arguments->out, "Dataset folder to write").required();
  arguments->variant.add_to(verb);
  verb.add_option("--set", arguments->sets, "Setting: stage.key=value (repeatable; see `run --help`)");
  const Option format =
      verb.add_option("--format", arguments->format,
                      "fringes: a dataset for `run`; tum-rgbd: texture and depth in the TUM RGB-D folder layout")
          .check_one_of({"fringes", "tum-rgbd"});
  const std::vector<Option> of_rgbd = {
      verb.add_option("--depth", arguments->rgbd.depth,
                      "tum-rgbd: depth measured from the fringes (default), or the true depth")
          .check_one_of({"measured", "truth"}),
      verb.add_option("--depth-scale", arguments->rgbd.units_per_m, "tum-rgbd: depth image units per metre (5000)")
          .check_range(1.0, 1e6),
      verb.add_flag("--distorted", arguments->rgbd.distorted, "tum-rgbd: keep the camera's lens distortion")};
  for (const Option& option : of_rgbd) option.needs(format);
  return [arguments, of_rgbd, &common] {
    const Settings settings = parse_settings(arguments->sets);
    const auto source = open_source(arguments->scene, arguments->variant, settings, false);
    if (arguments->format == "tum-rgbd") {
      const int images = write_tum_rgbd(*source, settings, arguments->rgbd, arguments->out, common);
      print_result(common, {{"dataset", arguments->out}, {"stacks", images}}, "dataset: " + arguments->out);
      return 0;
    }
    for (const Option& option : of_rgbd) {
      if (option.count() > 0) throw Error("render: " + option.get_name() + " has no effect without --format tum-rgbd");
    }
    StagedFolder folder(arguments->out, "dataset");
    const auto rig = source->open(folder.path());
    RecordingRig recording(*rig, folder.path());
    Progress progress("rendering", source->stacks(), common.quiet || common.json);
    int stacks = 0;
    for (; recording.capture(source->sequence()); ++stacks) progress.step();
    recording.finish(source->name(), source->seed(), source->has_truth());
    if (std::filesystem::exists(source->board_file())) copy_input(source->board_file(), folder.path() / kBoardFile);
    folder.commit();
    if (common.json)
      std::printf("%s\n", json_text(nlohmann::json{{"dataset", arguments->out}, {"stacks", stacks}}).c_str());
    else if (!common.quiet)
      std::printf("dataset: %s\n", arguments->out.c_str());
    return 0;
  };
}

}  // namespace fringeslam::tools
