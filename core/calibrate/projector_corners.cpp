// SPDX-License-Identifier: Apache-2.0
#include "core/calibrate/projector_corners.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "core/calibrate/median.h"
#include "core/types/linear_algebra.h"

namespace fringeslam {

namespace {

struct Sample {
  Eigen::Vector2d camera, projector;  // relative to the window's centre in radii; px
  Eigen::Vector2d weight;             // 1 / sigma
  double trust = 1;                   // robust weight; 0: rejected
};

std::vector<Sample> collect(const ProjectorCoordinates& coordinates, const Eigen::Vector2d& corner, double radius,
                            int& window_pixels) {
  std::vector<Sample> samples;
  window_pixels = 0;
  const int reach = static_cast<int>(std::ceil(radius));
  const int x0 = static_cast<int>(std::lround(corner.x())), y0 = static_cast<int>(std::lround(corner.y()));
  for (int y = y0 - reach; y <= y0 + reach; ++y) {
    for (int x = x0 - reach; x <= x0 + reach; ++x) {
      const Eigen::Vector2d offset = Eigen::Vector2d(x, y) - corner;
      if (offset.norm() > radius) continue;
      ++window_pixels;
      if (x < 0 || y < 0 || x >= coordinates.column_px.cols || y >= coordinates.column_px.rows) continue;
      const double u = coordinates.column_px(y, x), v = coordinates.row_px(y, x);
      if (std::isnan(u) || std::isnan(v)) continue;
      const double su = std::max(1e-3, static_cast<double>(coordinates.column_sigma_px(y, x)));
      const double sv = std::max(1e-3, static_cast<double>(coordinates.row_sigma_px(y, x)));
      samples.push_back({offset / radius, {u, v}, {1 / su, 1 / sv}});
    }
  }
  return samples;
}

// Weighted direct linear transform: u (h7 x + h8 y + h9) = h1 x + h2 y + h3, likewise for v. Coordinates are small
// around the window's centre, where the denominator is nearly h9, so the algebraic error approximates the geometric
// error.
Eigen::Matrix3d direct_linear_transform(const std::vector<Sample>& samples, const Eigen::Vector2d& middle,
                                        double scale) {
  Eigen::Matrix<double, 9, 9> normal = Eigen::Matrix<double, 9, 9>::Zero();
  for (const Sample& sample : samples) {
    if (sample.trust == 0) continue;
    const double x = sample.camera.x(), y = sample.camera.y();
    const Eigen::Vector2d p = (sample.projector - middle) / scale;
    Eigen::Matrix<double, 2, 9> rows;
    rows << x, y, 1, 0, 0, 0, -p.x() * x, -p.x() * y, -p.x(),  //
        0, 0, 0, x, y, 1, -p.y() * x, -p.y() * y, -p.y();
    rows = std::sqrt(sample.trust) * sample.weight.asDiagonal() * rows;
    normal += rows.transpose().lazyProduct(rows);
  }
  const Eigen::Matrix<double, 9, 1> h = symmetric_eigen(Eigen::MatrixXd(normal)).vectors.col(0);
  Eigen::Matrix3d result;
  result << h(0), h(1), h(2), h(3), h(4), h(5), h(6), h(7), h(8);
  Eigen::Matrix3d back = Eigen::Matrix3d::Identity();
  back(0, 0) = back(1, 1) = scale;
  back.block<2, 1>(0, 2) = middle;
  return back * result;
}

// Weighted affine fit. Unlike a homography, it cannot become nearly singular because of outliers.
Eigen::Matrix3d affine_fit(const std::vector<Sample>& samples) {
  Eigen::Matrix3d result = Eigen::Matrix3d::Identity();
  for (int axis = 0; axis < 2; ++axis) {
    Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
    Eigen::Vector3d right = Eigen::Vector3d::Zero();
    for (const Sample& sample : samples) {
      const double weight = sample.trust * sample.weight[axis] * sample.weight[axis];
      normal += weight * sample.camera.homogeneous() * sample.camera.homogeneous().transpose();
      right += weight * sample.camera.homogeneous() * sample.projector[axis];
    }
    result.row(axis) = solve_symmetric(normal, right).transpose();
  }
  return result;
}

// True if known pixels surround the corner; a homography extrapolates poorly.
bool surrounded(const std::vector<Sample>& samples) {
  int quadrants[4] = {0, 0, 0, 0};
  for (const Sample& s : samples) ++quadrants[(s.camera.x() > 0 ? 1 : 0) + (s.camera.y() > 0 ? 2 : 0)];
  // A checkerboard's dark squares may have no coordinates, so two opposite quadrants suffice.
  return (quadrants[0] >= 4 && quadrants[3] >= 4) || (quadrants[1] >= 4 && quadrants[2] >= 4);
}

}  // namespace

std::optional<LocalHomography> local_homography(const ProjectorCoordinates& coordinates,
                                                const Eigen::Vector2d& corner_px, double radius_px) {
  int window_pixels = 0;
  std::vector<Sample> samples = collect(coordinates, corner_px, radius_px, window_pixels);
  if (samples.size() < 20 || 3 * samples.size() < static_cast<size_t>(window_pixels) || !surrounded(samples))
    return std::nullopt;
  std::vector<double> us, vs;
  for (const Sample& s : samples) us.push_back(s.projector.x()), vs.push_back(s.projector.y());
  const Eigen::Vector2d middle(median(us), median(vs));
  const double scale = std::max(1.0, (samples.front().projector - middle).norm());
  // Starts with iteratively reweighted least absolute deviations, robust to a third of outliers, then continues with
  // least squares on the inliers.
  constexpr int kAbsolute = 8, kSquares = 3;
  Eigen::Matrix3d homography;
  std::vector<Eigen::Vector2d> residuals(samples.size());
  for (int round = 0; round < kAbsolute + kSquares; ++round) {
    homography = round < kAbsolute ? affine_fit(samples) : direct_linear_transform(samples, middle, scale);
    std::vector<double> sizes;
    for (size_t i = 0; i < samples.size(); ++i) {
      residuals[i] = (homography * samples[i].camera.homogeneous()).hnormalized() - samples[i].projector;
      sizes.push_back(residuals[i].cwiseProduct(samples[i].weight).norm());
    }
    const double typical = std::max(median(sizes) / 1.18, 1e-6);  // 1.18: median norm of two standard normal variables
    for (size_t i = 0; i < samples.size(); ++i)
      samples[i].trust = round + 1 < kAbsolute     ? 1 / std::max(sizes[i], 0.1 * typical)
                         : sizes[i] <= 4 * typical ? 1
                                                   : 0;
  }
  LocalHomography result;
  Eigen::Vector2d squares = Eigen::Vector2d::Zero();
  for (size_t i = 0; i < samples.size(); ++i) {
    if (samples[i].trust == 0) continue;
    ++result.pixels;
    squares += residuals[i].cwiseAbs2();
  }
  if (result.pixels < 20) return std::nullopt;
  // At its centre, a fit is about as accurate as the mean, less a few degrees of freedom; times 2 as a safety margin.
  result.sigma_px = (squares / (result.pixels * std::max(1, result.pixels - 8))).cwiseSqrt() * 2;
  Eigen::Matrix3d to_window = Eigen::Matrix3d::Identity() / radius_px;
  to_window.block<2, 1>(0, 2) = -corner_px / radius_px;
  to_window(2, 2) = 1;
  result.projector_from_camera = homography * to_window;
  if (!result.projector_from_camera.allFinite()) return std::nullopt;
  return result;
}

}  // namespace fringeslam
