// SPDX-License-Identifier: Apache-2.0
#include "bench/moving_run.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "core/decode/stack_motion.h"
#include "core/score/pose_honesty.h"
#include "core/score/score.h"
#include "core/types/linear_algebra.h"

namespace fringeslam::bench {

namespace {

// The true motion of the camera during a stack, from the poses of the exposures.
CameraMotion true_motion(const sim::Scene& scene, double time_s) {
  constexpr double kStep_s = 2e-3;
  const auto camera = [&](double t) { return scene.path->at(t) * scene.rig.robot_from_camera; };
  const Pose reference = camera(time_s);
  const Pose before = reference.inverse() * camera(time_s - kStep_s),
             after = reference.inverse() * camera(time_s + kStep_s);
  const Eigen::Vector3d turn_before = rotation_log(before.rotation), turn_after = rotation_log(after.rotation);
  CameraMotion motion;
  motion.angular_rad_s = (turn_after - turn_before) / (2 * kStep_s);
  motion.velocity_m_s = (after.translation - before.translation) / (2 * kStep_s);
  motion.angular_rad_s2 = (turn_after + turn_before) / (kStep_s * kStep_s);
  motion.acceleration_m_s2 = (after.translation + before.translation) / (kStep_s * kStep_s);
  return motion;
}

void score_depth_of(const FrameResult& result, const TruthFrame& truth, MovingView& view) {
  std::vector<double> errors, sigmas;
  for (int row = 0; row < truth.depth_m.rows; ++row) {
    for (int col = 0; col < truth.depth_m.cols; ++col) {
      if (!is_lit_surface(static_cast<int>(truth.mask(row, col)))) continue;
      const double error = std::abs(static_cast<double>(result.frame.points_m(row, col)[2] - truth.depth_m(row, col)));
      if (std::isnan(error)) continue;
      errors.push_back(error);
      sigmas.push_back(error / static_cast<double>(result.frame.sigma_m(row, col)));
    }
  }
  if (errors.empty()) return;
  view.depth_m = median_of(std::move(errors));
  view.depth_sigmas = median_of(std::move(sigmas));
}

// Fisher information of the pose when the velocity during the stack has to be estimated too (docs/method.md, section 9.4).
Matrix6d information_in_motion(const Frame& keyframe, const TruthFrame& keyframe_truth, const FringeStack& stack,
                               const FrameResult& result, const TruthFrame& truth, const RigModel& rig,
                               const CameraMotion& motion, const Pose& keyframe_from_camera) {
  constexpr int kStride = 2;
  const PixelRays rays = pixel_rays(rig.camera);
  const Matrix6d at_rest = pose_information(keyframe_truth, keyframe.sigma_m, truth, result.frame.sigma_m, rig.camera,
                                            rays, keyframe_from_camera);
  if (motion.is_still()) return at_rest;
  // The slopes turn the same residuals into a system with twelve unknowns; their scale cancels in the Schur complement.
  cv::Mat1f depth = truth.depth_m.clone();
  depth.setTo(NAN, result.frame.sigma_m != result.frame.sigma_m);
  using Matrix12 = Eigen::Matrix<double, 12, 12>;
  Matrix12 joint = Matrix12::Zero();
  Eigen::Matrix<double, 12, 1> gradient;
  for (const DepthSlope& slope :
       depth_slopes(stack, rig, rays, depth, rig.sensor.max_dn(), motion, result.decoded.finest_period_px, kStride)) {
    const int row = slope.row, col = slope.col;
    if (static_cast<int>(truth.mask(row, col)) & kTruthMixed) continue;
    const cv::Vec2f d = rays(row, col);
    const Eigen::Vector3d ray(static_cast<double>(d[0]), static_cast<double>(d[1]), 1);
    const Eigen::Vector3d turned = keyframe_from_camera.rotation * (ray * static_cast<double>(truth.depth_m(row, col)));
    const Eigen::Vector3d there = turned + keyframe_from_camera.translation;
    if (!(there.z() > 0)) continue;
    const Eigen::Vector2d pixel = rig.camera.project(there);
    const int x = static_cast<int>(std::lround(pixel.x())), y = static_cast<int>(std::lround(pixel.y()));
    if (x < 0 || y < 0 || x >= truth.depth_m.cols || y >= truth.depth_m.rows) continue;
    const auto known = static_cast<double>(keyframe.sigma_m(y, x)),
               own = static_cast<double>(result.frame.sigma_m(row, col));
    if (std::isnan(known) || std::abs(static_cast<double>(keyframe_truth.depth_m(y, x)) - there.z()) > 5e-3) continue;
    const cv::Vec3f n = result.frame.normals(row, col);
    if (n[2] != n[2]) continue;
    const Eigen::Vector3d normal = keyframe_from_camera.rotation * Eigen::Vector3d(n[0], n[1], n[2]);
    const double by_depth = normal.dot(keyframe_from_camera.rotation * ray), by_known = normal.dot(there) / there.z();
    const double variance = by_depth * by_depth * own * own + by_known * by_known * known * known;
    gradient << turned.cross(normal), normal, by_depth * slope.by_motion.head<6>();
    joint += gradient * gradient.transpose() / variance;
  }
  const Matrix6d pose = joint.topLeftCorner<6, 6>(), cross = joint.topRightCorner<6, 6>();
  const Matrix6d reduced = pose - cross * inverse(Matrix6d(joint.bottomRightCorner<6, 6>())) * cross.transpose();
  // Information relative to rest, in the same coordinates.
  const Matrix6d loss = inverse(reduced) - inverse(pose);
  return inverse(Matrix6d(inverse(at_rest) + loss));
}

}  // namespace

int MovingRun::lost() const {
  return static_cast<int>(
      std::count_if(views.begin(), views.end(), [](const MovingView& v) { return !has_pose(v.tracking); }));
}

std::vector<const MovingView*> MovingRun::tracked() const {
  std::vector<const MovingView*> list;
  for (const MovingView& view : views) {
    if (view.has_pose && !view.keyframe && view.tracking == Tracking::followed) list.push_back(&view);
  }
  return list;
}

MovingRun moving_run(const sim::Scene& scene, const MovingRunOptions& options) {
  PipelineOptions settings = options.pipeline;
  if (options.predicted) settings.decode.unwrapping = Unwrapping::predicted;
  const RigModel& rig = scene.rig;
  sim::VirtualRig camera(scene, options.render);
  Pipeline pipeline(rig, scene.patterns, settings, scene.trajectory.front().world_from_robot);
  struct TrueKeyframe {
    Frame frame;
    TruthFrame truth;
  };
  // A view without a pose, which may be registered later.
  struct Lost {
    sim::SimulatedView view;
    CameraMotion motion;
    size_t number = 0;  // in the run
  };
  std::vector<TrueKeyframe> keyframes;
  std::map<int, Lost> lost;  // by the index of the stack
  MovingRun run;
  Trajectory truth;
  const auto score_view = [&](const FrameResult& result, const sim::SimulatedView& view, const CameraMotion& motion,
                              MovingView& scored) {
    truth.push_back({scored.time_s, view.truth.world_from_robot});
    score_depth_of(result, view.truth, scored);
    if (result.tracking == Tracking::first) return;
    const TrueKeyframe& reference = keyframes[static_cast<size_t>(result.reference)];
    const Pose& mount = rig.robot_from_camera;
    const Pose true_pose = (reference.truth.world_from_robot * mount).inverse() * view.truth.world_from_robot * mount;
    const Pose& found = result.registration.earlier_from_current;
    const PoseHonesty honesty = pose_honesty(found, true_pose, result.covariance, rig);
    scored.has_pose = true;
    scored.baseline_m = true_pose.translation.norm();
    scored.off_m = honesty.off_m;
    scored.sigmas = honesty.sigmas();
    scored.confidently_wrong = honesty.confidently_wrong();
    if (options.bound)
      scored.over_bound = error_over_bound(found, true_pose,
                                           information_in_motion(reference.frame, reference.truth, view.stack, result,
                                                                 view.truth, rig, motion, true_pose));
  };
  while (static_cast<int>(run.views.size()) < options.most_views) {
    auto view = camera.simulate(pipeline.next_patterns());
    if (!view) break;
    if (options.disturb && !options.disturb(view->stack)) continue;
    const FrameResult result = pipeline.process(view->stack);
    MovingView scored;
    scored.time_s = view->stack.timestamp_s;
    scored.tracking = result.tracking;
    scored.images = static_cast<int>(view->stack.images.size());
    scored.keyframe = result.keyframe >= 0;
    const CameraMotion motion = scene.path ? true_motion(scene, scored.time_s) : CameraMotion{};
    if (result.motion && result.motion->converged) {
      scored.velocity_m_s = (result.motion->motion.velocity_m_s - motion.velocity_m_s).norm();
      scored.angular_rad_s = (result.motion->motion.angular_rad_s - motion.angular_rad_s).norm();
    }
    if (has_pose(result.tracking)) {
      score_view(result, *view, motion, scored);
      if (result.keyframe >= 0) keyframes.push_back({result.frame, view->truth});
    } else {
      lost.emplace(view->stack.index, Lost{*view, motion, run.views.size()});
    }
    run.views.push_back(scored);
    for (const std::shared_ptr<const FrameResult>& late : result.recovered) {
      const Lost& earlier = lost.at(late->frame.index);
      MovingView& scored_late = run.views[earlier.number];
      scored_late.tracking = late->tracking;
      score_view(*late, earlier.view, earlier.motion, scored_late);
    }
  }
  std::sort(truth.begin(), truth.end(), [](const auto& a, const auto& b) { return a.timestamp_s < b.timestamp_s; });
  if (truth.size() > 1) run.ate_m = score_trajectory(pipeline.trajectory(), truth).ate_rmse_m;
  return run;
}

sim::Scene scene_with(const std::string& name, uint64_t seed,
                      const std::vector<std::pair<std::string, std::string>>& changes) {
  sim::SceneLoadOptions loading;
  loading.seed = seed;
  loading.changes = changes;
  return sim::load_scene(std::string(FRINGESLAM_SCENES) + "/" + name + "/scene.yaml", loading);
}

sim::Scene scene_with_constant_motion(const std::string& name, uint64_t seed, const Eigen::Vector3d& velocity_m_s,
                                      const Eigen::Vector3d& angular_rad_s, double duration_s, double view_rate_hz) {
  constexpr double kKnot_s = 0.05;
  sim::Scene scene = scene_with(name, seed, {});
  const Pose &mount = scene.rig.robot_from_camera, start = scene.trajectory.front().world_from_robot * mount;
  std::vector<Pose> controls;
  for (double t = 0; t < duration_s + kKnot_s; t += kKnot_s) {
    const double from_start_s = t - 0.5 * duration_s;
    controls.push_back(orthonormalised(
        start * Pose{rotation_exp(from_start_s * angular_rad_s), from_start_s * velocity_m_s} * mount.inverse()));
  }
  scene.path.emplace(std::move(controls), kKnot_s, sim::Vibration{}, seed);
  scene.view_rate_hz = view_rate_hz;
  scene.trajectory.clear();
  for (double t = 0; t < duration_s; t += 1 / 30.0) scene.trajectory.push_back({t, scene.path->at(t)});
  return scene;
}

}  // namespace fringeslam::bench
