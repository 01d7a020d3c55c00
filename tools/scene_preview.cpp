// SPDX-License-Identifier: Apache-2.0
// fringeslam scene preview SCENE --out IMAGE
#include <charconv>
#include <memory>
#include <nlohmann/json.hpp>

#include "core/io/files.h"
#include "core/types/error.h"
#include "sim/preview.h"
#include "tools/output_file.h"
#include "tools/scene_verbs.h"
#include "tools/source.h"

namespace fringeslam::tools {

namespace {

struct ScenePreviewArguments {
  std::string scene, out, size = "1200x800";
  SceneVariant variant;
};

// Parses WxH, or a width alone, for which the height is two thirds of it.
cv::Size size_of(const std::string& text) {
  cv::Size size;
  const char* end = text.data() + text.size();
  auto [rest, failure] = std::from_chars(text.data(), end, size.width);
  size.height = size.width * 2 / 3;
  if (failure == std::errc() && rest != end && *rest == 'x')
    std::tie(rest, failure) = [&] {
      const auto result = std::from_chars(rest + 1, end, size.height);
      return std::pair(result.ptr, result.ec);
    }();
  if (failure != std::errc() || rest != end || size.width < 320 || size.height < 200 || size.width > 8192 ||
      size.height > 8192)
    throw Error("--size " + text + ": must be WxH or a width, such as 1200x800, from 320x200 to 8192x8192 px");
  return size;
}

int preview(const ScenePreviewArguments& arguments, const Common& common) {
  const cv::Size size = size_of(arguments.size);
  require_extension(arguments.out, ".png");
  std::vector<std::filesystem::path> files;
  sim::SceneLoadOptions reading = arguments.variant.reading();
  reading.files = &files;
  const sim::Scene scene = sim::load_scene(scene_file(arguments.scene), reading);
  require_not_an_input(arguments.out, files);
  write_png(arguments.out, sim::preview_picture(scene, size));
  print_result(common, {{"written", arguments.out}}, "written: " + arguments.out);
  return 0;
}

}  // namespace

Verb add_scene_preview(Command group, const Common& common) {
  auto arguments = std::make_shared<ScenePreviewArguments>();
  const Command verb =
      group.add_subcommand("preview", "Write an image of the scene from outside and of what the first view sees");
  verb.add_option("scene", arguments->scene, "Scene file, or a folder with scene.yaml").required();
  verb.add_option("--out", arguments->out, "PNG file to write").required();
  verb.add_option("--size", arguments->size, "Image size: WxH, or its width").capture_default_str();
  arguments->variant.add_to(verb);
  return [arguments, &common] { return preview(*arguments, common); };
}

}  // namespace fringeslam::tools
