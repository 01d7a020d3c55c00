// SPDX-License-Identifier: Apache-2.0
#include "core/calibrate/initial_rig.h"

#include <Eigen/LU>
#include <cmath>
#include <opencv2/calib3d.hpp>

#include "core/types/error.h"
#include "core/types/linear_algebra.h"

namespace fringeslam {

namespace {

// Normalises points to zero mean and mean distance sqrt(N), which conditions the linear system.
template <int N>
Eigen::Matrix<double, N + 1, N + 1> normalising(const std::vector<Eigen::Matrix<double, N, 1>>& points) {
  Eigen::Matrix<double, N, 1> mean = Eigen::Matrix<double, N, 1>::Zero();
  for (const auto& p : points) mean += p / static_cast<double>(points.size());
  double distance = 0;
  for (const auto& p : points) distance += (p - mean).norm() / static_cast<double>(points.size());
  const double scale = std::sqrt(N) / distance;
  Eigen::Matrix<double, N + 1, N + 1> transform = Eigen::Matrix<double, N + 1, N + 1>::Identity() * scale;
  transform.template topRightCorner<N, 1>() = -scale * mean;
  transform(N, N) = 1;
  return transform;
}

}  // namespace

Pinhole initial_camera(const std::vector<std::vector<cv::Point2f>>& corners, const std::vector<Eigen::Vector3d>& board,
                       cv::Size size, std::vector<Pose>& poses) {
  std::vector<std::vector<cv::Point3f>> objects;
  std::vector<std::vector<cv::Point2f>> images;
  for (const std::vector<cv::Point2f>& view : corners) {
    objects.emplace_back();
    images.emplace_back();
    for (size_t j = 0; j < view.size(); ++j) {
      if (std::isnan(view[j].x)) continue;
      const Eigen::Vector3d& p = board[j];
      objects.back().emplace_back(static_cast<float>(p.x()), static_cast<float>(p.y()), static_cast<float>(p.z()));
      images.back().push_back(view[j]);
    }
  }
  cv::Mat1d matrix, distortion;
  std::vector<cv::Mat> rotations, translations;
  try {
    cv::calibrateCamera(objects, images, size, matrix, distortion, rotations, translations,
                        cv::CALIB_ZERO_TANGENT_DIST | cv::CALIB_FIX_K3);
  } catch (const cv::Exception& e) {
    throw Error("the camera's intrinsics cannot be estimated from these views: " +
                std::string(e.err.substr(0, e.err.find('\n'))) +
                "; tilt the board by 20 to 40 degrees in several directions");
  }
  Pinhole camera{size.width, size.height, matrix(0, 0), matrix(1, 1), matrix(0, 2), matrix(1, 2), {}};
  camera.distortion.k1 = distortion(0);
  camera.distortion.k2 = distortion(1);
  poses.clear();
  for (size_t i = 0; i < rotations.size(); ++i) {
    cv::Matx33d rotation;
    cv::Rodrigues(rotations[i], rotation);
    Pose pose;
    for (int r = 0; r < 3; ++r) {
      for (int c = 0; c < 3; ++c) pose.rotation(r, c) = rotation(r, c);
      pose.translation[r] = translations[i].at<double>(r);
    }
    poses.push_back(pose);
  }
  if (!std::isfinite(camera.fx * camera.fy) || camera.fx < 10 || camera.fx > 1e6)
    throw Error("the camera's focal length was estimated as " + std::to_string(camera.fx) +
                " px; tilt the board by 20 to 40 degrees in several directions");
  return camera;
}

Pinhole initial_projector(const std::vector<Eigen::Vector3d>& points, const std::vector<Eigen::Vector2d>& pixels,
                          cv::Size size, Pose& projector_from_camera) {
  const Eigen::Matrix4d scale_points = normalising<3>(points);
  const Eigen::Matrix3d scale_pixels = normalising<2>(pixels);
  Eigen::Matrix<double, 12, 12> normal = Eigen::Matrix<double, 12, 12>::Zero();
  for (size_t i = 0; i < points.size(); ++i) {
    const Eigen::Vector4d x = scale_points * points[i].homogeneous();
    const Eigen::Vector3d p = scale_pixels * pixels[i].homogeneous();
    Eigen::Matrix<double, 2, 12> rows;
    rows << x.transpose(), Eigen::RowVector4d::Zero(), -p.x() * x.transpose(),  //
        Eigen::RowVector4d::Zero(), x.transpose(), -p.y() * x.transpose();
    normal += rows.transpose().lazyProduct(rows);
  }
  const auto eigen = symmetric_eigen(Eigen::MatrixXd(normal));
  // The null space must be one-dimensional; a second null direction means that all points are coplanar.
  if (!(eigen.values(1) > 1e-9 * eigen.values(11)))
    throw Error(
        "all boards lie in one plane, which does not determine the projector's lens; tilt the board and change its "
        "distance");
  const Eigen::Matrix<double, 12, 1> h = eigen.vectors.col(0);
  Eigen::Matrix<double, 3, 4> matrix;
  matrix << h(0), h(1), h(2), h(3), h(4), h(5), h(6), h(7), h(8), h(9), h(10), h(11);
  matrix = scale_pixels.inverse() * matrix * scale_points;
  if (matrix.row(2).dot(points.front().homogeneous()) < 0) matrix = -matrix;  // points lie in front of the projector

  // Decomposes matrix = K [R t] with an upper triangular K by Gram-Schmidt orthogonalisation from the last row up.
  Eigen::Matrix3d rotation = matrix.leftCols<3>(), k = Eigen::Matrix3d::Zero();
  for (int i = 2; i >= 0; --i) {
    for (int j = 2; j > i; --j) {
      k(i, j) = rotation.row(i).dot(rotation.row(j));
      rotation.row(i) -= k(i, j) * rotation.row(j);
    }
    k(i, i) = rotation.row(i).norm();
    rotation.row(i) /= k(i, i);
  }
  const double scale = k(2, 2);
  projector_from_camera.translation = k.inverse() * matrix.col(3);
  if (rotation.determinant() < 0)
    throw Error("the projector's coordinates are mirrored; check the axis and direction that each pattern encodes");
  projector_from_camera.rotation = rotation;
  k /= scale;
  return {size.width, size.height, k(0, 0), k(1, 1), k(0, 2), k(1, 2), {}};
}

}  // namespace fringeslam
