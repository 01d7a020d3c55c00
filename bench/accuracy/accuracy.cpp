// SPDX-License-Identifier: Apache-2.0
// Accuracy rows: generated scenes through the whole pipeline, scored against exact ground truth.
#include <cmath>
#include <cstdio>
#include <map>
#include <numbers>

#include "bench/row.h"
#include "core/mapper/pipeline.h"
#include "core/score/score.h"
#include "sim/virtual_rig.h"

namespace fringeslam::bench {

namespace {

struct PairError {
  double translation_m = 0, rotation_rad = 0, over_bound = 0;
};

std::string scene_file(const std::string& name) { return std::string(FRINGESLAM_SCENES) + "/" + name + "/scene.yaml"; }

// Returns the errors of a scene's first motion, estimated from newly rendered images. A motion that is not found has an
// infinite error: it can only increase a median.
PairError first_motion_error(const std::string& scene_name, uint64_t seed) {
  const sim::Scene scene = sim::load_scene(scene_file(scene_name), {seed});
  sim::VirtualRig rig(scene, {});
  Pipeline pipeline(scene.rig, scene.patterns, {}, scene.trajectory[0].world_from_robot);
  const auto earlier = rig.simulate(scene.patterns), later = rig.simulate(scene.patterns);
  const FrameResult first = pipeline.process(earlier->stack), second = pipeline.process(later->stack);
  if (!has_pose(second.tracking)) return {INFINITY, INFINITY, INFINITY};

  const Pose& robot_from_camera = scene.rig.robot_from_camera;
  const Pose true_motion = earlier->truth.world_from_robot.inverse() * later->truth.world_from_robot;
  const Pose motion = first.world_from_robot.inverse() * second.world_from_robot;
  const Pose true_camera_motion = robot_from_camera.inverse() * true_motion * robot_from_camera;
  const Matrix6d information = pose_information(earlier->truth, first.frame.sigma_m, later->truth, second.frame.sigma_m,
                                                scene.rig.camera, pixel_rays(scene.rig.camera), true_camera_motion);
  const MotionScore score = score_motion(motion, true_motion);
  return {score.translation_error_m, score.rotation_error_rad,
          error_over_bound(second.previous_from_current, true_camera_motion, information)};
}

// Returns the errors over the seeds 1 … n; measured once for all rows that use them.
const std::vector<PairError>& first_motion_errors(const std::string& scene, int seeds) {
  static std::map<std::pair<std::string, int>, std::vector<PairError>> known;
  std::vector<PairError>& errors = known[{scene, seeds}];
  for (int seed = static_cast<int>(errors.size()) + 1; seed <= seeds; ++seed) {
    errors.push_back(first_motion_error(scene, static_cast<uint64_t>(seed)));
    std::fprintf(stderr, "  %s seed %d: %.5f mm, %.6f deg, %.2f of the bound\n", scene.c_str(), seed,
                 errors.back().translation_m * 1e3, errors.back().rotation_rad * 180 / std::numbers::pi,
                 errors.back().over_bound);
  }
  return errors;
}

template <class Member>
std::vector<double> collect(const std::vector<PairError>& errors, Member member, double factor) {
  std::vector<double> values;
  for (const PairError& error : errors) values.push_back(factor * error.*member);
  return values;
}

int seeds(const Context& context) { return context.quick ? 15 : 30; }

std::vector<Row> experiment_rows(const std::string& id, const std::string& scene, double limit_mm, double limit_deg,
                                 const Context& context) {
  const std::vector<PairError>& errors = first_motion_errors(scene, seeds(context));
  return {median_row(id + ".translation", collect(errors, &PairError::translation_m, 1e3), "mm", limit_mm),
          median_row(id + ".rotation", collect(errors, &PairError::rotation_rad, 180 / std::numbers::pi), "deg",
                     limit_deg)};
}

std::vector<Row> bound_rows(const Context& context) {
  const std::vector<PairError>& errors = first_motion_errors("boxes_and_foam", seeds(context));
  return {median_row("pose.bound", collect(errors, &PairError::over_bound, 1), "x", 1.3)};
}

// All effects off and float images: what remains is the numerical error of decoding and triangulation.
std::vector<Row> depth_numerics_rows(const Context& context) {
  std::vector<double> medians;
  for (int seed = 1; seed <= (context.quick ? 1 : 5); ++seed) {
    sim::Scene scene = sim::load_scene(scene_file("boxes_and_foam"), {static_cast<uint64_t>(seed)});
    for (Pattern& pattern : scene.patterns.patterns) pattern.bits = 0;
    const auto view = sim::VirtualRig(scene, {1, false, false, sim::Effects::none()}).simulate(scene.patterns);
    const DecodedStack decoded = decode(view->stack, scene.rig, {});
    DepthOptions options;
    options.texture_correction = false;  // a single sample sees a point instead of a pixel's square
    const Frame frame = reconstruct(decoded, scene.rig, pixel_rays(scene.rig.camera), options);
    cv::Mat1f depth;
    cv::extractChannel(frame.points_m, depth, 2);
    const DepthScore score =
        score_depth({depth, frame.sigma_m, decoded.coordinate_px}, view->truth, decoded.finest_period_px);
    medians.push_back(score.median_m * 1e6);
  }
  return {median_row("depth_numerics", medians, "um", 1)};
}

}  // namespace

std::vector<Item> accuracy_items() {
  return {
      {{"depth_numerics"}, "depth against the ray tracer, all effects off", depth_numerics_rows},
      {{"pose.thesis_a.translation", "pose.thesis_a.rotation"},
       "[T] 5.2.1 a: boxes and foam on a stage",
       [](const Context& context) { return experiment_rows("pose.thesis_a", "boxes_and_foam", 0.02, 0.005, context); }},
      {{"pose.thesis_b.translation", "pose.thesis_b.rotation"},
       "[T] 5.2.1 b: a face mask on a stage",
       [](const Context& context) { return experiment_rows("pose.thesis_b", "face_mask", 0.02, 0.005, context); }},
      {{"pose.thesis_rubble.translation", "pose.thesis_rubble.rotation"},
       "[T] 5.2.2: rubble under dust",
       [](const Context& context) {
         return experiment_rows("pose.thesis_rubble", "rubble_under_dust", 0.02, 0.005, context);
       }},
      {{"pose.paper.translation", "pose.paper.rotation"},
       "[C] IV: boxes, 70 cm",
       [](const Context& context) { return experiment_rows("pose.paper", "paper_boxes", 0.1, 0.01, context); }},
      {{"pose.bound"}, "pose error relative to the Cramer-Rao bound", bound_rows}};
}

}  // namespace fringeslam::bench
