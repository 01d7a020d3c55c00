// SPDX-License-Identifier: Apache-2.0
#include "tools/report/map_error.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/base/parallel.h"

namespace fringeslam::tools {

namespace {

constexpr double kMaxAlongRayM = 0.03;
constexpr double kMinAgreement = 0.7;  // cosine of the angle between the normals; below it, it is another surface
constexpr size_t kChunk = 4096;

}  // namespace

MapError::MapError(const std::vector<CloudPoint>& points, const RigModel& rig)
    : points_(points),
      rig_(rig),
      rays_(pixel_rays(rig.camera)),
      distances_m_(points.size(), std::numeric_limits<float>::quiet_NaN()),
      weights_(points.size(), 0) {}

void MapError::add(const TruthFrame& truth, const Pose& map_from_camera) {
  const Pose camera_from_map = map_from_camera.inverse();
  const Pinhole& camera = rig_.camera;
  // Beyond this slope the lens polynomial may fold back into the image.
  const double max_slope = 0.6 * (camera.width / camera.fx + camera.height / camera.fy);
  const auto measure = [&](size_t k) {
    const Eigen::Vector3d x = camera_from_map * points_[k].position_m.cast<double>();
    if (x.z() <= 0 || x.head<2>().norm() > max_slope * x.z()) return;
    const Eigen::Vector2d pixel = camera.project(x);
    if (!camera.contains(pixel)) return;
    const int row = std::clamp(static_cast<int>(std::lround(pixel.y())), 0, truth.depth_m.rows - 1);
    const int col = std::clamp(static_cast<int>(std::lround(pixel.x())), 0, truth.depth_m.cols - 1);
    const double depth = truth.depth_m(row, col);
    const int mask = static_cast<int>(truth.mask(row, col));
    if (!(std::abs(depth - x.z()) < kMaxAlongRayM) || (mask & kTruthMixed)) return;
    const cv::Vec2f ray = rays_(row, col);
    const cv::Vec3f n = truth.normals(row, col);
    const Eigen::Vector3d p(ray[0] * depth, ray[1] * depth, depth), normal(n[0], n[1], n[2]);
    const Eigen::Vector3d own_normal = camera_from_map.rotation * points_[k].normal.cast<double>();
    if (!(normal.dot(own_normal) > kMinAgreement)) return;
    const double facing = -own_normal.dot(x.normalized());
    const double weight = facing / x.z();
    if (!(weight > weights_[k])) return;
    weights_[k] = static_cast<float>(weight);
    distances_m_[k] = static_cast<float>(-normal.dot(x - p));  // normals face the camera
  };
  for_each_row(static_cast<int>((points_.size() + kChunk - 1) / kChunk), [&](int chunk) {
    const size_t first = static_cast<size_t>(chunk) * kChunk;
    for (size_t k = first; k < std::min(first + kChunk, points_.size()); ++k) measure(k);
  });
}

}  // namespace fringeslam::tools
