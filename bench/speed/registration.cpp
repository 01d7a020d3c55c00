// SPDX-License-Identifier: Apache-2.0
// Registration of two full frames without an initial pose, compared with PCL's ICP and OpenCV's FastICPOdometry, on
// motions that all of them can find.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <optional>

#include "bench/fast_icp.h"
#include "bench/frame_pairs.h"
#include "bench/row.h"
#include "bench/speed/interleaving.h"
#include "core/registration/reference/engines.h"

namespace fringeslam::bench {

namespace {

struct Engine {
  const char* name;
  std::function<std::optional<Pose>(const FramePair&)> find;
  std::vector<double> seconds = {}, errors_mm = {};
};

std::optional<Pose> pose_of(const IcpResult& result) {
  if (!result.converged) return std::nullopt;
  return result.target_from_source;
}

// Displacement of the centre of the observed surface; infinite if no motion was found.
double error_mm(const std::optional<Pose>& found, const FramePair& pair) {
  const Eigen::Vector3d middle(0, 0, 0.5 * (pair.rig.near_m + pair.rig.far_m));
  return found ? 1e3 * (*found * middle - pair.target_from_source * middle).norm() : INFINITY;
}

std::vector<Row> register_rows(const Context& context) {
  IcpOptions options;
  options.max_distance_m = 0.05;
  std::vector<Engine> engines = {
      {"cold", [](const FramePair& p) { return pose_of(register_frames(p.target, p.source, p.rig.camera, {})); }},
      {"from no motion",
       [&](const FramePair& p) {
         return pose_of(
             register_with_engine(RegistrationEngine::point_to_plane, p.target, p.source, p.rig.camera, {}, options));
       }},
      {"PCL's ICP",
       [&](const FramePair& p) {
         return pose_of(
             register_with_engine(RegistrationEngine::pcl_icp, p.target, p.source, p.rig.camera, {}, options, 1));
       }},
      {"OpenCV's FastICPOdometry", opencv_fast_icp}};
  Engine &ours = engines[0], &pcl = engines[2], &opencv = engines[3];
  // Interleaved; the first pair is a warm-up.
  for (int number = 0; number <= (context.quick ? 2 : 8); ++number) {
    const auto seed = static_cast<uint64_t>(number);
    const FramePair pair =
        rendered_frames(number % 2 ? "boxes_and_foam" : "rubble_under_dust", seed, random_motion(2, 0.02, 1, seed));
    for (Engine& engine : engines) {
      std::optional<Pose> found;
      const double seconds = seconds_of([&] { found = engine.find(pair); });
      if (number == 0) continue;
      engine.seconds.push_back(seconds);
      engine.errors_mm.push_back(error_mm(found, pair));
    }
  }
  for (const Engine& engine : engines)
    std::fprintf(stderr, "  %-24s %8.1f ms, median error %.4f mm, largest %.4f mm\n", engine.name,
                 1e3 * median(engine.seconds), median(engine.errors_mm),
                 *std::max_element(engine.errors_mm.begin(), engine.errors_mm.end()));
  const Engine& fastest = median(pcl.seconds) < median(opencv.seconds) ? pcl : opencv;
  return {median_row("speed.register", ratios(pcl.seconds, ours.seconds), "x", 50, Limit::least),
          median_row("speed.register.fastest", ratios(fastest.seconds, ours.seconds), "x", 3, Limit::least),
          median_row("speed.register.error", ratios(ours.errors_mm, fastest.errors_mm), "x", 1)};
}

}  // namespace

std::vector<Item> registration_speed_items() {
  return {{{"speed.register", "speed.register.fastest", "speed.register.error"},
           "two full frames without an initial pose, relative to PCL's ICP and OpenCV's FastICPOdometry",
           register_rows}};
}

}  // namespace fringeslam::bench
