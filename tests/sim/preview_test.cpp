// SPDX-License-Identifier: Apache-2.0
// The preview shows the region of interest, at the positions predicted by a pinhole projection.
#include "sim/preview.h"

#include <gmock/gmock.h>

#include <Eigen/Geometry>
#include <opencv2/core/utility.hpp>

#include "sim/preview/line_drawing.h"
#include "sim/preview/overview.h"
#include "tests/sim/test_scenes.h"
#include "tests/support/matchers.h"

namespace fringeslam::sim {
namespace {

// Returns a scene whose camera, at a given position, and projector, 0.3 m beside it, look along world x.
Scene scene_at(const Eigen::Vector3d& camera, std::vector<Object> objects) {
  RigModel rig = coaxial_rig();
  rig.near_m = 0.5, rig.far_m = 1.5;
  rig.projector_from_camera.translation = {-0.3, 0, 0};
  Scene scene = world_of(std::move(objects), rig);
  scene.name = "test";
  Pose pose;
  pose.rotation << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  pose.translation = camera;
  scene.trajectory = {{0, pose}, {1, {pose.rotation, camera + Eigen::Vector3d(0.1, 0.2, 0)}}};
  return scene;
}

Object box_at(const Eigen::Vector3d& size, const Eigen::Vector3d& centre, double albedo = 0.5) {
  return grey_object(box_mesh(size), {Eigen::Matrix3d::Identity(), centre}, albedo);
}

// Returns a scene with a wall on a floor in front of the camera.
Scene open_world() {
  return scene_at({0, 0, 0.5}, {grey_object(plane_mesh(8, 8), Pose{}, 0.3), box_at({0.1, 3, 1}, {1.2, 0, 0.5})});
}

// Returns the same scene in a room of 4 x 4 x 2 m with a roof.
Scene closed_room() {
  Scene scene = open_world();
  for (const double side : {-1.0, 1.0}) {
    scene.objects.push_back(box_at({0.1, 4, 2}, {2 * side, 0, 1}));
    scene.objects.push_back(box_at({4, 0.1, 2}, {0, 2 * side, 1}));
  }
  scene.objects.push_back(box_at({4.2, 4.2, 0.1}, {0, 0, 2.05}));
  return scene;
}

constexpr int kWidth = 160, kHeight = 120;

Viewpoint viewpoint_of(const Scene& scene, const RayScene& world) {
  return choose_viewpoint(scene, world, interest_of(scene, world), kWidth, kHeight);
}

// Returns the fraction of the spots visible in the overview: its distance agrees with theirs.
double shown_spots(const Scene& scene) {
  const RayScene world(scene);
  const Interest interest = interest_of(scene, world);
  const Viewpoint view = viewpoint_of(scene, world);
  const Overview overview = render_overview(scene, world, view);
  int shown = 0;
  for (const Interest::Spot& spot : interest.spots) {
    const Eigen::Vector3d in_view = view.world_from_camera.inverse() * spot.point;
    const Eigen::Vector2d pixel = view.camera.project(in_view);
    const auto seen = static_cast<double>(
        overview.distance_m(static_cast<int>(std::lround(pixel.y())), static_cast<int>(std::lround(pixel.x()))));
    shown += std::abs(seen - in_view.norm()) < 0.1;
  }
  return shown / static_cast<double>(interest.spots.size());
}

TEST(Preview, TheObjectsFillThePicture) {
  for (const Scene& scene : {open_world(), closed_room()}) {
    const RayScene world(scene);
    const Viewpoint view = viewpoint_of(scene, world);
    Eigen::Vector2d low(kWidth, kHeight), high(0, 0);
    for (const Eigen::Vector3d& point : interest_of(scene, world).points()) {
      const Eigen::Vector3d in_view = view.world_from_camera.inverse() * point;
      ASSERT_GT(in_view.z(), 0);
      const Eigen::Vector2d pixel = view.camera.project(in_view);
      EXPECT_TRUE(view.camera.contains(pixel)) << pixel.transpose();
      low = low.cwiseMin(pixel), high = high.cwiseMax(pixel);
    }
    EXPECT_GT(std::max((high - low).x() / kWidth, (high - low).y() / kHeight), 0.8);
  }
}

TEST(Preview, IsTakenFromAboveWhereThatShowsMost) {
  const Scene scene = open_world();
  const RayScene world(scene);
  const Viewpoint view = viewpoint_of(scene, world);
  EXPECT_FALSE(view.window);
  EXPECT_GT(view.world_from_camera.translation.z(), 1);
  EXPECT_GT(shown_spots(scene), 0.9);
}

TEST(Preview, WallsAndRoofAreOpened) {
  const Scene scene = closed_room();
  const RayScene world(scene);
  EXPECT_TRUE(viewpoint_of(scene, world).window);
  EXPECT_GT(shown_spots(scene), 0.8);
}

TEST(Preview, SurfacesUnderAnUpwardCameraAreSeenFromBelow) {
  Scene scene = scene_at({0, 0, 0}, {grey_object(plane_mesh(2, 2), {Eigen::Matrix3d::Identity(), {0, 0, 1}})});
  scene.trajectory = {TimedPose{}};
  EXPECT_LT(viewpoint_of(scene, RayScene(scene)).world_from_camera.translation.z(), 0.9);
  EXPECT_GT(shown_spots(scene), 0.9);
}

TEST(Preview, CornersOfAnImageAreSeenAtItsCorners) {
  Pinhole device = coaxial_rig().projector;
  device.distortion = {-0.05, 0.01, 1e-4, -2e-4, 0};
  const auto corners = image_corners(device, 0.8);
  ASSERT_EQ(corners.size(), 4u);
  for (const Eigen::Vector3d& corner : corners) EXPECT_NEAR(corner.z(), 0.8, 1e-12);
  EXPECT_THAT(device.project(corners[0]), support::MatrixNear(Eigen::Vector2d(-0.5, -0.5), 1e-6));
  EXPECT_THAT(device.project(corners[2]),
              support::MatrixNear(Eigen::Vector2d(device.width - 0.5, device.height - 0.5), 1e-6));
}

// Viewpoint at the origin looking along z, with a wall at 2 m in the left half of the image.
class Drawing : public testing::Test {
 protected:
  Drawing() {
    view_.camera = {101, 81, 100, 100, 50, 40, {}};
    distance_m_.colRange(0, 50) = 2.0f;
  }
  cv::Vec3b colour_at(double x, double y) {
    return picture_(static_cast<int>(std::lround(y)), static_cast<int>(std::lround(x)));
  }
  Viewpoint view_;
  cv::Mat1f distance_m_ = cv::Mat1f(81, 101, std::numeric_limits<float>::infinity());
  cv::Mat3b picture_ = cv::Mat3b(81, 101, kPaper);
  const Pen pen_{cv::Scalar(0, 0, 255), 1, 1};
};

TEST_F(Drawing, LinesAreWhereAPinholeSees) {
  LineDrawing drawing(view_, distance_m_);
  const Eigen::Vector3d a(0.1, -0.2, 1), b(0.8, 0.6, 2.5);
  drawing.line(a, b, pen_);
  drawing.paint(picture_);
  for (const double t : {0.0, 0.2, 0.5, 0.8, 1.0}) {
    const Eigen::Vector3d p = a + t * (b - a);
    EXPECT_GT(colour_at(50 + 100 * p.x() / p.z(), 40 + 100 * p.y() / p.z())[2], 120) << t;
  }
  EXPECT_EQ(colour_at(20, 20), kPaper);
}

TEST_F(Drawing, HiddenLinesAreFainter) {
  LineDrawing drawing(view_, distance_m_);
  drawing.line({-1.2, 0, 3}, {1.2, 0, 3}, pen_);      // behind the wall and beside it
  drawing.line({-0.4, 0.2, 1}, {0.4, 0.2, 1}, pen_);  // in front of the wall
  drawing.line({0.1, 0.3, -1}, {0.1, 0.3, 1}, pen_);  // starts behind the viewer
  drawing.paint(picture_);
  EXPECT_GT(colour_at(70, 40)[2], 200);
  EXPECT_LT(colour_at(30, 40)[2], 120);
  EXPECT_GT(colour_at(30, 40)[2], kPaper[2] + 30);
  EXPECT_GT(colour_at(30, 60)[2], 200);
  EXPECT_GT(colour_at(60, 70)[2], 120);
}

TEST(Preview, NothingIsPaper) {
  const Scene scene = scene_at({0, 0, 0}, {box_at({0.1, 0.1, 0.1}, {-50, 0, -50})});
  const RayScene world(scene);
  const Overview overview = render_overview(scene, world, viewpoint_of(scene, world));
  for (const cv::Vec3b& pixel : overview.picture) ASSERT_EQ(pixel, kPaper);
  for (const float distance : overview.distance_m) ASSERT_TRUE(std::isinf(distance));
  const cv::Mat3b picture = preview_picture(scene, {480, 320});
  EXPECT_EQ(picture(310, 470), kPaper);  // in the depth panel
}

TEST(Preview, PalerSurfacesAreBrighter) {
  std::vector<double> means;
  for (const double albedo : {0.2, 0.6}) {
    Scene scene = open_world();
    for (Object& object : scene.objects) object.material.albedo = albedo;
    const RayScene world(scene);
    means.push_back(cv::mean(render_overview(scene, world, viewpoint_of(scene, world)).picture)[1]);
  }
  EXPECT_GT(means[1], 1.4 * means[0]);
}

TEST(Preview, ThreadsDoNotChangeIt) {
  const Scene scene = closed_room();
  cv::setNumThreads(1);
  const cv::Mat3b one = preview_picture(scene, {480, 320});
  cv::setNumThreads(2);
  const cv::Mat3b two = preview_picture(scene, {480, 320});
  cv::setNumThreads(-1);
  EXPECT_EQ(one.size(), cv::Size(480, 320));
  EXPECT_EQ(cv::norm(one, two, cv::NORM_INF), 0);
}

TEST(Preview, ManyViewsAreThinnedOut) {
  EXPECT_THAT(some_views(3, 12), testing::ElementsAre(0, 1, 2));
  EXPECT_THAT(some_views(101, 3), testing::ElementsAre(0, 50, 100));
  EXPECT_THAT(some_views(1, 12), testing::ElementsAre(0));
}

TEST(Preview, TooSmallASizeIsRefused) {
  EXPECT_THAT(support::error_of([] { preview_picture(open_world(), {100, 100}); }), testing::HasSubstr("320x200"));
}

}  // namespace
}  // namespace fringeslam::sim
