// SPDX-License-Identifier: Apache-2.0
// Random views of rubble and of repetitive scenes, all pairs registered: how often is the result wrong by more than its
// covariance allows?
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <numeric>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "bench/frame_pairs.h"
#include "bench/landmark_method.h"
#include "bench/pose_judge.h"
#include "bench/repeating_scenes.h"
#include "bench/row.h"

namespace fringeslam::bench {

namespace {

constexpr double kRadPerDeg = std::numbers::pi / 180;

struct World {
  const char* scene;
  uint64_t seed;
};
constexpr World kWorlds[] = {{"rubble_pile", 1}, {"rubble_pile", 2},       {"rubble_pile", 3},
                             {"rubble_pile", 4}, {"rubble_under_dust", 1}, {"rubble_pile", 5},
                             {"rubble_pile", 6}, {"rubble_under_dust", 2}};
constexpr int kViews = 17, kRepeatingViews = 8;

// Cameras that look down from all sides at places near the centre, four of them close together.
std::vector<Pose> random_cameras(uint64_t seed) {
  constexpr double kPile_m = 0.05, kFarthest_m = 0.28, kTilt = 18, kTurn = 40, kNearest_m = 0.9, kFar_m = 1.15;
  constexpr double kShift_m = 0.06, kShiftTurn = 12;
  constexpr int kTogether = 4;
  std::mt19937_64 random(seed);
  const auto uniform = [&](double low, double high) {
    return low + (high - low) * static_cast<double>(random() >> 11) / 9007199254740992.0;
  };
  std::vector<Pose> poses;
  Pose stand;
  for (int i = 0; i < kViews; ++i) {
    if (i % kTogether == 0) {
      const double side = uniform(0, 2 * std::numbers::pi), off = kFarthest_m * std::sqrt(uniform(0, 1));
      const double tilt = kRadPerDeg * uniform(0, kTilt), towards = uniform(0, 2 * std::numbers::pi);
      const double turn = kRadPerDeg * uniform(-kTurn, kTurn), distance = uniform(kNearest_m, kFar_m);
      stand.rotation = rotation_exp({tilt * std::cos(towards), tilt * std::sin(towards), 0}) *
                       rotation_exp({0, 0, turn}) * rotation_exp({std::numbers::pi, 0, 0});
      stand.translation =
          Eigen::Vector3d(off * std::cos(side), off * std::sin(side), kPile_m) - distance * stand.rotation.col(2);
    }
    const double share = uniform(0, 1);
    poses.push_back(stand * random_motion(share * kShiftTurn, share * kShift_m, 1, random()));
  }
  return poses;
}

bool lit(const TruthFrame& truth, int row, int col) {
  const int mask = static_cast<int>(truth.mask(row, col));
  return (mask & kTruthSurface) && (mask & kTruthInBeam) && !(mask & kTruthInShadow);
}

// Fraction of the current view's lit surface that is also lit in the earlier view.
double true_overlap(const Views& views, size_t earlier, size_t current) {
  constexpr int kEvery = 4;
  constexpr double kSame_m = 0.005;  // depth range of a slanted surface within a pixel
  const TruthFrame &e = views.views[earlier].truth, &c = views.views[current].truth;
  const Pose earlier_from_world = views.world_from_camera(earlier).inverse();
  int all = 0, shared = 0;
  for (int row = 0; row < c.mask.rows; row += kEvery) {
    for (int col = 0; col < c.mask.cols; col += kEvery) {
      if (!lit(c, row, col)) continue;
      ++all;
      const cv::Vec3f w = c.position_m(row, col);
      const Eigen::Vector3d point = earlier_from_world * Eigen::Vector3d(w[0], w[1], w[2]);
      if (!(point.z() > 0)) continue;
      const Eigen::Vector2d pixel = views.rig.camera.project(point);
      const int x = static_cast<int>(std::lround(pixel.x())), y = static_cast<int>(std::lround(pixel.y()));
      if (x < 0 || y < 0 || x >= e.mask.cols || y >= e.mask.rows || !lit(e, y, x)) continue;
      shared += std::abs(e.depth_m(y, x) - point.z()) < kSame_m;
    }
  }
  return static_cast<double>(shared) / std::max(1, all);
}

// Wrong initial poses, in addition to landmarks.
struct Start {
  double degrees, metres;
};
constexpr Start kStarts[] = {{1, 0.01}, {3, 0.03}};
constexpr size_t kWays = 1 + std::size(kStarts);

using Counts = std::array<Count, kWays>;

// Registers two views by landmarks and from wrong starts.
void add_pair(const Views& views, const std::vector<Landmarks>& landmarks, const LandmarkDatabase& database,
              int earlier, int current, double overlap, const std::string& scene, Counts& counts) {
  const auto e = static_cast<size_t>(earlier), c = static_cast<size_t>(current);
  const double middle_m = 0.5 * (views.rig.near_m + views.rig.far_m);
  const Pose truth = views.world_from_camera(e).inverse() * views.world_from_camera(c);
  const std::string name = scene + " views " + std::to_string(earlier) + " and " + std::to_string(current);
  judge(registered(views, landmarks, earlier, current, database.reidentify(landmarks[c])), truth, views.rig,
        name + " by landmarks", overlap, counts[0]);
  for (size_t i = 0; i < std::size(kStarts); ++i) {
    const auto seed = static_cast<uint64_t>(1000 * earlier + current);
    const Pose start = truth * random_motion(kStarts[i].degrees, kStarts[i].metres, middle_m, seed);
    judge(follow_view(views.views[e].frame, views.views[c].frame, start, views.rig.camera, middle_m, {}), truth,
          views.rig, name + " from " + std::to_string(static_cast<int>(1e3 * kStarts[i].metres)) + " mm", overlap,
          counts[1 + i]);
  }
}

// Calls add(earlier, current, overlap, database of the earlier view) for all pairs of views.
template <class Add>
void for_each_pair(const Views& views, const std::vector<Landmarks>& landmarks, const Add& add) {
  const int count = static_cast<int>(views.views.size());
  for (int earlier = 0; earlier < count; ++earlier) {
    LandmarkDatabase database(views.rig.camera, LandmarkMethod().recognition);
    database.add(earlier, landmarks[static_cast<size_t>(earlier)]);
    for (int current = earlier + 1; current < count; ++current)
      add(earlier, current, true_overlap(views, static_cast<size_t>(earlier), static_cast<size_t>(current)), database);
  }
}

// Pairs of a class, and how they were registered.
struct Tally {
  int pairs = 0;
  Counts ways;

  Tally& operator+=(const Tally& other) {
    pairs += other.pairs;
    for (size_t i = 0; i < kWays; ++i) ways[i] += other.ways[i];
    return *this;
  }
  int wrong() const { return sum(&Count::wrong); }
  int found() const { return sum(&Count::found); }
  int sum(int Count::*number) const {
    int count = 0;
    for (const Count& way : ways) count += way.*number;
    return count;
  }
};

void print_head(const char* classes) {
  std::fprintf(stderr, "  %-38s %6s", classes, "pairs");
  for (const char* way : {"by landmarks", "from 10 mm, 1 deg", "from 30 mm, 3 deg"})
    std::fprintf(stderr, " | %-32s", way);
  std::fprintf(stderr, "\n  %-38s %6s", "", "");
  for (size_t i = 0; i < kWays; ++i)
    std::fprintf(stderr, " | %6s %7s %7s %9s", "found", "correct", "wrong", "ambiguous");
  std::fprintf(stderr, "\n");
}

void print(const std::string& name, const Tally& tally) {
  std::fprintf(stderr, "  %-38s %6d", name.c_str(), tally.pairs);
  for (const Count& way : tally.ways)
    std::fprintf(stderr, " | %6d %7d %7d %9d", way.found, way.right, way.wrong, way.ambiguous);
  std::fprintf(stderr, "\n");
}

using Deciles = std::array<Tally, 10>;

void add_world(const World& world, Deciles& deciles) {
  const Views views = rendered_views(world.scene, world.seed, random_cameras(world.seed));
  const std::vector<Landmarks> landmarks = landmarks_of(views, LandmarkMethod());
  for_each_pair(views, landmarks, [&](int earlier, int current, double overlap, const LandmarkDatabase& database) {
    Tally& decile = deciles[static_cast<size_t>(std::clamp(static_cast<int>(10 * overlap), 0, 9))];
    ++decile.pairs;
    add_pair(views, landmarks, database, earlier, current, overlap,
             std::string(world.scene) + " " + std::to_string(world.seed), decile.ways);
  });
}

// The share of pairs of rubble that count as ambiguous, in percent, is the cost of the check.
std::vector<Row> wrong_rows(const Context& context) {
  constexpr double kMostAmbiguous = 1;
  Deciles deciles;
  for (const World& world : kWorlds) {
    if (context.quick && &world - kWorlds >= 2) break;
    add_world(world, deciles);
  }
  print_head("overlap %");
  Tally all;
  for (size_t d = 0; d < deciles.size(); ++d) {
    print(std::to_string(10 * d) + " to " + std::to_string(10 * d + 10), deciles[d]);
    all += deciles[d];
  }
  print("all", all);
  const Count& located = all.ways[0];
  return {wrong_row("pose.wrong", all.wrong(), all.found(), "wrong"),
          bound_row("pose.ambiguous", 100.0 * located.ambiguous / (located.found + located.ambiguous),
                    located.found + located.ambiguous, "%", kMostAmbiguous, Limit::most)};
}

std::vector<Row> repeating_rows(const Context& context) {
  constexpr int kQuickScenes[] = {3, 8, 11}, kQuickViews = 5;
  Tally all;
  std::vector<std::pair<std::string, Tally>> scenes;
  std::vector<int> numbers(std::begin(kQuickScenes), std::end(kQuickScenes));
  if (!context.quick) {
    numbers.resize(static_cast<size_t>(repeating_scene_count()));
    std::iota(numbers.begin(), numbers.end(), 0);
  }
  for (const int number : numbers) {
    RepeatingScene repeating = repeating_scene(number);
    const std::vector<Pose> cameras =
        cameras_above(repeating, context.quick ? kQuickViews : kRepeatingViews, static_cast<uint64_t>(100 + number));
    const Views views = rendered_views(std::move(repeating.scene), cameras);
    const std::vector<Landmarks> landmarks = landmarks_of(views, LandmarkMethod());
    Tally tally;
    for_each_pair(views, landmarks, [&](int earlier, int current, double overlap, const LandmarkDatabase& database) {
      ++tally.pairs;
      add_pair(views, landmarks, database, earlier, current, overlap, repeating.name, tally.ways);
    });
    scenes.emplace_back(repeating.name, tally);
    all += tally;
  }
  print_head("scene");
  for (const auto& [name, tally] : scenes) print(name, tally);
  print("all", all);
  return {wrong_row("pose.repeating", all.wrong(), all.found(), "wrong")};
}

}  // namespace

std::vector<Item> wrong_pose_items() {
  return {{{"pose.wrong", "pose.ambiguous"}, "random pairs of views: confidently wrong registrations", wrong_rows},
          {{"pose.repeating"}, "pairs of views of repetitive scenes: confidently wrong registrations", repeating_rows}};
}

}  // namespace fringeslam::bench
