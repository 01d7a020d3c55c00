// SPDX-License-Identifier: Apache-2.0
// Poses of single images, the patterns they show, and views from any three of them.
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "core/mapper/front_end.h"
#include "core/mapper/image_tracker.h"
#include "core/mapper/image_trajectory.h"
#include "core/mapper/pipeline.h"
#include "core/mapper/rolling_views.h"
#include "core/types/linear_algebra.h"
#include "sim/virtual_rig.h"
#include "tests/support/matchers.h"

namespace fringeslam::sim {
namespace {

// scenes/loop, seen by a robot that moves at 0.3 m/s, as stacks of the finest fringes.
class MovingImages : public ::testing::Test {
 protected:
  static Scene scene_at(uint64_t seed) {
    SceneLoadOptions reading;
    reading.seed = seed;
    reading.changes = {{"trajectory.continuous.speed_m_s", "0.3"}};
    return load_scene(std::string(FRINGESLAM_SOURCE_DIR) + "/scenes/loop/scene.yaml", reading);
  }
  explicit MovingImages(uint64_t seed = 3)
      : scene(scene_at(seed)),
        finest(finest_patterns(scene.patterns, Axis::columns)),
        rays(pixel_rays(scene.rig.camera)) {
    VirtualRig rig(scene, {});
    for (int i = 0; i < 3; ++i) views.push_back(*rig.simulate(finest));
  }

  Pose camera_at(double time_s) const { return scene.path->at(time_s) * scene.rig.robot_from_camera; }
  // The motion about a time, by finite differences of the true path.
  CameraMotion motion_at(double time_s) const {
    constexpr double kStep_s = 0.01;
    const Pose now = camera_at(time_s);
    const Vector6d before = difference(now.inverse() * camera_at(time_s - kStep_s), {}),
                   after = difference(now.inverse() * camera_at(time_s + kStep_s), {});
    Vector12d motion;
    motion << (after - before) / (2 * kStep_s), (after + before) / (kStep_s * kStep_s);
    return to_motion(motion);
  }

  // Decodes a stack with a motion (the true one by default) and the true fringe orders.
  ReconstructedView decoded(const FringeStack& stack, const cv::Mat1f& truth_m) const {
    return decoded(stack, truth_m, motion_at(stack.timestamp_s));
  }
  ReconstructedView decoded(const FringeStack& stack, const cv::Mat1f& truth_m, const CameraMotion& motion) const {
    const RigModel& rig = scene.rig;
    const CoordinatePrior expected = predict_coordinate(rig, rays, truth_m, cv::Mat1f(truth_m.size(), 2e-3f));
    const AlignedStack aligned =
        align_stack(stack, rig, rays, filled_depth(truth_m, rig.middle_range_m()), motion, rig.sensor.max_dn());
    DecodeOptions options;
    options.unwrapping = Unwrapping::predicted;
    DecodeContext context{Axis::columns, &expected};
    context.aligned = &aligned;
    ReconstructedView view;
    view.decoded = decode(stack, rig, options, context);
    view.frame = reconstruct(view.decoded, rig, rays, {});
    return view;
  }

  // `error` of the motion that the view is decoded with.
  ImageReference reference(const SimulatedView& from, const Vector12d& error = Vector12d::Zero()) const {
    const CameraMotion motion = changed(motion_at(from.stack.timestamp_s), error);
    ReconstructedView view = decoded(from.stack, from.truth.depth_m, motion);
    view.motion = StackMotion{motion, Matrix12d::Zero(), 1, 0, true};
    return image_reference(view, from.stack);
  }

  // A tracker with the first view as its reference.
  ImageTracker tracker() const { return tracker(reference(views[0])); }
  ImageTracker tracker(const ImageReference& first) const {
    const FringeStack& stack = views[0].stack;
    ImageTracker tracker(scene.rig, scene.patterns);
    MotionPrior motion = unknown_motion({});
    motion.motion = motion_at(stack.timestamp_s);
    motion.covariance *= 1e-4;
    tracker.set_reference(first, camera_at(stack.timestamp_s), Matrix6d::Zero(), stack.timestamp_s, motion);
    return tracker;
  }

  Scene scene;
  PatternSequence finest;
  PixelRays rays;
  std::vector<SimulatedView> views;
};

double nees(const Vector6d& error, const Matrix6d& covariance) { return error.dot(solve_symmetric(covariance, error)); }

double median_depth_error_m(const Frame& frame, const cv::Mat1f& truth_m) {
  std::vector<double> errors;
  for (int row = 0; row < frame.height(); ++row) {
    for (int col = 0; col < frame.width(); ++col) {
      const double error = std::abs(static_cast<double>(frame.points_m(row, col)[2] - truth_m(row, col)));
      if (!std::isnan(error)) errors.push_back(error);
    }
  }
  std::nth_element(errors.begin(), errors.begin() + static_cast<std::ptrdiff_t>(errors.size() / 2), errors.end());
  return errors[errors.size() / 2];
}

TEST(ImagePose, IsAsAccurateAsItsCovarianceOverSeeds) {
  class Images : public MovingImages {
   public:
    explicit Images(uint64_t seed) : MovingImages(seed) {}
    void TestBody() override {
      const ImagePoseEstimator estimator(scene.rig, reference(views[0]));
      const Pose reference_pose = camera_at(views[0].stack.timestamp_s);
      for (size_t view = 1; view < views.size(); ++view) {
        for (size_t k = 0; k < finest.patterns.size(); ++k) {
          const FringeStack& stack = views[view].stack;
          const Pose truth = reference_pose.inverse() * camera_at(stack.exposure_time_s[k]);
          // A millimetre and a milliradian away, which is a third of a fringe.
          Vector6d off;
          off << 1e-3, -1e-3, 1e-3, 1e-3, 1e-3, -1e-3;
          const ImagePose found =
              estimator.estimate(stack.images[k], finest.patterns[k], retract(truth, off), Matrix6d::Zero());
          ASSERT_TRUE(found.valid);
          const Vector6d error = difference(found.reference_from_camera, truth);
          EXPECT_LT(error.tail<3>().norm(), 0.3e-3);
          sum += nees(error, found.covariance);
          ++count;
        }
      }
    }
    double sum = 0;
    int count = 0;
  };
  double sum = 0;
  int count = 0;
  for (const uint64_t seed : {3, 4, 5, 6}) {
    Images images(seed);
    images.TestBody();
    sum += images.sum;
    count += images.count;
  }
  ASSERT_EQ(count, 24);
  // Six for six degrees of freedom. Images of one scene share their reference, so that four scenes count: three sigmas
  // of the mean of four chi-squares. The covariance also covers systematic errors, so that it may be too large.
  EXPECT_LT(sum / count, 6 + 3 * std::sqrt(12.0 / 4));
  EXPECT_GT(sum / count, 0.5);
}

// Points whose fringes would move by a multiple of the camera's motion, if their normals were correct.
TEST_F(MovingImages, NormalsAcrossTheLineOfSightDoNotDecideThePose) {
  const ImageReference from = reference(views[0]);
  ImageReference grazing = from;
  grazing.frame.normals = from.frame.normals.clone();
  for (int row = 5; row < grazing.frame.height(); row += 25) {
    for (int col = 5; col < grazing.frame.width(); col += 25) {
      const cv::Vec3f& point = grazing.frame.points_m(row, col);
      if (!(point[2] > 0) || std::isnan(grazing.frame.normals(row, col)[2])) continue;
      const Eigen::Vector3d sight = Eigen::Vector3d(point[0], point[1], point[2]).normalized();
      const Eigen::Vector3d normal = (sight.cross(Eigen::Vector3d::UnitY()).normalized() - 0.01 * sight).normalized();
      for (int k = 0; k < 3; ++k) grazing.frame.normals(row, col)[k] = static_cast<float>(normal[k]);
    }
  }
  const FringeStack& stack = views[1].stack;
  const Pose start = camera_at(views[0].stack.timestamp_s).inverse() * camera_at(stack.exposure_time_s[0]);
  const auto pose = [&](const ImageReference& reference) {
    return ImagePoseEstimator(scene.rig, reference, 1)
        .estimate(stack.images[0], finest.patterns[0], start, Matrix6d::Zero());
  };
  const ImagePose expected = pose(from), found = pose(grazing);
  ASSERT_TRUE(expected.valid && found.valid);
  EXPECT_LT(nees(difference(found.reference_from_camera, expected.reference_from_camera), expected.covariance), 0.2);
}

TEST_F(MovingImages, ThePatternOfAnImageIsRecognised) {
  const ImagePoseEstimator estimator(scene.rig, reference(views[0]));
  const Pose reference_pose = camera_at(views[0].stack.timestamp_s);
  const FringeStack& stack = views[1].stack;
  const Matrix6d information = 1e7 * Matrix6d::Identity();  // 0.3 mm and 0.3 mrad
  for (size_t k = 0; k < stack.images.size(); ++k) {
    const Pose pose = reference_pose.inverse() * camera_at(stack.exposure_time_s[k]);
    const ShownPattern shown = estimator.shown_pattern(stack.images[k], scene.patterns.patterns, pose, information);
    EXPECT_TRUE(shown.explained);
    EXPECT_EQ(scene.patterns.patterns[shown.pattern], finest.patterns[k]);
    EXPECT_FALSE(shown.agrees_with(shown.pattern == 0 ? 1 : 0));
    const ShownPattern wrong =
        estimator.shown_pattern(stack.images[k], {finest.patterns[(k + 1) % 3]}, pose, information);
    EXPECT_FALSE(wrong.explained);
  }
}

TEST_F(MovingImages, DroppedAndRepeatedImagesAreFound) {
  const ImageTracker start = tracker();
  FringeStack stack = views[1].stack;
  EXPECT_EQ(first_inconsistent_image(start, stack), std::nullopt);
  // The second image is missing: those after it move up, and the first of the next stack is the last.
  FringeStack dropped = stack;
  dropped.images[1] = stack.images[2];
  dropped.images[2] = views[2].stack.images[0];
  EXPECT_EQ(first_inconsistent_image(start, dropped), 1u);
  // The projector repeats its first pattern.
  FringeStack repeated = stack;
  repeated.images[1] = stack.images[0];
  EXPECT_EQ(first_inconsistent_image(start, repeated), 1u);
  // A dark image shows no pattern of the sequence.
  FringeStack dark = stack;
  dark.images[2] = cv::Mat::zeros(stack.images[2].size(), stack.images[2].type());
  EXPECT_EQ(first_inconsistent_image(start, dark), 2u);
}

TEST_F(MovingImages, TheTrackerFollowsImagesAndPredictsTheNextView) {
  ImageTracker tracker = this->tracker();
  double sum = 0;
  for (size_t view = 1; view < views.size(); ++view) {
    const FringeStack& stack = views[view].stack;
    for (size_t k = 0; k < stack.images.size(); ++k) {
      const TrackedImage image = tracker.track(stack.images[k], finest.patterns[k], stack.exposure_time_s[k]);
      ASSERT_TRUE(image.tracked);
      EXPECT_TRUE(image.as_expected);
      sum += nees(difference(image.world_from_camera, camera_at(stack.exposure_time_s[k])), image.covariance);
    }
  }
  EXPECT_LT(sum / 6, 16.8);  // 99 % of chi-square with 6 degrees of freedom; the images share their reference
  EXPECT_FALSE(tracker.needs_reference());
  const double next_s = views.back().stack.timestamp_s + 3 / scene.rig.timing.camera_rate_hz;
  const auto prediction = tracker.predict(next_s);
  ASSERT_TRUE(prediction);
  EXPECT_LT(nees(difference(prediction->world_from_camera, camera_at(next_s)), prediction->covariance), 22.5);
  const CameraMotion truth = motion_at(next_s);
  EXPECT_LT((prediction->motion.motion.velocity_m_s - truth.velocity_m_s).norm(), 0.02);
  EXPECT_LT((prediction->motion.motion.angular_rad_s - truth.angular_rad_s).norm(), 0.02);
  EXPECT_FALSE(tracker.predict(next_s + 1));
}

// A correction of the map changes no pose relative to the reference.
TEST_F(MovingImages, AMovedMapMovesTheFilter) {
  const Pose new_from_old{rotation_exp({0.1, -0.2, 0.3}), {0.5, 0.2, -0.1}};
  const Matrix6d turn = rotated_tangent(new_from_old.rotation);
  ImageTracker still = tracker(), moved = tracker();
  const FringeStack& stack = views[1].stack;
  for (size_t k = 0; k < stack.images.size(); ++k) {
    if (k == 1) moved.move(new_from_old);
    const double time_s = stack.exposure_time_s[k];
    const TrackedImage a = still.track(stack.images[k], finest.patterns[k], time_s),
                       b = moved.track(stack.images[k], finest.patterns[k], time_s);
    ASSERT_TRUE(a.tracked && b.tracked);
    if (k == 0) continue;
    const Pose expected = new_from_old * a.world_from_camera;
    EXPECT_LT(translation_m(expected.inverse() * b.world_from_camera), 1e-6) << k;
    EXPECT_LT(rotation_rad(expected.inverse() * b.world_from_camera), 1e-6) << k;
    const Matrix6d covariance = turn * a.covariance * turn.transpose();
    EXPECT_LT((b.covariance - covariance).norm(), 1e-3 * covariance.norm()) << k;
  }
}

// The reference was decoded with a motion that is off by 30 mm/s and 30 mrad/s.
TEST_F(MovingImages, PosesOfViewsCorrectTheErrorThatImagesShare) {
  constexpr double kError = 0.03;
  Vector12d change = Vector12d::Zero();
  change.head<6>().setConstant(kError);
  ImageReference off = reference(views[0], change);
  off.motion_covariance.topLeftCorner<6, 6>().diagonal().setConstant(kError * kError);
  double square[2] = {0, 0}, sum_nees = 0;
  for (const bool compared : {false, true}) {
    ImageTracker tracker = this->tracker(off);
    for (size_t i = 1; i < views.size(); ++i) {
      const FringeStack& stack = views[i].stack;
      for (size_t k = 0; k < stack.images.size(); ++k) {
        const Pose truth = camera_at(stack.exposure_time_s[k]);
        const TrackedImage image = tracker.track(stack.images[k], finest.patterns[k], stack.exposure_time_s[k]);
        ASSERT_TRUE(image.tracked);
        if (compared) tracker.compare(image, truth, 1e-10 * Matrix6d::Identity());
        if (i + 1 < views.size()) continue;
        const Vector6d error = difference(image.world_from_camera, truth);
        square[compared] += error.tail<3>().squaredNorm();
        if (compared) sum_nees += nees(error, image.covariance);
      }
    }
  }
  EXPECT_LT(std::sqrt(square[1]), 0.5 * std::sqrt(square[0]));
  EXPECT_LT(sum_nees / 3, 16.8);
}

// The images of all stacks but the first, a complete one, get poses, and two patterns projected in the wrong order are noticed.
TEST(ImagesOfARun, HavePosesAndShowTheirPatterns) {
  SceneLoadOptions reading;
  reading.changes = {{"trajectory.continuous.speed_m_s", "0.3"}};
  const Scene scene = load_scene(std::string(FRINGESLAM_SOURCE_DIR) + "/scenes/loop/scene.yaml", reading);
  VirtualRig rig(scene, {});
  Pipeline pipeline(rig.model(), scene.patterns, {}, {});
  ImageTrajectory images(rig.model(), scene.patterns);
  constexpr int kStacks = 6;
  Trajectory truth;
  Pose map_from_truth;
  size_t shown = 0, swapped = 0;
  for (int i = 0; i < kStacks; ++i) {
    SimulatedView view = *rig.simulate(pipeline.next_patterns());
    for (const TimedPose& exposure : view.truth.exposures) truth.push_back(exposure);
    const FrameResult result = pipeline.process(view.stack);
    ASSERT_TRUE(has_pose(result.tracking));
    if (i == 0) map_from_truth = result.world_from_robot * view.truth.world_from_robot.inverse();
    FringeStack seen = view.stack;
    if (i == kStacks - 1) {
      ASSERT_GE(seen.images.size(), 3u);
      std::swap(seen.patterns.patterns[0], seen.patterns.patterns[1]);
      swapped = shown;
    }
    shown += seen.images.size();
    images.add(seen, result, pipeline.mapper());
  }
  ASSERT_EQ(images.images().size(), shown);
  for (size_t k = 0; k < shown; ++k) {
    const ImageOfRun& image = images.images()[k];
    EXPECT_EQ(image.tracked, image.stack > 0) << k;
    EXPECT_EQ(image.as_expected, k != swapped && k != swapped + 1) << k;
    EXPECT_EQ(image.shown.has_value(), !image.as_expected) << k;
  }
  const Trajectory poses = images.trajectory(pipeline.mapper());
  ASSERT_EQ(poses.size(), shown - scene.patterns.patterns.size());
  for (const TimedPose& pose : poses) {
    const auto true_pose = std::find_if(truth.begin(), truth.end(), [&](const TimedPose& exposure) {
      return std::abs(exposure.timestamp_s - pose.timestamp_s) < 1e-9;
    });
    ASSERT_NE(true_pose, truth.end());
    const Pose expected = map_from_truth * true_pose->world_from_robot;
    EXPECT_LT(translation_m(expected.inverse() * pose.world_from_robot), 1e-3);
    EXPECT_LT(rotation_rad(expected.inverse() * pose.world_from_robot), 1e-3);
  }
}

// Share of the displacement `moved` that the surface of a frame has made, along its normals, in another frame of the same pixels.
double share_of_movement(const Frame& before, const Pose& moved, const Frame& after) {
  constexpr double kOtherSurface_m = 1e-3;
  double products = 0, squares = 0;
  for (int row = 0; row < before.height(); ++row) {
    for (int col = 0; col < before.width(); ++col) {
      if (!before.valid(row, col) || !after.valid(row, col)) continue;
      const auto vector = [](const cv::Vec3f& v) { return Eigen::Vector3d(v[0], v[1], v[2]); };
      const Eigen::Vector3d normal = vector(after.normals(row, col)), from = vector(before.points_m(row, col));
      const double expected = normal.dot(moved * from - from),
                   made = normal.dot(vector(after.points_m(row, col)) - from);
      if (std::isnan(expected) || std::abs(made) > kOtherSurface_m) continue;
      products += expected * made;
      squares += expected * expected;
    }
  }
  return products / squares;
}

// The first view is reconstructed again when later views determine its motion better. Poses relative to the frame as it was
// move with its surface.
TEST(ImagesOfARun, MoveWithTheFirstFrame) {
  SceneLoadOptions reading;
  reading.changes = {{"trajectory.continuous.speed_m_s", "0.3"}};
  const Scene scene = load_scene(std::string(FRINGESLAM_SOURCE_DIR) + "/scenes/loop/scene.yaml", reading);
  VirtualRig rig(scene, {});
  Pipeline pipeline(rig.model(), scene.patterns, {}, {});
  const Mapper& mapper = pipeline.mapper();
  Frame first;
  for (int i = 0; i < 5; ++i) {
    const FrameResult result = pipeline.process(rig.simulate(pipeline.next_patterns())->stack);
    ASSERT_TRUE(has_pose(result.tracking));
    if (i == 0) {
      first = result.frame;
      EXPECT_THAT(mapper.world_from_frame(0), support::PoseNear(mapper.world_from_camera(0), 0, 1e-15));
    }
  }
  const Pose moved = mapper.world_from_camera(0).inverse() * mapper.world_from_frame(0);
  const double share = share_of_movement(first, moved, mapper.map().keyframe_image(0));
  EXPECT_GT(share, 0.5);
  EXPECT_LT(share, 1.5);
  EXPECT_THAT(mapper.world_from_frame(4), support::PoseNear(mapper.world_from_camera(4), 0, 1e-15));
}

TEST_F(MovingImages, AnyThreeConsecutiveImagesMakeAView) {
  RollingViews rolling(scene.patterns, scene.rig.timing);
  std::vector<FringeStack> stacks;
  for (const SimulatedView& view : views) {
    for (size_t k = 0; k < view.stack.images.size(); ++k) {
      auto stack = rolling.push({view.stack.images[k], view.stack.patterns.patterns[k], view.stack.exposure_s[k],
                                 view.stack.exposure_time_s[k]});
      if (stack) stacks.push_back(std::move(*stack));
    }
  }
  ASSERT_EQ(stacks.size(), 7u);  // nine images

  const double regular_m =
      median_depth_error_m(decoded(views[1].stack, views[1].truth.depth_m).frame, views[1].truth.depth_m);
  for (size_t i = 0; i < stacks.size(); ++i) {
    const FringeStack& stack = stacks[i];
    EXPECT_NO_THROW(check_stack(stack));
    EXPECT_EQ(stack.index, static_cast<int>(i));
    EXPECT_NEAR(stack.timestamp_s, stack.exposure_time_s[1], 1e-9);
    EXPECT_EQ(stack.patterns.patterns[0], finest.patterns[i % 3]);
    if (i % 3 == 0) {
      const SimulatedView& same = views[i / 3];
      EXPECT_EQ(stack.patterns, same.stack.patterns);
      EXPECT_NEAR(stack.timestamp_s, same.stack.timestamp_s, 1e-9);
    }
  }
  // Views in between: their true depth is rendered from the path.
  Scene between = scene;
  between.path.reset();
  for (const size_t i : {1u, 2u}) {
    between.trajectory = {{stacks[i].timestamp_s, scene.path->at(stacks[i].timestamp_s)}};
    const cv::Mat1f truth_m = VirtualRig(between, {}).truth_of(0).depth_m;
    EXPECT_LT(median_depth_error_m(decoded(stacks[i], truth_m).frame, truth_m), 1.2 * regular_m);
  }
}

TEST_F(MovingImages, GapsAndOtherPatternsMakeNoView) {
  RollingViews rolling(scene.patterns, scene.rig.timing);
  const FringeStack& stack = views[0].stack;
  const auto push = [&](const Pattern& pattern, double time_s) {
    return rolling.push({stack.images[0], pattern, stack.exposure_s[0], time_s}).has_value();
  };
  const double interval_s = 1 / scene.rig.timing.camera_rate_hz;
  EXPECT_FALSE(push(finest.patterns[0], 0));
  EXPECT_FALSE(push(finest.patterns[1], interval_s));
  EXPECT_FALSE(push(finest.patterns[2], 3 * interval_s));  // one is missing
  EXPECT_FALSE(push(finest.patterns[0], 4 * interval_s));
  EXPECT_TRUE(push(finest.patterns[1], 5 * interval_s));
  EXPECT_FALSE(push(finest.patterns[1], 6 * interval_s));          // two shifts only
  EXPECT_FALSE(push(scene.patterns.patterns[0], 7 * interval_s));  // coarse fringes
  EXPECT_THROW(RollingViews(scene.patterns, scene.rig.timing, 2), Error);
}

}  // namespace
}  // namespace fringeslam::sim
