// SPDX-License-Identifier: Apache-2.0
#include "core/mapper/driver.h"

#include <gmock/gmock.h>

#include "core/types/error.h"
#include "tests/support/bump_rig.h"
#include "tests/support/matchers.h"

namespace fringeslam {
namespace {

using support::BumpRig;

class Driven : public testing::TestWithParam<Unwrapping> {
 protected:
  Driven() {
    options_.decode.unwrapping = GetParam();
    // A tenth of the pixels has few keypoints, and coarse sigmas.
    options_.tracking.max_displacement_sigma_m = 5e-3;
    options_.icp.min_overlap = 0.1;
  }
  Pipeline pipeline() const { return Pipeline(BumpRig(1).model(), sequence_, options_, {}); }

  static constexpr int kViews = 12;
  const PatternSequence sequence_ = phase_shift_sequence(1024, 768, {1040, 131, 16.5}, 3, Axis::columns, 8);
  PipelineOptions options_;
};

TEST_P(Driven, ResultsEqualThoseOfOneViewAtATime) {
  BumpRig one_at_a_time(kViews), ahead(kViews);
  Pipeline expected = pipeline(), got = pipeline();
  Driver driver(ahead, got);
  int views = 0;
  while (const auto stack = one_at_a_time.capture(expected.next_patterns())) {
    const FrameResult result = expected.process(*stack);
    const auto view = driver.next();
    ASSERT_TRUE(view.has_value());
    EXPECT_EQ(view->stack.index, stack->index);
    EXPECT_EQ(view->result.images, result.images);
    EXPECT_EQ(view->result.tracking, result.tracking);
    EXPECT_EQ(view->result.keyframe, result.keyframe);
    EXPECT_EQ(view->result.world_from_robot.translation, result.world_from_robot.translation);
    ++views;
  }
  EXPECT_EQ(views, kViews);
  EXPECT_FALSE(driver.next().has_value());
  ASSERT_GT(expected.trajectory().size(), 5u);
  EXPECT_EQ(to_tum(got.trajectory()), to_tum(expected.trajectory()));
  const SurfaceMesh mesh = got.surface().mesh(), same = expected.surface().mesh();
  ASSERT_GT(mesh.vertices.size(), 1000u);
  EXPECT_EQ(mesh.triangles, same.triangles);
}

// On one core, later views wait until the pipeline waits for them.
TEST_P(Driven, WorksOnOneCore) {
  const int threads = cv::getNumThreads();
  cv::setNumThreads(1);
  BumpRig one_at_a_time(kViews), ahead(kViews);
  Pipeline expected = pipeline(), got = pipeline();
  while (const auto stack = one_at_a_time.capture(expected.next_patterns())) expected.process(*stack);
  Driver driver(ahead, got);
  while (driver.next()) {
  }
  cv::setNumThreads(threads);
  EXPECT_EQ(to_tum(got.trajectory()), to_tum(expected.trajectory()));
}

INSTANTIATE_TEST_SUITE_P(Unwrapping, Driven, testing::Values(Unwrapping::multifrequency, Unwrapping::predicted),
                         [](const auto& test) { return std::string(to_string(test.param)); });

TEST(Pipeline, RefusesOtherPatterns) {
  BumpRig rig(1);
  const PatternSequence sequence = phase_shift_sequence(1024, 768, {1040, 131, 16.5}, 3, Axis::columns, 8);
  Pipeline pipeline(rig.model(), sequence, {}, {});
  const PatternSequence other = phase_shift_sequence(1024, 768, {1040, 131, 16}, 3, Axis::columns, 8);
  EXPECT_THAT(support::error_of([&] { pipeline.process(*rig.capture(other)); }),
              testing::HasSubstr("its patterns are neither"));
}

class Failing : public BumpRig {
 public:
  Failing() : BumpRig(100) {}
  std::optional<FringeStack> capture(const PatternSequence& patterns) override {
    if (++taken_ == 4) throw Error("the camera is gone");
    return BumpRig::capture(patterns);
  }

 private:
  int taken_ = 0;
};

TEST(Driver, ReportsACameraFailureAfterTheViewsBeforeIt) {
  Failing rig;
  const PatternSequence sequence = phase_shift_sequence(1024, 768, {1040, 131, 16.5}, 3, Axis::columns, 8);
  Pipeline pipeline(rig.model(), sequence, {}, {});
  Driver driver(rig, pipeline);
  for (int view = 0; view < 3; ++view) EXPECT_EQ(driver.next()->stack.index, view);
  EXPECT_THROW(driver.next(), Error);
  EXPECT_FALSE(driver.next().has_value()) << "nothing is captured after a failure";
}

}  // namespace
}  // namespace fringeslam
