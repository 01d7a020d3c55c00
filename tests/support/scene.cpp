// SPDX-License-Identifier: Apache-2.0
#include "tests/support/scene.h"

#include <Eigen/Geometry>
#include <limits>
#include <numbers>

namespace fringeslam::support {

namespace {

constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();

cv::Vec3f to_cv(const Eigen::Vector3d& v) {
  return {static_cast<float>(v.x()), static_cast<float>(v.y()), static_cast<float>(v.z())};
}

// Casts the ray through a pixel's centre; the result is in the camera frame, and point.z() is the depth.
std::optional<Hit> look(const Surface& surface, const Pinhole& camera, const Pose& world_from_camera, int row,
                        int col) {
  const Eigen::Vector3d ray = camera.undistort({col, row}).homogeneous();
  const auto hit = surface(world_from_camera.translation, world_from_camera.rotation * ray);
  if (!hit) return std::nullopt;
  Hit seen = *hit;
  seen.point = hit->distance * ray;
  seen.normal = world_from_camera.rotation.transpose() * hit->normal;
  if (seen.normal.dot(ray) > 0) seen.normal = -seen.normal;
  return seen;
}

template <class Use>
void for_each_hit(const Surface& surface, const RigModel& rig, const Pose& world_from_camera, const Use& use) {
  for (int row = 0; row < rig.camera.height; ++row) {
    for (int col = 0; col < rig.camera.width; ++col) {
      if (const auto hit = look(surface, rig.camera, world_from_camera, row, col)) use(row, col, *hit);
    }
  }
}

}  // namespace

Surface plane(const Eigen::Vector3d& normal, double offset) {
  return [normal, offset](const Eigen::Vector3d& origin, const Eigen::Vector3d& direction) -> std::optional<Hit> {
    const double distance = (offset - normal.dot(origin)) / normal.dot(direction);
    if (!(distance > 0) || !std::isfinite(distance)) return std::nullopt;
    return Hit{distance, origin + distance * direction, normal.normalized()};
  };
}

Surface nearest_of(std::vector<Surface> surfaces) {
  return [surfaces = std::move(surfaces)](const Eigen::Vector3d& origin, const Eigen::Vector3d& direction) {
    std::optional<Hit> best;
    for (const Surface& surface : surfaces) {
      const auto hit = surface(origin, direction);
      if (hit && (!best || hit->distance < best->distance)) best = hit;
    }
    return best;
  };
}

Surface corner(const Eigen::Vector3d& tip) {
  std::vector<Surface> faces;
  for (int i = 0; i < 3; ++i) {
    const double angle = 0.3 + 2 * std::numbers::pi * i / 3;  // no face aligned with a pixel axis
    const Eigen::Vector3d normal =
        Eigen::Vector3d(std::sqrt(2.0) * std::cos(angle), std::sqrt(2.0) * std::sin(angle), -1).normalized();
    faces.push_back(plane(normal, normal.dot(tip)));
  }
  return nearest_of(faces);
}

Surface bumps(double depth, double height, double period) {
  const double k = 2 * std::numbers::pi / period;
  return [=](const Eigen::Vector3d& origin, const Eigen::Vector3d& direction) -> std::optional<Hit> {
    double distance = (depth - origin.z()) / direction.z();
    Eigen::Vector3d gradient;
    for (int i = 0; i < 30; ++i) {  // Newton on z - f(x, y) along the ray
      const Eigen::Vector3d p = origin + distance * direction;
      const double a = k * p.x(), b = k * (p.y() + 0.3 * p.x());
      const double fx = height * k * (std::cos(a) * std::sin(b) + 0.3 * std::sin(a) * std::cos(b));
      const double fy = height * k * std::sin(a) * std::cos(b);
      gradient = {-fx, -fy, 1};
      distance -= (p.z() - depth - height * std::sin(a) * std::sin(b)) / gradient.dot(direction);
    }
    return Hit{distance, origin + distance * direction, gradient.normalized()};
  };
}

RigModel small_rig(bool distorted) {
  RigModel rig;
  rig.camera = {133, 125, 511.5, 511.5, 66, 62, {}};
  rig.projector = {1024, 768, 2600, 2600, 511.5, 383.5, {}};
  if (distorted) {
    rig.camera.distortion = {-0.12, 0.1, 0.0003, -0.0002, 0};
    rig.projector.distortion = {0.05, -0.03, 0.0004, -0.0003, 0.01};
  }
  // 250 mm to the right of the camera, rotated inwards so that the axes meet at 1 m.
  const double turn = std::atan(0.25);
  rig.projector_from_camera.rotation = rotation_exp({0, turn, 0});
  rig.projector_from_camera.translation = rig.projector_from_camera.rotation * Eigen::Vector3d(-0.25, 0, 0);
  return rig;
}

Frame observe(const Surface& surface, const RigModel& rig, const Pose& world_from_camera, double sigma_m,
              Random* noise) {
  const cv::Size size(rig.camera.width, rig.camera.height);
  Frame frame;
  frame.texture = cv::Mat1b(size, uchar{128});
  frame.depth_image = cv::Mat1b(size, uchar{0});
  frame.points_m = cv::Mat3f(size, cv::Vec3f::all(kNaN));
  frame.normals = cv::Mat3f(size, cv::Vec3f::all(kNaN));
  frame.sigma_m = cv::Mat1f(size, kNaN);
  for_each_hit(surface, rig, world_from_camera, [&](int row, int col, const Hit& hit) {
    const double z = hit.point.z() + (noise ? sigma_m * noise->normal() : 0);
    frame.points_m(row, col) = to_cv(hit.point * (z / hit.point.z()));
    frame.normals(row, col) = to_cv(hit.normal);
    frame.sigma_m(row, col) = static_cast<float>(sigma_m);
  });
  return frame;
}

void print_texture(Frame& frame, const Pose& world_from_camera) {
  frame.texture.create(frame.points_m.size());
  for (int row = 0; row < frame.height(); ++row) {
    for (int col = 0; col < frame.width(); ++col) {
      const cv::Vec3f& p = frame.points_m(row, col);
      const Eigen::Vector3d world = world_from_camera * Eigen::Vector3d(p[0], p[1], p[2]);
      double level = 128;
      for (int k = 1; k <= 6; ++k)
        level += 20 * std::sin((60 + 31 * k) * world.x() + 7.0 * k * k) * std::cos((45 + 37 * k) * world.y() + 3.0 * k);
      frame.texture(row, col) = frame.valid(row, col) ? cv::saturate_cast<uchar>(level) : 0;
    }
  }
}

TruthFrame truth_of(const Surface& surface, const RigModel& rig, const Pose& world_from_camera) {
  const cv::Size size(rig.camera.width, rig.camera.height);
  TruthFrame truth;
  truth.depth_m = cv::Mat1f(size, kNaN);
  truth.normals = cv::Mat3f(size, cv::Vec3f::all(kNaN));
  truth.projector_column = cv::Mat1f(size, kNaN);
  truth.mask = cv::Mat1f(size, 0.0F);
  for_each_hit(surface, rig, world_from_camera, [&](int row, int col, const Hit& hit) {
    truth.depth_m(row, col) = static_cast<float>(hit.point.z());
    truth.normals(row, col) = to_cv(hit.normal);
    const Eigen::Vector2d pixel = rig.projector.project(rig.projector_from_camera * hit.point);
    truth.projector_column(row, col) = static_cast<float>(pixel.x());
    truth.mask(row, col) = static_cast<float>(kTruthSurface | (rig.projector.contains(pixel) ? kTruthInBeam : 0));
  });
  return truth;
}

DecodedStack seen_columns(const Surface& surface, const RigModel& rig, const Pose& world_from_camera, double sigma_px,
                          Random* noise) {
  const cv::Size size(rig.camera.width, rig.camera.height);
  DecodedStack decoded;
  decoded.mean = cv::Mat1f(size, 100.0F);
  decoded.modulation = cv::Mat1f(size, 80.0F);
  decoded.coordinate_px = cv::Mat1f(size, kNaN);
  decoded.sigma_px = cv::Mat1f(size, kNaN);
  decoded.finest_period_px = 16;
  for_each_hit(surface, rig, world_from_camera, [&](int row, int col, const Hit& hit) {
    const double column = rig.projector.project(rig.projector_from_camera * hit.point).x();
    decoded.coordinate_px(row, col) = static_cast<float>(column + (noise ? sigma_px * noise->normal() : 0));
    decoded.sigma_px(row, col) = static_cast<float>(sigma_px);
  });
  return decoded;
}

}  // namespace fringeslam::support
