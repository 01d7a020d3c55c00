// SPDX-License-Identifier: Apache-2.0
// All named scenes through the whole pipeline.
#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <thread>

#include "bench/row.h"
#include "core/mapper/pipeline.h"
#include "core/score/score.h"
#include "core/types/error.h"
#include "sim/scene_check.h"
#include "sim/virtual_rig.h"

namespace fringeslam::bench {

namespace {

namespace fs = std::filesystem;

std::vector<std::string> named_scenes() {
  std::vector<std::string> names;
  for (const auto& entry : fs::directory_iterator(FRINGESLAM_SCENES)) {
    if (fs::exists(entry.path() / "scene.yaml")) names.push_back(entry.path().filename().string());
  }
  std::sort(names.begin(), names.end());
  return names;
}

// True for calibration scenes: their fringes have no absolute depth, or they show a board with repetitive corners.
bool for_calibration(const std::string& name) {
  return fs::exists(fs::path(FRINGESLAM_SCENES) / name / "board.yaml") || name == "response_ramp";
}

struct Outcome {
  int views = 0, lost = 0;
  double valid = 1;          // smallest fraction of lit pixels with depth
  double depth_m = 0;        // median depth error of the worst view
  double translation_m = 0;  // largest motion error
};

Outcome run(const std::string& name) {
  const sim::Scene scene = sim::load_scene(std::string(FRINGESLAM_SCENES) + "/" + name + "/scene.yaml");
  sim::VirtualRig rig(scene, {});
  Pipeline pipeline(scene.rig, scene.patterns, {}, scene.trajectory[0].world_from_robot);
  Outcome outcome;
  std::optional<Pose> last, last_truth;
  while (const auto view = rig.simulate(scene.patterns)) {
    const FrameResult result = pipeline.process(view->stack);
    cv::Mat1f z;
    cv::extractChannel(result.frame.points_m, z, 2);
    const DepthScore depth = score_depth({z, result.frame.sigma_m, result.decoded.coordinate_px}, view->truth,
                                         result.decoded.finest_period_px);
    outcome.valid = std::min(outcome.valid, depth.valid_fraction);
    outcome.depth_m = std::max(outcome.depth_m, depth.median_m);
    ++outcome.views;
    if (!has_pose(result.tracking)) {
      ++outcome.lost;
      last.reset();
      continue;
    }
    if (last) {
      const Pose true_motion = last_truth->inverse() * view->truth.world_from_robot;
      const MotionScore score = score_motion(last->inverse() * result.world_from_robot, true_motion);
      outcome.translation_m = std::max(outcome.translation_m, score.translation_error_m);
    }
    last = result.world_from_robot;
    last_truth = view->truth.world_from_robot;
  }
  return outcome;
}

std::vector<Row> score_rows(const Context&) {
  int failed = 0, count = 0;
  std::fprintf(stderr, "  %-26s %6s %6s %8s %10s %10s\n", "scene", "views", "lost", "valid %", "depth mm", "motion mm");
  for (const std::string& name : named_scenes()) {
    if (for_calibration(name)) continue;
    ++count;
    const Outcome o = run(name);
    const bool good = o.lost == 0 && o.valid > 0.8 && o.translation_m < 1e-3;
    failed += !good;
    std::fprintf(stderr, "  %-26s %6d %6d %8.2f %10.4f %10.4f %s\n", name.c_str(), o.views, o.lost, 100 * o.valid,
                 1e3 * o.depth_m, 1e3 * o.translation_m, good ? "" : "FAILED");
  }
  return {bound_row("worlds.scores", failed, count, "failed", 0, Limit::most)};
}

// Returns what is wrong with a generated scene: warnings of its check, saturation, errors.
std::vector<std::string> problems_of(const fs::path& file, uint64_t seed) try {
  const sim::Scene scene = sim::load_scene(file, {seed});
  std::vector<std::string> found = sim::check_scene(scene).warnings;
  sim::VirtualRig rig(scene, {});
  const auto stack = rig.capture(scene.patterns);
  int saturated = 0, total = 0;
  const int white = (1 << scene.rig.sensor.bits) - 1;
  for (const cv::Mat& image : stack->images) {
    saturated += cv::countNonZero(image >= white);
    total += static_cast<int>(image.total());
  }
  if (saturated > total / 20) found.push_back("more than 5 % of the pixels are saturated");
  return found;
} catch (const Error& e) {
  return {e.what()};
}

// Settles the piles, two at a time, so that they are in the cache; their errors are reported by the check.
void settle_all(const fs::path& file, int count) {
  std::atomic<int> next = 1;
  const auto work = [&] {
    for (int seed = next++; seed <= count; seed = next++) {
      try {
        sim::load_scene(file, {static_cast<uint64_t>(seed)});
      } catch (const Error&) {
      }
    }
  };
  std::thread other(work);
  work();
  other.join();
}

std::vector<Row> generated_rows(const Context& context) {
  const fs::path file = fs::path(FRINGESLAM_SCENES) / "rubble_pile/scene.yaml";
  const int count = context.quick ? 20 : 200;
  settle_all(file, count);
  int warned = 0;
  for (int seed = 1; seed <= count; ++seed) {
    const std::vector<std::string> found = problems_of(file, static_cast<uint64_t>(seed));
    warned += !found.empty();
    for (const std::string& complaint : found) std::fprintf(stderr, "  seed %d: %s\n", seed, complaint.c_str());
  }
  return {bound_row("worlds.generated", warned, count, "warned", 0, Limit::most)};
}

}  // namespace

std::vector<Item> world_items() {
  return {{{"worlds.scores"}, "all named scenes through the whole pipeline", score_rows},
          {{"worlds.generated"}, "200 rubble piles, checked and rendered", generated_rows}};
}

}  // namespace fringeslam::bench
