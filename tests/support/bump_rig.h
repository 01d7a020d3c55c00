// SPDX-License-Identifier: Apache-2.0
// A rig that observes an analytic scene suitable for mapping, without a renderer.
#pragma once

#include <cmath>
#include <optional>

#include "core/rig/rig.h"
#include "tests/support/fringes.h"
#include "tests/support/scene.h"

namespace fringeslam::support {

// Smooth random texture with a grid spacing of 15 mm and values between 0.5 and 1.
inline double stains(const Eigen::Vector3d& world) {
  const auto level = [](double i, double j) {
    const double scattered = std::sin(12.9898 * i + 78.233 * j) * 43758.5453;
    return 0.5 + 0.5 * (scattered - std::floor(scattered));
  };
  const double x = world.x() / 0.015, y = world.y() / 0.015, i = std::floor(x), j = std::floor(y);
  const double u = x - i, v = y - j;
  return (1 - v) * ((1 - u) * level(i, j) + u * level(i + 1, j)) +
         v * ((1 - u) * level(i, j + 1) + u * level(i + 1, j + 1));
}

// Views of textured bumps from a robot that moves by 8 mm and 0.5 degrees between views.
class BumpRig : public Rig {
 public:
  explicit BumpRig(int views) : views_(views) {}
  const RigModel& model() const override { return rig_; }
  std::optional<FringeStack> capture(const PatternSequence& patterns) override {
    if (next_ == views_) return std::nullopt;
    const Surface surface = bumps(1, 0.03, 0.12);
    const Pose world_from_robot{rotation_exp({0, 0.0087 * next_, 0}), {0.008 * next_, 0, 0}};
    const Pose world_from_camera = world_from_robot * rig_.robot_from_camera;
    Random noise(static_cast<uint64_t>(next_) + 1);
    cv::Mat1d columns;
    seen_columns(surface, rig_, world_from_camera, 0).coordinate_px.convertTo(columns, CV_64F);
    FringeStack stack = fringe_stack(columns, patterns, {}, CV_32FC1, rig_.sensor, &noise);
    const Frame view = observe(surface, rig_, world_from_camera, 0);
    for (cv::Mat& image : stack.images) {
      cv::Mat1f grey = image;
      for (int row = 0; row < grey.rows; ++row) {
        for (int col = 0; col < grey.cols; ++col) {
          const cv::Vec3f p = view.points_m(row, col);
          grey(row, col) *= static_cast<float>(stains(world_from_camera * Eigen::Vector3d(p[0], p[1], p[2])));
        }
      }
    }
    stack.index = next_;
    stack.timestamp_s = next_ / 30.0;
    stack.exposure_time_s = exposure_times_s(stack.timestamp_s, stack.images.size(), rig_.timing);
    ++next_;
    return stack;
  }

 private:
  RigModel rig_ = small_rig(false);
  int views_, next_ = 0;
};

}  // namespace fringeslam::support
