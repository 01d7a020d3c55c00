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
#include "core/rig/files.h"
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
    if (const char* at = std::getenv("VICTIMS_PICTURES")) {
      cv::Mat3b p(view.frame.texture.size());
      for (int i = 0; i < (int)p.total(); ++i) {
        const float t = view.frame.temperature_c(i); const int g = view.frame.texture(i); const int r = view.warm.regions(i);
        p(i) = r >= 0 ? (view.warm.list[r].candidate() ? cv::Vec3b(g/2, g/2, 255) : cv::Vec3b(255, (r*67)%256, (r*31)%128)) : std::isnan(t) ? cv::Vec3b(80,0,0) : cv::Vec3b(g,g,g);
      }
      write_png(std::string(at) + "/" + std::to_string(seed) + "_" + std::to_string(stack->index) + ".png", p);
    }
    if (std::getenv("VICTIMS_DUMP")) {
      for (size_t i = 0; i < view.warm.list.size(); ++i) {
        const WarmRegion& r = view.warm.list[i];
        if (r.pixels < 60) continue;
        std::printf("R,%d,%d,%s,%s,%.2f,%.2f,%.1f,%.1f,%.1f,%.2f,%.1f,%.2f\n", static_cast<int>(seed), stack->index,
                    commonest_material(scene, truth.back(), regions.back(), static_cast<int>(i)).c_str(),
                    to_string(r.kind).c_str(), r.planar_share, r.pipe.share, 1e3 * r.pipe.radius_m,
                    1e3 * r.pipe.length_m, 1e3 * r.pipe.width_m, r.spread_c, 1e4 * r.area_m2, r.warmest_c);
      }
    }
  }
  const std::vector<WarmThing> things = pipeline.warm_things();
  if (std::getenv("VICTIMS_DUMP")) {
    for (const auto& t : things) std::printf("T,%d,%s,victim=%d,(%.3f %.3f %.3f),extent %.2f,views %d/%d,skin %.2f,%.0f cm2,%s\n", (int)seed, "", t.victim, t.position_m.x(), t.position_m.y(), t.position_m.z(), t.extent_m, t.skin_views, t.views, t.skin_share, 1e4*t.area_m2, t.reason.c_str());
    for (const auto& [o, v] : visible.all()) { Eigen::Vector3d m = Eigen::Vector3d::Zero(); for (auto& p : v.points_m) m += p / v.points_m.size(); std::printf("V,%d,%s,%.0f cm2,(%.3f %.3f %.3f)\n", (int)seed, scene.objects[o-1].material.name.c_str(), 1e4*v.area_m2, m.x(), m.y(), m.z()); }
    std::fflush(stdout);
  }
  std::vector<VictimCandidate> candidates;
  std::vector<const WarmThing*> victims;
  for (const WarmThing& thing : things) {
    if (thing.victim) victims.push_back(&thing), candidates.push_back(thing.points_m);
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
  if (const char* tune = std::getenv("VICTIMS_TUNE")) first = std::getenv("VICTIMS_FIRST") ? std::atoi(std::getenv("VICTIMS_FIRST")) : 1001, count = std::atoi(tune);
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
