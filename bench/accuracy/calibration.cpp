// SPDX-License-Identifier: Apache-2.0
// Calibration rows: boards rendered with a known rig, and the rig estimated from them.
#include <cmath>
#include <cstdio>
#include <numbers>

#include "bench/row.h"
#include "core/calibrate/rig_calibration.h"
#include "core/calibrate/stage.h"
#include "core/decode/decode.h"
#include "core/depth/depth.h"
#include "core/score/score.h"
#include "core/types/linear_algebra.h"
#include "sim/virtual_rig.h"

namespace fringeslam::bench {

namespace {

// Same values as scenes/calibration_checkerboard/board.yaml.
Board checkerboard() { return {BoardKind::checkerboard, 12, 10, 0.01, 0}; }

// A camera pixel integrates over its area: corners are only as accurate as the renderer's model of that.
constexpr int kSamplesPerPixel = 16;

RigCalibration calibrate_seed(uint64_t seed, int boards = 15, int samples_per_pixel = kSamplesPerPixel) {
  sim::SceneLoadOptions reading;
  reading.seed = seed;
  reading.changes = {{"trajectory.board_views.count", std::to_string(boards)}};
  const sim::Scene scene =
      sim::load_scene(std::string(FRINGESLAM_SCENES) + "/calibration_checkerboard/scene.yaml", reading);
  sim::VirtualRig rig(scene, {samples_per_pixel, true, true});
  std::vector<BoardView> views;
  while (const auto stack = rig.capture(scene.patterns)) {
    const DecodedStack columns = decode(*stack, scene.rig, {}, {Axis::columns});
    const DecodedStack rows = decode(*stack, scene.rig, {}, {Axis::rows});
    cv::Mat1f texture;
    cv::addWeighted(columns.mean, 0.5, rows.mean, 0.5, 0, texture);
    views.push_back(observe_board("view " + std::to_string(stack->index), texture,
                                  {columns.coordinate_px, rows.coordinate_px, columns.sigma_px, rows.sigma_px},
                                  checkerboard(), {}));
  }
  return calibrate_rig(views, checkerboard(), scene.rig, {});
}

struct DepthBias {
  double mean_m = 0;   // largest mean error over the image, at any depth
  double shape_m = 0;  // RMS of all points after the best rigid alignment
};

// Triangulates true points over the image and the range with the estimated rig, from where the true rig sees and
// lights them.
DepthBias depth_bias(const RigModel& truth, const RigModel& estimate) {
  constexpr int kDepths = 15, kStep = 19;
  const PixelRays true_rays = pixel_rays(truth.camera);
  const Triangulation triangulation(estimate, pixel_rays(estimate.camera), 0.4, 2.5);
  const int width = true_rays.cols;
  std::vector<float> column(width), sigma(width, 1e-6f), depth(width), depth_sigma(width);
  DepthBias bias;
  std::vector<double> means_m;
  std::vector<Eigen::Vector3d> true_points, points;
  for (int k = 0; k < kDepths; ++k) {
    const double z = truth.near_m + (truth.far_m - truth.near_m) * k / (kDepths - 1);
    double sum = 0;
    int count = 0;
    for (int row = 0; row < true_rays.rows; row += kStep) {
      for (int col = 0; col < width; ++col) {
        const cv::Vec2f ray = true_rays(row, col);
        const Eigen::Vector2d pixel =
            truth.projector.project(truth.projector_from_camera * (z * Eigen::Vector3d(ray[0], ray[1], 1)));
        column[col] = truth.projector.contains(pixel) ? static_cast<float>(pixel.x()) : NAN;
      }
      triangulation.row(row, column.data(), sigma.data(), 1, depth.data(), depth_sigma.data(),
                        selected_instruction_set());
      for (int col = 0; col < width; col += kStep) {
        if (std::isnan(depth[col])) continue;
        const cv::Vec2f ray = true_rays(row, col), seen = triangulation.rays()(row, col);
        true_points.push_back(z * Eigen::Vector3d(ray[0], ray[1], 1));
        points.push_back(depth[col] * Eigen::Vector3d(seen[0], seen[1], 1));
        sum += depth[col] - z;
        ++count;
      }
    }
    means_m.push_back(std::abs(sum / count));
  }
  bias.mean_m = greatest_of(means_m);
  const Pose alignment = align_points(true_points, points);
  double squares = 0;
  for (size_t i = 0; i < points.size(); ++i) squares += (alignment * points[i] - true_points[i]).squaredNorm();
  bias.shape_m = std::sqrt(squares / static_cast<double>(points.size()));
  return bias;
}

std::vector<Row> rig_rows(const Context& context) {
  const RigModel truth = sim::load_scene(std::string(FRINGESLAM_SCENES) + "/calibration_checkerboard/scene.yaml").rig;
  std::vector<double> camera, projector, mean, shape;
  for (int seed = 1; seed <= (context.quick ? 2 : 8); ++seed) {
    const RigCalibration calibration = calibrate_seed({static_cast<uint64_t>(seed)});
    const DepthBias bias = depth_bias(truth, calibration.rig);
    camera.push_back(calibration.camera_rms_px);
    projector.push_back(calibration.projector_rms_px);
    mean.push_back(1e3 * bias.mean_m);
    shape.push_back(1e3 * bias.shape_m);
    std::fprintf(stderr, "  seed %d: %.4f and %.4f px, depth bias %.4f mm, shape %.4f mm\n", seed, camera.back(),
                 projector.back(), mean.back(), shape.back());
  }
  return {median_row("calibration.rig.camera", camera, "px", 0.1),
          median_row("calibration.rig.projector", projector, "px", 0.1),
          median_row("calibration.rig.depth_bias", mean, "mm", 0.1),
          median_row("calibration.rig.shape", shape, "mm", 0.1)};
}

// Lenses and relative pose in the order of RigCalibration::covariance, as differences from the truth.
Eigen::VectorXd parameter_errors(const RigModel& truth, const RigModel& estimate) {
  Eigen::VectorXd errors(24);
  const auto lens = [&](Eigen::Index first, const Pinhole& a, const Pinhole& b) {
    const Distortion &d = a.distortion, &e = b.distortion;
    errors.segment(first, 9) << b.fx - a.fx, b.fy - a.fy, b.cx - a.cx, b.cy - a.cy, e.k1 - d.k1, e.k2 - d.k2,
        e.p1 - d.p1, e.p2 - d.p2, e.k3 - d.k3;
  };
  lens(0, truth.camera, estimate.camera);
  lens(9, truth.projector, estimate.projector);
  errors.segment<3>(18) =
      rotation_log(estimate.projector_from_camera.rotation) - rotation_log(truth.projector_from_camera.rotation);
  errors.segment<3>(21) = estimate.projector_from_camera.translation - truth.projector_from_camera.translation;
  return errors;
}

// Honesty of the rig's covariance: for each parameter, the mean over the sets of its squared error divided by its
// variance. The limits contain all of 22 parameters with a probability of 95 % if the variances are right: quantiles of
// chi-square per degree of freedom at 0.05 / 44.
std::vector<Row> rig_nees_rows(const Context& context) {
  const RigModel truth = sim::load_scene(std::string(FRINGESLAM_SCENES) + "/calibration_checkerboard/scene.yaml").rig;
  const int sets = context.quick ? 10 : 50;
  Eigen::VectorXd sum = Eigen::VectorXd::Zero(24), bias = sum;
  double factors = 0;
  Eigen::VectorXd estimated;
  for (int set = 0; set < sets; ++set) {
    // The renderer's sampling error is common to all boards, so it must be small against the sigmas.
    constexpr int kFineSampling = 36;
    const RigCalibration calibration = calibrate_seed(static_cast<uint64_t>(100 + set), 6 + set % 10, kFineSampling);
    const Eigen::VectorXd errors = parameter_errors(truth, calibration.rig),
                          variances = calibration.covariance.diagonal();
    estimated = variances;
    for (Eigen::Index i = 0; i < errors.size(); ++i) {
      if (variances[i] == 0) continue;  // kept fixed
      bias[i] += errors[i] / std::sqrt(variances[i]) / sets;
      sum[i] += errors[i] * errors[i] / variances[i] / sets;
    }
    factors += calibration.covariance_factor / sets;
  }
  std::vector<double> nees;
  for (Eigen::Index i = 0; i < sum.size(); ++i) {
    if (estimated[i] == 0) continue;
    nees.push_back(sum[i]);
    std::fprintf(stderr, "  parameter %ld: NEES %.2f, mean error %.2f sigmas\n", static_cast<long>(i), sum[i], bias[i]);
  }
  std::fprintf(stderr, "  mean factor on the covariance's sigmas %.2f\n", factors);
  const auto quantile = [&](double normal) {
    const double spread = 2 / (9.0 * sets);
    return std::pow(1 - spread + normal * std::sqrt(spread), 3);
  };
  return {bound_row("calibration.rig.nees.least", least_of(nees), sets, "(1)", quantile(-3.05), Limit::least),
          bound_row("calibration.rig.nees.greatest", greatest_of(nees), sets, "(1)", quantile(3.05), Limit::most)};
}

// Sensor-to-stage calibration: errors, and the error squared normalized by the covariance (expected value 6 for six
// degrees of freedom).
StageCalibration calibrate_stage_seed(const sim::Scene& scene) {
  sim::VirtualRig rig(scene, {kSamplesPerPixel, true, true});
  const Triangulation triangulation(scene.rig, pixel_rays(scene.rig.camera), 0.4, 2.5);
  std::vector<StageView> views;
  std::vector<cv::Point2f> last;
  while (const auto simulated = rig.simulate(scene.patterns)) {
    const DecodedStack decoded = decode(simulated->stack, scene.rig, {});
    Frame frame;
    triangulate(frame, decoded, triangulation, {});
    StageView view{simulated->truth.world_from_robot, {}};
    std::vector<cv::Point2f> corners = detect_board(decoded.mean, checkerboard());
    if (corners.empty()) continue;
    align_corner_order(last, corners);
    last = corners;
    const double radius = 0.8 * cv::norm(corners[1] - corners[0]);
    for (const cv::Point2f& corner : corners)
      view.corners.push_back(corner_point(frame, scene.rig.camera, {corner.x, corner.y}, radius));
    views.push_back(std::move(view));
  }
  return calibrate_stage(views);
}

std::vector<Row> stage_rows(const Context& context) {
  std::vector<double> translation, rotation, nees;
  for (int seed = 1; seed <= (context.quick ? 3 : 12); ++seed) {
    const sim::Scene scene = sim::load_scene(std::string(FRINGESLAM_SCENES) + "/stage_checkerboard/scene.yaml",
                                             {static_cast<uint64_t>(seed)});
    const StageCalibration calibration = calibrate_stage_seed(scene);
    const Vector6d off = difference(calibration.robot_from_camera, scene.rig.robot_from_camera);
    nees.push_back(off.dot(inverse(calibration.covariance) * off));
    translation.push_back(1e3 * off.tail<3>().norm());
    rotation.push_back(off.head<3>().norm() * 180 / std::numbers::pi);
    std::fprintf(stderr, "  seed %d: %.4f mm, %.5f deg, NEES %.2f; residuals %.4f mm\n", seed, translation.back(),
                 rotation.back(), nees.back(), 1e3 * calibration.rms_m);
  }
  const auto n = static_cast<double>(nees.size());
  double mean = 0;
  for (const double value : nees) mean += value / n;
  // 95 % quantile of the mean of n such values: approximately 6 + 1.96 sqrt(12 / n).
  return {
      median_row("calibration.stage.translation", translation, "mm", 0.05),
      median_row("calibration.stage.rotation", rotation, "deg", 0.005),
      bound_row("calibration.stage.nees", mean, static_cast<int>(n), "(6)", 6 + 1.96 * std::sqrt(12 / n), Limit::most)};
}

}  // namespace

std::vector<Item> calibration_items() {
  return {
      {{"calibration.rig.camera", "calibration.rig.projector", "calibration.rig.depth_bias", "calibration.rig.shape"},
       "the rig from 15 rendered boards: reprojection, depth bias from 0.7 to 1.4 m",
       rig_rows},
      {{"calibration.rig.nees.least", "calibration.rig.nees.greatest"},
       "errors of rig parameters over their sigmas, 6 to 15 rendered boards",
       rig_nees_rows},
      {{"calibration.stage.translation", "calibration.stage.rotation", "calibration.stage.nees"},
       "sensor-to-stage calibration from 8 rendered motions ([T] 4.1.1)",
       stage_rows}};
}

}  // namespace fringeslam::bench
