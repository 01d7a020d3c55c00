// SPDX-License-Identifier: Apache-2.0
// Registration of frames without landmarks: basin of convergence of each engine, and consistency of the estimated
// covariance.
#include <cmath>
#include <cstdio>
#include <functional>
#include <numbers>
#include <numeric>
#include <optional>
#include <string>
#include <vector>

#include "bench/accuracy/percent_chart.h"
#include "bench/fast_icp.h"
#include "bench/frame_pairs.h"
#include "bench/landmark_method.h"
#include "bench/row.h"
#include "bench/speed/interleaving.h"
#include "core/registration/reference/engines.h"

namespace fringeslam::bench {

namespace {

constexpr double kDegPerRad = 180 / std::numbers::pi;
const char* const kScenes[] = {"boxes_and_foam", "rubble_under_dust"};

struct Band {
  const char* name;
  double degrees, metres, least_percent;
};
constexpr Band kBands[] = {{"2deg", 2, 0.02, 100}, {"6deg", 6, 0.05, 100}, {"15deg", 15, 0.12, 99}};

// A motion of 50 to 100 % of the band's size.
Pose motion_of(const Band& band, int number) {
  const double size = 0.5 + 0.5 * std::fmod(number * 0.618, 1);
  return random_motion(size * band.degrees, size * band.metres, 1, static_cast<uint64_t>(number));
}

FramePair pair_of(const Band& band, int number) {
  return rendered_frames(kScenes[number % 2], static_cast<uint64_t>(number), motion_of(band, number));
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
  for (const RegistrationEngine engine : registration_engines()) {
    add(to_string(engine), [engine](const FramePair& pair) {
      IcpOptions options;
      options.max_distance_m = 0.1;
      return register_with_engine(engine, pair.target, pair.source, pair.rig.camera, {}, options);
    });
  }
  all.push_back({"opencv_fast_icp", opencv_fast_icp});
  return all;
}

bool succeeds(const std::optional<Pose>& found, const Pose& truth) {
  return found && (found->translation - truth.translation).norm() < 1e-3 &&
         rotation_rad(*found * truth.inverse()) * kDegPerRad < 0.1;
}

std::vector<Row> basin_rows(const Context& context) {
  const int pairs = context.quick ? 6 : 50, peers_on = context.quick ? 2 : 8;
  std::vector<Row> rows;
  std::fprintf(stderr, "  success (below 1 mm and 0.1 deg) without landmarks; the other engines on %d pairs each\n",
               peers_on);
  const auto all = contenders();
  std::vector<BarGroup> bars;
  for (const Contender& contender : all) bars.push_back({contender.name, {}});
  for (const Band& band : kBands) {
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
    for (size_t i = 0; i < all.size(); ++i) {
      bars[i].percents.push_back(100.0 * found[i] / tried[i]);
      std::fprintf(stderr, "  %-6s %-16s %5.1f %% of %d, %8.1f ms\n", band.name, all[i].name.c_str(),
                   bars[i].percents.back(), tried[i], 1e3 * median(seconds[i]));
    }
    rows.push_back(bound_row(std::string("pose.basin.") + band.name, 100.0 * found[0] / tried[0], tried[0], "%",
                             band.least_percent, Limit::least));
  }
  if (!context.quick)
    write_percent_chart(FRINGESLAM_SCENES "/../bench/accuracy/registration_basin.png",
                        "frames registered without landmarks, % by distance",
                        {"to 2 deg, 2 cm", "to 6 deg, 5 cm", "to 15 deg, 12 cm"}, bars);
  return rows;
}

// Motions of the largest band, initialized from landmarks.
std::vector<Row> seeded_rows(const Context& context) {
  const Band& band = kBands[2];
  const int pairs = context.quick ? 6 : 50;
  std::vector<double> errors_mm;
  int found = 0;
  for (int number = 1; number <= pairs; ++number) {
    const Pose truth = motion_of(band, number);
    const ViewPair pair = rendered_pair(kScenes[number % 2], static_cast<uint64_t>(number), truth);
    const std::vector<Landmarks> landmarks = landmarks_of(pair, {});
    LandmarkDatabase database(pair.rig.camera, {});
    database.add(0, landmarks[0]);
    const std::vector<Recognition> recognitions = database.reidentify(landmarks[1]);
    const ViewRegistration registration = registered(pair, landmarks, 0, 1, recognitions);
    // A motion that is not found has an infinite error: it can only increase the median.
    const double off_m =
        registration.found ? (registration.earlier_from_current.translation - truth.translation).norm() : INFINITY;
    errors_mm.push_back(1e3 * off_m);
    const bool success = registration.found && succeeds(registration.earlier_from_current, truth);
    found += success;
    if (success) continue;
    int matches = 0;
    for (const Recognition& recognition : recognitions) matches += static_cast<int>(recognition.matches.size());
    std::fprintf(stderr,
                 "  missed: %s pair %d, %.2f mm; %zu and %zu landmarks, %zu re-identified by %d matches; of %d "
                 "keypoint pairs %d are inliers (%s)%s\n",
                 kScenes[number % 2], number, 1e3 * off_m, landmarks[0].landmarks.size(), landmarks[1].landmarks.size(),
                 recognitions.size(), matches, registration.motion.pairs, registration.motion.inliers,
                 to_string(registration.motion.status).c_str(), registration.refined ? "" : ", not refined by depth");
  }
  return {median_row("pose.seeded.translation", errors_mm, "mm", 0.02),
          bound_row("pose.seeded.success", 100.0 * found / pairs, pairs, "%", 100, Limit::least)};
}

// NEES of six degrees of freedom over pairs of both scenes: expected value 6 if the covariance is correct.
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
  // 95 % half-width of the mean of this many squared errors with six degrees of freedom each.
  const double spread = 1.96 * std::sqrt(12.0 / static_cast<double>(values.size()));
  std::fprintf(stderr, "  %zu pairs; mean %.2f (expected 6), median %.2f (expected 5.35)\n", values.size(), mean,
               median(values));
  const int n = static_cast<int>(values.size());
  return {bound_row("pose.nees.least", mean, n, "", 6 - spread, Limit::least),
          bound_row("pose.nees.most", mean, n, "", 6 + spread, Limit::most)};
}

}  // namespace

std::vector<Item> registration_items() {
  return {{{"pose.basin.2deg", "pose.basin.6deg", "pose.basin.15deg"},
           "basin of convergence of registration without landmarks",
           basin_rows},
          {{"pose.seeded.translation", "pose.seeded.success"},
           "frames registered from landmarks, motions up to 15 deg and 12 cm",
           seeded_rows},
          {{"pose.nees.least", "pose.nees.most"}, "normalized error squared (NEES) of refined motions", nees_rows}};
}

}  // namespace fringeslam::bench
