// SPDX-License-Identifier: Apache-2.0
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <cmath>
#include <limits>

#include "core/score/score.h"
#include "core/types/error.h"

namespace fringeslam {

namespace {

Eigen::Vector3d to_eigen(const cv::Vec3f& v) { return {v[0], v[1], v[2]}; }

// A pixel of one view that contributes to the information: true geometry and measured sigma.
struct BoundPoint {
  Eigen::Vector3d point, normal;
  double residual_sigma = 0;  // |n.d| sigma_z
  bool usable = false;
};

BoundPoint bound_point(const TruthFrame& truth, const cv::Mat1f& sigma_m, const PixelRays& rays, int row, int col) {
  BoundPoint result;
  const double depth = truth.depth_m(row, col), sigma = sigma_m(row, col);
  // The sigma of a pixel that sees an edge says nothing about where its point lies.
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
      // The same surface in both views: the true plane of the one holds the point of the other.
      if (!target.usable || std::abs(target.normal.dot(x - target.point)) > 5e-4 || (x - target.point).norm() > 5e-3)
        continue;
      Vector6d g;
      g << rotated.cross(target.normal), target.normal;
      ++uses(at);
      pairs.push_back(
          {g, source.residual_sigma * source.residual_sigma, target.residual_sigma * target.residual_sigma, at});
    }
  }
  // A pixel of the previous view on which several of the current one fall was measured once all the same.
  Matrix6d information = Matrix6d::Zero();
  for (const Pair& pair : pairs)
    information += pair.g * pair.g.transpose() / (pair.source_variance + uses(pair.target) * pair.target_variance);
  return information;
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

std::vector<std::pair<size_t, size_t>> associate(const Trajectory& estimate, const Trajectory& truth,
                                                 double max_gap_s) {
  std::vector<std::pair<size_t, size_t>> pairs;
  size_t j = 0;
  for (size_t i = 0; i < estimate.size(); ++i) {
    const double time = estimate[i].timestamp_s;
    while (j + 1 < truth.size() && std::abs(truth[j + 1].timestamp_s - time) <= std::abs(truth[j].timestamp_s - time))
      ++j;
    if (j < truth.size() && std::abs(truth[j].timestamp_s - time) <= max_gap_s) pairs.emplace_back(i, j);
  }
  return pairs;
}

namespace {

double ate_rmse(const std::vector<Eigen::Vector3d>& truth, const std::vector<Eigen::Vector3d>& estimate,
                const Pose& truth_from_estimate) {
  double squares = 0;
  for (size_t i = 0; i < truth.size(); ++i) squares += (truth_from_estimate * estimate[i] - truth[i]).squaredNorm();
  return std::sqrt(squares / static_cast<double>(truth.size()));
}

}  // namespace

TrajectoryScore score_trajectory(const Trajectory& estimate, const Trajectory& truth) {
  const auto pairs = associate(estimate, truth);
  if (pairs.size() < 2)
    throw Error("score: only " + std::to_string(pairs.size()) +
                " poses of the estimate have a true pose within 10 ms; two are needed");
  std::vector<Eigen::Vector3d> true_positions, positions;
  for (const auto& [i, j] : pairs) {
    positions.push_back(estimate[i].world_from_robot.translation);
    true_positions.push_back(truth[j].world_from_robot.translation);
  }
  TrajectoryScore score;
  score.poses = static_cast<int>(pairs.size());
  const Pose by_origin = truth[pairs[0].second].world_from_robot * estimate[pairs[0].first].world_from_robot.inverse();
  score.ate_rmse_m = ate_rmse(true_positions, positions, by_origin);
  score.ate_umeyama_rmse_m = ate_rmse(true_positions, positions, align_points(true_positions, positions));

  double translation2 = 0, rotation2 = 0;
  for (size_t k = 1; k < pairs.size(); ++k) {
    const auto motion = [&](const Trajectory& t, size_t from, size_t to) {
      return t[from].world_from_robot.inverse() * t[to].world_from_robot;
    };
    const Pose error = motion(truth, pairs[k - 1].second, pairs[k].second).inverse() *
                       motion(estimate, pairs[k - 1].first, pairs[k].first);
    translation2 += error.translation.squaredNorm();
    rotation2 += std::pow(rotation_rad(error), 2);
  }
  const auto steps = static_cast<double>(pairs.size() - 1);
  score.rpe_translation_rmse_m = std::sqrt(translation2 / steps);
  score.rpe_rotation_rmse_rad = std::sqrt(rotation2 / steps);
  return score;
}

}  // namespace fringeslam
