// SPDX-License-Identifier: Apache-2.0
// A tour of scenes/mission, rendered view by view and mapped twice, with and without loop closure: cost per view, memory,
// drift, and relocalization anywhere in the map.

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <numbers>
#include <string>
#include <utility>

#include "bench/process_memory.h"
#include "bench/row.h"
#include "core/mapper/pipeline.h"
#include "core/score/pose_honesty.h"
#include "core/score/score.h"
#include "sim/random.h"
#include "sim/virtual_rig.h"

namespace fringeslam::bench {

namespace {

constexpr int kReported = 250;         // views between lines of the table
constexpr size_t kEarly = 100;         // views until buffers have their final size
constexpr double kLeastOverlap = 0.3;  // of dropped views that have to be located

struct ViewCost {
  double cpu_s = 0, wall_s = 0;
};

// Pages of the map's file are the kernel's to keep or to drop; only the others are memory that the process needs.
double resident_mib() { return process_memory_mib("RssAnon"); }

double elapsed_s(std::chrono::steady_clock::time_point since) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - since).count();
}

sim::Scene loaded_mission(std::vector<std::pair<std::string, std::string>> changes) {
  sim::SceneLoadOptions reading;
  reading.changes = std::move(changes);
  return sim::load_scene(std::string(FRINGESLAM_SCENES) + "/mission/scene.yaml", reading);
}

// Adds the way back, 5 cm higher, to the tour.
void return_on_the_same_path(sim::Scene& scene) {
  const Trajectory higher = loaded_mission({{"trajectory.tour.height_m", "1.0"}}).trajectory;
  const double last_s = scene.trajectory.back().timestamp_s;
  for (auto pose = higher.rbegin(); pose != higher.rend(); ++pose)
    scene.trajectory.push_back({2 * last_s + 1 - pose->timestamp_s, pose->world_from_robot});
}

// Maps each stack and notes what that costs, and how far the pose has drifted.
class Explorer {
 public:
  Explorer(const sim::Scene& scene, const PipelineOptions& options)
      : pipeline_(scene.rig, scene.patterns, options, scene.trajectory[0].world_from_robot) {}

  void process(const FringeStack& stack, const Pose& truth) {
    const std::clock_t cpu = std::clock();
    const auto start = std::chrono::steady_clock::now();
    const FrameResult result = pipeline_.process(stack);
    costs_.push_back({static_cast<double>(std::clock() - cpu) / CLOCKS_PER_SEC, elapsed_s(start)});
    lost_ += !has_pose(result.tracking);
    loops_ += result.loops;
    corrections_ += result.corrected;
    if (!has_pose(result.tracking)) return;
    const Pose error = truth.inverse() * result.world_from_robot;
    drift_m_ = translation_m(error);
    drift_rad_ = rotation_rad(error);
  }

  Pipeline& pipeline() { return pipeline_; }
  const std::vector<ViewCost>& costs() const { return costs_; }
  int lost() const { return lost_; }
  int loops() const { return loops_; }
  int corrections() const { return corrections_; }
  double drift_m() const { return drift_m_; }
  double drift_rad() const { return drift_rad_; }

  // Root mean square error of all robot positions, given the final map.
  double ate_m(const Trajectory& truth) const {
    double squares = 0;
    size_t k = 0;
    const Trajectory poses = pipeline_.trajectory();
    for (const TimedPose& pose : poses) {
      while (truth[k].timestamp_s < pose.timestamp_s - 1e-6) ++k;
      squares += (pose.world_from_robot.translation - truth[k].world_from_robot.translation).squaredNorm();
    }
    return std::sqrt(squares / static_cast<double>(poses.size()));
  }

 private:
  Pipeline pipeline_;
  std::vector<ViewCost> costs_;
  int lost_ = 0, loops_ = 0, corrections_ = 0;
  double drift_m_ = 0, drift_rad_ = 0;
};

double mean_cpu_s(const std::vector<ViewCost>& costs, size_t first, size_t end) {
  double sum = 0;
  for (size_t i = first; i < end; ++i) sum += costs[i].cpu_s;
  return sum / static_cast<double>(end - first);
}

// Returns the true pose of a keyframe's camera. `truth` is that of the tour.
Pose true_camera(const KeyframeMap& map, const Trajectory& truth, int keyframe) {
  const auto index = static_cast<size_t>(map.keyframes()[static_cast<size_t>(keyframe)].index);
  return truth[index].world_from_robot * map.rig().robot_from_camera;
}

// Prints the NEES of the map's links, 6 for exact covariances, by the distance between the cameras.
void report_links(const KeyframeMap& map, const Trajectory& truth) {
  constexpr double kBin_m = 0.2;
  constexpr int kBins = 5;
  for (const bool loops : {false, true}) {
    std::vector<double> nees[kBins];
    for (const PoseEdge& link : map.links()) {
      if (link.loop != loops) continue;
      const Pose motion = true_camera(map, truth, link.from).inverse() * true_camera(map, truth, link.to);
      const Vector6d error = difference(link.from_from_to, motion);
      nees[std::min(kBins - 1, static_cast<int>(translation_m(motion) / kBin_m))].push_back(
          error.dot(link.information * error));
    }
    for (int i = 0; i < kBins; ++i) {
      if (nees[i].empty()) continue;
      double sum = 0;
      for (const double value : nees[i]) sum += value;
      std::fprintf(stderr, "  %s links of views from %.1f m apart: %zu, NEES %.1f, median %.1f\n",
                   loops ? "loop" : "other", i * kBin_m, nees[i].size(), sum / static_cast<double>(nees[i].size()),
                   median_of(nees[i]));
    }
  }
}

struct Relocations {
  int located = 0, ambiguous = 0, lost = 0, wrong = 0;
  int unseen = 0;  // without a pose, and no keyframe sees enough of the view
  std::vector<double> wall_s;
};

// Returns the largest share of a view's points that a keyframe sees as well.
double largest_overlap(const KeyframeMap& map, const Trajectory& truth, const Frame& frame,
                       const Pose& world_from_camera) {
  double largest = 0;
  for (int k = 0; k < static_cast<int>(map.keyframes().size()); ++k) {
    // The map drifts, so that the view is placed relative to each keyframe.
    const Keyframe& keyframe = map.keyframes()[static_cast<size_t>(k)];
    const Pose keyframe_from_view = true_camera(map, truth, k).inverse() * world_from_camera;
    if (map.view_change(keyframe_from_view) > 2) continue;
    largest = std::max(largest, map.expected_overlap(frame, keyframe.world_from_camera * keyframe_from_view, k));
  }
  return largest;
}

// Drops the robot at random places of the tour, 10 cm higher and with another view of the floor than when it was mapped.
Relocations relocate(const KeyframeMap& map, const Trajectory& truth, int drops) {
  sim::Scene scene = loaded_mission({{"trajectory.tour.height_m", "1.05"}, {"trajectory.tour.ahead_m", "0.45"}});
  const Trajectory tour = std::exchange(scene.trajectory, {});
  sim::Philox random(1, sim::Stream::views, 0);
  const auto known = std::min(truth.size(), tour.size());
  for (int i = 0; i < drops; ++i)
    scene.trajectory.push_back(
        {static_cast<double>(i),
         tour[static_cast<size_t>(random.uniform() * static_cast<double>(known))].world_from_robot});
  sim::VirtualRig rig(scene, {});
  Relocations result;
  for (int i = 0; i < drops; ++i) {
    Pipeline pipeline(map, scene.patterns, {});
    const std::optional<FringeStack> stack = rig.capture(scene.patterns);
    const auto start = std::chrono::steady_clock::now();
    const FrameResult found = pipeline.process(*stack);
    result.wall_s.push_back(elapsed_s(start));
    const Pose world_from_camera =
        scene.trajectory[static_cast<size_t>(i)].world_from_robot * scene.rig.robot_from_camera;
    if (!has_pose(found.tracking)) {
      const double overlap = largest_overlap(map, truth, found.frame, world_from_camera);
      std::fprintf(
          stderr,
          "  drop %d: %s, overlap with a keyframe at most %.2f; %zu keypoints, %zu landmarks, %zu re-identified\n", i,
          std::string(to_string(found.tracking)).c_str(), overlap, found.keypoints.keypoints.size(),
          found.landmarks.landmarks.size(), found.recognitions.size());
      if (found.tracking == Tracking::ambiguous)
        ++result.ambiguous;
      else
        ++(overlap < kLeastOverlap ? result.unseen : result.lost);
      continue;
    }
    // The map drifts, so the pose is compared with that of its keyframe.
    const Pose expected = true_camera(map, truth, found.reference).inverse() * world_from_camera;
    const PoseHonesty honesty =
        pose_honesty(found.registration.earlier_from_current, expected, found.covariance, scene.rig);
    const bool wrong = honesty.confidently_wrong();
    if (wrong)
      std::fprintf(stderr, "  drop %d: %.1f mm and %.1f sigmas off keyframe %d\n", i, 1e3 * honesty.off_m,
                   honesty.sigmas(), found.reference);
    ++(wrong ? result.wrong : result.located);
  }
  return result;
}

std::vector<Row> mission_rows(const Context& context) {
  sim::Scene scene = loaded_mission({});
  const size_t tour = scene.trajectory.size();
  return_on_the_same_path(scene);
  sim::VirtualRig rig(scene, {});
  PipelineOptions alone;
  alone.mapping.max_links = 0;
  Explorer closing(scene, {}), open(scene, alone);
  const int views = context.quick ? std::min<int>(500, context.last_case) : context.last_case;
  double path_m = 0, most_mib = 0, early_mib = 0;
  size_t early_keyframes = 0;
  // Counts the keyframes of both maps.
  const auto keyframes_so_far = [&] {
    return closing.pipeline().map().keyframes().size() + open.pipeline().map().keyframes().size();
  };
  const auto start = std::chrono::steady_clock::now();
  std::fprintf(stderr, "  %zu views; drift with loop closure and without\n", scene.trajectory.size());
  std::fprintf(stderr,
               "  views   path m  keyframes  links   MiB  ms/view  (cpu)   drift mm        deg           lost\n");
  const auto report = [&] {
    const auto& costs = closing.costs();
    const size_t last = costs.size(), first = last - std::min<size_t>(last, kReported);
    double wall_s = 0;
    for (size_t i = first; i < last; ++i) wall_s += costs[i].wall_s;
    const KeyframeMap& map = closing.pipeline().map();
    std::fprintf(stderr, "  %5zu %8.1f %10zu %6zu %5.0f %8.1f %6.1f %7.3f %9.3f %7.4f %9.4f %4d %d   (%.0f s)\n", last,
                 path_m, map.keyframes().size(), map.links().size(), resident_mib(),
                 1e3 * wall_s / static_cast<double>(last - first), 1e3 * mean_cpu_s(costs, first, last),
                 1e3 * closing.drift_m(), 1e3 * open.drift_m(), closing.drift_rad() * 180 / std::numbers::pi,
                 open.drift_rad() * 180 / std::numbers::pi, closing.lost(), open.lost(), elapsed_s(start));
  };
  Trajectory truth;
  const auto report_errors = [&] {
    const KeyframeMap& map = closing.pipeline().map();
    std::fprintf(stderr,
                 "  %.1f m: ATE %.3f mm with loop closure (%zu keyframes, %d links, %d corrections), %.3f mm without\n",
                 path_m, 1e3 * closing.ate_m(truth), map.keyframes().size(), closing.loops(), closing.corrections(),
                 1e3 * open.ate_m(truth));
  };
  while (static_cast<int>(truth.size()) < views) {
    const std::optional<FringeStack> stack = rig.capture(scene.patterns);
    if (!stack) break;
    truth.push_back(scene.trajectory[truth.size()]);
    if (truth.size() > 1)
      path_m += translation_m(truth[truth.size() - 2].world_from_robot.inverse() * truth.back().world_from_robot);
    closing.process(*stack, truth.back().world_from_robot);
    open.process(*stack, truth.back().world_from_robot);
    most_mib = std::max(most_mib, resident_mib());
    if (truth.size() == kEarly) {
      early_mib = resident_mib();
      early_keyframes = keyframes_so_far();
    }
    if (truth.size() % kReported == 0) report();
    if (truth.size() == tour) report_errors();
  }
  const double per_keyframe_mib =
      (resident_mib() - early_mib) / static_cast<double>(std::max<size_t>(1, keyframes_so_far() - early_keyframes));
  if (truth.size() % kReported != 0) report();
  const int n = static_cast<int>(truth.size());
  const KeyframeMap& map = closing.pipeline().map();
  report_errors();

  report_links(map, truth);

  const auto& costs = closing.costs();
  const size_t part = std::min<size_t>(1000, costs.size() / 4);
  const size_t warm = std::min<size_t>(500, costs.size() / 8);
  const double growth = mean_cpu_s(costs, costs.size() - part, costs.size()) / mean_cpu_s(costs, warm, warm + part);
  const Relocations drops = relocate(closing.pipeline().map(), truth, context.quick ? 20 : 200);
  const int count = static_cast<int>(drops.wall_s.size());
  const int to_locate = count - drops.unseen;
  std::fprintf(stderr, "  dropped %d times: %d located, %d ambiguous, %d lost, %d unseen, %d wrong; median %.2f s\n",
               count, drops.located, drops.ambiguous, drops.lost, drops.unseen, drops.wrong, median_of(drops.wall_s));
  return {bound_row("scale.view", growth, n, "x", 1.1, Limit::most),
          bound_row("scale.memory", most_mib / 1024, n, "GiB", 2, Limit::most),
          bound_row("scale.memory.keyframe", per_keyframe_mib, n, "MiB", 1, Limit::most),
          bound_row("scale.lost", closing.lost(), n, "", 0, Limit::most),
          bound_row("scale.relocate", static_cast<double>(drops.located + drops.ambiguous) / to_locate, to_locate, "",
                    0.99, Limit::least),
          bound_row("scale.relocate.wrong", drops.wrong, count, "", 0, Limit::most),
          median_row("scale.relocate.time", drops.wall_s, "s", 1)};
}

}  // namespace

std::vector<Item> mission_items() {
  return {{{"scale.view", "scale.memory", "scale.memory.keyframe", "scale.lost", "scale.relocate",
            "scale.relocate.wrong", "scale.relocate.time"},
           "a tour of a building: growth of cost per view and of memory, relocalization",
           mission_rows,
           true}};
}

}  // namespace fringeslam::bench
