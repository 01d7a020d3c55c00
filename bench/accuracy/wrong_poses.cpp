// SPDX-License-Identifier: Apache-2.0
// Random views of rubble, all pairs registered: how often is the result wrong by more than its covariance allows?
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <random>
#include <string>
#include <vector>

#include "bench/frame_pairs.h"
#include "bench/landmark_method.h"
#include "bench/row.h"
#include "core/types/linear_algebra.h"

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
constexpr int kViews = 17;

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

// Largest displacement of points on the camera's axis and corner rays at the middle of its range.
double displacement_m(const Pose& found, const Pose& truth, const RigModel& rig) {
  const Pinhole& camera = rig.camera;
  const double z = 0.5 * (rig.near_m + rig.far_m);
  const double x = z * 0.5 * camera.width / camera.fx, y = z * 0.5 * camera.height / camera.fy;
  double largest = 0;
  for (const Eigen::Vector3d& point : {Eigen::Vector3d(0, 0, z), Eigen::Vector3d(x, y, z), Eigen::Vector3d(-x, y, z),
                                       Eigen::Vector3d(x, -y, z), Eigen::Vector3d(-x, -y, z)})
    largest = std::max(largest, (found * point - truth * point).norm());
  return largest;
}

struct Count {
  int found = 0, right = 0, wrong = 0;
};

struct Judge {
  const RigModel& rig;
  const Pose& truth;

  void operator()(const ViewRegistration& registration, const std::string& name, double overlap, Count& count) const {
    constexpr double kOff_m = 1e-3, kSigmas = 10;
    if (!registration.found) return;
    ++count.found;
    const double off_m = displacement_m(registration.earlier_from_current, truth, rig);
    if (off_m <= kOff_m) {
      ++count.right;
      return;
    }
    const Vector6d error = difference(registration.earlier_from_current, truth);
    const double sigmas = std::sqrt(error.dot(solve_symmetric(registration.covariance, error)));
    const bool wrong = !(sigmas <= kSigmas);
    count.wrong += wrong;
    const IcpResult& icp = registration.icp;
    std::fprintf(stderr,
                 "  %s: %s, overlap %.0f %%, %.1f mm and %.1f sigmas off; keypoints %d of %d%s, overlap %.2f, "
                 "consistency %.2f, RMS %.2f sigmas, %.1f if reopened\n",
                 wrong ? "WRONG" : "unsure", name.c_str(), 100 * overlap, 1e3 * off_m, sigmas,
                 registration.motion.inliers, registration.motion.pairs,
                 registration.refined ? "" : ", not confirmed by depth", icp.overlap, icp.consistency, icp.rms_sigma,
                 icp.reopened_sigma);
  }
};

// Wrong initial poses, in addition to landmarks.
struct Start {
  double degrees, metres;
};
constexpr Start kStarts[] = {{1, 0.01}, {3, 0.03}};
constexpr size_t kWays = 1 + std::size(kStarts);

struct Decile {
  int pairs = 0;
  std::array<Count, kWays> ways;
};
using Deciles = std::array<Decile, 10>;

void add_world(const World& world, Deciles& deciles) {
  const Views views = rendered_views(world.scene, world.seed, random_cameras(world.seed));
  const LandmarkMethod method;
  const RegistrationOptions options;
  const double middle_m = 0.5 * (views.rig.near_m + views.rig.far_m);
  const std::vector<Landmarks> landmarks = landmarks_of(views, method);
  for (int earlier = 0; earlier < kViews; ++earlier) {
    LandmarkDatabase database(views.rig.camera, method.recognition);
    database.add(earlier, landmarks[static_cast<size_t>(earlier)]);
    for (int current = earlier + 1; current < kViews; ++current) {
      const auto e = static_cast<size_t>(earlier), c = static_cast<size_t>(current);
      const double overlap = true_overlap(views, e, c);
      const Pose truth = views.world_from_camera(e).inverse() * views.world_from_camera(c);
      const Judge judge{views.rig, truth};
      const std::string name = std::string(world.scene) + " " + std::to_string(world.seed) + " views " +
                               std::to_string(earlier) + " and " + std::to_string(current);
      Decile& decile = deciles[static_cast<size_t>(std::clamp(static_cast<int>(10 * overlap), 0, 9))];
      ++decile.pairs;
      judge(registered(views, landmarks, earlier, current, database.reidentify(landmarks[c])), name + " by landmarks",
            overlap, decile.ways[0]);
      for (size_t i = 0; i < std::size(kStarts); ++i) {
        const auto seed = static_cast<uint64_t>(1000 * earlier + current);
        const Pose start = truth * random_motion(kStarts[i].degrees, kStarts[i].metres, middle_m, seed);
        judge(follow_view(views.views[e].frame, views.views[c].frame, start, views.rig.camera, middle_m, options),
              name + " from " + std::to_string(static_cast<int>(1e3 * kStarts[i].metres)) + " mm", overlap,
              decile.ways[1 + i]);
      }
    }
  }
}

std::vector<Row> wrong_rows(const Context& context) {
  Deciles deciles;
  for (const World& world : kWorlds) {
    if (context.quick && &world - kWorlds >= 2) break;
    add_world(world, deciles);
  }
  std::fprintf(stderr, "  %-10s %6s", "overlap %", "pairs");
  for (const char* way : {"by landmarks", "from 10 mm, 1 deg", "from 30 mm, 3 deg"})
    std::fprintf(stderr, " | %-22s", way);
  std::fprintf(stderr, "\n  %-10s %6s", "", "");
  for (size_t i = 0; i < kWays; ++i) std::fprintf(stderr, " | %6s %7s %7s", "found", "correct", "wrong");
  const auto print = [](const std::string& name, const Decile& decile) {
    std::fprintf(stderr, "\n  %-10s %6d", name.c_str(), decile.pairs);
    for (const Count& way : decile.ways) std::fprintf(stderr, " | %6d %7d %7d", way.found, way.right, way.wrong);
  };
  Decile all;
  for (size_t d = 0; d < deciles.size(); ++d) {
    print(std::to_string(10 * d) + " to " + std::to_string(10 * d + 10), deciles[d]);
    all.pairs += deciles[d].pairs;
    for (size_t i = 0; i < kWays; ++i) {
      all.ways[i].found += deciles[d].ways[i].found;
      all.ways[i].right += deciles[d].ways[i].right;
      all.ways[i].wrong += deciles[d].ways[i].wrong;
    }
  }
  print("all", all);
  std::fprintf(stderr, "\n");
  int wrong = 0;
  for (const Count& way : all.ways) wrong += way.wrong;
  return {bound_row("pose.wrong", wrong, all.pairs, "wrong", 0, Limit::most)};
}

}  // namespace

std::vector<Item> wrong_pose_items() {
  return {{{"pose.wrong"}, "random pairs of views: confidently wrong registrations", wrong_rows}};
}

}  // namespace fringeslam::bench
