// SPDX-License-Identifier: Apache-2.0
// Stacks that were rendered in motion, decoded and registered.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numbers>
#include <opencv2/core.hpp>
#include <random>

#include "core/decode/stack_motion.h"
#include "core/decode/texture_flow.h"
#include "core/mapper/pipeline.h"
#include "core/patterns/waveform.h"
#include "core/types/linear_algebra.h"
#include "sim/virtual_rig.h"
#include "tests/support/temp_folder.h"

namespace fringeslam::sim {
namespace {

Scene loop_scene() { return load_scene(std::string(FRINGESLAM_SOURCE_DIR) + "/scenes/loop/scene.yaml"); }

// The first view of scenes/loop, exposed while the camera moves at a constant twist.
struct MovingView {
  Scene scene = loop_scene();
  CameraMotion motion;
  SimulatedView view;
  PixelRays rays = pixel_rays(scene.rig.camera);

  MovingView(const Eigen::Vector3d& velocity_m_s, const Eigen::Vector3d& angular_rad_s, bool complete,
             const RenderOptions& options = {}) {
    const Pose& mount = scene.rig.robot_from_camera;
    scene.trajectory.resize(1);
    scene.motion.angular_rad_s = mount.rotation * angular_rad_s;
    scene.motion.velocity_m_s = mount.rotation * velocity_m_s - scene.motion.angular_rad_s.cross(mount.translation);
    motion.angular_rad_s = angular_rad_s;
    motion.velocity_m_s = velocity_m_s;
    const PatternSequence sequence = complete ? scene.patterns : finest_patterns(scene.patterns, Axis::columns);
    view = *VirtualRig(scene, options).simulate(sequence);
  }

  // Median depth error, with fringe orders from a prediction within 2 mm of the truth.
  double depth_error_m(const CameraMotion& compensated) const {
    const RigModel& rig = scene.rig;
    const cv::Mat1f& truth_m = view.truth.depth_m;
    const CoordinatePrior expected = predict_coordinate(rig, rays, truth_m, cv::Mat1f(truth_m.size(), 2e-3f));
    DecodeOptions options;
    options.unwrapping = Unwrapping::predicted;
    DecodeContext context{Axis::columns, &expected};
    AlignedStack aligned;
    if (!compensated.is_still()) {
      aligned = align_stack(view.stack, rig, rays, filled_depth(truth_m, rig.middle_range_m()), compensated,
                            rig.sensor.max_dn());
      context.aligned = &aligned;
    }
    const Frame frame = reconstruct(decode(view.stack, rig, options, context), rig, rays, {});
    std::vector<double> errors;
    for (int row = 0; row < frame.height(); ++row) {
      for (int col = 0; col < frame.width(); ++col) {
        const double error = std::abs(static_cast<double>(frame.points_m(row, col)[2] - truth_m(row, col)));
        if (!std::isnan(error)) errors.push_back(error);
      }
    }
    std::nth_element(errors.begin(), errors.begin() + static_cast<std::ptrdiff_t>(errors.size() / 2), errors.end());
    return errors[errors.size() / 2];
  }
};

TEST(MovingStack, KnownMotionRestoresTheDepth) {
  const double at_rest_m = MovingView({0, 0, 0}, {0, 0, 0}, false).depth_error_m({});
  for (const Eigen::Vector3d& velocity : {Eigen::Vector3d(0, 0.3, 0), Eigen::Vector3d(0, 0, 0.3)}) {
    const MovingView moving(velocity, {0, 0, 0}, false);
    EXPECT_LT(moving.depth_error_m(moving.motion), 1.35 * at_rest_m);
    EXPECT_GT(moving.depth_error_m({}), 3 * at_rest_m);
  }
}

TEST(MovingStack, AlignmentAtRestChangesNothing) {
  const MovingView still({0, 0, 0}, {0, 0, 0}, false);
  const cv::Mat1f depth_m = filled_depth(still.view.truth.depth_m, 1);
  const AlignedStack aligned =
      align_stack(still.view.stack, still.scene.rig, still.rays, depth_m, {}, still.scene.rig.sensor.max_dn());
  const cv::Rect inner(4, 4, depth_m.cols - 8, depth_m.rows - 8);
  for (size_t k = 0; k < aligned.images.size(); ++k) {
    cv::Mat1f image;
    still.view.stack.images[k].convertTo(image, CV_32F);
    // The pixels that the rays return to, within the rounding of the lens model.
    EXPECT_LT(cv::norm(cv::Mat(aligned.images[k](inner)), cv::Mat(image(inner)), cv::NORM_INF), 0.1);
    EXPECT_LT(cv::norm(cv::Mat(aligned.drift_px[k](inner)), cv::NORM_INF), 1e-3);
  }
}

TEST(MovingStack, DepthSlopesPredictTheEffectOfAWrongMotion) {
  RenderOptions clean{16, false, false, {}};
  clean.effects.fixed_pattern = false;
  const MovingView moving({0.1, 0.15, 0.1}, {0.05, 0.1, -0.1}, false, clean);
  const RigModel& rig = moving.scene.rig;
  const cv::Mat1f& truth_m = moving.view.truth.depth_m;
  const CoordinatePrior expected = predict_coordinate(rig, moving.rays, truth_m, cv::Mat1f(truth_m.size(), 2e-3f));
  DecodeOptions options;
  options.unwrapping = Unwrapping::predicted;
  const auto depth_with = [&](const CameraMotion& motion) {
    const AlignedStack aligned =
        align_stack(moving.view.stack, rig, moving.rays, filled_depth(truth_m, 1), motion, rig.sensor.max_dn());
    DecodeContext context{Axis::columns, &expected};
    context.aligned = &aligned;
    cv::Mat1f depth;
    cv::extractChannel(reconstruct(decode(moving.view.stack, rig, options, context), rig, moving.rays, {}).points_m,
                       depth, 2);
    return depth;
  };
  const cv::Mat1f depth = depth_with(moving.motion);
  const double finest_px = fringe_groups(moving.view.stack.patterns, Axis::columns).back().period_px;
  const std::vector<DepthSlope> slopes =
      depth_slopes(moving.view.stack, rig, moving.rays, depth, rig.sensor.max_dn(), moving.motion, finest_px, 7);
  ASSERT_GT(slopes.size(), 2000u);
  Vector12d sizes;
  sizes << Eigen::Vector3d::Constant(0.01), Eigen::Vector3d::Constant(0.01), Eigen::Vector3d::Constant(1),
      Eigen::Vector3d::Constant(1);
  for (int parameter = 0; parameter < 12; ++parameter) {
    Vector12d change = Vector12d::Zero();
    change[parameter] = sizes[parameter];
    const cv::Mat1f changed = depth_with(to_motion(to_vector(moving.motion) + change));
    double product = 0, predicted = 0, measured = 0;
    for (const DepthSlope& slope : slopes) {
      const double by = slope.by_motion.dot(change);
      const double effect = static_cast<double>(changed(slope.row, slope.col) - depth(slope.row, slope.col));
      if (std::isnan(effect) || std::abs(effect) > 5e-3 || std::abs(by) > 5e-3) continue;
      product += by * effect;
      predicted += by * by;
      measured += effect * effect;
    }
    EXPECT_GT(product / std::sqrt(predicted * measured), 0.9) << parameter;
    EXPECT_NEAR(product / predicted, 1, 0.1) << parameter;
  }
}

TEST(MovingStack, CompleteStacksEstimateTheirMotion) {
  const double turn = 20 * std::numbers::pi / 180;
  const std::pair<Eigen::Vector3d, Eigen::Vector3d> motions[] = {{{0.3, 0, 0}, {0, 0, 0}},
                                                                 {{-0.3, 0, 0}, {0, 0, 0}},
                                                                 {{0, 0.3, 0}, {0, 0, 0}},
                                                                 {{0, 0, 0.3}, {0, 0, 0}},
                                                                 {{0, 0, 0}, {turn, 0, 0}},
                                                                 {{0, 0, 0}, {0, -turn, 0}},
                                                                 {{-0.2, 0.1, 0.1}, {0, 0.5 * turn, 0.5 * turn}}};
  for (const auto& [velocity, angular] : motions) {
    const MovingView moving(velocity, angular, true);
    const FringeFrontEnd front_end(moving.scene.rig, moving.scene.patterns, {});
    const ReconstructedView detected = front_end.reconstruct(moving.view.stack, {});
    ASSERT_TRUE(detected.motion);
    EXPECT_FALSE(detected.motion->converged);
    const ReconstructedView view = front_end.reconstruct(moving.view.stack, {nullptr, unknown_motion({})});
    ASSERT_TRUE(view.motion && view.motion->converged);
    EXPECT_LT((view.motion->motion.velocity_m_s - velocity).norm(), 0.03);
    EXPECT_LT((view.motion->motion.angular_rad_s - angular).norm(), 0.03);
  }
}

// Between the images of one period, the texture moves by up to 20 px, and the depth decoded as at rest has many wrong
// fringe orders.
TEST(MovingStack, TextureShowsFastMotions) {
  const double turn = 60 * std::numbers::pi / 180;
  const std::pair<Eigen::Vector3d, Eigen::Vector3d> motions[] = {
      {{0.6, 0, 0}, {0, 0, turn}}, {{0, -0.8, 0}, {0, turn, 0}}, {{0.3, 0.3, -0.3}, {-turn, 0.5 * turn, 0}}};
  for (const auto& [velocity, angular] : motions) {
    const MovingView moving(velocity, angular, true);
    const RigModel& rig = moving.scene.rig;
    const FringeFrontEnd front_end(rig, moving.scene.patterns, {});
    const ReconstructedView at_rest = front_end.reconstruct(moving.view.stack, {});
    cv::Mat1f depth_m;
    cv::extractChannel(at_rest.frame.points_m, depth_m, 2);
    const std::optional<CameraMotion> rough = motion_from_texture(
        moving.view.stack, rig, moving.rays, filled_depth(depth_m, rig.middle_range_m()), unknown_motion({}));
    ASSERT_TRUE(rough);
    // Rotation and translation are hardly distinguishable; their common displacement of surfaces is known.
    const Eigen::Vector3d middle(0, 0, rig.middle_range_m());
    const auto flow_m_s = [&](const Eigen::Vector3d& w, const Eigen::Vector3d& v) {
      return Eigen::Vector3d(w.cross(middle) + v);
    };
    EXPECT_LT((flow_m_s(rough->angular_rad_s, rough->velocity_m_s) - flow_m_s(angular, velocity)).norm(), 0.1);
    const ReconstructedView view = front_end.reconstruct(moving.view.stack, {nullptr, unknown_motion({})});
    ASSERT_TRUE(view.motion && view.motion->converged);
    const CameraMotion& found = view.motion->motion;
    // Over several seeds of the noise it is 0.002 to 0.039.
    EXPECT_LT((flow_m_s(found.angular_rad_s, found.velocity_m_s) - flow_m_s(angular, velocity)).norm(), 0.05);
    Vector12d error = to_vector(found);
    error.head<6>() -= (Eigen::Matrix<double, 6, 1>() << angular, velocity).finished();
    constexpr double kUnlikely = 33;  // chi-square of twelve degrees of freedom, 0.1 %
    EXPECT_LT(error.dot(view.motion->covariance.inverse() * error), kUnlikely);
    EXPECT_LT(view.motion->covariance(3, 3), 0.06 * 0.06);
  }
}

// Stacks of several exposures are not decoded in motion, but one of their exposures shows it.
TEST(MovingStack, SeveralExposuresShowMotion) {
  Scene scene = loop_scene();
  scene.trajectory.resize(1);
  PatternSequence patterns = scene.patterns;
  for (Pattern pattern : scene.patterns.patterns) {
    pattern.exposure = 0.25;
    patterns.patterns.push_back(pattern);
  }
  const FringeFrontEnd front_end(scene.rig, patterns, {});
  for (const double speed_m_s : {0.0, 0.05, 0.3}) {
    scene.motion.velocity_m_s = scene.rig.robot_from_camera.rotation * Eigen::Vector3d(speed_m_s, 0, 0);
    const SimulatedView moving = *VirtualRig(scene, {}).simulate(patterns);
    const ReconstructedView view = front_end.reconstruct(moving.stack, {nullptr, unknown_motion({})});
    ASSERT_TRUE(view.motion) << speed_m_s;
    EXPECT_EQ(view.motion->converged, speed_m_s == 0) << speed_m_s;
    EXPECT_FALSE(view.in_motion()) << speed_m_s;
    EXPECT_TRUE(front_end.depth_slopes(moving.stack, view, 8).empty()) << speed_m_s;
  }
}

// 99.9 % of a chi-square distribution with six degrees of freedom.
constexpr double kUnlikelySixSquare = 22.5;

// Turn rate and velocity of the camera in its own axes.
Vector6d rate_of(const ContinuousPath& path, const Pose& robot_from_camera, double time_s) {
  constexpr double kStep_s = 2e-3;
  const auto camera_at = [&](double after_s) { return path.at(time_s + after_s) * robot_from_camera; };
  const Pose camera_from_world = camera_at(0).inverse();
  const Pose before = camera_from_world * camera_at(-kStep_s), after = camera_from_world * camera_at(kStep_s);
  Vector6d rate;
  rate << rotation_log(after.rotation) - rotation_log(before.rotation), after.translation - before.translation;
  return rate / (2 * kStep_s);
}

// Accelerations of 1.6 to 2.9 m/s^2 and rad/s^2 that change every 50 ms: more than a motion of second order can follow.
TEST(MovingStack, ChangingAccelerationsAreEstimatedWithinTheirSigmas) {
  constexpr double kKnot_s = 0.05;
  Scene scene = loop_scene();
  const Pose mount = scene.rig.robot_from_camera, start = scene.trajectory.front().world_from_robot * mount;
  for (const uint64_t seed : {uint64_t{1}, uint64_t{2}, uint64_t{3}}) {
    std::mt19937_64 random(seed);
    const auto change = [&] {
      return Eigen::Vector3d::NullaryExpr([&] { return 2 * static_cast<double>(random() >> 11) / 0x1p53 - 1; }).eval();
    };
    Eigen::Vector3d velocity = 0.25 * change(), turn = 0.3 * change();
    std::vector<Pose> controls;
    for (Pose at = start; controls.size() < 8; at = at * Pose{rotation_exp(kKnot_s * turn), kKnot_s * velocity}) {
      controls.push_back(orthonormalised(at * mount.inverse()));
      velocity += 0.08 * change();
      turn += 0.12 * change();
    }
    scene.path.emplace(std::move(controls), kKnot_s, Vibration{}, seed);
    scene.view_rate_hz = 0;
    VirtualRig rig(scene, {});
    const SimulatedView view = *rig.simulate(scene.patterns);
    const FringeFrontEnd front_end(scene.rig, scene.patterns, {});
    const ReconstructedView found = front_end.reconstruct(view.stack, {nullptr, unknown_motion({})});
    ASSERT_TRUE(found.motion && found.motion->converged) << seed;
    const Vector6d error =
        to_vector(found.motion->motion).head<6>() - rate_of(*scene.path, mount, view.stack.timestamp_s);
    const Matrix6d covariance = found.motion->covariance.topLeftCorner<6, 6>();
    EXPECT_LT(error.norm(), 0.1) << seed;
    EXPECT_LT(error.dot(solve_symmetric(covariance, error)), kUnlikelySixSquare) << seed;
  }
}

// The robot brakes at 8 m/s^2 and 10 rad/s^2 during the stack, which was predicted to go on as before. One in ten stacks is
// estimated at a wrong minimum.
TEST(MovingStack, AStackThatBrakesIsEstimatedFromThePredictionThatItContradicts) {
  constexpr double kKnot_s = 0.05;
  constexpr int kStacks = 6;
  std::mt19937_64 random(5);
  std::normal_distribution<double> normal;
  int within_sigmas = 0;
  for (int i = 0; i < kStacks; ++i) {
    const double x = normal(random), y = normal(random), z = normal(random);
    const Eigen::Vector3d forward = Eigen::Vector3d(x, y, 0.4 * z).normalized(),
                          about = forward.cross(Eigen::Vector3d::UnitZ()).normalized();
    Scene scene = loop_scene();
    const Pose mount = scene.rig.robot_from_camera, start = scene.trajectory.front().world_from_robot * mount;
    double speed_m_s = 0.25, turn_rad_s = 0.25;
    std::vector<Pose> controls;
    for (Pose at = start; controls.size() < 8;
         at = at * Pose{rotation_exp(kKnot_s * turn_rad_s * about), kKnot_s * speed_m_s * forward}) {
      controls.push_back(orthonormalised(at * mount.inverse()));
      speed_m_s -= 8 * kKnot_s;
      turn_rad_s -= 10 * kKnot_s;
    }
    scene.path.emplace(std::move(controls), kKnot_s, Vibration{}, 1);
    scene.view_rate_hz = 0;
    const SimulatedView view = *VirtualRig(scene, {}).simulate(scene.patterns);
    const FringeFrontEnd front_end(scene.rig, scene.patterns, {});
    const ReconstructedView rough = front_end.reconstruct(view.stack, {});
    MotionPrior predicted = unknown_motion({});
    predicted.motion.velocity_m_s = 0.25 * forward;
    predicted.motion.angular_rad_s = 0.25 * about;
    predicted.covariance.topLeftCorner<6, 6>() = 1e-3 * Matrix6d::Identity();
    const ReconstructedView found = front_end.reconstruct(view.stack, {nullptr, predicted, false, &rough});
    ASSERT_TRUE(found.motion && found.motion->converged) << i;
    const Vector6d error =
        to_vector(found.motion->motion).head<6>() - rate_of(*scene.path, mount, view.stack.timestamp_s);
    const Matrix6d covariance = found.motion->covariance.topLeftCorner<6, 6>();
    within_sigmas += error.norm() < 0.1 && error.dot(solve_symmetric(covariance, error)) < kUnlikelySixSquare;
  }
  EXPECT_GE(within_sigmas, kStacks - 1);
}

// Three steps of 120 degrees that drift by minus 120 degrees per image are equal.
TEST(MovingStack, FringesThatDriftWithTheirShiftsAreLeftOut) {
  const PatternSequence sequence = phase_shift_sequence(64, 8, {64, 16}, 3, Axis::columns, 0);
  const std::vector<FringeGroup> groups = fringe_groups(sequence, Axis::columns);
  ASSERT_EQ(groups.size(), 2u);
  for (const double drift_px : {-16.0 / 3, -2.0, 0.0, 16.0 / 3}) {
    AlignedStack aligned;
    for (size_t k = 0; k < sequence.patterns.size(); ++k) {
      aligned.images.emplace_back(32, 32, 100.f);
      aligned.drift_px.emplace_back(32, 32, static_cast<float>(drift_px * static_cast<double>(k)));
    }
    EXPECT_EQ(most_accurate_group(aligned, groups), drift_px == -16.0 / 3 ? 0u : 1u) << drift_px;
  }
}

TEST(MovingStack, NoTextureShowsNoMotion) {
  MovingView still({0, 0, 0}, {0, 0, 0}, true);
  for (cv::Mat& image : still.view.stack.images) image.setTo(100);
  EXPECT_FALSE(motion_from_texture(still.view.stack, still.scene.rig, still.rays,
                                   cv::Mat1f(still.view.truth.depth_m.size(), 1.f), unknown_motion({})));
}

// Along the baseline, drift turns steps of 120 degrees into 65 in one direction and 175 in the other.
TEST(MovingStack, AnticipatedShiftsAreEvenlySpacedAfterTheDrift) {
  for (const double speed_m_s : {-0.3, 0.3, 0.6}) {
    const MovingView before({speed_m_s, 0, 0}, {0, 0, 0}, true);
    const RigModel& rig = before.scene.rig;
    const FringeFrontEnd front_end(rig, before.scene.patterns, {});
    ReconstructedView last;
    cv::Mat1f depth = before.view.truth.depth_m;
    last.frame.points_m.create(depth.size());
    for (int row = 0; row < depth.rows; ++row) {
      for (int col = 0; col < depth.cols; ++col) {
        const cv::Vec2f& ray = before.rays(row, col);
        last.frame.points_m(row, col) = depth(row, col) * cv::Vec3f(ray[0], ray[1], 1);
      }
    }
    last.motion.emplace();
    last.motion->motion = before.motion;
    last.motion->converged = true;
    const PatternSequence finest = finest_patterns(before.scene.patterns, Axis::columns);
    const PatternSequence patterns = front_end.anticipated(finest, last);
    FringeStack stack = before.view.stack;
    stack.patterns = patterns;
    stack.exposure_time_s = exposure_times_s(0, patterns, rig.timing);
    stack.timestamp_s = 0;
    stack.images.resize(3);
    stack.exposure_s.resize(3);
    const AlignedStack aligned = align_stack(stack, rig, before.rays, filled_depth(depth, rig.middle_range_m()),
                                             before.motion, rig.sensor.max_dn());
    std::array<std::vector<double>, 2> steps;
    const double rad_per_px = 2 * std::numbers::pi / patterns.patterns[0].period_px;
    for (int row = 0; row < depth.rows; row += 10) {
      for (int col = 0; col < depth.cols; col += 10) {
        for (size_t k = 0; k < 2; ++k) {
          const double drift_px =
              static_cast<double>(aligned.drift_px[k + 1](row, col) - aligned.drift_px[k](row, col));
          if (std::isnan(drift_px)) continue;
          const double step =
              patterns.patterns[k + 1].shift_rad - patterns.patterns[k].shift_rad + rad_per_px * drift_px;
          steps[k].push_back(std::abs(std::remainder(step, 2 * std::numbers::pi)));
        }
      }
    }
    for (std::vector<double>& list : steps) {
      ASSERT_GT(list.size(), 100u);
      std::nth_element(list.begin(), list.begin() + static_cast<std::ptrdiff_t>(list.size() / 2), list.end());
      EXPECT_NEAR(list[list.size() / 2] * 180 / std::numbers::pi, 120, 16) << speed_m_s;
    }
  }
}

// A drift that moves the fringes by as much as they are shifted would leave two different patterns of an even number.
TEST(MovingStack, AnticipatedShiftsCanBeDecoded) {
  const MovingView before({0.3, 0, 0}, {0, 0, 0}, true);
  const RigModel& rig = before.scene.rig;
  ReconstructedView last;
  last.frame.points_m.create(before.view.truth.depth_m.size());
  last.frame.points_m.setTo(
      cv::Scalar::all(std::numeric_limits<float>::quiet_NaN()));  // all at the middle of the range
  last.motion.emplace();
  last.motion->converged = true;
  int changed = 0;
  for (const int steps : {3, 4, 5, 6, 8}) {
    const PatternSequence all =
        phase_shift_sequence(rig.projector.width, rig.projector.height, {1040, 130, 16.25}, steps, Axis::columns, 8);
    const PatternSequence finest = finest_patterns(all, Axis::columns);
    const FringeFrontEnd front_end(rig, all, {});
    for (double speed_m_s = -1; speed_m_s <= 1; speed_m_s += 0.02) {
      last.motion->motion.velocity_m_s = {speed_m_s, 0, 0};
      for (const PatternSequence& wanted : {all, finest}) {
        const PatternSequence anticipated = front_end.anticipated(wanted, last);
        EXPECT_NO_THROW(fringe_groups(anticipated, Axis::columns)) << steps << " steps, " << speed_m_s;
        changed += !(anticipated == wanted);
      }
    }
  }
  EXPECT_GT(changed, 500);
}

// A selection of the steps needs the designed shifts.
TEST(MovingStack, ShiftsOfSelectedStepsAreNotChanged) {
  const MovingView before({0.3, 0, 0}, {0, 0, 0}, true);
  ReconstructedView last;
  last.frame.points_m.create(before.view.truth.depth_m.size());
  last.frame.points_m.setTo(cv::Scalar::all(std::numeric_limits<float>::quiet_NaN()));
  last.motion.emplace();
  last.motion->motion.velocity_m_s = {0.3, 0, 0};
  last.motion->converged = true;
  FrontEndOptions options;
  EXPECT_FALSE(
      FringeFrontEnd(before.scene.rig, before.scene.patterns, options).anticipated(before.scene.patterns, last) ==
      before.scene.patterns);
  options.decode.steps = 3;
  EXPECT_TRUE(
      FringeFrontEnd(before.scene.rig, before.scene.patterns, options).anticipated(before.scene.patterns, last) ==
      before.scene.patterns);
}

// The drift changes the shifts that the projector's response is corrected for: at 0.3 m/s, by up to 60 degrees.
TEST(MovingStack, TheResponseIsCorrectedForTheShiftsInMotion) {
  for (const double speed_m_s : {0.3, -0.3}) {
    Scene scene = loop_scene();
    scene.rig.projector_response = gamma_table(1.5);
    scene.rig.phase_correction = phase_correction_of(scene.rig.projector_response, 3);
    scene.trajectory.resize(1);
    CameraMotion motion;
    motion.velocity_m_s = {speed_m_s, 0, 0};
    scene.motion.velocity_m_s = scene.rig.robot_from_camera.rotation * motion.velocity_m_s;
    const SimulatedView moving = *VirtualRig(scene, {}).simulate(scene.patterns);
    const ReconstructedView view =
        FringeFrontEnd(scene.rig, scene.patterns, {}).reconstruct(moving.stack, {nullptr, unknown_motion({}), false});
    ASSERT_TRUE(view.motion);
    ASSERT_TRUE(view.motion->converged) << speed_m_s;
    const StackMotion& found = view.undecided_motion ? *view.undecided_motion : *view.motion;
    const Eigen::VectorXd error = to_vector(found.motion) - to_vector(motion);
    EXPECT_LT(error.dot(solve_positive_definite(Eigen::MatrixXd(found.covariance), error)), 33)
        << "99.9 % of a chi-square distribution with twelve degrees of freedom, " << speed_m_s
        << " m/s: " << error.transpose();
  }
}

// Codings that need a camera at rest say that the motion is unknown instead of ending the run.
TEST(MovingStack, CodingsThatNeedRestLeaveTheMotionUnknown) {
  for (const char* patterns : {"{axis: columns, steps: 3, periods_px: [1040, 130, 16.25], gray: complementary, "
                               "gray_cell_px: 8.125, gray_xor_px: [0, 16.25]}",
                               "{axis: columns, steps: 3, periods_px: [130, 16.25], gray: plain}",
                               "{axis: columns, steps: 3, periods_px: [65, 16.25], gray: plain, gray_cell_px: 32.5}"}) {
    SceneLoadOptions reading;
    reading.changes = {{"patterns", patterns}};
    Scene scene = load_scene(std::string(FRINGESLAM_SOURCE_DIR) + "/scenes/loop/scene.yaml", reading);
    scene.trajectory.resize(1);
    const FringeFrontEnd front_end(scene.rig, scene.patterns, {});
    EXPECT_FALSE(decodes_in_motion(scene.patterns, scene.rig, {}));
    for (const double speed_m_s : {0.0, 0.3}) {
      scene.motion.velocity_m_s = scene.rig.robot_from_camera.rotation * Eigen::Vector3d(speed_m_s, 0, 0);
      const SimulatedView moving = *VirtualRig(scene, {}).simulate(scene.patterns);
      CameraMotion known;
      known.velocity_m_s = {0.3, 0, 0};
      for (const bool is_known : {false, true}) {
        const MotionPrior prior{known, unknown_motion({}).covariance};
        const ReconstructedView view =
            front_end.reconstruct(moving.stack, {nullptr, is_known ? prior : unknown_motion({}), is_known});
        ASSERT_TRUE(view.motion) << patterns;
        EXPECT_EQ(view.motion->converged, speed_m_s == 0) << patterns << speed_m_s;
        EXPECT_FALSE(view.in_motion());
      }
    }
  }
}

// Each bit of a Gray code is that of its own exposure's coordinate, which differs from that of the phase by up to a period.
TEST(MovingStack, GrayCodesNumberThePeriods) {
  const char* const complementary =
      "{axis: columns, steps: 3, periods_px: [130, 16.25], gray: complementary, gray_cell_px: 8.125}";
  const char* const xored =
      "{axis: columns, steps: 3, periods_px: [130, 16.25], gray: complementary, gray_cell_px: 8.125, "
      "gray_xor_px: [16.25]}";
  struct Case {
    const char *patterns, *rig, *world;
    double most_wrong;
  };
  // Beside edges, some of the images show another surface. The fringes of a nonlinear projector have phase errors, which the
  // drift between three images multiplies.
  for (const auto& [patterns, rig, world, most_wrong] :
       {Case{complementary, "thesis", "flat_board", 1e-5}, Case{xored, "thesis", "flat_board", 1e-5},
        Case{complementary, "thesis", "loop", 2e-3}, Case{complementary, "gamma", "flat_board", 5e-3}}) {
    int valid_at_rest = 0;
    for (const double speed_m_s : {0.0, 0.3, -0.3}) {
      SceneLoadOptions reading;
      reading.changes = {{"patterns", patterns}};
      reading.rig_file = std::string(FRINGESLAM_SOURCE_DIR) + "/scenes/rigs/" + rig + ".yaml";
      Scene scene = load_scene(std::string(FRINGESLAM_SOURCE_DIR) + "/scenes/" + world + "/scene.yaml", reading);
      scene.trajectory.resize(1);
      CameraMotion motion;
      motion.velocity_m_s = {speed_m_s, 0, 0};
      scene.motion.velocity_m_s = scene.rig.robot_from_camera.rotation * motion.velocity_m_s;
      const SimulatedView view = *VirtualRig(scene, {}).simulate(scene.patterns);
      const PixelRays rays = pixel_rays(scene.rig.camera);
      const cv::Mat1f& truth_m = view.truth.depth_m;
      const AlignedStack aligned =
          align_stack(view.stack, scene.rig, rays, filled_depth(truth_m, 1), motion, 0.98 * scene.rig.sensor.max_dn());
      DecodeOptions options;
      options.unwrapping = Unwrapping::gray;
      DecodeContext context;
      if (speed_m_s != 0) context.aligned = &aligned;
      const DecodedStack decoded = decode(view.stack, scene.rig, options, context);
      const cv::Mat1f true_px =
          predict_coordinate(scene.rig, rays, truth_m, cv::Mat1f(truth_m.size(), 1e-3f)).coordinate_px;
      int valid = 0, wrong = 0;
      for (int row = 0; row < truth_m.rows; ++row) {
        for (int col = 0; col < truth_m.cols; ++col) {
          const double error_px = std::abs(static_cast<double>(decoded.coordinate_px(row, col) - true_px(row, col)));
          if (std::isnan(error_px) || (static_cast<int>(view.truth.mask(row, col)) & kTruthMixed) != 0) continue;
          ++valid;
          wrong += error_px > 0.5 * decoded.finest_period_px;
        }
      }
      if (speed_m_s == 0) valid_at_rest = valid;
      EXPECT_GT(valid, 0.45 * valid_at_rest) << patterns << rig << world << speed_m_s;
      EXPECT_LE(wrong, (speed_m_s == 0 ? 1e-4 : most_wrong) * valid) << patterns << rig << world << speed_m_s;
    }
  }
}

// Saturated pixels are no sign of a motion.
TEST(MovingStack, SaturationIsNoMotion) {
  Scene scene = loop_scene();
  scene.trajectory.resize(1);
  scene.rig.projector_lens.flux_lm *= 5;
  const SimulatedView still = *VirtualRig(scene, {}).simulate(scene.patterns);
  int saturated = 0;
  for (const cv::Mat& image : still.stack.images) saturated = std::max(saturated, cv::countNonZero(image == 255));
  EXPECT_GT(saturated, static_cast<int>(still.stack.images[0].total()) / 20);
  const cv::Mat1f depth_m = filled_depth(still.truth.depth_m, 1);
  const PixelRays rays = pixel_rays(scene.rig.camera);
  EXPECT_EQ(shows_motion(still.stack, scene.rig, rays, depth_m, 250), false);
  EXPECT_EQ(shows_motion(still.stack, scene.rig, rays, depth_m, 1000), true);
  const StackMotion at_rest =
      estimate_stack_motion(still.stack, scene.rig, rays, depth_m, 250, unknown_motion({}), MotionSearch::close);
  EXPECT_TRUE(at_rest.converged);
  EXPECT_TRUE(at_rest.covariance.allFinite());
  EXPECT_FALSE(is_moving(at_rest));
  // Motion too slow to leave large residuals is found beside saturated pixels too.
  scene.motion.velocity_m_s = scene.rig.robot_from_camera.rotation * Eigen::Vector3d(0.01, 0, 0);
  const SimulatedView slow = *VirtualRig(scene, {}).simulate(scene.patterns);
  EXPECT_EQ(shows_motion(slow.stack, scene.rig, rays, filled_depth(slow.truth.depth_m, 1), 250), true);
}

// Interpolation between saturated and other pixels must not hide the saturation.
TEST(MovingStack, SaturatedPixelsAreNotAligned) {
  const MovingView moving({0.1, 0.05, 0}, {0, 0, 0}, true);
  FringeStack stack = moving.view.stack;
  const size_t number = stack.images.size() - 1;
  const cv::Point at(60, 40);
  stack.images[number] = stack.images[number].clone();
  stack.images[number].at<uchar>(at) = 255;
  const cv::Mat1f depth_m = filled_depth(moving.view.truth.depth_m, 1);
  const auto aligned = [&](double clip_dn) {
    return align_stack(stack, moving.scene.rig, moving.rays, depth_m, moving.motion, clip_dn).drift_px[number];
  };
  const cv::Mat1f with = aligned(250), without = aligned(1000);
  int hidden = 0;
  for (int row = 0; row < with.rows; ++row) {
    for (int col = 0; col < with.cols; ++col) {
      if (std::isnan(without(row, col))) continue;
      if (std::isnan(with(row, col))) {
        ++hidden;
        EXPECT_LT(std::hypot(row - at.y, col - at.x), 12) << row << ' ' << col;
      } else {
        EXPECT_EQ(with(row, col), without(row, col));
      }
    }
  }
  EXPECT_GE(hidden, 9);
  EXPECT_LE(hidden, 25);
}

TEST(MovingStack, AStackAtRestIsDecodedAsAtRest) {
  const MovingView still({0, 0, 0}, {0, 0, 0}, true);
  const FringeFrontEnd front_end(still.scene.rig, still.scene.patterns, {});
  const ReconstructedView view = front_end.reconstruct(still.view.stack, {});
  ASSERT_TRUE(view.motion && view.motion->converged);
  EXPECT_TRUE(view.motion->motion.is_still());
  const DecodedStack decoded = decode(still.view.stack, still.scene.rig, {});
  const auto same = [](const cv::Mat& a, const cv::Mat& b) {
    return a.size() == b.size() && std::equal(a.datastart, a.dataend, b.datastart);
  };
  EXPECT_TRUE(same(view.decoded.coordinate_px, decoded.coordinate_px));
  EXPECT_TRUE(same(view.decoded.sigma_px, decoded.sigma_px));
  // Nor does the estimation of a motion change a stack that turns out to be at rest.
  const ReconstructedView estimated = front_end.reconstruct(still.view.stack, {nullptr, unknown_motion({})});
  ASSERT_TRUE(estimated.motion && estimated.motion->converged);
  EXPECT_TRUE(estimated.motion->motion.is_still());
  EXPECT_TRUE(same(estimated.decoded.coordinate_px, decoded.coordinate_px));
}

// The path of scenes/loop at 0.3 m/s, without stops.
Scene moving_loop_scene() {
  SceneLoadOptions reading;
  reading.changes = {{"trajectory.continuous.speed_m_s", "0.3"}};
  return load_scene(std::string(FRINGESLAM_SOURCE_DIR) + "/scenes/loop/scene.yaml", reading);
}

// Half a metre at 0.3 m/s: full sequences, then three images per view at 30 views a second.
TEST(MovingRobot, IsTrackedWithThreeImagesPerView) {
  const Scene scene = moving_loop_scene();
  VirtualRig rig(scene, {});
  PipelineOptions options;
  options.decode.unwrapping = Unwrapping::predicted;
  Pipeline pipeline(rig.model(), scene.patterns, options, {});
  std::optional<Pose> start_true, start_found;
  int predicted = 0;
  for (int i = 0; i < 10; ++i) {
    SimulatedView view = *rig.simulate(pipeline.next_patterns());
    ASSERT_EQ(view.truth.exposures.size(), view.stack.images.size());
    const FrameResult result = pipeline.process(std::move(view.stack));
    ASSERT_NE(result.tracking, Tracking::lost) << i;
    predicted += !result.complete;
    if (!start_true) {
      start_true = view.truth.world_from_robot;
      start_found = result.world_from_robot;
    }
    const Pose found = start_found->inverse() * result.world_from_robot,
               truth = start_true->inverse() * view.truth.world_from_robot;
    EXPECT_LT((found.translation - truth.translation).norm(), 0.3e-3) << i;
    EXPECT_LT(rotation_rad(truth.inverse() * found), 3e-4) << i;
  }
  EXPECT_GE(predicted, 5);
}

void blank_coarse_fringes(FringeStack& stack) {
  const double finest_px = finest_patterns(stack.patterns, Axis::columns).patterns.front().period_px;
  for (size_t k = 0; k < stack.images.size(); ++k) {
    if (stack.patterns.patterns[k].period_px > finest_px) stack.images[k].setTo(40);
  }
}

// A first stack without its coarse fringes has neither fringe orders nor a motion, until later views predict it.
TEST(MovingRobot, AViewBeforeTheMapIsRegisteredLater) {
  const Scene scene = moving_loop_scene();
  VirtualRig rig(scene, {});
  PipelineOptions options;
  options.decode.unwrapping = Unwrapping::predicted;
  Pipeline pipeline(rig.model(), scene.patterns, options, {});
  std::vector<TruthFrame> truths;
  std::vector<std::shared_ptr<const FrameResult>> recovered;
  for (int i = 0; i < 6; ++i) {
    SimulatedView view = *rig.simulate(pipeline.next_patterns());
    if (i == 0) blank_coarse_fringes(view.stack);
    truths.push_back(view.truth);
    const FrameResult result = pipeline.process(std::move(view.stack));
    EXPECT_EQ(has_pose(result.tracking), i > 0) << i;
    recovered.insert(recovered.end(), result.recovered.begin(), result.recovered.end());
    EXPECT_EQ(pipeline.trajectory().size(), static_cast<size_t>(i) + recovered.size());
  }
  ASSERT_EQ(recovered.size(), 1u);
  const FrameResult& first = *recovered.front();
  EXPECT_EQ(first.frame.index, truths[0].index);
  EXPECT_EQ(first.tracking, Tracking::followed);
  EXPECT_EQ(first.images, 9);
  const Pose& mount = scene.rig.robot_from_camera;
  const Pose true_pose = (truths[1].world_from_robot * mount).inverse() * truths[0].world_from_robot * mount;
  const Vector6d error = difference(first.registration.earlier_from_current, true_pose);
  EXPECT_LT(error.tail<3>().norm(), 0.3e-3);
  EXPECT_LT(error.dot(solve_symmetric(first.covariance, error)), 30);  // exceeded with a probability of 4e-5
  const Trajectory trajectory = pipeline.trajectory();
  EXPECT_EQ(trajectory.front().timestamp_s, truths[0].timestamp_s);
  EXPECT_TRUE(std::is_sorted(trajectory.begin(), trajectory.end(),
                             [](const auto& a, const auto& b) { return a.timestamp_s < b.timestamp_s; }));
  const Pose moved = trajectory[1].world_from_robot.inverse() * trajectory[0].world_from_robot,
             truly = truths[1].world_from_robot.inverse() * truths[0].world_from_robot;
  EXPECT_LT((moved.translation - truly.translation).norm(), 0.3e-3);
}

// A view without light and one whose coarse fringes are missing, which thus needs a prediction, leave no pose. Once the robot is
// relocalized, the views before and after predict the second one.
TEST(MovingRobot, AViewBetweenLostOnesIsRegisteredLater) {
  const Scene scene = moving_loop_scene();
  VirtualRig rig(scene, {});
  Pipeline pipeline(rig.model(), scene.patterns, {}, {});
  pipeline.keep_all_patterns();
  constexpr int kDark = 4, kNoCoarse = 5, kViews = 9;
  std::map<int, TruthFrame> truths;
  std::map<int, int> keyframes;  // numbers of the stacks
  std::vector<int> lost;
  std::vector<std::shared_ptr<const FrameResult>> recovered;
  for (int i = 0; i < kViews; ++i) {
    SimulatedView view = *rig.simulate(pipeline.next_patterns());
    if (i == kDark) {
      for (cv::Mat& image : view.stack.images) image.setTo(2);
    }
    if (i == kNoCoarse) blank_coarse_fringes(view.stack);
    truths[view.truth.index] = view.truth;
    const FrameResult result = pipeline.process(std::move(view.stack));
    if (!has_pose(result.tracking)) lost.push_back(i);
    if (result.keyframe >= 0) keyframes[result.keyframe] = result.frame.index;
    recovered.insert(recovered.end(), result.recovered.begin(), result.recovered.end());
  }
  EXPECT_THAT(lost, testing::ElementsAre(kDark, kNoCoarse));
  ASSERT_EQ(recovered.size(), 1u);
  const FrameResult& view = *recovered.front();
  EXPECT_EQ(view.frame.index, truths.at(kNoCoarse).index);
  const Pose& mount = scene.rig.robot_from_camera;
  const Pose true_pose = (truths.at(keyframes.at(view.reference)).world_from_robot * mount).inverse() *
                         truths.at(kNoCoarse).world_from_robot * mount;
  const Vector6d error = difference(view.registration.earlier_from_current, true_pose);
  EXPECT_LT(error.tail<3>().norm(), 1e-3);
  EXPECT_LT(error.dot(solve_symmetric(view.covariance, error)), 30);
  EXPECT_EQ(pipeline.trajectory().size(), static_cast<size_t>(kViews) - 1);
}

// A robot that was pushed between two views: the prediction misleads the estimation of the second one's motion.
TEST(MovingRobot, AStackThatContradictsItsPredictionIsEstimatedWithoutIt) {
  const MovingView still({0, 0, 0}, {0, 0, 0}, true);
  const RigModel& rig = still.scene.rig;
  const FringeFrontEnd front_end(rig, still.scene.patterns, {});
  const ReconstructedView seen = front_end.reconstruct(still.view.stack, {});
  StackMotion moving;
  moving.motion.velocity_m_s = {0.02, 0, 0};
  moving.covariance = 1e-6 * Matrix12d::Identity();
  moving.residuals = 1000;
  moving.converged = true;
  StackMotion unknown = moving;
  unknown.converged = false;
  Mapper mapper(rig, PipelineOptions().mapper(), {});
  std::vector<std::optional<MotionPrior>> asked;
  for (int i = 0; i < 2; ++i) {
    asked.clear();
    MapperInput input;
    input.timestamp_s = 0.1 * i;
    input.reconstruct = [&](const ReconstructionPrior& prior) {
      asked.push_back(prior.motion);
      ReconstructedView view = seen;
      view.frame.timestamp_s = 0.1 * i;
      const bool with_prediction = prior.motion && !prior.motion->motion.is_still();
      view.motion = prior.motion && !with_prediction ? moving : unknown;
      return view;
    };
    const FrameResult result = mapper.process(std::move(input));
    EXPECT_TRUE(has_pose(result.tracking)) << i;
    ASSERT_TRUE(result.motion && result.motion->converged) << i;
  }
  // The second view: without a prior, with the prediction, with the prior of an unknown motion.
  ASSERT_EQ(asked.size(), 3u);
  EXPECT_FALSE(asked[0]);
  EXPECT_GT(asked[1]->motion.velocity_m_s.norm(), 0.01);
  EXPECT_TRUE(asked[2]->motion.is_still());
}

// A robot whose velocity changes abruptly every 50 ms. The random paths are those of the benchmark moving.wrong.
class JerkyRobot : public testing::TestWithParam<int> {};

// In 161, the prediction of the second view is wrong, and so is the motion that is estimated with it: landmarks must not
// be registered with a view that was decoded with that motion. In 377, the stack of a relocalized view misjudges its
// motion by seven sigmas, and its distorted depth matches the map 5 mm beside the true pose.
TEST_P(JerkyRobot, LeavesNoWrongPoses) {
  const uint64_t seed = 1 + static_cast<uint64_t>(GetParam()) / 8;
  SceneLoadOptions loading;
  loading.seed = seed;
  Scene scene = load_scene(std::string(FRINGESLAM_SOURCE_DIR) + "/scenes/loop/scene.yaml", loading);
  std::mt19937_64 random(static_cast<uint64_t>(GetParam()));
  const auto uniform = [&](double low, double high) {
    return low + (high - low) * static_cast<double>(random() >> 11) / 9007199254740992.0;
  };
  const auto direction = [&] {
    Eigen::Vector3d d;
    do {
      for (double& x : d) x = uniform(-1, 1);
    } while (d.norm() > 1 || d.norm() < 0.1);
    return Eigen::Vector3d(d.normalized());
  };
  constexpr double kDuration_s = 0.4, kKnot_s = 0.05, kRadPerDeg = std::numbers::pi / 180;
  Eigen::Vector3d v = direction();
  v *= uniform(0, 1);
  Eigen::Vector3d w = direction();
  w *= uniform(0, 90) * kRadPerDeg;
  const double jerk = uniform(0, 1);
  const Pose &mount = scene.rig.robot_from_camera, start = scene.trajectory.front().world_from_robot * mount;
  Pose at = start * Pose{rotation_exp(-0.5 * kDuration_s * w), -0.5 * kDuration_s * v};
  std::vector<Pose> controls;
  for (double t = 0; t < kDuration_s + 3 * kKnot_s; t += kKnot_s) {
    controls.push_back(orthonormalised(at * mount.inverse()));
    at = at * Pose{rotation_exp(kKnot_s * w), kKnot_s * v};
    v += 0.3 * jerk * direction();
    w += 30 * kRadPerDeg * jerk * direction();
  }
  scene.path.emplace(std::move(controls), kKnot_s, Vibration{}, seed);
  VirtualRig rig(scene, {});
  Pipeline pipeline(rig.model(), scene.patterns, {}, {});
  std::vector<Pose> keyframes;  // true poses of the camera
  int posed = 0;
  for (int i = 0; i < 4; ++i) {
    const SimulatedView view = *rig.simulate(pipeline.next_patterns());
    const Pose camera = view.truth.world_from_robot * mount;
    const FrameResult result = pipeline.process(view.stack);
    if (result.tracking != Tracking::first && has_pose(result.tracking)) {
      ++posed;
      const Pose truth = keyframes[static_cast<size_t>(result.reference)].inverse() * camera;
      const Vector6d error = difference(result.registration.earlier_from_current, truth);
      const double sigmas = std::sqrt(error.dot(solve_symmetric(result.covariance, error)));
      // Points on the camera's axis and corner rays at the middle of its range.
      const Pinhole& lens = scene.rig.camera;
      const double z = scene.rig.middle_range_m(), x = z * 0.5 * lens.width / lens.fx,
                   y = z * 0.5 * lens.height / lens.fy;
      std::vector<double> off_m;
      for (const Eigen::Vector3d& point :
           {Eigen::Vector3d(0, 0, z), Eigen::Vector3d(x, y, z), Eigen::Vector3d(-x, y, z), Eigen::Vector3d(x, -y, z),
            Eigen::Vector3d(-x, -y, z)})
        off_m.push_back((result.registration.earlier_from_current * point - truth * point).norm());
      EXPECT_TRUE(sigmas <= 10 || std::all_of(off_m.begin(), off_m.end(), [](double off) { return off <= 1e-3; }))
          << "view " << i << ": " << testing::PrintToString(off_m) << " m, " << sigmas << " sigmas";
    }
    if (result.keyframe >= 0) keyframes.push_back(camera);
  }
  EXPECT_GE(posed, 1);
}

INSTANTIATE_TEST_SUITE_P(Motion, JerkyRobot, testing::Values(161, 377));

// Views of a scene, each with the squared Mahalanobis distance of its pose from the true one.
struct TrackedViews {
  std::vector<FrameResult> views;
  std::vector<double> squared_sigmas, sigmas_m;
  double least_valid = 1;  // share of the pixels with depth

  TrackedViews(const Scene& scene, const RigModel& assumed, int count) {
    VirtualRig rig(scene, {});
    Pipeline pipeline(assumed, scene.patterns, {}, {});
    const Pose& mount = scene.rig.robot_from_camera;
    std::vector<Pose> keyframes;
    for (int i = 0; i < count; ++i) {
      SimulatedView view = *rig.simulate(pipeline.next_patterns());
      const Pose camera = view.truth.world_from_robot * mount;
      FrameResult result = pipeline.process(std::move(view.stack));
      if (has_pose(result.tracking) && result.tracking != Tracking::first) {
        const Vector6d error = difference(result.registration.earlier_from_current,
                                          keyframes[static_cast<size_t>(result.reference)].inverse() * camera);
        squared_sigmas.push_back(error.dot(solve_symmetric(result.covariance, error)));
        sigmas_m.push_back(std::sqrt(result.covariance.bottomRightCorner<3, 3>().trace()));
      }
      if (result.keyframe >= 0) keyframes.push_back(camera);
      cv::Mat1f depth;
      cv::extractChannel(result.frame.points_m, depth, 2);
      least_valid = std::min(least_valid, cv::countNonZero(depth == depth) / static_cast<double>(depth.total()));
      result.decoded = {};
      result.frame = {};
      views.push_back(std::move(result));
    }
  }
  double largest_square() const { return *std::max_element(squared_sigmas.begin(), squared_sigmas.end()); }
};

Scene loop_in_motion(uint64_t seed, std::vector<std::pair<std::string, std::string>> changes) {
  SceneLoadOptions reading{seed};
  reading.changes = std::move(changes);
  return load_scene(std::string(FRINGESLAM_SOURCE_DIR) + "/scenes/loop/scene.yaml", reading);
}

// Vibration hides fringe orders from a whole sequence, and predictions over 0.2 s determine hardly any for the finest
// fringes alone.
TEST(MovingRobot, VibrationLeavesMostFringeOrders) {
  for (const char* rate_hz : {"0", "5"}) {
    const Scene scene = loop_in_motion(
        3, {{"trajectory.continuous.speed_m_s", "0.3"},
            {"trajectory.continuous.view_rate_hz", rate_hz},
            {"trajectory.continuous.vibration", "{amplitude_mm: 0.3, amplitude_deg: 0, band_hz: [5, 40]}"}});
    const TrackedViews run(scene, scene.rig, 8);
    EXPECT_GE(run.squared_sigmas.size(), 6) << rate_hz;
    EXPECT_GT(run.least_valid, 0.3) << rate_hz;
    EXPECT_LT(run.largest_square(), 36) << rate_hz;
  }
}

// The poses' errors are those of the exposures' unknown accelerations, ten times what a smooth motion leaves. They are
// covered from the first views on, before the poses reveal the vibration, and for the keyframe.
TEST(MovingRobot, VibrationWidensTheCovariance) {
  std::vector<double> squared_sigmas, sigmas_m;
  for (const auto& [amplitude_mm, rate_hz] :
       {std::pair("0.08", "10"), std::pair("0.3", "0"), std::pair("0.15", "0"), std::pair("0.3", "10")}) {
    const Scene scene = loop_in_motion(
        1 + squared_sigmas.size(), {{"trajectory.continuous.speed_m_s", "0.3"},
                                    {"trajectory.continuous.view_rate_hz", rate_hz},
                                    {"trajectory.continuous.vibration", std::string("{amplitude_mm: ") + amplitude_mm +
                                                                            ", amplitude_deg: 0, band_hz: [5, 40]}"}});
    const TrackedViews run(scene, scene.rig, 12);
    ASSERT_GE(run.squared_sigmas.size(), 9) << amplitude_mm;
    squared_sigmas.insert(squared_sigmas.end(), run.squared_sigmas.begin(), run.squared_sigmas.end());
    sigmas_m.insert(sigmas_m.end(), run.sigmas_m.begin(), run.sigmas_m.end());
  }
  const auto quantile = [](std::vector<double> values, double share) {
    const auto at = values.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size()));
    std::nth_element(values.begin(), at, values.end());
    return *at;
  };
  EXPECT_LT(quantile(squared_sigmas, 0.5), 13) << "95 % of a chi-square distribution with six degrees of freedom";
  EXPECT_LT(quantile(squared_sigmas, 0.95), 36);
  EXPECT_LT(*std::max_element(squared_sigmas.begin(), squared_sigmas.end()), 100);
  EXPECT_LT(quantile(sigmas_m, 0.5), 1e-3);
}

// The mean motion during a stack is hardly different from rest, but neither explains the images.
TEST(MovingRobot, VibrationOfANearlyRestingRobotWidensTheCovariance) {
  std::vector<double> squared_sigmas;
  for (const uint64_t seed : {1, 2, 3}) {
    const Scene scene = loop_in_motion(
        seed, {{"trajectory.continuous.speed_m_s", "0.02"},
               {"trajectory.continuous.view_rate_hz", "5"},
               {"trajectory.continuous.vibration", "{amplitude_mm: 0.4, amplitude_deg: 0, band_hz: [5, 40]}"}});
    const TrackedViews run(scene, scene.rig, 6);
    squared_sigmas.insert(squared_sigmas.end(), run.squared_sigmas.begin(), run.squared_sigmas.end());
  }
  ASSERT_GE(squared_sigmas.size(), 12);
  EXPECT_LT(*std::max_element(squared_sigmas.begin(), squared_sigmas.end()), 100);
}

// A single stack does not show this motion significantly, but it agrees with that of the poses.
TEST(MovingRobot, SlowMotionIsRecognizedByItsPoses) {
  const Scene scene = loop_in_motion(1, {{"trajectory.continuous.speed_m_s", "0.025"}});
  const TrackedViews run(scene, scene.rig, 10);
  EXPECT_TRUE(run.views.front().undecided_motion);
  EXPECT_FALSE(run.views.front().in_motion());
  EXPECT_TRUE(run.views.back().in_motion());
  ASSERT_EQ(run.squared_sigmas.size(), 9);
  EXPECT_LT(run.largest_square(), 36);
}

// A camera with more noise than assumed leaves residuals in which a stack at rest seems to move. The robot stops for each
// capture, so its poses do not agree with that motion.
TEST(StoppingRobot, IsNotMistakenForASlowOne) {
  const Scene scene = loop_scene();
  RigModel assumed = scene.rig;
  assumed.sensor.gain_dn_per_electron /= 3;
  assumed.sensor.dark_noise_electrons /= 3;
  const TrackedViews run(scene, assumed, 6);
  ASSERT_EQ(run.squared_sigmas.size(), 5);
  EXPECT_TRUE(run.views.front().undecided_motion) << "otherwise this tests nothing";
  for (const FrameResult& view : run.views) EXPECT_FALSE(view.in_motion());
}

// A software trigger is slower than the rate of the rig file. Vibration and anticipated drifts depend on the rate.
TEST(MovingRobot, ImagesAreAsFastAsTheirTimesSay) {
  Scene scene = loop_in_motion(1, {{"trajectory.continuous.speed_m_s", "0.06"}});
  const RigModel assumed = scene.rig;
  scene.rig.timing.camera_rate_hz = assumed.timing.camera_rate_hz / 3;
  const TrackedViews right(scene, scene.rig, 5), wrong(scene, assumed, 5);
  ASSERT_GE(right.sigmas_m.size(), 3);
  ASSERT_EQ(wrong.sigmas_m.size(), right.sigmas_m.size());
  for (size_t i = 0; i < right.sigmas_m.size(); ++i)
    EXPECT_NEAR(wrong.sigmas_m[i], right.sigmas_m[i], 1e-3 * right.sigmas_m[i]);
}

// With one fringe period, nothing in a stack contradicts rest. The poses show how far the robot moved at most.
TEST(MovingRobot, StacksThatCannotShowMotionWidenTheCovariance) {
  for (const char* patterns :
       {"{axis: columns, steps: 3, periods_px: [16.25], gray: complementary, gray_cell_px: 8.125}",
        "{axis: columns, steps: 3, micro_period_px: 16.5, micro_images: 7}"}) {
    for (const char* speed_m_s : {"0.1", "0.2"}) {
      const Scene scene = loop_in_motion(1, {{"patterns", patterns}, {"trajectory.continuous.speed_m_s", speed_m_s}});
      const TrackedViews run(scene, scene.rig, 5);
      EXPECT_TRUE(run.views.front().motion_untested) << patterns;
      ASSERT_GE(run.squared_sigmas.size(), 3) << patterns << speed_m_s;
      EXPECT_LT(run.largest_square(), 36) << patterns << speed_m_s;
    }
    Scene standing = loop_in_motion(1, {{"patterns", patterns}});
    for (TimedPose& pose : standing.trajectory) pose.world_from_robot = standing.trajectory.front().world_from_robot;
    const TrackedViews run(standing, standing.rig, 3);
    ASSERT_EQ(run.sigmas_m.size(), 2) << patterns;
    for (const double sigma_m : run.sigmas_m) EXPECT_LT(sigma_m, 1e-4) << patterns;
  }
}

// Boxes at the start of the path, enough of them that landmarks determine the first motion; then a plain wall, which
// determines three of six directions. The prediction determines the others until the view is registered without it.
TEST(StoppingRobot, ViewsOfAWallAreLost) {
  const test::TempFolder temp;
  std::string poses;
  for (int i = 0; i < 12; ++i) poses += "    - {translation_m: [" + std::to_string(0.03 * i) + ", 0, 0]}\n";
  test::write_bytes(temp / "scene.yaml", R"(name: wall
seed: 1
rig:
  file: )" + std::string(FRINGESLAM_SOURCE_DIR) +
                                             R"(/scenes/rigs/thesis.yaml
  robot_from_camera: {translation_m: [0, 0, 0]}
patterns: {axis: columns, steps: 3, periods_px: [1040, 131, 16.5]}
light: {ambient_lux: 290}
materials:
  wall: {grain: plain, albedo: 0.6}
objects:
  - {shape: plane, size_m: [2, 2], material: wall, pose: {translation_m: [0, 0, 1.05]}}
  - {shape: box, size_m: [0.06, 0.08, 0.05], material: wall, pose: {translation_m: [0.02, 0.05, 1], rotation_deg: [10, 20, 30]}}
  - {shape: box, size_m: [0.05, 0.06, 0.07], material: wall, pose: {translation_m: [-0.05, -0.04, 1], rotation_deg: [20, -10, 50]}}
  - {shape: box, size_m: [0.07, 0.04, 0.05], material: wall, pose: {translation_m: [0.05, -0.07, 1.02], rotation_deg: [-20, 15, 70]}}
  - {shape: box, size_m: [0.04, 0.05, 0.06], material: wall, pose: {translation_m: [-0.06, 0.06, 1.02], rotation_deg: [-10, 25, 10]}}
trajectory:
  interval_s: 0.5
  poses:
)" + poses);
  const Scene scene = load_scene(temp / "scene.yaml");
  VirtualRig rig(scene, {});
  PipelineOptions options;
  options.decode.unwrapping = Unwrapping::predicted;
  Pipeline pipeline(rig.model(), scene.patterns, options, {});
  std::vector<Pose> keyframes;
  int followed = 0, lost = 0;
  while (const std::optional<SimulatedView> view = rig.simulate(pipeline.next_patterns())) {
    const Pose camera = view->truth.world_from_robot;
    const FrameResult result = pipeline.process(view->stack);
    if (result.keyframe >= 0) keyframes.push_back(camera);
    if (!has_pose(result.tracking)) {
      ++lost;
    } else if (result.tracking != Tracking::first) {
      ++followed;
      const Pose expected = keyframes[static_cast<size_t>(result.reference)].inverse() * camera;
      const Vector6d error = difference(result.registration.earlier_from_current, expected);
      EXPECT_GT(result.covariance.diagonal().minCoeff(), 0) << result.frame.index;
      EXPECT_LT(error.dot(solve_symmetric(result.covariance, error)), 30) << result.frame.index;
    }
  }
  EXPECT_GE(followed, 3);
  EXPECT_GE(lost, 1);
}

TEST(MovingRobot, AViewRateBeyondTheCameraIsAnError) {
  SceneLoadOptions reading;
  reading.changes = {{"trajectory.continuous.speed_m_s", "0.3"}, {"trajectory.continuous.view_rate_hz", "30"}};
  const Scene scene = load_scene(std::string(FRINGESLAM_SOURCE_DIR) + "/scenes/loop/scene.yaml", reading);
  VirtualRig rig(scene, {});
  EXPECT_THROW(rig.simulate(scene.patterns), Error);
  EXPECT_TRUE(rig.simulate(finest_patterns(scene.patterns, Axis::columns)));
}

}  // namespace
}  // namespace fringeslam::sim
