// SPDX-License-Identifier: Apache-2.0
#include "core/map/icp.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

#include "core/types/parallel.h"

namespace fringeslam {

namespace {

Eigen::Vector3d to_eigen(const cv::Vec3f& v) { return {v[0], v[1], v[2]}; }

// Normal equations and statistics; one for each source row, added in row order so that the result
// does not depend on the number of threads.
struct Sums {
  Matrix6d information = Matrix6d::Zero();
  Vector6d gradient = Vector6d::Zero();
  double squares_m2 = 0, squares_sigma = 0;
  int pairs = 0;

  void operator+=(const Sums& other) {
    information += other.information;
    gradient += other.gradient;
    squares_m2 += other.squares_m2;
    squares_sigma += other.squares_sigma;
    pairs += other.pairs;
  }
};

struct Gates {
  double distance_m = 0;
  double outlier_sigma = 0;
};

class PointToPlane {
 public:
  PointToPlane(const Frame& target, const Frame& source, const Pinhole& camera, const IcpOptions& options)
      : target_(target),
        source_(source),
        camera_(camera),
        min_normal_cos_(std::cos(options.max_normal_deg * std::numbers::pi / 180)) {}

  int source_points() const {
    int count = 0;
    for (const cv::Vec3f& normal : source_.normals) count += !std::isnan(normal[2]);
    return count;
  }

  Sums linearise(const Pose& pose, const Gates& gates) const {
    std::vector<Sums> rows(static_cast<size_t>(source_.height()));
    for_each_row(source_.height(), [&](int row) {
      for (int col = 0; col < source_.width(); ++col) accumulate(row, col, pose, gates, rows[static_cast<size_t>(row)]);
    });
    Sums total;
    for (const Sums& row : rows) total += row;
    return total;
  }

 private:
  void accumulate(int row, int col, const Pose& pose, const Gates& gates, Sums& sums) const {
    if (std::isnan(source_.normals(row, col)[2])) return;
    const Eigen::Vector3d p = to_eigen(source_.points_m(row, col));
    const Eigen::Vector3d rotated = pose.rotation * p;
    const Eigen::Vector3d x = rotated + pose.translation;
    if (x.z() <= 0) return;
    const Eigen::Vector2d pixel = camera_.project(x);
    if (!camera_.contains(pixel)) return;
    const int target_col = static_cast<int>(std::lround(pixel.x())),
              target_row = static_cast<int>(std::lround(pixel.y()));
    const Eigen::Vector3d q = to_eigen(target_.points_m(target_row, target_col));

    const Eigen::Vector3d n_q = to_eigen(target_.normals(target_row, target_col));
    const Eigen::Vector3d n_p = pose.rotation * to_eigen(source_.normals(row, col));
    // False when a normal is missing: the pixel sees an edge, and its point may lie on either side of it.
    if (!(n_q.dot(n_p) >= min_normal_cos_)) return;
    const bool by_source = -n_p.dot(rotated) * q.norm() > -n_q.dot(q) * p.norm();
    const Eigen::Vector3d& n = by_source ? n_p : n_q;

    const double residual = n.dot(x - q);
    if (std::abs(residual) > gates.distance_m) return;
    const double sigma_q = n.dot(q) / q.z() * target_.sigma_m(target_row, target_col);
    const double sigma_p = n.dot(rotated) / p.z() * source_.sigma_m(row, col);
    const double variance = sigma_q * sigma_q + sigma_p * sigma_p;
    const double scaled = residual / (std::sqrt(variance) * gates.outlier_sigma);
    if (std::abs(scaled) >= 1) return;
    const double robust = (1 - scaled * scaled) * (1 - scaled * scaled);  // Tukey's weight
    Vector6d g;
    g << rotated.cross(n), n;
    sums.information += (robust / variance) * g * g.transpose();
    sums.gradient += (robust / variance * residual) * g;
    sums.squares_m2 += residual * residual;
    sums.squares_sigma += residual * residual / variance;
    ++sums.pairs;
  }

  const Frame& target_;
  const Frame& source_;
  const Pinhole& camera_;
  double min_normal_cos_;
};

double smallest_sigma(const Frame& frame) {
  double smallest = std::numeric_limits<double>::infinity();
  for (const float sigma : frame.sigma_m) {
    if (sigma > 0) smallest = std::min(smallest, static_cast<double>(sigma));
  }
  return smallest;
}

}  // namespace

IcpResult point_to_plane_icp(const Frame& target, const Frame& source, const Pinhole& camera, const Pose& initial,
                             const IcpOptions& options, const Matrix6d& prior) {
  check_options(options, "icp");
  const PointToPlane problem(target, source, camera, options);
  IcpResult result;
  result.target_from_source = initial;
  const int points = problem.source_points();
  if (points < 6) return result;

  // The gates start wide and halve with each iteration down to the noise (graduated non-convexity). They
  // must not follow the residuals down at once: those are mostly of flat ground, at the noise long before the
  // few walls that hold the view sideways have been pulled in.
  constexpr double kSettledSigmas = 0.25;
  Gates gates{options.max_distance_m, std::max(options.max_distance_m / smallest_sigma(source), options.outlier_sigma)};
  Sums sums;
  bool settled = false;
  for (result.iterations = 0; result.iterations < options.max_iterations && !settled; ++result.iterations) {
    sums = problem.linearise(result.target_from_source, gates);
    if (sums.pairs < 6) return result;
    sums.information += prior;
    sums.gradient += prior * difference(result.target_from_source, initial);
    const Eigen::LDLT<Matrix6d> factor(sums.information);
    if (factor.info() != Eigen::Success || !(factor.rcond() > 1e-12)) return result;
    const Vector6d step = factor.solve(-sums.gradient);
    result.target_from_source = retract(result.target_from_source, step);
    const double rms = std::sqrt(sums.squares_m2 / sums.pairs);
    const bool at_noise = gates.outlier_sigma <= options.outlier_sigma;
    // Partners flip between neighbouring pixels for ever; a step far below what noise can do ends it.
    settled = at_noise && step.dot(sums.information * step) < kSettledSigmas * kSettledSigmas;
    gates.outlier_sigma = std::max(options.outlier_sigma, 0.5 * gates.outlier_sigma);
    gates.distance_m = std::min(gates.distance_m, std::max(6 * rms, 0.5 * gates.distance_m));
  }
  result.pairs = sums.pairs;
  result.overlap = static_cast<double>(sums.pairs) / points;
  result.rms_m = std::sqrt(sums.squares_m2 / sums.pairs);
  result.rms_sigma = std::sqrt(sums.squares_sigma / sums.pairs);
  result.information = sums.information;
  result.converged = settled && result.overlap >= options.min_overlap && result.rms_sigma <= options.max_rms_sigma;
  return result;
}

}  // namespace fringeslam
