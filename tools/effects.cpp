// SPDX-License-Identifier: Apache-2.0
// fringeslam effects SCENE --out IMAGE
#include "tools/report/effects.h"

#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>

#include "core/io/files.h"
#include "core/types/error.h"
#include "tools/output_file.h"
#include "tools/settings.h"
#include "tools/source.h"
#include "tools/verbs.h"

namespace fringeslam::tools {

Verb add_effects(Command app, const Common& common) {
  struct EffectsArguments {
    std::string scene, out;
    std::vector<std::string> sets;
  };
  auto arguments = std::make_shared<EffectsArguments>();
  const Command verb =
      app.add_subcommand("effects", "Write an image that shows each simulated light effect of a scene separately");
  verb.add_option("scene", arguments->scene, "Scene file, or a folder with scene.yaml").required();
  verb.add_option("--out", arguments->out, "PNG file to write").required();
  verb.add_option("--set", arguments->sets, "render.key=value; see `run --help`");
  return [arguments, &common] {
    require_extension(arguments->out, ".png");
    for (const std::string& set : arguments->sets) {
      if (!set.starts_with("render."))
        throw Error("--set " + set + ": has no effect on this image; give render.key=value, see `run --help`");
    }
    const Settings settings = parse_settings(arguments->sets);
    std::vector<std::filesystem::path> files;
    sim::SceneLoadOptions reading;
    reading.files = &files;
    const std::filesystem::path file = scene_file(arguments->scene);
    const sim::Scene scene = sim::load_scene(file, reading);
    require_not_an_input(arguments->out, files);
    cv::Mat3b picture;
    try {
      picture = effects_picture(scene, settings.render);
    } catch (const Error& e) {
      throw Error(file.string() + ": " + e.what());
    }
    write_png(arguments->out, picture);
    print_result(common, {{"written", arguments->out}}, "written: " + arguments->out);
    return 0;
  };
}

}  // namespace fringeslam::tools
