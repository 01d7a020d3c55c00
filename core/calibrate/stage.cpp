// SPDX-License-Identifier: Apache-2.0
#include "core/calibrate/stage.h"

#include <ceres/ceres.h>
#include <ceres/rotation.h>

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <string>

#include "core/types/error.h"
#include "core/types/linear_algebra.h"
#include "core/types/options.h"

namespace fringeslam {

namespace {

constexpr double kCornerSigmaPx = 0.02;

struct Sighting {
  size_t view, corner;
};

// Solves the linear system for [M t], M row by row; throws Error if the motions leave a direction undetermined.
Eigen::Matrix<double, 3, 4> solve_affine(const std::vector<StageView>& views) {
  Eigen::Matrix<double, 12, 12> normal = Eigen::Matrix<double, 12, 12>::Zero();
  Eigen::Matrix<double, 12, 1> right = Eigen::Matrix<double, 12, 1>::Zero();
  // Lengths are in units of the corners' mean distance, which gives all columns a similar magnitude.
  double scale = 0;
  int sightings = 0;
  for (const StageView& view : views) {
    for (const auto& corner : view.corners) {
      if (corner) scale += corner->point_m.norm(), ++sightings;
    }
  }
  scale /= std::max(1, sightings);
  for (size_t i = 1; i < views.size(); ++i) {
    const Eigen::Matrix3d &r0 = views[0].world_from_robot.rotation, &ri = views[i].world_from_robot.rotation;
    for (size_t j = 0; j < views[i].corners.size(); ++j) {
      if (!views[0].corners[j] || !views[i].corners[j]) continue;
      const Eigen::Vector3d c0 = views[0].corners[j]->point_m / scale, ci = views[i].corners[j]->point_m / scale;
      Eigen::Matrix<double, 3, 12> rows;
      for (int k = 0; k < 3; ++k) rows.middleCols<3>(3 * k) = r0.col(k) * c0.transpose() - ri.col(k) * ci.transpose();
      rows.rightCols<3>() = r0 - ri;
      const Eigen::Vector3d value =
          (views[i].world_from_robot.translation - views[0].world_from_robot.translation) / scale;
      normal += rows.transpose().lazyProduct(rows);
      right += rows.transpose() * value;
    }
  }
  const auto eigen = symmetric_eigen(Eigen::MatrixXd(normal));
  if (!(eigen.values(0) > 1e-7 * eigen.values(11))) {
    const bool offset_open = eigen.vectors.col(0).tail<3>().squaredNorm() > 0.5;
    throw Error(offset_open
                    ? "the motions do not determine the camera's position: there is no rotation, or only one axis; add "
                      "rotations of 5 degrees or more about two axes"
                    : "the motions do not determine the camera's orientation; add translations along three axes");
  }
  const Eigen::VectorXd along = eigen.vectors.transpose().lazyProduct(right).cwiseQuotient(eigen.values);
  const Eigen::Matrix<double, 12, 1> x = eigen.vectors.lazyProduct(along);
  Eigen::Matrix<double, 3, 4> affine;
  for (int k = 0; k < 3; ++k) affine.row(k).head<3>() = x.segment<3>(3 * k).transpose();
  affine.col(3) = scale * x.tail<3>();
  return affine;
}

// Returns the rotation nearest to M, and the translation that maps the corners' centre to the same point as the affine
// transform does.
Pose nearest_rigid(const Eigen::Matrix<double, 3, 4>& affine, const Eigen::Vector3d& centre) {
  Pose pose;
  pose.rotation = nearest_rotation(affine.leftCols<3>());
  pose.translation = affine.leftCols<3>() * centre + affine.col(3) - pose.rotation * centre;
  return pose;
}

// Whitened residual between a measured corner transformed to the world and the corner's estimated world position.
struct CornerResidual {
  Eigen::Matrix3d world_rotation, initial_rotation, whitening;
  Eigen::Vector3d world_translation, camera_point;

  // `tangent` is that of retract(initial, tangent), except that its translation part is the full translation.
  template <class T>
  bool operator()(const T* tangent, const T* corner, T* residual) const {
    const Eigen::Vector3d rotated = initial_rotation * camera_point;
    const T point[3] = {T(rotated.x()), T(rotated.y()), T(rotated.z())};
    T turned[3];
    ceres::AngleAxisRotatePoint(tangent, point, turned);
    Eigen::Matrix<T, 3, 1> in_robot;
    for (int i = 0; i < 3; ++i) in_robot[i] = turned[i] + tangent[3 + i];
    const Eigen::Matrix<T, 3, 1> off = world_rotation.cast<T>() * in_robot + world_translation.cast<T>() -
                                       Eigen::Map<const Eigen::Matrix<T, 3, 1>>(corner);
    Eigen::Map<Eigen::Matrix<T, 3, 1>> out(residual);
    out = whitening.cast<T>() * off;
    return true;
  }
};

// Variance factor for errors common to all corners of a view, such as the phase error of fringes on the print. These do
// not average out over the corners, and the transform depends only on differences between views. Returns the reduced
// chi-square of the views' residual rigid motions: the greater of those out of the image plane (tilts and distance,
// determined by depth) and in it (roll and shifts, determined by the corners' image positions).
double view_variance_factor(const std::vector<StageView>& views, const Pose& robot_from_camera,
                            const std::vector<Eigen::Vector3d>& corners) {
  Eigen::Vector2d chi2 = Eigen::Vector2d::Zero();
  Eigen::Vector3d pivot = Eigen::Vector3d::Zero();  // the middle of the used corners
  int used = 0;
  for (const Eigen::Vector3d& corner : corners) {
    if (!corner.isZero()) pivot += corner, ++used;
  }
  pivot /= std::max(1, used);
  int freedom = -6;  // per half: 3 for the transform and 3 for the board's pose
  for (const StageView& view : views) {
    const Pose camera_from_world = (view.world_from_robot * robot_from_camera).inverse();
    Matrix6d normal = Matrix6d::Zero();
    Vector6d right = Vector6d::Zero();
    int seen = 0;
    for (size_t j = 0; j < corners.size(); ++j) {
      if (!view.corners[j] || corners[j].isZero()) continue;
      const Eigen::Vector3d off = view.corners[j]->point_m - camera_from_world * corners[j];
      const Eigen::Vector3d arm = camera_from_world.rotation * (corners[j] - pivot);
      // Columns: tilts and distance, then roll and shifts.
      Eigen::Matrix<double, 3, 6> jacobian;
      jacobian << 0, arm.z(), 0, -arm.y(), 1, 0, -arm.z(), 0, 0, arm.x(), 0, 1, arm.y(), -arm.x(), 1, 0, 0, 0;
      const Eigen::Matrix3d information = view.corners[j]->covariance_m2.inverse();
      normal += jacobian.transpose() * information * jacobian;
      right += jacobian.transpose() * information * off;
      ++seen;
    }
    if (seen < 6) continue;
    const Matrix6d covariance = inverse(normal);
    const Vector6d motion = covariance * right;
    for (int half = 0; half < 2; ++half) {
      const Eigen::Vector3d part = motion.segment<3>(3 * half);
      chi2[half] += part.dot(covariance.block<3, 3>(3 * half, 3 * half).inverse() * part);
    }
    freedom += 3;
  }
  return chi2.maxCoeff() / std::max(1, freedom);
}

void refine(const std::vector<StageView>& views, StageCalibration& result) {
  const Pose start = result.nearest_rigid;
  Vector6d tangent;
  tangent << Eigen::Vector3d::Zero(), start.translation;
  std::vector<Eigen::Vector3d> corners(views[0].corners.size(), Eigen::Vector3d::Zero());
  ceres::Problem problem;
  int residuals = 0, used_corners = 0;
  for (size_t j = 0; j < corners.size(); ++j) {
    int seen = 0;
    for (const StageView& view : views) {
      if (!view.corners[j]) continue;
      corners[j] += view.world_from_robot * (start * view.corners[j]->point_m);
      ++seen;
    }
    if (seen < 2) {
      corners[j].setZero();  // not used
      continue;
    }
    corners[j] /= seen;
    ++used_corners;
    for (const StageView& view : views) {
      if (!view.corners[j]) continue;
      const Eigen::Matrix3d to_world = view.world_from_robot.rotation * start.rotation;
      auto* residual = new CornerResidual{view.world_from_robot.rotation, start.rotation,
                                          whitening(to_world * view.corners[j]->covariance_m2 * to_world.transpose()),
                                          view.world_from_robot.translation, view.corners[j]->point_m};
      problem.AddResidualBlock(new ceres::AutoDiffCostFunction<CornerResidual, 3, 6, 3>(residual),
                               new ceres::HuberLoss(3), tangent.data(), corners[j].data());
      residuals += 3;
    }
  }
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_SCHUR;
  options.max_num_iterations = 100;
  options.function_tolerance = 1e-14;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);

  ceres::Covariance covariance{ceres::Covariance::Options{}};
  const double* block = tangent.data();
  if (!summary.IsSolutionUsable() || !covariance.Compute(std::vector<const double*>{block}, &problem))
    throw Error(
        "the motions do not determine the transform; add rotations about two axes and translations along three");
  Eigen::Matrix<double, 6, 6, Eigen::RowMajor> matrix;
  covariance.GetCovarianceBlock(block, block, matrix.data());
  // The corners' covariances are correct up to a factor, which is estimated from the residuals.
  const double excess = 2 * summary.final_cost / std::max(1, residuals - 6 - 3 * used_corners);
  result.robot_from_camera = {rotation_exp(tangent.head<3>()) * start.rotation, tangent.tail<3>()};
  result.covariance = std::max(excess, view_variance_factor(views, result.robot_from_camera, corners)) * matrix;
  result.corners = used_corners;

  double squares = 0;
  int sightings = 0;
  for (size_t j = 0; j < corners.size(); ++j) {
    for (const StageView& view : views) {
      if (!view.corners[j] || corners[j].isZero()) continue;
      squares +=
          (view.world_from_robot * (result.robot_from_camera * view.corners[j]->point_m) - corners[j]).squaredNorm();
      ++sightings;
    }
  }
  result.rms_m = std::sqrt(squares / std::max(1, sightings));
}

}  // namespace

StageCalibration calibrate_stage(const std::vector<StageView>& views) {
  if (views.size() < 4)
    throw Error(std::to_string(views.size()) +
                " views of the board; at least four (three motions) are required, the papers use nine");
  size_t common = 0;
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();
  for (size_t j = 0; j < views[0].corners.size(); ++j) {
    if (!views[0].corners[j]) continue;
    centre += views[0].corners[j]->point_m;
    ++common;
  }
  if (common < 6)
    throw Error("only " + std::to_string(common) + " corners have depth in the first view; at least six are required");
  StageCalibration result;
  result.motions = static_cast<int>(views.size()) - 1;
  result.affine = solve_affine(views);
  const Eigen::Matrix3d m = result.affine.leftCols<3>();
  result.affinity = (m.transpose() * m - Eigen::Matrix3d::Identity()).norm();
  constexpr double kMostAffinity = 0.1;  // noise leaves some thousandths
  if (!(result.affinity <= kMostAffinity))
    throw Error("the poses and the views do not fit a rigid transform (it would scale or shear by " +
                to_text(std::round(1e3 * result.affinity) / 1e3) +
                "); use poses of the robot in the world, in meters, in the order of the views");
  // Poses that a reflection F has changed to (F R F, F t) fit F M exactly.
  if (m.determinant() < 0)
    throw Error(
        "the poses fit only a mirrored transform: they are those of a left-handed frame, or the images are mirrored; "
        "convert the poses (negate the translation along one axis and the rotations about the two others), or flip the "
        "images");
  result.nearest_rigid = nearest_rigid(result.affine, centre / static_cast<double>(common));
  refine(views, result);
  return result;
}

std::optional<CornerPoint> corner_point(const Frame& frame, const Pinhole& camera, const Eigen::Vector2d& corner_px,
                                        double radius_px) {
  const int reach = static_cast<int>(std::ceil(radius_px));
  const int x0 = static_cast<int>(std::lround(corner_px.x())), y0 = static_cast<int>(std::lround(corner_px.y()));
  const Eigen::Vector2d ray = camera.undistort(corner_px);
  // In perspective, a plane is linear in inverse depth: 1/z = (a, b, c).(x, y, 1), relative to the corner's ray.
  Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
  Eigen::Vector3d right = Eigen::Vector3d::Zero();
  double squares = 0, count = 0;
  for (int y = std::max(0, y0 - reach); y <= std::min(frame.height() - 1, y0 + reach); ++y) {
    for (int x = std::max(0, x0 - reach); x <= std::min(frame.width() - 1, x0 + reach); ++x) {
      if (!frame.valid(y, x) || (Eigen::Vector2d(x, y) - corner_px).norm() > radius_px) continue;
      const cv::Vec3f& p = frame.points_m(y, x);
      const double z = p[2], sigma = frame.sigma_m(y, x) / (z * z);
      const Eigen::Vector3d row(p[0] / z - ray.x(), p[1] / z - ray.y(), 1);
      const double weight = 1 / (sigma * sigma);
      normal += weight * row * row.transpose();
      right += weight * row / z;
      squares += weight / (z * z);
      ++count;
    }
  }
  if (count < 12) return std::nullopt;
  const Eigen::Matrix3d covariance = normal.inverse();
  const Eigen::Vector3d plane = covariance * right;
  const double chi2 = (squares - plane.dot(right)) / (count - 3);
  constexpr double kMaxChi2 = 4;
  if (!(chi2 <= kMaxChi2) || !(plane.z() > 0)) return std::nullopt;
  const double z = 1 / plane.z();
  CornerPoint corner;
  corner.point_m = z * Eigen::Vector3d(ray.x(), ray.y(), 1);
  // Variance along the ray comes from the plane fit, variance across it from the corner's image position; a shift in
  // the image changes the depth along the plane.
  const double sigma_z = z * z * std::sqrt(covariance(2, 2) * std::max(1.0, chi2));
  Eigen::Matrix<double, 3, 3> jacobian;  // of the point with respect to depth, pixel x, pixel y
  const Eigen::Vector2d slope = -z * z * plane.head<2>();
  const Eigen::Vector3d direction(ray.x(), ray.y(), 1);
  jacobian.col(0) = direction;
  jacobian.col(1) = (Eigen::Vector3d(z, 0, 0) + slope.x() * direction) / camera.fx;
  jacobian.col(2) = (Eigen::Vector3d(0, z, 0) + slope.y() * direction) / camera.fy;
  const Eigen::Vector3d variances(sigma_z * sigma_z, kCornerSigmaPx * kCornerSigmaPx, kCornerSigmaPx * kCornerSigmaPx);
  corner.covariance_m2 = jacobian * variances.asDiagonal() * jacobian.transpose();
  return corner;
}

}  // namespace fringeslam
