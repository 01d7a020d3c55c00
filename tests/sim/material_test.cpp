// SPDX-License-Identifier: Apache-2.0
// Textures, dust, relief, and pixel-exact geometry.
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <opencv2/imgproc.hpp>

#include "core/io/files.h"
#include "sim/light/gloss.h"
#include "sim/virtual_rig.h"
#include "tests/sim/test_scenes.h"
#include "tests/support/image_file.h"
#include "tests/support/temp_folder.h"

namespace fringeslam::sim {
namespace {

// Brightness at the image centre relative to a white board at 1 m under uniform projector light.
double brightness(const Scene& scene, const Effects& effects) {
  return static_cast<double>(lux_of(scene, {constant_pattern(1)}, 1, effects)[0](24, 32)) / kWhiteLux;
}

// A dark board at 1 m whose normal is tilted by `tilt` degrees from the scene's up direction, towards the camera.
Scene tilted_board(double tilt) {
  Scene scene =
      world_of({grey_object(plane_mesh(3, 3), pose_from({{0, 0, 1000}, {180 + tilt, 0, 0}}), 0.1)}, coaxial_rig());
  scene.dust = {1, 0.5, 50, -Eigen::Vector3d::UnitZ()};
  return scene;
}

TEST(Dust, CoversWhatFacesUpAndLeavesWhatIsSteep) {
  const Effects effects = only(&Effects::dust);
  EXPECT_NEAR(brightness(tilted_board(0), effects), 0.5, 1e-3);
  const double steep = std::cos(60 * kPi / 180);
  EXPECT_NEAR(brightness(tilted_board(60), effects), 0.1 * steep, 1e-3 * steep);
  EXPECT_NEAR(brightness(tilted_board(0), Effects::none()), 0.1, 1e-4);
  Scene clean = tilted_board(0);
  clean.objects[0].material.dust = false;
  EXPECT_NEAR(brightness(clean, effects), 0.1, 1e-4);
}

// The mean over many patches, none of which is covered more than completely.
TEST(Dust, CoversTheStatedShareOfLevelSurfaces) {
  constexpr double kBare = 0.1, kDust = 0.5;
  for (const double cover : {0.2, 0.5, 0.75, 0.9}) {
    Scene scene = tilted_board(0);
    scene.dust.cover = cover;
    const auto image = [&](const Effects& effects) { return lux_of(scene, {constant_pattern(1)}, 4, effects)[0]; };
    cv::Mat albedo;
    cv::divide(image(only(&Effects::dust)), image(Effects::none()), albedo, kBare);
    EXPECT_NEAR((cv::mean(albedo)[0] - kBare) / (kDust - kBare), cover, 0.03) << cover;
    double most = 0;
    cv::minMaxLoc(albedo, nullptr, &most);
    EXPECT_LE(most, kDust + 1e-3) << cover;
  }
}

TEST(Dust, TakesTheGlossOffAMetal) {
  Scene scene = tilted_board(0);
  scene.objects[0].material.albedo = 0.8;
  scene.objects[0].material.metal = true;
  Effects effects = only(&Effects::gloss);
  EXPECT_GT(brightness(scene, effects), 2);
  effects.dust = true;
  EXPECT_NEAR(brightness(scene, effects), 0.5, 1e-3);
}

// With no absorption, all light that enters a film leaves it again: at each angle of incidence, the diffuse light outside is
// what the film's surface does not reflect.
TEST(Water, FilmOnAWhiteSurfaceLosesNothing) {
  const double rho = wet_albedo(1);
  for (const double angle_deg : {0.0, 30.0, 60.0, 80.0}) {
    const double in = passed(kWaterReflectance, std::cos(angle_deg * kPi / 180));
    double out = 0;  // the integral of the Lambertian lobe that leaves the film
    constexpr int kSteps = 20000;
    for (int k = 0; k < kSteps; ++k) {
      const double cosine = (k + 0.5) / kSteps;
      out += 2 * cosine * passed(kWaterReflectance, cosine) / kSteps;
    }
    EXPECT_NEAR(rho * in * out, in, 1e-6) << angle_deg;
  }
}

// Saunderson's equation for perpendicular light on a Lambertian surface below an interface; 0.5 becomes 0.36.
TEST(Water, DarkensMattSurfacesByTheClosedForm) {
  Scene scene = world_of({grey_object(plane_mesh(3, 3), pose_from({{0, 0, 1000}, {0, 10, 0}}), 0.5)}, coaxial_rig());
  Effects effects = only(&Effects::water);
  EXPECT_NEAR(brightness(scene, effects), 0.5 * std::cos(10 * kPi / 180), 1e-3);
  scene.water.cover = 1;
  scene.water.up = -Eigen::Vector3d::UnitZ();
  EXPECT_NEAR(brightness(scene, effects), wet_albedo(0.5) * std::cos(10 * kPi / 180), 1e-3);
  // With gloss, light passes the interface twice; the mirror direction is 20 degrees away, beyond a puddle's lobe.
  effects.gloss = true;
  scene.water.puddle_slope_deg = 90;
  const double through = passed(kWaterReflectance, std::cos(10 * kPi / 180));
  EXPECT_NEAR(brightness(scene, effects), wet_albedo(0.5) * through * through * std::cos(10 * kPi / 180), 2e-3);
  EXPECT_NEAR(wet_albedo(0.5), 0.37, 0.01);
  // A metal keeps its albedo.
  scene.objects[0].material.metal = true;
  scene.objects[0].material.roughness = 1;
  Scene dry = scene;
  dry.water.cover = 0;
  scene.water.puddle_slope_deg = 0;
  EXPECT_NEAR(brightness(scene, effects), brightness(dry, effects), 1e-3);
}

TEST(Water, CoversTheStatedShare) {
  for (const double cover : {0.2, 0.6}) {
    Scene scene = world_of({grey_object(plane_mesh(9, 9), pose_from({{0, 0, 1000}, {180, 0, 0}}), 0.5)}, coaxial_rig());
    scene.water.cover = cover;
    scene.water.patch_m = 0.01;
    scene.water.up = -Eigen::Vector3d::UnitZ();
    const cv::Mat1f lux = lux_of(scene, {constant_pattern(1)}, 1, only(&Effects::water))[0];
    const cv::Mat1f dry = lux_of(world_of(scene.objects, coaxial_rig()), {constant_pattern(1)}, 1, Effects::none())[0];
    int wet = 0;
    for (int row = 0; row < lux.rows; ++row) {
      for (int col = 0; col < lux.cols; ++col) wet += lux(row, col) < 0.9f * dry(row, col);
    }
    EXPECT_NEAR(wet / static_cast<double>(lux.total()), cover, 0.05);
    scene.seed = 2;  // other patches
    EXPECT_GT(cv::countNonZero(lux_of(scene, {constant_pattern(1)}, 1, only(&Effects::water))[0] != lux), 0);
  }
}

TEST(Relief, TurnsNormalsAboutTheTrueOne) {
  Scene scene = world_of({grey_object(plane_mesh(3, 3), pose_from({{0, 0, 1000}, {0, 40, 0}}), 0.5)}, coaxial_rig());
  scene.objects[0].material.bump_m = 0.0004;
  scene.objects[0].material.bump_size_m = 0.003;
  const cv::Mat1f flat = lux_of(scene, {constant_pattern(1)}, 16)[0];
  const cv::Mat1f rough = lux_of(scene, {constant_pattern(1)}, 16, only(&Effects::relief))[0];
  cv::Scalar mean, deviation;
  cv::meanStdDev(cv::Mat1f(rough / flat), mean, deviation);
  EXPECT_NEAR(mean[0], 1, 0.03);
  EXPECT_GT(deviation[0], 0.01);
  // Geometry and ground truth are unchanged.
  TruthFrame truth;
  lux_of(scene, {}, 1, only(&Effects::relief), {}, &truth);
  EXPECT_NEAR(truth.depth_m(24, 32), 1, 1e-7);
}

TEST(Texture, IsReadLinearlyAndFiltered) {
  const test::TempFolder temp;
  // Halves of sRGB grey 188 (luminance 0.503) and 0, tile size 0.2 m.
  cv::Mat1b image(64, 64, static_cast<uchar>(188));
  image.colRange(32, 64) = 0;
  write_png(temp / "halves.png", image);
  Scene scene = world_of({grey_object(plane_mesh(2, 2), pose_from({{0, 0, 1000}, {0, 0, 0}}), 1)}, coaxial_rig());
  scene.objects[0].material.texture = (temp / "halves.png").string();
  scene.objects[0].material.texture_m = 0.2;
  const cv::Mat1f lux = lux_of(scene, {constant_pattern(1)})[0];
  double low = 0, high = 0;
  cv::minMaxLoc(lux, &low, &high);
  EXPECT_NEAR(high / kWhiteLux, 0.503, 0.01);
  EXPECT_NEAR(low / kWhiteLux, 0, 0.01);
  // Tiles much smaller than a pixel average out.
  scene.objects[0].material.texture_m = 0.001;
  const cv::Mat1f fine = lux_of(scene, {constant_pattern(1)})[0];
  cv::minMaxLoc(fine(cv::Rect(10, 10, 45, 29)), &low, &high);
  EXPECT_NEAR(high, low, 0.1 * high);
}

TEST(Texture, AlphaDoesNotDarkenColors) {
  const test::TempFolder temp;
  test::write_image(temp / "veil.png", cv::Mat(16, 16, CV_8UC4, cv::Scalar(188, 188, 188, 60)));
  Scene scene = world_of({grey_object(plane_mesh(2, 2), pose_from({{0, 0, 1000}, {0, 0, 0}}), 1)}, coaxial_rig());
  scene.objects[0].material.texture = (temp / "veil.png").string();
  EXPECT_NEAR(lux_of(scene, {constant_pattern(1)})[0](24, 32) / kWhiteLux, 0.503, 0.01);
}

TEST(Texture, ThatIsNoImageIsRefused) {
  const test::TempFolder temp;
  write_text(temp / "words.png", "no image");
  Scene scene = world_of({grey_object(plane_mesh(2, 2), pose_from({{0, 0, 1000}, {0, 0, 0}}), 1)}, coaxial_rig());
  scene.objects[0].material.texture = (temp / "words.png").string();
  EXPECT_THROW(Renderer(scene, Effects::none(), 1), Error);
}

// Compares with the ray-sphere intersection t = d.c - sqrt((d.c)^2 - c.c + r^2), within the sagitta of the facets.
TEST(Geometry, OfASphereIsThatOfTheFormula) {
  constexpr double kRadius = 0.12;
  const Eigen::Vector3d centre(0.01, -0.02, 1);
  const Scene scene =
      world_of({grey_object(sphere_mesh(kRadius, 6), {Eigen::Matrix3d::Identity(), centre}, 0.5)}, coaxial_rig());
  const TruthFrame truth = truth_of(scene);
  const double facet = kRadius * 1.11 / 64;            // edge of an icosahedron subdivided six times
  const double sagitta = facet * facet / 6 / kRadius;  // at the centre of a triangle
  int inside = 0;
  for (int row = 0; row < 49; ++row) {
    for (int col = 0; col < 65; ++col) {
      const Eigen::Vector3d ray = Eigen::Vector3d((col - 32) / 200.0, (row - 24) / 200.0, 1);
      const double along = ray.dot(centre) / ray.squaredNorm();
      const double gap = (along * ray - centre).squaredNorm(), room = kRadius * kRadius - gap;
      if (std::abs(room) < 0.1 * kRadius * kRadius) continue;  // the rim
      EXPECT_EQ(truth.object_id(row, col), room > 0 ? 1 : 0) << row << ' ' << col;
      if (room < 0) continue;
      const double depth = along - std::sqrt(room / ray.squaredNorm());
      const double grazing = std::sqrt(room) / kRadius;
      ASSERT_NEAR(truth.depth_m(row, col), depth, 1.5 * sagitta / grazing) << row << ' ' << col;
      const cv::Vec3f p = truth.position_m(row, col);
      ASSERT_NEAR((Eigen::Vector3f(p[0], p[1], p[2]).cast<double>() - depth * ray).norm(), 0, 2 * sagitta / grazing);
      ++inside;
    }
  }
  EXPECT_GT(inside, 1000);
}

// With all effects enabled, one thread and two threads give identical bytes.
TEST(Renderer, ThreadsDoNotChangeTheLight) {
  RigModel rig = coaxial_rig();
  rig.projector_from_camera.translation = {-0.2, 0, 0};
  rig.projector_lens.aperture_m = 0.02, rig.projector_lens.blur_px = 0.4, rig.projector_lens.pixel_fill = 0.9;
  Scene scene = world_of({grey_object(box_mesh({2, 1.6, 2.4}), Pose{}, 0.6),
                          grey_object(rock_mesh({0.3, 0.2, 0.2}, 4, 0.3, 5), pose_from({{0, 0, 800}, {0, 0, 0}}))},
                         rig);
  scene.objects[0].material.grain = Grain::brick;
  scene.objects[1].material.metal = true;
  scene.objects[1].material.bump_m = 0.0002;
  scene.ambient_lux = 100;
  scene.bounces = 2;
  scene.air = {0.2, 0.9, 0.4};
  scene.dust.cover = 0.5;
  const std::vector<Pattern> patterns = {constant_pattern(1), {Axis::columns, 16, 0, 8}, {Axis::rows, 16, 0, 8}};
  const int before = cv::getNumThreads();
  std::vector<cv::Mat1f> images[2];
  for (const int threads : {1, 2}) {
    cv::setNumThreads(threads);
    images[threads - 1] = lux_of(scene, patterns, 4, Effects{});
  }
  cv::setNumThreads(before);
  for (size_t i = 0; i < patterns.size(); ++i) {
    EXPECT_EQ(cv::countNonZero(images[0][i] != images[1][i]), 0);
    EXPECT_GT(cv::mean(images[0][i])[0], 100);
  }
}

}  // namespace
}  // namespace fringeslam::sim
