// SPDX-License-Identifier: Apache-2.0
// fringeslam scene list | check SCENE; the other subcommands of `scene` are in tools/scene_verbs.h
#include <algorithm>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>

#include "core/io/json_text.h"
#include "core/io/yaml.h"
#include "sim/scene_check.h"
#include "tools/authoring/difficulty.h"
#include "tools/authoring/difficulty_json.h"
#include "tools/authoring/scene_list.h"
#include "tools/live/live_option.h"
#include "tools/progress.h"
#include "tools/scene_verbs.h"
#include "tools/source.h"
#include "tools/verbs.h"

namespace fringeslam::tools {

namespace fs = std::filesystem;

namespace {

using Json = nlohmann::ordered_json;

int list(const fs::path& folder, const Common& common) {
  Json json = Json::array();
  for (const auto& [scene, description] : list_scenes(folder)) {
    json.push_back({{"scene", scene.string()}, {"description", description}});
    if (!common.json) std::printf("%-36s %s\n", single_line(scene.string()).c_str(), single_line(description).c_str());
  }
  if (common.json) std::printf("%s\n", json_text(json, 2).c_str());
  return 0;
}

// Prints all errors in the scene file, or else what each view sees.
int check(const fs::path& path, std::optional<uint64_t> seed, const Common& common) {
  std::vector<std::string> errors;
  const sim::Scene scene = sim::load_scene(scene_file(path), {seed, &errors});
  if (!errors.empty()) {
    if (common.json) std::printf("%s\n", json_text(Json{{"errors", errors}}, 2).c_str());
    for (const std::string& error : errors) std::fprintf(stderr, "fringeslam: %s\n", error.c_str());
    return 2;
  }
  const sim::SceneCheck result = [&] {
    Progress progress("checking", static_cast<int>(scene.trajectory.size()), common.quiet || common.json);
    return sim::check_scene(scene, [&] { progress.step(); });
  }();
  if (common.json) {
    Json views = Json::array();
    for (const sim::ViewCheck& view : result.views)
      views.push_back(
          {{"surface", view.surface}, {"lit", view.lit}, {"in_range", view.in_range}, {"overlap", view.overlap}});
    std::printf("%s\n",
                json_text(Json{{"scene", scene.name}, {"views", views}, {"warnings", result.warnings}}, 2).c_str());
    return 0;
  }
  for (const std::string& note : scene.notes) std::printf("%s\n", single_line(note).c_str());
  std::printf("%s, seed %llu: %zu objects, %zu views\n", single_line(scene.name).c_str(),
              static_cast<unsigned long long>(scene.seed), scene.objects.size(), result.views.size());
  std::printf("%-8s %10s %10s %10s %10s\n", "", "surface %", "lit %", "in range %", "overlap %");
  for (size_t i = 0; i < result.views.size(); ++i) {
    const sim::ViewCheck& view = result.views[i];
    std::printf("view %-3zu %10.1f %10.1f %10.1f %10.1f\n", i, 100 * view.surface, 100 * view.lit, 100 * view.in_range,
                100 * view.overlap);
  }
  for (const std::string& warning : result.warnings) std::printf("warning: %s\n", single_line(warning).c_str());
  return 0;
}

constexpr size_t kMostAssessed = 100;  // views

void print_difficulty(const ViewDifficulty& view) {
  const auto or_dash = [](const char* format, std::optional<double> value) {
    char text[32];
    std::snprintf(text, sizeof text, format, value.value_or(0));
    return value ? std::string(text) : std::string("-");
  };
  const auto scaled = [](std::optional<double> value, double factor) {
    return value ? std::optional(factor * *value) : value;
  };
  const auto norm = [](const std::optional<Eigen::Vector3d>& sigma) {
    return sigma ? std::optional(sigma->norm()) : std::nullopt;
  };
  std::printf("view %-3zu %8.2f %9.1f %11.1f %9s %10s %10s %10s %8.2f\n", view.view, view.time_s, 100 * view.in_range,
              100 * view.measured, or_dash("%.1f", scaled(view.sigma_m, 1e6)).c_str(),
              or_dash("%.1f", scaled(view.overlap, 100)).c_str(),
              or_dash("%.2f", scaled(norm(view.translation_m), 1e6)).c_str(),
              or_dash("%.4f", scaled(norm(view.rotation_rad), 1e3)).c_str(), view.step_px);
  for (const std::string& reason : view.reason) {
    if (!reason.empty()) std::printf("  difficult: %s\n", reason.c_str());
  }
  std::fflush(stdout);
}

// Prints how difficult the views are for the mapper.
int assess(const fs::path& path, std::optional<uint64_t> seed, const Common& common) {
  const sim::Scene scene = sim::load_scene(scene_file(path), {seed});
  sim::SensorView sensor(scene);
  if (!common.json)
    std::printf("%-8s %8s %9s %11s %9s %10s %10s %10s %8s\n", single_line(scene.name).c_str(), "time s", "in range %",
                "measured %", "sigma um", "overlap %", "bound um", "bound mrad", "px/image");
  Json views = Json::array();
  assess_difficulty(scene, sensor, kMostAssessed, [&](const ViewDifficulty& view) {
    if (common.json)
      views.push_back(difficulty_json(view));
    else
      print_difficulty(view);
  });
  if (common.json)
    std::printf("%s\n", json_text(Json{{"scene", scene.name}, {"seed", scene.seed}, {"views", views}}, 2).c_str());
  return 0;
}

Verb add_list(Command group, const Common& common) {
  struct ListArguments {
    std::string folder = "scenes";
#if FRINGESLAM_REPORT
    LiveOption page;
#endif
  };
  auto arguments = std::make_shared<ListArguments>();
  const Command verb = group.add_subcommand("list", "List the scenes of a folder");
  verb.add_option("--in", arguments->folder, "Folder of scenes").capture_default_str();
#if FRINGESLAM_REPORT
  add_page_option(verb, "--page", arguments->page,
                  "Show them on a web page, until Ctrl-C, where they can be opened and where a mesh becomes a scene");
  return [arguments, &common] {
    LiveOption& page = arguments->page;
    if (!page.port) return list(arguments->folder, common);
    page.access.port = *page.port;
    return show_gallery(arguments->folder, page.access);
  };
#else
  return [arguments, &common] { return list(arguments->folder, common); };
#endif
}

Verb add_check(Command group, const Common& common) {
  struct SceneArguments {
    std::string scene;
    std::optional<uint64_t> seed;
    bool difficulty = false;
  };
  auto arguments = std::make_shared<SceneArguments>();
  const Command verb = group.add_subcommand("check", "Print all errors in a scene file, or what each view sees");
  verb.add_option("scene", arguments->scene, "Scene file, or a folder with scene.yaml").required();
  verb.add_option("--seed", arguments->seed, "Seed; overrides the scene's").check_non_negative();
  verb.add_flag(
      "--difficulty", arguments->difficulty,
      "Print how difficult the views are for the mapper, and why: range, depth, overlap, motion, repetition, speed");
  return [arguments, &common] {
    return arguments->difficulty ? assess(arguments->scene, arguments->seed, common)
                                 : check(arguments->scene, arguments->seed, common);
  };
}

}  // namespace

Verb add_scene(Command app, const Common& common) {
  const Command group = app.add_subcommand("scene", "Create and inspect test scenes");
  group.require_subcommand(1);
  std::vector<std::pair<Command, Verb>> verbs;
  for (const auto add : {
         add_list, add_scene_new, add_check, add_scene_preview,
#if FRINGESLAM_REPORT
             add_scene_open,
#endif
             add_scene_export, add_scene_generate
       }) {
    Verb verb = add(group, common);
    verbs.emplace_back(group.subcommands().back(), std::move(verb));
  }
  return [verbs] {
    for (const auto& [verb, run] : verbs) {
      if (verb.parsed()) return run();
    }
    return 0;
  };
}

}  // namespace fringeslam::tools
