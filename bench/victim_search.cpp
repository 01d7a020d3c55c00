// SPDX-License-Identifier: Apache-2.0
#include "bench/victim_search.h"

#include <algorithm>
#include <atomic>
#include <cstdio>
#include <limits>
#include <optional>
#include <thread>

#include "core/mapper/pipeline.h"
#include "core/mapper/thermal_observer.h"
#include "core/score/score.h"
#include "core/types/error.h"
#include "sim/virtual_rig.h"

namespace fringeslam::bench {

namespace {

using Changes = std::vector<std::pair<std::string, std::string>>;

sim::Scene load(uint64_t seed, const Changes& changes) {
  sim::SceneLoadOptions reading{seed};
  reading.changes = changes;
  return sim::load_scene(std::string(FRINGESLAM_SCENES) + "/victims/scene.yaml", reading);
}

const std::string& material_of(const sim::Scene& scene, int object) {
  return scene.objects[static_cast<size_t>(object - 1)].material.name;
}

// Returns the material of most pixels of a region, from ground truth.
std::string shown_material(const sim::Scene& scene, const TruthFrame& truth, const cv::Mat1i& regions, int number) {
  std::map<std::string, int> counts;
  for (int row = 0; row < regions.rows; ++row) {
    for (int col = 0; col < regions.cols; ++col) {
      const int object = static_cast<int>(truth.object_id(row, col));
      if (regions(row, col) == number && object > 0) ++counts[material_of(scene, object)];
    }
  }
  const auto most =
      std::max_element(counts.begin(), counts.end(), [](const auto& a, const auto& b) { return a.second < b.second; });
  return most == counts.end() ? "nothing" : most->first;
}

double valid_share(const FrameResult& view, const TruthFrame& truth) {
  cv::Mat1f depth;
  cv::extractChannel(view.frame.points_m, depth, 2);
  return score_depth({depth, view.frame.sigma_m, view.decoded.coordinate_px}, truth, view.decoded.finest_period_px)
      .valid_fraction;
}

}  // namespace

VictimSearchResult search_for_victims(uint64_t seed, const Changes& changes) {
  const sim::Scene scene = load(seed, changes);
  std::vector<TruthFrame> truth;
  sim::VirtualRig rig(scene, {});
  Pipeline pipeline(rig.model(), scene.patterns, {}, scene.trajectory[0].world_from_robot);
  ThermalObserver thermal(rig.model(), {});
  VictimSearchResult result;
  VisibleVictims visible;
  std::vector<cv::Mat1i> regions;
  std::optional<Pose> last;
  while (const auto simulated = rig.simulate(scene.patterns)) {
    truth.push_back(simulated->truth);
    const FrameResult view = pipeline.process(simulated->stack);
    visible.add(truth.back(), scene.rig.camera, truth.back().world_from_robot * scene.rig.robot_from_camera);
    regions.push_back(thermal.observe(simulated->stack, view).warm.regions);
    result.valid = std::min(result.valid, valid_share(view, truth.back()));
    ++result.views;
    if (!has_pose(view.tracking)) {
      last.reset();
      continue;
    }
    ++result.tracked;
    if (last) {
      const Pose true_motion = truth[truth.size() - 2].world_from_robot.inverse() * truth.back().world_from_robot;
      result.translations_m.push_back(
          score_motion(last->inverse() * view.world_from_robot, true_motion).translation_error_m);
    }
    last = view.world_from_robot;
  }

  const std::vector<WarmObject> things = thermal.warm_objects(pipeline.mapper());
  const auto shown = [&](const WarmObject& thing) {
    const auto view = static_cast<size_t>(thing.best_view);
    return shown_material(scene, truth[view], regions[view], thing.best_region);
  };
  std::vector<VictimCandidate> candidates;
  std::vector<const WarmObject*> victims;
  for (const WarmObject& thing : things) {
    ++result.things[shown(thing)];
    if (!thing.victim) continue;
    victims.push_back(&thing);
    candidates.push_back(thing.points_m);
  }
  result.score = score_victims(visible, candidates);
  char line[512];
  for (const size_t i : result.score.wrong) {
    const std::string material = shown(*victims[i]);
    ++result.wrong[material];
    std::snprintf(line, sizeof line, "%s mistaken for a victim in %d of %d views: %s", material.c_str(),
                  victims[i]->skin_views, victims[i]->views, victims[i]->reason.c_str());
    result.failures.push_back(line);
  }
  for (const int object : result.score.missed) {
    std::snprintf(line, sizeof line, "%s missed, %.0f cm2 visible", material_of(scene, object).c_str(),
                  1e4 * visible.all().at(object).area_m2);
    result.failures.push_back(line);
  }
  if (result.tracked < result.views) result.failures.push_back("a view was lost");
  return result;
}

void prepare_victim_scenes(uint64_t first_seed, int count) {
  std::atomic<int> next = 0;
  const auto work = [&] {
    for (int i = next++; i < count; i = next++) {
      try {
        load(first_seed + static_cast<uint64_t>(i), {});
      } catch (const Error&) {  // reported when it is searched
      }
    }
  };
  std::thread other(work);
  work();
  other.join();
}

}  // namespace fringeslam::bench
