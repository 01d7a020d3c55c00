// SPDX-License-Identifier: Apache-2.0
// Victims in generated rubble: found by the thermal camera, and warm things that are none.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "bench/row.h"
#include "core/pipeline/pipeline.h"
#include "core/score/victim_score.h"
#include "sim/virtual_rig.h"

namespace fringeslam::bench {

namespace {

// The gates were set on seeds from 1001 on; these are others.
constexpr uint64_t kFirstSeed = 1;

struct Searched {
  VictimScore score;
  std::map<std::string, int> shown;   // warm things that are no victims and show, by their material
  std::map<std::string, int> wrong;   // of those, taken for a victim
  std::vector<std::string> failures;  // in words
};

// The material of what most pixels of a region show.
std::string commonest_material(const sim::Scene& scene, const TruthFrame& truth, const cv::Mat1i& regions, int number) {
  std::map<std::string, int> counts;
  for (int i = 0; i < static_cast<int>(regions.total()); ++i) {
    const int object = static_cast<int>(truth.object_id(i));
    if (regions(i) == number && object > 0) ++counts[scene.objects[static_cast<size_t>(object - 1)].material.name];
  }
  const auto most =
      std::max_element(counts.begin(), counts.end(), [](const auto& a, const auto& b) { return a.second < b.second; });
  return most == counts.end() ? "nothing" : most->first;
}

Searched search(uint64_t seed) {
  const sim::Scene scene = sim::load_scene(std::string(FRINGESLAM_SCENES) + "/victims/scene.yaml", {seed});
  std::vector<TruthFrame> truth;
  sim::VirtualRig rig(scene, {}, [&](const TruthFrame& frame) { truth.push_back(frame); });
  Pipeline pipeline(rig.model(), scene.patterns, {}, scene.trajectory[0].world_from_robot);
  Searched result;
  VisibleVictims visible;
  std::vector<cv::Mat1i> regions;
  char line[512];
  while (const auto stack = rig.capture(scene.patterns)) {
    const FrameResult view = pipeline.process(*stack);
    visible.add(truth.back(), scene.rig.camera);
    regions.push_back(view.warm.regions);
    if (view.tracking == Tracking::lost) result.failures.push_back("a view was lost");
    if (std::getenv("VICTIMS_DUMP")) {
      for (size_t i = 0; i < view.warm.list.size(); ++i) {
        const WarmRegion& r = view.warm.list[i];
        if (r.pixels < 60) continue;
        std::printf("R seed %d view %d %s %s planar %.2f pipe %.2f : %s\n", static_cast<int>(seed), stack->index,
                    commonest_material(scene, truth.back(), regions.back(), static_cast<int>(i)).c_str(),
                    to_string(r.kind).c_str(), r.planar_share, r.pipe_share, r.reason.c_str());
      }
    }
  }
  const std::vector<WarmThing> things = pipeline.warm_things();
  std::vector<Eigen::Vector3d> candidates;
  std::vector<const WarmThing*> victims;
  for (const WarmThing& thing : things) {
    if (thing.victim) victims.push_back(&thing), candidates.push_back(thing.position_m);
  }
  result.score = score_victims(visible, candidates);
  const auto material_of = [&](const WarmThing& thing) {
    const auto view = static_cast<size_t>(thing.best_view);
    return commonest_material(scene, truth[view], regions[view], thing.best_region);
  };
  for (const WarmThing& thing : things) ++result.shown[material_of(thing)];
  for (const size_t i : result.score.wrong) {
    const std::string material = material_of(*victims[i]);
    ++result.wrong[material];
    std::snprintf(line, sizeof line, "%s taken for a victim in %d of %d views: %s", material.c_str(),
                  victims[i]->skin_views, victims[i]->views, victims[i]->reason.c_str());
    result.failures.push_back(line);
  }
  for (const int object : result.score.missed) {
    std::snprintf(line, sizeof line, "%s missed, which shows %.0f cm2",
                  scene.objects[static_cast<size_t>(object - 1)].material.name.c_str(),
                  1e4 * visible.all().at(object).area_m2);
    result.failures.push_back(line);
    // What was thought of what lies there.
    for (const WarmThing& thing : things) {
      for (const Eigen::Vector3d& p : visible.all().at(object).points_m) {
        if ((p - thing.position_m).norm() > 0.05) continue;
        result.failures.push_back("  taken for: " + thing.reason);
        break;
      }
    }
  }
  return result;
}

std::vector<Row> victim_rows(const Context& context) {
  uint64_t first = kFirstSeed;
  int count = context.quick ? 15 : 120;
  if (const char* tune = std::getenv("VICTIMS_TUNE")) first = 1001, count = std::atoi(tune);
  int to_find = 0, found = 0, candidates = 0, right = 0;
  std::map<std::string, int> shown, wrong;
  for (int i = 0; i < count; ++i) {
    const uint64_t seed = first + static_cast<uint64_t>(i);
    const Searched s = search(seed);
    to_find += s.score.to_find;
    found += s.score.found;
    candidates += s.score.candidates;
    right += s.score.right;
    for (const auto& [material, n] : s.shown) shown[material] += n;
    for (const auto& [material, n] : s.wrong) wrong[material] += n;
    for (const std::string& failure : s.failures)
      std::fprintf(stderr, "  seed %d: %s\n", static_cast<int>(seed), failure.c_str());
  }
  for (const auto& [material, n] : shown)
    std::fprintf(stderr, "  %-12s %4d warm things, %d of them wrongly taken for a victim\n", material.c_str(), n,
                 wrong[material]);
  return {bound_row("victim.recall", static_cast<double>(found) / to_find, to_find, "", 0.95, Limit::least),
          bound_row("victim.precision", static_cast<double>(right) / candidates, candidates, "", 0.9, Limit::least)};
}

}  // namespace

std::vector<Item> victim_items() {
  return {{{"victim.recall", "victim.precision"},
           "victims in 120 heaps of rubble among warm things that are none, by the thermal camera",
           victim_rows}};
}

}  // namespace fringeslam::bench
