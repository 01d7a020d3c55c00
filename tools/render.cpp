// SPDX-License-Identifier: Apache-2.0
// fringeslam render SCENE --out DATASET [--format tum-rgbd|euroc|rosbag]
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>

#include "core/io/files.h"
#include "core/io/input_file.h"
#include "core/io/json_text.h"
#include "core/rig/dataset.h"
#include "tools/bag/bag_dataset.h"
#include "tools/board_file.h"
#include "tools/euroc.h"
#include "tools/output_file.h"
#include "tools/progress.h"
#include "tools/source.h"
#include "tools/tum_rgbd.h"
#include "tools/verbs.h"

namespace fringeslam::tools {

namespace {

// Writes one of the formats for other systems and returns the number of views.
int write_views(const std::string& format, Source& source, const Settings& settings, const RgbdOptions& options,
                const std::string& out, const Common& common) {
  if (format == "rosbag") return write_bag(source, settings, options, true, out, common).views;
  if (format == "euroc") return write_euroc(source, settings, options, true, out, common).views;
  return write_tum_rgbd(source, settings, options, out, common);
}

}  // namespace

Verb add_render(Command app, const Common& common) {
  struct RenderArguments {
    std::string scene, out;
    std::vector<std::string> sets;
    SceneVariant variant;
    std::string format = "fringes";
    RgbdOptions rgbd;
  };
  auto arguments = std::make_shared<RenderArguments>();
  const Command verb =
      app.add_subcommand("render", "Render a scene's fringe images and their ground truth to a dataset");
  verb.add_option("scene", arguments->scene, "Scene file, or a folder with scene.yaml").required();
  verb.add_option("--out", arguments->out, "Dataset folder to write; a file with --format rosbag").required();
  arguments->variant.add_to(verb);
  verb.add_option("--set", arguments->sets, "Setting: stage.key=value (repeatable; see `run --help`)");
  const Option format =
      verb.add_option("--format", arguments->format,
                      "fringes: a dataset for `run`; tum-rgbd, euroc: texture and depth in the folder layout of TUM "
                      "RGB-D or like that of EuRoC; rosbag: a ROS 1 bag with fringe images, texture, depth and points")
          .check_one_of({"fringes", "tum-rgbd", "euroc", "rosbag"});
  const Option scale = verb.add_option("--depth-scale", arguments->rgbd.units_per_m,
                                       "tum-rgbd, euroc: depth image units per meter (5000)")
                           .check_range(1.0, 1e6);
  const std::vector<Option> of_rgbd = {
      scale,
      verb.add_option("--depth", arguments->rgbd.depth,
                      "Depth images: measured from the fringes (default), or the true depth")
          .check_one_of({"measured", "truth"}),
      verb.add_flag("--distorted", arguments->rgbd.distorted,
                    "tum-rgbd, euroc, rosbag: keep the camera's lens distortion")};
  for (const Option& option : of_rgbd) option.needs(format);
  return [arguments, scale, of_rgbd, &common] {
    if (arguments->format == "rosbag" && scale.count() > 0)
      throw Error("render: --depth-scale has no effect with --format rosbag, whose depth is in meters");
    if (arguments->format == "rosbag") require_bags("render --format rosbag");
    const Settings settings = parse_settings(arguments->sets);
    const auto source =
        open_source(arguments->scene, arguments->variant, settings, sets_any_of(arguments->sets, "render"));
    require_not_an_input(arguments->out, source->inputs());
    const double deepest_m = UINT16_MAX / arguments->rgbd.units_per_m, far_m = source->model().far_m;
    if ((arguments->format == "tum-rgbd" || arguments->format == "euroc") && deepest_m < far_m)
      throw Error("--depth-scale: at " + to_text(arguments->rgbd.units_per_m) + " units per meter, 16 bits end at " +
                  to_text(deepest_m) + " m, but the rig's working range ends at " + to_text(far_m) +
                  " m; specify at most " + to_text(std::floor(UINT16_MAX / far_m)));
    if (arguments->format != "fringes") {
      const int images = write_views(arguments->format, *source, settings, arguments->rgbd, arguments->out, common);
      print_result(common, {{"dataset", arguments->out}, {"stacks", images}}, "dataset: " + arguments->out);
      return 0;
    }
    for (const Option& option : of_rgbd) {
      if (option.count() > 0)
        throw Error("render: " + option.get_name() + " has no effect without --format tum-rgbd, euroc or rosbag");
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
