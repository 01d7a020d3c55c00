// SPDX-License-Identifier: Apache-2.0
#include "core/pipeline/conveyor.h"

#include <gtest/gtest.h>

#include <cmath>

#include "core/rig/rig.h"
#include "core/types/error.h"
#include "tests/support/fringes.h"
#include "tests/support/scene.h"

namespace fringeslam {
namespace {

// Stains of 15 mm, between half and all of the light.
double albedo(const Eigen::Vector3d& world) {
  const auto level = [](double i, double j) {
    const double scattered = std::sin(12.9898 * i + 78.233 * j) * 43758.5453;
    return 0.5 + 0.5 * (scattered - std::floor(scattered));
  };
  const double x = world.x() / 0.015, y = world.y() / 0.015, i = std::floor(x), j = std::floor(y);
  const double u = x - i, v = y - j;
  return (1 - v) * ((1 - u) * level(i, j) + u * level(i + 1, j)) +
         v * ((1 - u) * level(i, j + 1) + u * level(i + 1, j + 1));
}

// Views of stained bumps from a robot that moves by 8 mm and half a degree from one to the next.
class Bumps : public Rig {
 public:
  explicit Bumps(int views) : views_(views) {}
  const RigModel& model() const override { return rig_; }
  std::optional<FringeStack> capture(const PatternSequence& patterns) override {
    if (next_ == views_) return std::nullopt;
    const support::Surface bumps = support::bumps(1, 0.03, 0.12);
    const Pose world_from_robot{rotation_exp({0, 0.0087 * next_, 0}), {0.008 * next_, 0, 0}};
    const Pose world_from_camera = world_from_robot * rig_.robot_from_camera;
    support::Random noise(static_cast<uint64_t>(next_) + 1);
    cv::Mat1d columns;
    support::seen_columns(bumps, rig_, world_from_camera, 0).coordinate_px.convertTo(columns, CV_64F);
    FringeStack stack = support::fringe_stack(columns, patterns, {}, CV_32FC1, rig_.sensor, &noise);
    const Frame view = support::observe(bumps, rig_, world_from_camera, 0);
    for (cv::Mat& image : stack.images) {
      cv::Mat1f grey = image;
      for (int row = 0; row < grey.rows; ++row) {
        for (int col = 0; col < grey.cols; ++col) {
          const cv::Vec3f p = view.points_m(row, col);
          grey(row, col) *= static_cast<float>(albedo(world_from_camera * Eigen::Vector3d(p[0], p[1], p[2])));
        }
      }
    }
    stack.index = next_;
    stack.timestamp_s = next_ / 30.0;
    ++next_;
    return stack;
  }

 private:
  RigModel rig_ = support::small_rig(false);
  int views_, next_ = 0;
};

class Conveyed : public testing::TestWithParam<std::string> {
 protected:
  Conveyed() {
    options_.decode.unwrapping = GetParam();
    // A tenth of the pixels has few keypoints, and coarse sigmas.
    options_.tracking.max_displacement_sigma_m = 5e-3;
    options_.icp.min_overlap = 0.1;
  }
  Pipeline pipeline() const { return Pipeline(Bumps(1).model(), sequence_, options_, {}); }

  static constexpr int kViews = 12;
  const PatternSequence sequence_ = phase_shift_sequence(1024, 768, {1040, 131, 16.5}, 3, Axis::columns, 8);
  PipelineOptions options_;
};

TEST_P(Conveyed, ViewsAreThoseOfOneAtATime) {
  Bumps one_at_a_time(kViews), ahead(kViews);
  Pipeline expected = pipeline(), got = pipeline();
  Conveyor conveyor([&](const PatternSequence& patterns) { return ahead.capture(patterns); }, got);
  int views = 0;
  while (const auto stack = one_at_a_time.capture(expected.next_patterns())) {
    const FrameResult result = expected.process(*stack);
    const auto view = conveyor.next();
    ASSERT_TRUE(view.has_value());
    EXPECT_EQ(view->stack.index, stack->index);
    EXPECT_EQ(view->result.images, result.images);
    EXPECT_EQ(view->result.tracking, result.tracking);
    EXPECT_EQ(view->result.keyframe, result.keyframe);
    EXPECT_EQ(view->result.world_from_robot.translation, result.world_from_robot.translation);
    ++views;
  }
  EXPECT_EQ(views, kViews);
  EXPECT_FALSE(conveyor.next().has_value());
  ASSERT_GT(expected.trajectory().size(), 5u);
  EXPECT_EQ(to_tum(got.trajectory()), to_tum(expected.trajectory()));
  const SurfaceMesh mesh = got.surface().mesh(), same = expected.surface().mesh();
  ASSERT_GT(mesh.vertices.size(), 1000u);
  EXPECT_EQ(mesh.triangles, same.triangles);
}

INSTANTIATE_TEST_SUITE_P(Unwrapping, Conveyed, testing::Values("multifrequency", "predicted"),
                         [](const auto& name) { return name.param; });

class Failing : public Bumps {
 public:
  Failing() : Bumps(100) {}
  std::optional<FringeStack> capture(const PatternSequence& patterns) override {
    if (++taken_ == 4) throw Error("the camera is gone");
    return Bumps::capture(patterns);
  }

 private:
  int taken_ = 0;
};

TEST(Conveyor, ACameraThatIsGoneIsSaidAfterTheViewsBefore) {
  Failing rig;
  const PatternSequence sequence = phase_shift_sequence(1024, 768, {1040, 131, 16.5}, 3, Axis::columns, 8);
  Pipeline pipeline(rig.model(), sequence, {}, {});
  Conveyor conveyor([&](const PatternSequence& patterns) { return rig.capture(patterns); }, pipeline);
  for (int view = 0; view < 3; ++view) EXPECT_EQ(conveyor.next()->stack.index, view);
  EXPECT_THROW(conveyor.next(), Error);
}

}  // namespace
}  // namespace fringeslam
