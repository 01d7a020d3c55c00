// SPDX-License-Identifier: Apache-2.0
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <cmath>
#include <limits>

#include "core/score/score.h"

namespace fringeslam {

namespace {

Eigen::Vector3d to_eigen(const cv::Vec3f& v) { return {v[0], v[1], v[2]}; }

// A pixel of one view that contributes to the information: true geometry, estimated sigma.
struct BoundPoint {
  Eigen::Vector3d point, normal;
  double residual_sigma = 0;  // |n.d| sigma_z
  bool usable = false;
};

BoundPoint bound_point(const TruthFrame& truth, const cv::Mat1f& sigma_m, const PixelRays& rays, int row, int col) {
  BoundPoint result;
  const double depth = truth.depth_m(row, col), sigma = sigma_m(row, col);
  // The sigma of a mixed pixel does not describe the error of its point.
  const bool mixed = (static_cast<int>(truth.mask(row, col)) & kTruthMixed) != 0;
  if (std::isnan(depth) || std::isnan(sigma) || mixed) return result;
  const Eigen::Vector3d ray(rays(row, col)[0], rays(row, col)[1], 1);
  result.point = depth * ray;
  result.normal = to_eigen(truth.normals(row, col));
  result.residual_sigma = std::abs(result.normal.dot(ray)) * sigma;
  result.usable = true;
  return result;
}

}  // namespace

Matrix6d pose_information(const TruthFrame& previous, const cv::Mat1f& previous_sigma_m, const TruthFrame& current,
                          const cv::Mat1f& current_sigma_m, const Pinhole& camera, const PixelRays& rays,
                          const Pose& true_previous_from_current) {
  struct Pair {
    Vector6d g;
    double source_variance, target_variance;
    cv::Point target;
  };
  std::vector<Pair> pairs;
  pairs.reserve(current.depth_m.total());
  cv::Mat1i uses(previous.depth_m.size(), 0);
  for (int row = 0; row < current.depth_m.rows; ++row) {
    for (int col = 0; col < current.depth_m.cols; ++col) {
      const BoundPoint source = bound_point(current, current_sigma_m, rays, row, col);
      if (!source.usable) continue;
      const Eigen::Vector3d rotated = true_previous_from_current.rotation * source.point;
      const Eigen::Vector3d x = rotated + true_previous_from_current.translation;
      if (x.z() <= 0) continue;
      const Eigen::Vector2d pixel = camera.project(x);
      if (!camera.contains(pixel)) continue;
      const cv::Point at(static_cast<int>(std::lround(pixel.x())), static_cast<int>(std::lround(pixel.y())));
      const BoundPoint target = bound_point(previous, previous_sigma_m, rays, at.y, at.x);
      // Keeps only pairs on the same surface: the point of one view lies in the true tangent plane of the other.
      if (!target.usable || std::abs(target.normal.dot(x - target.point)) > 5e-4 || (x - target.point).norm() > 5e-3)
        continue;
      Vector6d g;
      g << rotated.cross(target.normal), target.normal;
      ++uses(at);
      pairs.push_back(
          {g, source.residual_sigma * source.residual_sigma, target.residual_sigma * target.residual_sigma, at});
    }
  }
  // A pixel of the previous view was measured only once, even if several pixels of the current view fall on it.
  Matrix6d lower = Matrix6d::Zero();
  for (const Pair& pair : pairs) {
    const double weight = 1 / (pair.source_variance + uses(pair.target) * pair.target_variance);
    lower.selfadjointView<Eigen::Lower>().rankUpdate(pair.g, weight);
  }
  return lower.selfadjointView<Eigen::Lower>();
}

double error_over_bound(const Pose& estimate, const Pose& truth, const Matrix6d& information) {
  const Eigen::FullPivLU<Matrix6d> factor(information);
  if (!factor.isInvertible()) return std::numeric_limits<double>::quiet_NaN();
  const Vector6d error = difference(estimate, truth);
  return std::sqrt(error.dot(information * error) / 6);
}

MotionScore score_motion(const Pose& estimate, const Pose& truth) {
  MotionScore score;
  score.truth = six_dof(truth);
  score.estimate = six_dof(estimate);
  score.error.translation_mm = score.estimate.translation_mm - score.truth.translation_mm;
  for (int i = 0; i < 3; ++i)
    score.error.angles_deg[i] = std::remainder(score.estimate.angles_deg[i] - score.truth.angles_deg[i], 360.0);
  score.translation_error_m = (estimate.translation - truth.translation).norm();
  score.rotation_error_rad = rotation_log(estimate.rotation * truth.rotation.transpose()).norm();
  return score;
}

}  // namespace fringeslam
