// SPDX-License-Identifier: Apache-2.0
#include "tools/authoring/scene_page.h"

#include <chrono>

#include "tools/authoring/sensor_picture.h"
#include "tools/report/report_page.h"

namespace fringeslam::tools {

namespace {

constexpr auto kTurn = std::chrono::milliseconds(10);  // between looks whether a waiting viewer left

std::optional<SensorPicture> picture_of(const std::string& file) {
  for (const auto& [kind, name] : choices(SensorPicture())) {
    if (file == name + std::string(".png")) return kind;
  }
  return std::nullopt;
}

}  // namespace

ScenePage::ScenePage(sim::Scene scene, LiveAccess access)
    : scene_(std::move(scene)),
      data_(scene_data(scene_)),
      view_(scene_),
      server_(std::move(access), "--port", [this](const PageRequest& request) { return answer(request); }) {}

PageAnswer ScenePage::answer(const PageRequest& request) {
  if (request.path == "/") return PageAnswer::of(std::string(world_page()), "text/html; charset=utf-8");
  if (request.path == "/scene") return PageAnswer::of(data_.json, "application/json");
  if (request.path.starts_with("/view/")) return view(request);
  constexpr std::string_view kMesh = "/mesh/";
  if (!request.path.starts_with(kMesh)) return {};
  const auto number = number_in<size_t>(std::string_view(request.path).substr(kMesh.size()));
  if (!number || *number >= data_.meshes.size()) return {};
  return PageAnswer::of(data_.meshes[*number], "application/octet-stream");
}

PageAnswer ScenePage::view(const PageRequest& request) {
  const auto kind = picture_of(request.path.substr(std::string_view("/view/").size()));
  if (!kind) return {};
  const auto place = number_in<size_t>(request.parameter("place"));
  const std::string size = request.parameter("size"), wanted = request.parameter("pattern");
  const auto pattern = *kind == SensorPicture::pattern ? number_in<size_t>(wanted) : size_t{0};
  const bool reduced = size == "reduced";
  if (!place || !pattern || (!reduced && size != "full")) return {400, {}};
  if (*place >= data_.path.size()) return {};
  if (*kind == SensorPicture::pattern && *pattern >= scene_.patterns.patterns.size()) return {};

  const Waiting waiting(renderings_);
  if (waiting.place > kRenderings) return {503, {}};
  std::unique_lock turn(rendering_, kTurn);
  while (!turn.owns_lock() && !request.given_up()) (void)turn.try_lock_for(kTurn);
  if (!turn.owns_lock()) return {503, {}};
  return PageAnswer::of(sensor_picture(view_, scene_.rig, *kind, *pattern, data_.path[*place].world_from_robot, reduced,
                                       request.given_up),
                        "image/png");
}

}  // namespace fringeslam::tools
