// SPDX-License-Identifier: Apache-2.0
// Fringe orders of three images from the previous view and a slightly wrong predicted pose.
#include <Eigen/Geometry>
#include <cmath>
#include <cstdio>
#include <limits>
#include <numbers>
#include <random>

#include "bench/row.h"
#include "bench/speed/interleaving.h"
#include "core/base/constants.h"
#include "core/decode/decode.h"
#include "core/depth/depth.h"
#include "core/map/expected_view.h"
#include "core/registration/icp.h"
#include "core/score/score.h"
#include "core/types/linear_algebra.h"
#include "sim/virtual_rig.h"

namespace fringeslam::bench {

namespace {

// Standard deviations of the predicted pose, of the vectors' norms.
constexpr double kPoseErrorM = 2e-3, kPoseErrorRad = 0.2 * std::numbers::pi / 180;

struct PredictionPair {
  sim::Scene scene;
  PixelRays rays;
  Triangulation triangulation;
  FringeStack stack;  // the finest period of the second view
  Frame known;        // the first view
  Frame full;         // the second view from all of its images
  TruthFrame truth;   // of the second view
  Pose current_from_known, predicted;
  Matrix6d covariance;  // of `predicted`
};

PredictionPair prediction_pair(const std::string& name, size_t first, uint64_t seed) {
  sim::Scene scene = sim::load_scene(std::string(FRINGESLAM_SCENES) + "/" + name + "/scene.yaml", {seed});
  scene.trajectory = {scene.trajectory.at(first), scene.trajectory.at(first + 1)};
  const PixelRays rays = pixel_rays(scene.rig.camera);
  const DepthOptions depth;
  PredictionPair pair{scene, rays, Triangulation(scene.rig, rays, depth.near_m, depth.far_m), {}, {}, {}, {}, {},
                      {},    {}};
  sim::VirtualRig rig(pair.scene, {});
  const auto reconstructed = [&](const FringeStack& stack) {
    return reconstruct(decode(stack, scene.rig, {}), scene.rig, pair.triangulation, depth);
  };
  pair.known = reconstructed(*rig.capture(scene.patterns));
  const auto [stack, truth] = *rig.simulate(scene.patterns);
  pair.truth = truth;
  pair.full = reconstructed(stack);
  pair.stack.timestamp_s = stack.timestamp_s;
  pair.stack.patterns = finest_patterns(scene.patterns, Axis::columns);
  const FringeGroup finest = fringe_groups(scene.patterns, Axis::columns).back();
  for (const int image : finest.images) {
    pair.stack.images.push_back(stack.images[static_cast<size_t>(image)]);
    pair.stack.exposure_s.push_back(stack.exposure_s[static_cast<size_t>(image)]);
    pair.stack.exposure_time_s.push_back(stack.exposure_time_s[static_cast<size_t>(image)]);
  }
  const Pose& mount = scene.rig.robot_from_camera;
  pair.current_from_known =
      (scene.trajectory[1].world_from_robot * mount).inverse() * (scene.trajectory[0].world_from_robot * mount);
  Vector6d sigmas;
  sigmas << Eigen::Vector3d::Constant(kPoseErrorRad / std::sqrt(3.0)),
      Eigen::Vector3d::Constant(kPoseErrorM / std::sqrt(3.0));
  pair.covariance = sigmas.cwiseAbs2().asDiagonal();
  std::mt19937_64 random(seed);
  const auto normal = [&] {  // Box-Muller
    const auto uniform = [&] { return (static_cast<double>(random() >> 11) + 0.5) * 0x1p-53; };
    const double radius = std::sqrt(-2 * std::log(uniform()));
    return radius * std::cos(2 * std::numbers::pi * uniform());
  };
  Vector6d error;
  for (int i = 0; i < 6; ++i) error[i] = sigmas[i] * normal();
  pair.predicted = retract(pair.current_from_known, error);
  return pair;
}

Frame decoded_by(const PredictionPair& pair, Unwrapping unwrapping, const Pose& pose, const Matrix6d& covariance) {
  const ExpectedView view = expected_view({{&pair.known, pose, covariance}}, pair.scene.rig.camera, pair.rays);
  const CoordinatePrior expected = predict_coordinate(pair.scene.rig, pair.rays, view.depth_m, view.sigma_m);
  DecodeOptions options;
  options.unwrapping = unwrapping;
  options.spatial_reference = SpatialReference::predicted;
  return reconstruct(decode(pair.stack, pair.scene.rig, options, {Axis::columns, &expected}), pair.scene.rig,
                     pair.triangulation, {});
}

// Registers what could be decoded with the predicted pose, then decodes again with the refined pose.
Frame decoded_twice(const PredictionPair& pair, Unwrapping unwrapping) {
  const Frame first = decoded_by(pair, Unwrapping::predicted, pair.predicted, pair.covariance);
  IcpOptions options;
  options.max_distance_m = 0.02;
  const Pose start = pair.predicted.inverse();
  const IcpResult result = point_to_plane_icp(pair.known, first, pair.scene.rig.camera, start, options,
                                              inverse(covariance_of_inverse(pair.predicted, pair.covariance)));
  if (!result.converged) return first;
  const double excess = std::max(1.0, result.rms_sigma * result.rms_sigma);
  const Pose refined = result.target_from_source;
  return decoded_by(pair, unwrapping, refined.inverse(),
                    covariance_of_inverse(refined, excess * inverse(result.information)));
}

// Counts over the pixels of one part of the image.
struct Share {
  int full = 0, valid = 0, wrong = 0, spurious = 0;
  void add(const Share& other) {
    full += other.full, valid += other.valid, wrong += other.wrong, spurious += other.spurious;
  }
  double valid_percent() const { return 100.0 * valid / std::max(1, full); }
  double wrong_share() const { return static_cast<double>(wrong) / std::max(1, valid); }
};

Share share_of(const PredictionPair& pair, const Frame& frame, const cv::Mat& part) {
  cv::Mat1f depth, full, column(depth.size(), kNaN);
  cv::extractChannel(frame.points_m, depth, 2);
  cv::extractChannel(pair.full.points_m, full, 2);
  const cv::Mat outside = ~part;
  depth.setTo(kNaN, outside);
  full.setTo(kNaN, outside);
  const auto coordinate =
      predict_coordinate(pair.scene.rig, pair.rays, depth, cv::Mat1f(depth.size(), 0.0f)).coordinate_px;
  const DepthScore score =
      score_depth({depth, frame.sigma_m, coordinate}, pair.truth, pair.stack.patterns.patterns.front().period_px);
  return {cv::countNonZero(full == full), score.compared,
          score.compared ? static_cast<int>(std::lround(score.wrong_order * score.compared)) : 0, score.spurious};
}

struct Way {
  const char* name;
  Frame (*decode)(const PredictionPair&);
};
const Way kWays[] = {
    {"all images", [](const PredictionPair& pair) { return pair.full; }},
    {"predicted",
     [](const PredictionPair& p) { return decoded_by(p, Unwrapping::predicted, p.predicted, p.covariance); }},
    {"spatial", [](const PredictionPair& p) { return decoded_by(p, Unwrapping::spatial, p.predicted, p.covariance); }},
    {"predicted, twice", [](const PredictionPair& p) { return decoded_twice(p, Unwrapping::predicted); }},
    {"spatial, twice", [](const PredictionPair& p) { return decoded_twice(p, Unwrapping::spatial); }},
};

std::vector<Row> prediction_rows(const Context& context) {
  struct Place {
    const char* scene;
    size_t views;
  };
  const Place places[] = {{"loop", 120}, {"rubble_pile", 2}, {"victim_in_rubble", 1}, {"boxes_and_foam", 1}};
  const int seeds = context.quick ? 2 : 10;
  Share twice;  // predicted, twice, over all places and seeds
  std::vector<double> valid;
  for (const Place& place : places) {
    std::vector<Share> seen(std::size(kWays)), fresh(std::size(kWays));
    for (int seed = 1; seed <= seeds; ++seed) {
      const auto pair =
          prediction_pair(place.scene, static_cast<size_t>(13 * seed) % place.views, static_cast<uint64_t>(seed));
      const ExpectedView exact =
          expected_view({{&pair.known, pair.current_from_known}}, pair.scene.rig.camera, pair.rays);
      const cv::Mat before = exact.depth_m == exact.depth_m, after = ~before;
      for (size_t i = 0; i < std::size(kWays); ++i) {
        const Frame frame = kWays[i].decode(pair);
        seen[i].add(share_of(pair, frame, before));
        fresh[i].add(share_of(pair, frame, after));
        if (i == 3) {
          twice.add(share_of(pair, frame, before));
          valid.push_back(share_of(pair, frame, before).valid_percent());
        }
      }
    }
    for (size_t i = 0; i < std::size(kWays); ++i)
      std::fprintf(stderr,
                   "  %-16s %-17s seen before (%d px): %6.2f %% valid, %.1e wrong, %d spurious; new (%d px): %6.2f %% "
                   "valid, %.1e wrong, %d spurious\n",
                   place.scene, kWays[i].name, seen[i].full, seen[i].valid_percent(), seen[i].wrong_share(),
                   seen[i].spurious, fresh[i].full, fresh[i].valid_percent(), fresh[i].wrong_share(),
                   fresh[i].spurious);
  }
  const double wrong = static_cast<double>(twice.wrong) / twice.valid;
  return {bound_row("predicted.wrong_order", wrong, twice.valid, "share", 1e-3, Limit::most),
          median_row("predicted.valid", valid, "%", 90, Limit::least)};
}

// --- motion during capture ---

struct Motion {
  const char* name;
  Eigen::Vector3d direction, axis;  // of the camera, at 1 m/s or 1 rad/s
};

// Median depth errors of three images of rubble captured while the camera moves, uncompensated and compensated.
struct MovingErrors {
  double plain_m, compensated_m;
};

MovingErrors moving_errors(const Motion& motion, double speed, uint64_t seed) {
  sim::Scene scene = sim::load_scene(std::string(FRINGESLAM_SCENES) + "/rubble_pile/scene.yaml", {seed});
  const RigModel& rig = scene.rig;
  const PatternSequence sequence =
      phase_shift_sequence(rig.projector.width, rig.projector.height, {16.5}, 3, Axis::columns, 8);
  const CameraMotion twist{speed * motion.axis, speed * motion.direction};
  const Pose& mount = rig.robot_from_camera;
  scene.motion.angular_rad_s = mount.rotation * twist.angular_rad_s;
  scene.motion.velocity_m_s = mount.rotation * twist.velocity_m_s - scene.motion.angular_rad_s.cross(mount.translation);
  const auto [stack, truth] = *sim::VirtualRig(scene, {}).simulate(sequence);
  const PixelRays rays = pixel_rays(rig.camera);
  const DepthOptions depth_options;
  const Triangulation triangulation(rig, rays, depth_options.near_m, depth_options.far_m);
  const auto expected = predict_coordinate(rig, rays, truth.depth_m, cv::Mat1f(rays.size(), 3e-3f));
  DecodeOptions options;
  options.unwrapping = Unwrapping::predicted;
  DecodedStack decoded = decode(stack, rig, options, {Axis::columns, &expected});
  const auto median_error = [&](const Frame& frame) {
    cv::Mat1f depth;
    cv::extractChannel(frame.points_m, depth, 2);
    return score_depth({depth, frame.sigma_m, decoded.coordinate_px}, truth, decoded.finest_period_px).median_m;
  };
  const Frame plain = reconstruct(decoded, rig, triangulation, depth_options);
  const double before = median_error(plain);
  const AlignedStack aligned =
      align_stack(stack, rig, rays, filled_depth(truth.depth_m, rig.middle_range_m()), twist, rig.sensor.max_dn());
  DecodeContext context{Axis::columns, &expected};
  context.aligned = &aligned;
  decoded = decode(stack, rig, options, context);
  return {before, median_error(reconstruct(decoded, rig, triangulation, depth_options))};
}

std::vector<Row> motion_rows(const Context& context) {
  const Motion motions[] = {{"towards", {0, 0, 1}, {0, 0, 0}},
                            {"across", {0.8, 0.6, 0}, {0, 0, 0}},
                            {"oblique", {0.6, 0.3, 0.742}, {0, 0, 0}},
                            {"rolling", {0, 0, 0}, {0, 0, 1}},
                            {"turning", {0, 0, 0}, {0.5, 0.866, 0}}};
  const int seeds = context.quick ? 1 : 5;
  std::vector<double> ratios;
  for (const Motion& motion : motions) {
    std::vector<double> still;
    for (const double speed : {0.0, 0.02, 0.05, 0.1, 0.2}) {
      std::vector<double> plain, compensated;
      for (int seed = 1; seed <= seeds; ++seed) {
        const MovingErrors errors = moving_errors(motion, speed, static_cast<uint64_t>(seed));
        if (speed == 0) still.push_back(errors.plain_m);
        plain.push_back(errors.plain_m);
        compensated.push_back(errors.compensated_m);
        if (speed == 0.1 && motion.direction.z() == 1)
          ratios.push_back(errors.compensated_m / still[static_cast<size_t>(seed) - 1]);
      }
      std::fprintf(stderr, "  %-8s %.2f %s: median depth error %6.1f um, compensated %6.1f um\n", motion.name, speed,
                   motion.axis.isZero() ? "m/s" : "rad/s", 1e6 * median_of(plain), 1e6 * median_of(compensated));
    }
  }
  return {median_row("depth.moving", ratios, "x", 1.5)};
}

std::vector<Row> expected_view_rows(const Context& context) {
  const PredictionPair pair = prediction_pair("rubble_pile", 0, 1);
  ExpectedView view;
  CoordinatePrior expected;
  const auto times = interleaved_times(
      {[&] {
         view = expected_view({{&pair.known, pair.predicted, pair.covariance}}, pair.scene.rig.camera, pair.rays);
       },
       [&] { expected = predict_coordinate(pair.scene.rig, pair.rays, view.depth_m, view.sigma_m); }},
      context.quick ? 10 : 50);
  const Row coordinate = median_row("", in_ms(times[1]), "ms", 0);
  std::fprintf(stderr, "  predicted coordinates %.2f ms\n", coordinate.value);
  return {median_row("speed.expected_view", in_ms(times[0]), "ms", 40)};
}

}  // namespace

std::vector<Item> prediction_items() {
  return {{{"predicted.wrong_order", "predicted.valid"},
           "three images unwrapped with the previous view and a pose off by 2 mm and 0.2 degrees",
           prediction_rows},
          {{"depth.moving"}, "median depth error at 0.1 m/s after compensation, relative to that at rest", motion_rows},
          {{"speed.expected_view"}, "predicted depth of a 532 x 500 view of rubble", expected_view_rows}};
}

}  // namespace fringeslam::bench
