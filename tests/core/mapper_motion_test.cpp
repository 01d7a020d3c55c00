// SPDX-License-Identifier: Apache-2.0
// Tests that the mapper uses the motion that a view's own stack shows. Views have depth noise; their motions are made up.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "core/mapper/pipeline.h"
#include "core/score/score.h"
#include "tests/support/scene.h"

namespace fringeslam {
namespace {

// A speed along the axis changes all depths alike.
std::vector<DepthSlope> slopes_by_axial_speed(const ReconstructedView& view, int stride, double depth_by_speed_s) {
  std::vector<DepthSlope> slopes;
  for (int row = 0; row < view.frame.height(); row += stride) {
    for (int col = 0; col < view.frame.width(); col += stride) {
      DepthSlope slope{row, col, Vector12d::Zero()};
      slope.by_motion[5] = depth_by_speed_s;
      slopes.push_back(slope);
    }
  }
  return slopes;
}

class MapperInMotion : public testing::Test {
 protected:
  ReconstructedView seen_from(const Pose& world_from_camera, double time_s) {
    ReconstructedView view;
    view.frame = support::observe(surface_, rig_, world_from_camera, 1e-4, &noise_);
    support::print_texture(view.frame, world_from_camera);
    view.frame.timestamp_s = time_s;
    return view;
  }

  const RigModel rig_ = support::small_rig(true);
  const support::Surface surface_ = support::bumps(1, 0.03, 0.2);
  support::Random noise_{5};
  Mapper mapper_{rig_, PipelineOptions{}.mapper(), {}};
};

// A view unwrapped by the map is reconstructed twice. The first time, its stack shows a motion that may be none.
TEST_F(MapperInMotion, AnUndecidedMotionStaysInTheCovariance) {
  constexpr double kDepthBySpeed_s = 0.05, kSpeedSigma_m_s = 0.01;
  // Only a view that was followed shows how certain predictions are.
  FrameResult last;
  for (int i = 0; i < 4; ++i) {
    MapperInput input{0.1 * i, seen_from({}, 0.1 * i)};
    last = mapper_.process(std::move(input));
    ASSERT_TRUE(has_pose(last.tracking)) << i;
  }
  ASSERT_EQ(last.tracking, Tracking::followed);
  StackMotion undecided;
  undecided.covariance.diagonal()[5] = kSpeedSigma_m_s * kSpeedSigma_m_s;
  undecided.residuals = 1000;
  undecided.rms_sigma = 2;  // residuals of vibration
  undecided.converged = true;
  int calls = 0;
  MapperInput input;
  input.timestamp_s = 0.4;
  input.needs_prior = true;
  input.reconstruct = [&](const ReconstructionPrior& prior) {
    EXPECT_TRUE(prior.expected);
    ReconstructedView view = seen_from({}, 0.4);
    view.complete = false;
    if (calls++ == 0) view.undecided_motion = undecided;
    return view;
  };
  input.depth_slopes = [&](const ReconstructedView& view, int stride) {
    return slopes_by_axial_speed(view, stride, kDepthBySpeed_s);
  };
  const FrameResult result = mapper_.process(std::move(input));
  ASSERT_EQ(result.tracking, Tracking::followed);
  EXPECT_EQ(calls, 2);
  ASSERT_TRUE(result.undecided_motion);
  const double sigma_m = kDepthBySpeed_s * kSpeedSigma_m_s;
  EXPECT_NEAR(std::sqrt(result.covariance(5, 5)), sigma_m, 0.3 * sigma_m);
}

// A motion that did not converge says nothing about where the robot went.
TEST_F(MapperInMotion, AnUnknownMotionDoesNotMoveThePrediction) {
  constexpr double kInterval_s = 0.1;
  const Eigen::Vector3d velocity_m_s(0.2, 0, 0);
  StackMotion moving;
  moving.motion.velocity_m_s = velocity_m_s;
  moving.covariance = 1e-6 * Matrix12d::Identity();
  moving.residuals = 1000;
  moving.rms_sigma = 1;
  moving.converged = true;
  StackMotion unknown = moving;
  unknown.motion.velocity_m_s = {-1, 0, 0};
  unknown.converged = false;
  constexpr int kViews = 4;
  bool predicted = false;
  for (int i = 0; i < kViews; ++i) {
    const double time_s = kInterval_s * i;
    const Pose pose{Eigen::Matrix3d::Identity(), time_s * velocity_m_s};
    const ReconstructedView view = seen_from(pose, time_s);
    MapperInput input;
    input.timestamp_s = time_s;
    input.reconstruct = [&, i, pose, view](const ReconstructionPrior& prior) {
      ReconstructedView result = view;
      result.motion = i + 1 == kViews && !prior.expected ? unknown : moving;
      if (prior.expected && i + 1 == kViews && !std::exchange(predicted, true)) {
        std::vector<double> errors_m;
        const cv::Mat1f truth_m = support::truth_of(surface_, rig_, pose).depth_m;
        for (int row = 0; row < truth_m.rows; ++row) {
          for (int col = 0; col < truth_m.cols; ++col) {
            const double error_m = std::abs(static_cast<double>(prior.expected->depth_m(row, col) - truth_m(row, col)));
            if (!std::isnan(error_m)) errors_m.push_back(error_m);
          }
        }
        EXPECT_GT(errors_m.size(), truth_m.total() / 2);
        EXPECT_LT(median_of(errors_m), 2e-3);
      }
      return result;
    };
    const FrameResult result = mapper_.process(std::move(input));
    ASSERT_TRUE(has_pose(result.tracking)) << i;
  }
  EXPECT_TRUE(predicted) << "the view is unwrapped by the map";
}

// A view found by its landmarks is registered again with its motion as an unknown. Without enough pixels for that, repeating the
// registration from its own result would confirm nothing.
TEST_F(MapperInMotion, ARelocalizedViewNeedsAJointEstimate) {
  constexpr double kDepthBySpeed_s = 1e-3;
  StackMotion moving;
  moving.motion.velocity_m_s = {0.1, 0, 0};
  moving.covariance = 1e-8 * Matrix12d::Identity();
  moving.residuals = 1000;
  moving.rms_sigma = 1;
  moving.converged = true;
  for (const bool enough : {true, false}) {
    Mapper mapper(rig_, PipelineOptions{}.mapper(), {});
    MapperInput first{0, seen_from({}, 0)};
    ASSERT_EQ(mapper.process(std::move(first)).tracking, Tracking::first);
    // Only one view was tracked before, so that nothing is predicted.
    const Pose pose{rotation_exp({0, 0, 0.1}), {0.05, 0.02, 0}};
    ReconstructedView view = seen_from(pose, 1);
    view.motion = moving;
    MapperInput input;
    input.timestamp_s = 1;
    input.reconstruct = [&](const ReconstructionPrior&) { return view; };
    input.depth_slopes = [&](const ReconstructedView& of, int stride) {
      std::vector<DepthSlope> slopes = slopes_by_axial_speed(of, stride, kDepthBySpeed_s);
      if (!enough) slopes.resize(std::min<size_t>(slopes.size(), 50));
      return slopes;
    };
    const FrameResult result = mapper.process(std::move(input));
    EXPECT_EQ(result.tracking, enough ? Tracking::refined : Tracking::lost);
  }
}

}  // namespace
}  // namespace fringeslam
