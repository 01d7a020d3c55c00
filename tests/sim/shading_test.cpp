// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <opencv2/core.hpp>

#include "tests/sim/test_scenes.h"

namespace fringeslam::sim {
namespace {

constexpr double kAlbedo = 0.6;
constexpr int kCentreRow = 24, kCentreCol = 32;

Scene board(double distance, double tilt_deg, const RigModel& rig) {
  const Pose pose = pose_from({{0, 0, 1e3 * distance}, {0, tilt_deg, 0}});
  return world_of({grey_object(plane_mesh(8, 8), pose, kAlbedo)}, rig);
}

cv::Mat1f lux(Scene scene, const Pattern& pattern, int samples = 1, double ambient = 0) {
  scene.ambient_lux = ambient;
  return lux_of(scene, {pattern}, samples)[0];
}

float centre(const cv::Mat1f& image) { return image(kCentreRow, kCentreCol); }

TEST(Shading, FallsWithTheSquareOfTheDistanceAndTheCosineOfTheTilt) {
  for (const double distance : {0.5, 1.0, 1.4, 3.0}) {
    for (const double tilt_deg : {0.0, 30.0, -60.0, 80.0}) {
      const double truth = kAlbedo * kWhiteLux * std::cos(tilt_deg * kPi / 180) / (distance * distance);
      EXPECT_NEAR(centre(lux(board(distance, tilt_deg, coaxial_rig()), constant_pattern(1))), truth, 1e-6 * truth)
          << distance << " m, " << tilt_deg << " degrees";
    }
  }
}

TEST(Shading, EveryPixelOfABoardObeysTheCosineAndInverseSquareOfItsOwnPoint) {
  // The projector is next to the camera with a parallel axis.
  RigModel rig = coaxial_rig();
  rig.projector = {1025, 769, 200, 200, 512, 384, {}};
  set_lux_at_1m(rig, kWhiteLux);
  rig.projector_from_camera.translation = {-0.25, 0.04, 0.06};
  const Scene scene = board(1.2, 35, rig);
  const cv::Mat1f image = lux(scene, constant_pattern(1));
  const Pose board_pose = scene.objects[0].world_from_object;
  const Eigen::Vector3d normal = -board_pose.rotation.col(2);  // towards the camera
  const Eigen::Vector3d light = rig.projector_from_camera.inverse().translation;
  for (int row = 0; row < image.rows; ++row) {
    for (int col = 0; col < image.cols; ++col) {
      const Eigen::Vector3d ray((col - rig.camera.cx) / rig.camera.fx, (row - rig.camera.cy) / rig.camera.fy, 1);
      const Eigen::Vector3d point = ray * (normal.dot(board_pose.translation) / normal.dot(ray));
      const Eigen::Vector3d to_light = light - point;
      const double truth = kAlbedo * kWhiteLux * normal.dot(to_light) / std::pow(to_light.norm(), 3);
      ASSERT_NEAR(image(row, col), truth, 2e-6 * truth) << row << ' ' << col;
    }
  }
}

TEST(Shading, BlackLevelLeaksThroughDarkPixelsAndLeavesWhiteOnesAlone) {
  RigModel rig = coaxial_rig();
  rig.projector_black_level = 0.05;
  const Scene scene = board(1, 0, rig);
  EXPECT_NEAR(centre(lux(scene, constant_pattern(0))), kAlbedo * kWhiteLux * 0.05, 1e-3);
  EXPECT_NEAR(centre(lux(scene, constant_pattern(1))), kAlbedo * kWhiteLux, 1e-2);
  EXPECT_NEAR(centre(lux(scene, constant_pattern(0.5))), kAlbedo * kWhiteLux * (0.05 + 0.95 * 0.5), 1e-2);
}

TEST(Shading, AmbientLightNeedsNeitherProjectorNorDistance) {
  for (const double distance : {0.5, 2.0}) {
    const Scene scene = board(distance, 50, coaxial_rig());
    EXPECT_NEAR(centre(lux(scene, constant_pattern(0), 1, 700)), kAlbedo * 700, 1e-4);
    const float lit = centre(lux(scene, constant_pattern(1)));
    EXPECT_NEAR(centre(lux(scene, constant_pattern(1), 1, 700)), lit + kAlbedo * 700, 1e-2);
  }
}

TEST(Shading, OutOfTheBeamOnlyAmbientLightIsLeft) {
  // The beam is half as wide as the camera's field of view: columns within 16 px of the centre are lit at any depth.
  RigModel rig = coaxial_rig();
  rig.projector = {33, 97, 200, 200, 16, 48, {}};
  rig.projector_black_level = 0.1;
  const Scene scene = board(1, 0, rig);
  const TruthFrame truth = truth_of(scene);
  const cv::Mat1f image = lux(scene, constant_pattern(1), 1, 700);
  for (int col = 0; col < image.cols; ++col) {
    const bool lit = std::abs(col - kCentreCol) <= 16;
    EXPECT_EQ((static_cast<int>(truth.mask(kCentreRow, col)) & kTruthInBeam) != 0, lit) << col;
    EXPECT_EQ(std::isnan(truth.projector_column(kCentreRow, col)), !lit) << col;
    if (!lit) {
      EXPECT_NEAR(image(kCentreRow, col), kAlbedo * 700, 1e-3) << col;
    }
    if (lit) {
      EXPECT_GT(image(kCentreRow, col), 10000) << col;
    }
  }
}

TEST(Shading, SeesNothingWhereThereIsNothing) {
  const Scene scene = world_of({}, coaxial_rig());
  const TruthFrame truth = truth_of(scene, 4);
  const cv::Mat1f image = lux(scene, constant_pattern(1), 4, 700);
  EXPECT_EQ(cv::countNonZero(image), 0);
  EXPECT_EQ(cv::countNonZero(truth.mask), 0);
  EXPECT_EQ(cv::countNonZero(truth.object_id), 0);
  EXPECT_EQ(cv::countNonZero(truth.depth_m == truth.depth_m), 0);
}

TEST(Shading, ASurfaceThatFacesAwayFromTheLightIsInShadow) {
  // The camera sees the front of the board; the projector is behind it.
  RigModel rig = coaxial_rig();
  rig.projector_from_camera = pose_from({{0, 0, 3000}, {0, 180, 0}});
  const TruthFrame truth = truth_of(board(1, 0, rig));
  EXPECT_EQ(static_cast<int>(truth.mask(kCentreRow, kCentreCol)), kTruthSurface | kTruthInBeam | kTruthInShadow);
  EXPECT_EQ(centre(lux(board(1, 0, rig), constant_pattern(1))), 0);
}

TEST(Shading, ShowsTheFringesWhereTheProjectorPutsThem) {
  // Camera and projector are coaxial: camera column col sees projector column col + 32.
  const RigModel rig = coaxial_rig();
  const Scene scene = board(1, 0, rig);
  for (const int bits : {0, 8}) {
    const Pattern fringes{Axis::columns, 17.5, 0.7, bits};
    const cv::Mat1f white = lux(scene, constant_pattern(1)), image = lux(scene, fringes);
    for (int col = 0; col < image.cols; ++col) {
      const double truth = 0.5 + 0.5 * std::cos(2 * kPi * (col + 32 + 0.5) / 17.5 + 0.7);
      // An 8-bit projector rounds to the nearest level, with an error of at most half a level.
      EXPECT_NEAR(image(kCentreRow, col) / white(kCentreRow, col), truth, bits == 0 ? 2e-5 : 0.5 / 255 + 2e-5) << col;
    }
  }
}

TEST(Shading, FringesAlongRowsCodeTheRow) {
  const Scene scene = board(1, 0, coaxial_rig());
  const cv::Mat1f white = lux(scene, constant_pattern(1));
  const cv::Mat1f image = lux(scene, {Axis::rows, 17.5, 0, 0});
  for (int row = 0; row < image.rows; ++row) {
    const double truth = 0.5 + 0.5 * std::cos(2 * kPi * (row + 24 + 0.5) / 17.5);
    EXPECT_NEAR(image(row, kCentreCol) / white(row, kCentreCol), truth, 2e-5) << row;
  }
}

TEST(Shading, APixelIsTheMeanOfItsSamples) {
  // The samples average the fringe over the pixel; 16 x 16 samples approximate the integral, which reduces the
  // modulation by sin(pi / p) / (pi / p).
  const double period = 5;
  const Scene scene = board(1, 0, coaxial_rig());
  const cv::Mat1f white = lux(scene, constant_pattern(1), 256);
  const cv::Mat1f image = lux(scene, {Axis::columns, period, 0, 0}, 256);
  const double kept = std::sin(kPi / period) / (kPi / period);
  for (int col = 0; col < image.cols; ++col) {
    const double truth = 0.5 + 0.5 * kept * std::cos(2 * kPi * (col + 32 + 0.5) / period);
    EXPECT_NEAR(image(kCentreRow, col) / white(kCentreRow, col), truth, 1e-3) << col;
  }
}

}  // namespace
}  // namespace fringeslam::sim
