// SPDX-License-Identifier: Apache-2.0
// fringeslam scene open SCENE
#include <cstdio>
#include <cstdlib>
#include <memory>

#include "core/types/error.h"
#include "tools/authoring/gallery_page.h"
#include "tools/authoring/scene_page.h"
#include "tools/interrupt.h"
#include "tools/live/live_option.h"
#include "tools/scene_verbs.h"

namespace fringeslam::tools {

namespace {

struct SceneOpenArguments {
  std::string scene;
  int port = LivePage::kDefaultPort;
  LiveAccess access;
  SceneVariant variant;
};

int open(const SceneOpenArguments& arguments) {
  catch_interrupts();
  LiveAccess access = arguments.access;
  access.port = arguments.port;
  const ScenePage page(arguments.scene, arguments.variant, std::move(access));
  if (interrupted()) return kInterrupted;
  std::fprintf(stderr, "scene: %s\n", page.url().c_str());
  while (!interrupted()) wait_s(60);
  // A pile may take minutes to settle. Nothing is lost: its result is stored at once or not at all.
  if (page.loading()) std::quick_exit(0);
  return 0;
}

}  // namespace

int show_gallery(const std::string& folder, const LiveAccess& access) {
  catch_interrupts();
  const GalleryPage page(folder, access);
  if (interrupted()) return kInterrupted;
  std::fprintf(stderr, "scenes: %s\n", page.url().c_str());
  while (!interrupted()) wait_s(60);
  if (page.loading()) std::quick_exit(0);
  return 0;
}

Verb add_scene_open(Command group, const Common&) {
  auto arguments = std::make_shared<SceneOpenArguments>();
  const Command verb = group.add_subcommand("open", "Show a scene on a web page, until Ctrl-C");
  verb.add_option("scene", arguments->scene, "Scene file, or a folder with scene.yaml").required();
  verb.add_option("--port", arguments->port, "Port of the page; 0: any free port")
      .check_range(0, 65535)
      .capture_default_str();
  add_access_options(verb, arguments->access);
  arguments->variant.add_to(verb);
  return [arguments] { return open(*arguments); };
}

}  // namespace fringeslam::tools
