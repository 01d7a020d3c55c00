// SPDX-License-Identifier: Apache-2.0
// fringeslam scene open SCENE
#include <charconv>
#include <cstdio>
#include <memory>

#include "core/types/error.h"
#include "tools/authoring/scene_data.h"
#include "tools/interrupt.h"
#include "tools/live/live_option.h"
#include "tools/live/page_server.h"
#include "tools/report/report_page.h"
#include "tools/scene_verbs.h"
#include "tools/source.h"

namespace fringeslam::tools {

namespace {

struct SceneOpenArguments {
  std::string scene;
  int port = LivePage::kDefaultPort;
  LiveAccess access;
  SceneVariant variant;
};

//   /         the page (tools/report/page/src/world)
//   /scene    SceneData::json
//   /mesh/N   SceneData::meshes
PageAnswer answer(const SceneData& data, const PageRequest& request) {
  if (request.path == "/") return PageAnswer::of(std::string(world_page()), "text/html; charset=utf-8");
  if (request.path == "/scene") return PageAnswer::of(data.json, "application/json");
  constexpr std::string_view kMesh = "/mesh/";
  if (!request.path.starts_with(kMesh)) return {};
  size_t number = 0;
  const char* end = request.path.data() + request.path.size();
  const auto [rest, failure] = std::from_chars(request.path.data() + kMesh.size(), end, number);
  if (failure != std::errc() || rest != end || number >= data.meshes.size()) return {};
  return PageAnswer::of(data.meshes[number], "application/octet-stream");
}

int open(const SceneOpenArguments& arguments) {
  catch_interrupts();
  const SceneData data = scene_data(sim::load_scene(scene_file(arguments.scene), arguments.variant.reading()));
  if (interrupted()) return kInterrupted;
  LiveAccess access = arguments.access;
  access.port = arguments.port;
  const PageServer server(std::move(access), "--port",
                          [&](const PageRequest& request) { return answer(data, request); });
  std::fprintf(stderr, "scene: %s\n", server.url().c_str());
  while (!interrupted()) wait_s(60);
  return 0;
}

}  // namespace

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
