// SPDX-License-Identifier: Apache-2.0
#include "tools/authoring/scene_page.h"

#include <chrono>
#include <nlohmann/json.hpp>
#include <random>

#include "core/io/json_text.h"
#include "tools/authoring/difficulty_json.h"
#include "tools/authoring/placed_file.h"
#include "tools/authoring/sensor_picture.h"
#include "tools/report/report_page.h"
#include "tools/shell.h"

namespace fringeslam::tools {

namespace {

constexpr auto kLongestWait = std::chrono::seconds(5);  // for a change
constexpr uint32_t kSeeds = 1'000'000;                  // seeds drawn are easy to type
constexpr auto kTurn = std::chrono::milliseconds(10);   // between looks whether a waiting viewer left

std::optional<SensorPicture> picture_of(const std::string& file) {
  for (const auto& [kind, name] : choices(SensorPicture())) {
    if (file == name + std::string(".png")) return kind;
  }
  return std::nullopt;
}

// Answers with the content of this name; 204 if the newest scene has none.
PageAnswer named(std::string_view name, const std::map<std::string, std::string>& contents, const char* type) {
  if (name.size() != 16 || name.find_first_not_of("0123456789abcdef") != std::string_view::npos) return {};
  const auto found = contents.find(std::string(name));
  return found == contents.end() ? PageAnswer{204, {}} : PageAnswer::of(found->second, type);
}

}  // namespace

ScenePage::ScenePage(std::string scene, SceneVariant variant, LiveAccess access)
    : name_(std::move(scene)),
      variant_(std::move(variant)),
      scene_(scene_file(name_), variant_.reading()),
      difficulty_(scene_),
      server_(std::move(access), "--port", [this](const PageRequest& request) { return answer(request); },
              {.posts = true, .nice = 0}) {}

PageAnswer ScenePage::answer(const PageRequest& request) {
  const std::string_view path = request.path;
  if (request.is_post) {
    if (path == "/place") return place(request);
    if (path == "/value") return override_value(request);
    if (path != "/seed") return {405, {}};
    scene_.reseed(std::random_device()() % kSeeds);
    return PageAnswer::of("{}", "application/json");
  }
  if (path == "/") return PageAnswer::of(std::string(world_page()), "text/html; charset=utf-8");
  if (path == "/state") return state(request);
  if (path.starts_with("/view/")) return view(request);
  if (path == "/difficulty") return difficulty(request);
  const WatchedScene::State now = scene_.state();
  if (constexpr std::string_view kScene = "/scene/"; path.starts_with(kScene)) {
    const auto number = number_in<uint64_t>(path.substr(kScene.size()));
    if (!number) return {};
    return *number == now.scene_number ? PageAnswer::of(now.scene->data.json, "application/json") : PageAnswer{204, {}};
  }
  if (constexpr std::string_view kMesh = "/mesh/"; path.starts_with(kMesh))
    return named(path.substr(kMesh.size()), now.scene->data.meshes, "application/octet-stream");
  if (constexpr std::string_view kTile = "/tile/"; path.starts_with(kTile))
    return named(path.substr(kTile.size()), now.scene->data.tiles, "image/png");
  return {};
}

PageAnswer ScenePage::place(const PageRequest& request) {
  Eigen::Vector3d position_m;
  for (int i = 0; i < 3; ++i) {
    const auto value = number_in<double>(request.parameter(std::string(1, "xyz"[i])));
    if (!value) return {400, {}};
    position_m[i] = *value;
  }
  const std::string path = request.parameter("path");
  std::string error;
  try {
    const std::lock_guard lock(placing_);
    const std::filesystem::path folder = scene_.file().parent_path();
    create_placed(folder);
    if (!scene_.state().placeable)
      throw Error(scene_.file().string() + ": add `include: " + kPlacedFile +
                  "`, or the name to its list of includes; " + "what is dragged is stored there");
    tools::place(folder, path, position_m);
  } catch (const Error& refusal) {
    error = refusal.what();
  }
  return PageAnswer::of(json_text(nlohmann::ordered_json{{"error", error}}), "application/json");
}

PageAnswer ScenePage::override_value(const PageRequest& request) {
  constexpr size_t kLongest = 1000;
  const std::string path = request.parameter("path"), value = request.parameter("value");
  if (path.empty() || path.size() > kLongest || value.size() > kLongest) return {400, {}};
  scene_.change_value(path, value.empty() ? std::nullopt : std::optional(value));
  return PageAnswer::of("{}", "application/json");
}

std::string ScenePage::command(const WatchedScene::State& state) const {
  std::string text =
      "fringeslam scene open " + shell_word(name_) + " --seed " + std::to_string(state.scene->scene.seed);
  for (const std::string& change : variant_.with) text += " --with " + shell_word(change);
  for (const auto& [path, value] : state.changes) text += " --with " + shell_word(path + "=" + value);
  return text;
}

PageAnswer ScenePage::state(const PageRequest& request) {
  WatchedScene::State state = scene_.state();
  if (const std::string since = request.parameter("since"); !since.empty()) {
    const auto number = number_in<uint64_t>(since);
    if (!number) return {400, {}};
    const Waiting waiting(waiting_);
    if (waiting.place > kViewers) return {503, {}};
    state = scene_.await_change(*number, kLongestWait, request.given_up);
  }
  return PageAnswer::of(json_text(nlohmann::ordered_json{{"number", state.number},
                                                         {"scene", state.scene_number},
                                                         {"error", state.error},
                                                         {"loading", state.loading},
                                                         {"changes", state.changes},
                                                         {"command", command(state)}}),
                        "application/json");
}

PageAnswer ScenePage::difficulty(const PageRequest& request) {
  const auto number = number_in<uint64_t>(request.parameter("scene"));
  const auto known = number_in<size_t>(request.parameter("known"));
  if (!number || !known) return {400, {}};
  const Waiting waiting(waiting_for_difficulty_);
  if (waiting.place > kViewers) return {503, {}};
  const DifficultyRun::State state = difficulty_.await_more(*number, *known, kLongestWait, request.given_up);
  const WatchedScene::State now = scene_.state();
  if (*number != now.scene_number) return {204, {}};
  nlohmann::ordered_json views = nlohmann::ordered_json::array();
  const bool begun = state.scene_number == *number;
  for (size_t i = *known; begun && i < state.views.size(); ++i) views.push_back(difficulty_json(state.views[i]));
  return PageAnswer::of(
      json_text(nlohmann::ordered_json{{"total", assessed_views(now.scene->scene, DifficultyRun::kMost)},
                                       {"done", begun && state.done},
                                       {"error", begun ? state.error : ""},
                                       {"views", views}}),
      "application/json");
}

PageAnswer ScenePage::view(const PageRequest& request) {
  const auto kind = picture_of(request.path.substr(std::string_view("/view/").size()));
  if (!kind) return {};
  const auto place = number_in<size_t>(request.parameter("place"));
  const std::string size = request.parameter("size"), wanted = request.parameter("pattern");
  const auto pattern = *kind == SensorPicture::pattern ? number_in<size_t>(wanted) : size_t{0};
  const bool reduced = size == "reduced";
  if (!place || !pattern || (!reduced && size != "full")) return {400, {}};
  const auto number = number_in<uint64_t>(request.parameter("scene"));
  if (!number) return {400, {}};
  const WatchedScene::State now = scene_.state();
  if (*number != now.scene_number) return {204, {}};
  ShownScene& shown = *now.scene;
  if (*place >= shown.data.path.size()) return {};
  if (*kind == SensorPicture::pattern && *pattern >= shown.scene.patterns.patterns.size()) return {};

  const Waiting waiting(renderings_);
  if (waiting.place > kRenderings) return {503, {}};
  std::unique_lock turn(rendering_, kTurn);
  while (!turn.owns_lock() && !request.given_up()) (void)turn.try_lock_for(kTurn);
  if (!turn.owns_lock()) return {503, {}};
  return PageAnswer::of(sensor_picture(shown.view, shown.scene, *kind, *pattern,
                                       shown.data.path[*place].world_from_robot, reduced, request.given_up),
                        "image/png");
}

}  // namespace fringeslam::tools
