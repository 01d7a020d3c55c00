// SPDX-License-Identifier: Apache-2.0
// Depth bias on translucent foam. Light enters toward the projector and is seen from below the surface, so that fringes
// show a surface that lies deeper, and coarse fringes a deeper one than fine fringes do. The measured bias is compared
// with that of exact radiative transfer (bench/accuracy/half_space.h).
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>
#include <vector>

#include "bench/accuracy/half_space.h"
#include "bench/row.h"
#include "core/base/constants.h"
#include "core/decode/decode.h"
#include "core/depth/depth.h"
#include "core/patterns/design.h"
#include "sim/virtual_rig.h"

namespace fringeslam::bench {

namespace {

constexpr double kBorder_m = 0.015;  // from the block's edges, where the surface is no half-space
constexpr int kStride = 16;          // px between the points of the prediction

// The depth bias, along the camera's z, of fringes on a translucent half-space at a point of its surface.
class Prediction {
 public:
  Prediction(const RigModel& rig, double albedo, double mean_free_path_m, double period_px)
      : rig_(rig), space_(HalfSpace::of_albedo(albedo)), mean_free_path_m_(mean_free_path_m), period_px_(period_px) {}

  // `point` and unit `normal` in the camera frame, the normal towards the camera.
  double bias_m(const Eigen::Vector3d& point, const Eigen::Vector3d& normal) const {
    const Eigen::Vector3d across = normal.unitOrthogonal(), along = normal.cross(across);
    Eigen::Matrix3d surface_from_camera;
    surface_from_camera << across.transpose(), along.transpose(), normal.transpose();
    const Eigen::Vector3d projector = rig_.projector_from_camera.inverse().translation;
    const Eigen::Vector3d to_light = surface_from_camera * (projector - point).normalized();
    const Eigen::Vector3d to_viewer = surface_from_camera * -point.normalized();
    const Eigen::Vector2d wave =
        kTwoPi / period_px_ * mean_free_path_m_ * Eigen::Vector2d(slope(point, across), slope(point, along));
    const double shift_px = period_px_ / kTwoPi * std::arg(space_.reflected(to_light, to_viewer, wave));
    return shift_px / slope(point, point / point.z());
  }

 private:
  // Change of the projector column per step of this vector.
  double slope(const Eigen::Vector3d& point, const Eigen::Vector3d& step) const {
    constexpr double kStep = 1e-5;
    const auto column = [&](double s) {
      return rig_.projector.project(rig_.projector_from_camera * (point + s * step)).x();
    };
    return (column(kStep) - column(-kStep)) / (2 * kStep);
  }

  const RigModel& rig_;
  HalfSpace space_;
  double mean_free_path_m_, period_px_;
};

struct Mean {
  double sum = 0;
  int count = 0;
  void add(double value) { sum += value, ++count; }
  double value() const { return count > 0 ? sum / count : NAN; }
};

struct Bias {
  Mean measured_m, predicted_m;
};

// Adds the bias of one view on the front of a block; the prediction varies slowly and is evaluated on a coarse grid.
void add_view(const sim::Scene& scene, const sim::Object& block, double period_px, const PatternSequence& sequence,
              Bias& bias) {
  const auto view = sim::VirtualRig(scene, {}).simulate(sequence);
  const DecodedStack decoded = decode(view->stack, scene.rig, {});
  const Frame frame = reconstruct(decoded, scene.rig, pixel_rays(scene.rig.camera), {});
  const TruthFrame& truth = view->truth;
  const Pose camera_from_world = (truth.world_from_robot * scene.rig.robot_from_camera).inverse();
  const Pose block_from_world = block.world_from_object.inverse();
  Eigen::Vector3d half = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d& vertex : block.mesh->vertices) half = half.cwiseMax(vertex);
  const auto id = static_cast<float>(&block - scene.objects.data() + 1);
  const Prediction prediction(scene.rig, block.material.albedo, block.material.mean_free_path_m, period_px);
  for (int row = 0; row < truth.mask.rows; ++row) {
    for (int col = 0; col < truth.mask.cols; ++col) {
      if (truth.object_id(row, col) != id || !is_lit_surface(static_cast<int>(truth.mask(row, col)))) continue;
      const cv::Vec3f& p = truth.position_m(row, col);
      const Eigen::Vector3d world(p[0], p[1], p[2]), within = block_from_world * world;
      if (within.z() > -half.z() + 1e-4) continue;  // a side of the block
      if (std::abs(within.x()) > half.x() - kBorder_m || std::abs(within.y()) > half.y() - kBorder_m) continue;
      const float error = frame.points_m(row, col)[2] - truth.depth_m(row, col);
      if (std::isnan(error)) continue;
      bias.measured_m.add(static_cast<double>(error));
      if (row % kStride != 0 || col % kStride != 0) continue;
      const cv::Vec3f& n = truth.normals(row, col);
      bias.predicted_m.add(prediction.bias_m(camera_from_world * world, Eigen::Vector3d(n[0], n[1], n[2])));
    }
  }
}

Bias bias_on(size_t object, double period_px, const std::vector<double>& periods_px, int seeds) {
  Bias bias;
  for (int seed = 1; seed <= seeds; ++seed) {
    const sim::Scene scene =
        sim::load_scene(std::string(FRINGESLAM_SCENES) + "/foam_block/scene.yaml", {static_cast<uint64_t>(seed)});
    SequenceDesign design{scene.rig.projector.width, scene.rig.projector.height};
    design.periods_px = periods_px;
    add_view(scene, scene.objects.at(object), period_px, design_sequence(design), bias);
  }
  return bias;
}

std::vector<Row> subsurface_rows(const Context& context) {
  const int seeds = context.quick ? 3 : 20;
  const std::vector<double> coarse = {1040, 256, 64}, fine = {1040, 256, 64, 16};
  std::vector<double> ratios;
  for (const auto& [period_px, periods_px] : {std::pair{16.0, fine}, {64.0, coarse}}) {
    const Bias foam = bias_on(0, period_px, periods_px, seeds), chalk = bias_on(1, period_px, periods_px, seeds);
    std::fprintf(stderr, "  %2.0f px: foam %.4f mm, predicted %.4f mm, %d pixels; opaque block %.4f mm\n", period_px,
                 1e3 * foam.measured_m.value(), 1e3 * foam.predicted_m.value(), foam.measured_m.count / seeds,
                 1e3 * chalk.measured_m.value());
    ratios.push_back(foam.measured_m.value() / foam.predicted_m.value());
  }
  return {bound_row("subsurface.bias.least", least_of(ratios), seeds, "x", 0.8, Limit::least),
          bound_row("subsurface.bias.greatest", greatest_of(ratios), seeds, "x", 1.2, Limit::most)};
}

}  // namespace

std::vector<Item> subsurface_items() {
  return {{{"subsurface.bias.least", "subsurface.bias.greatest"},
           "depth bias on translucent foam relative to radiative transfer, fringes of 16 and 64 px",
           subsurface_rows}};
}

}  // namespace fringeslam::bench
