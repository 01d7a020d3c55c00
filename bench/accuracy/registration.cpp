// SPDX-License-Identifier: Apache-2.0
// Registration of frames without landmarks: from how far it finds the motion, engine by engine, and whether its
// covariance is honest.
#include <cmath>
#include <cstdio>
#include <functional>
#include <numbers>
#include <numeric>
#include <opencv2/rgbd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "bench/frame_pairs.h"
#include "bench/row.h"
#include "bench/speed/turns.h"
#include "core/map/engines.h"

namespace fringeslam::bench {

namespace {

constexpr double kDegPerRad = 180 / std::numbers::pi;
const char* const kScenes[] = {"boxes_and_foam", "rubble_under_dust"};

struct Band {
  const char* name;
  double degrees, metres, least_percent;
};
constexpr Band kBands[] = {{"2deg", 2, 0.02, 100}, {"6deg", 6, 0.05, 100}, {"15deg", 15, 0.12, 99}};

FramePair pair_of(const Band& band, int number) {
  // Motions of half the band's size and more.
  const double size = 0.5 + 0.5 * std::fmod(number * 0.618, 1);
  const auto seed = static_cast<uint64_t>(number);
  return rendered_frames(kScenes[number % 2], seed, random_motion(size * band.degrees, size * band.metres, 1, seed));
}

// OpenCV's FastICPOdometry; not found: nothing.
std::optional<Pose> fast_icp(const FramePair& pair) {
  cv::Mat1f depth[2];
  const Frame* frames[2] = {&pair.target, &pair.source};
  for (int i = 0; i < 2; ++i) cv::extractChannel(frames[i]->points_m, depth[i], 2);
  const Pinhole& camera = pair.rig.camera;
  const cv::Matx33f matrix(static_cast<float>(camera.fx), 0, static_cast<float>(camera.cx), 0,
                           static_cast<float>(camera.fy), static_cast<float>(camera.cy), 0, 0, 1);
  const auto odometry = cv::rgbd::FastICPOdometry::create(cv::Mat(matrix), 0.1f);
  cv::Mat found;
  const cv::Mat none;
  // From the first frame's camera to the second's.
  if (!odometry->compute(none, depth[1], none, none, depth[0], none, found) || found.empty()) return std::nullopt;
  const cv::Mat1d rt = cv::Mat1d(found);
  Pose pose;
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 3; ++c) pose.rotation(r, c) = rt(r, c);
    pose.translation[r] = rt(r, 3);
  }
  return pose;
}

struct Contender {
  std::string name;
  std::function<std::optional<Pose>(const FramePair&)> find;
};

std::vector<Contender> contenders() {
  std::vector<Contender> all;
  const auto add = [&](const std::string& name, const auto& run) {
    all.push_back({name, [run](const FramePair& pair) -> std::optional<Pose> {
                     const IcpResult result = run(pair);
                     if (!result.converged) return std::nullopt;
                     return result.target_from_source;
                   }});
  };
  add("cold", [](const FramePair& pair) { return register_frames(pair.target, pair.source, pair.rig.camera, {}); });
  for (const std::string& engine : registration_engines()) {
    add(engine, [engine](const FramePair& pair) {
      IcpOptions options;
      options.max_distance_m = 0.1;
      return register_by(engine, pair.target, pair.source, pair.rig.camera, {}, options);
    });
  }
  all.push_back({"opencv_fast_icp", fast_icp});
  return all;
}

bool succeeds(const std::optional<Pose>& found, const Pose& truth) {
  return found && (found->translation - truth.translation).norm() < 1e-3 &&
         rotation_rad(*found * truth.inverse()) * kDegPerRad < 0.1;
}

std::vector<Row> basin_rows(const Context& context) {
  const int pairs = context.quick ? 6 : 50, peers_on = context.quick ? 2 : 8;
  std::vector<Row> rows;
  std::fprintf(stderr, "  success (below 1 mm and 0.1 deg) without landmarks; the others than ours on %d pairs each\n",
               peers_on);
  for (const Band& band : kBands) {
    const auto all = contenders();
    std::vector<int> found(all.size(), 0), tried(all.size(), 0);
    std::vector<std::vector<double>> seconds(all.size());
    for (int number = 1; number <= pairs; ++number) {
      const FramePair pair = pair_of(band, number);
      for (size_t i = 0; i < all.size(); ++i) {
        if (i > 1 && number > peers_on) continue;
        std::optional<Pose> pose;
        seconds[i].push_back(seconds_of([&] { pose = all[i].find(pair); }));
        ++tried[i];
        const bool success = succeeds(pose, pair.target_from_source);
        found[i] += success;
        if (i == 0 && !success) std::fprintf(stderr, "  missed: %s pair %d\n", band.name, number);
      }
    }
    for (size_t i = 0; i < all.size(); ++i)
      std::fprintf(stderr, "  %-6s %-16s %5.1f %% of %d, %8.1f ms\n", band.name, all[i].name.c_str(),
                   100.0 * found[i] / tried[i], tried[i], 1e3 * median(seconds[i]));
    rows.push_back(bound_row(std::string("pose.basin.") + band.name, 100.0 * found[0] / tried[0], tried[0], "%",
                             band.least_percent, Limit::least));
  }
  return rows;
}

// Of 6 degrees of freedom, over pairs of both scenes: 6 when the covariance is right.
std::vector<Row> nees_rows(const Context& context) {
  std::vector<double> values;
  for (int number = 1; number <= (context.quick ? 10 : 100); ++number) {
    const FramePair pair = pair_of(kBands[1], number);
    IcpOptions options;
    options.max_distance_m = 5e-3;
    const IcpResult result =
        point_to_plane_icp(pair.target, pair.source, pair.rig.camera, pair.target_from_source, options);
    if (!result.converged) continue;
    const Vector6d error = difference(result.target_from_source, pair.target_from_source);
    values.push_back(error.dot(result.information * error));
  }
  const double mean = std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
  // Of the mean of as many squares with six degrees of freedom each.
  const double spread = 1.96 * std::sqrt(12.0 / static_cast<double>(values.size()));
  std::fprintf(stderr, "  of %zu pairs; mean %.2f (6 is right), median %.2f (5.35)\n", values.size(), mean,
               median(values));
  const int n = static_cast<int>(values.size());
  return {bound_row("pose.nees.least", mean, n, "", 6 - spread, Limit::least),
          bound_row("pose.nees.most", mean, n, "", 6 + spread, Limit::most)};
}

}  // namespace

std::vector<Item> registration_items() {
  return {{{"pose.basin.2deg", "pose.basin.6deg", "pose.basin.15deg"},
           "how far off registration without landmarks may start",
           basin_rows},
          {{"pose.nees.least", "pose.nees.most"}, "normalised error squared of refined motions", nees_rows}};
}

}  // namespace fringeslam::bench
