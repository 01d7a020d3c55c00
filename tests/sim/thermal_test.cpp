// SPDX-License-Identifier: Apache-2.0
// The simulated thermal camera, compared with closed-form solutions.
#include "sim/light/thermal.h"

#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <functional>
#include <optional>

#include "core/mapper/pipeline.h"
#include "core/mapper/thermal_observer.h"
#include "core/rig/rig_file.h"
#include "core/types/centikelvin.h"
#include "sim/light/infrared.h"
#include "sim/virtual_rig.h"
#include "tests/sim/test_scenes.h"

namespace fringeslam::sim {
namespace {

ThermalCamera plain_camera() {
  ThermalCamera thermal;
  thermal.lens = {33, 25, 60, 60, 16, 12, {}};
  thermal.netd_k = 0;
  thermal.blur_px = 0;
  return thermal;
}

RigModel rig_of(const ThermalCamera& thermal) {
  RigModel rig = coaxial_rig();
  rig.thermal = thermal;
  return rig;
}

// Returns a scene with a wall 1 m in front of the camera that fills its image.
Scene wall(double temperature_c, double emissivity, const ThermalCamera& thermal = plain_camera()) {
  Scene scene = world_of({grey_object(plane_mesh(20, 20), pose_from({{0, 0, 1000}, {0, 0, 0}}))}, rig_of(thermal));
  scene.objects[0].material.temperature_c = temperature_c;
  scene.objects[0].material.emissivity = emissivity;
  return scene;
}

cv::Mat1f image_of(const Scene& scene, const ThermalImaging& imaging = {false, false},
                   const Effects& effects = Effects(), int per_pixel = 4) {
  const RayScene world(scene);
  const Surfaces surfaces(scene, effects);
  return thermal_image(scene, thermal_rays(scene.rig, effects, per_pixel), world, surfaces, effects, {}, 0, imaging);
}

double centre(const cv::Mat1f& image) { return static_cast<double>(image(image.rows / 2, image.cols / 2)); }

// Integrates Planck's law, W / (m^2 sr m), with Simpson's rule.
double planck_integral(double low_m, double high_m, double kelvin) {
  const auto spectral = [&](double wavelength_m) {
    constexpr double kFirst = 1.191042972e-16, kSecond = 0.01438776877;  // 2 h c^2, h c / k
    return kFirst / (std::pow(wavelength_m, 5) * std::expm1(kSecond / (wavelength_m * kelvin)));
  };
  constexpr int kSteps = 2000;
  const double step = (high_m - low_m) / kSteps;
  double sum = spectral(low_m) + spectral(high_m);
  for (int i = 1; i < kSteps; ++i) sum += (i % 2 == 1 ? 4 : 2) * spectral(low_m + i * step);
  return sum * step / 3;
}

TEST(Infrared, RadianceIsPlancksLawIntegrated) {
  for (const double temperature_c : {-100.0, -20.0, 0.0, 20.25, 34.0, 120.0, 700.0, 1500.0}) {
    const double expected = planck_integral(8e-6, 14e-6, temperature_c + 273.15);
    EXPECT_NEAR(black_body_radiance(temperature_c) / expected, 1, 2e-5) << temperature_c;
  }
}

TEST(Infrared, ApparentTemperatureUndoesRadiance) {
  for (double temperature_c = -150; temperature_c < 1500; temperature_c += 13.37)
    EXPECT_NEAR(apparent_temperature_c(black_body_radiance(temperature_c)), temperature_c, 1e-9);
}

TEST(Thermal, BlackBodyReadsItsTemperature) {
  for (const double temperature_c : {-10.0, 20.0, 34.5, 300.0})
    EXPECT_NEAR(centre(image_of(wall(temperature_c, 1))), temperature_c, 1e-4) << temperature_c;
}

TEST(Thermal, SaturatesAtTheEndsOfItsRange) {
  ThermalCamera thermal = plain_camera();
  thermal.coldest_c = 0;
  thermal.hottest_c = 100;
  EXPECT_EQ(centre(image_of(wall(800, 1, thermal))), 100);
  EXPECT_EQ(centre(image_of(wall(-30, 1, thermal))), 0);
}

// Half of the wall's radiance is emitted, half is reflected from the surroundings. For 50 and 10 degrees C and the band
// from 8 to 14 um, this corresponds to a black body at 31.7 (Planck's law integrated and inverted by bisection).
TEST(Thermal, GreyBodyMixesInTheSurroundings) {
  Scene scene = wall(50, 0.5);
  scene.surroundings_c = 10;
  const double radiance =
      0.5 * planck_integral(8e-6, 14e-6, 50 + 273.15) + 0.5 * planck_integral(8e-6, 14e-6, 10 + 273.15);
  double low = 10, high = 50;
  while (high - low > 1e-9) {
    const double middle = (low + high) / 2;
    (planck_integral(8e-6, 14e-6, middle + 273.15) < radiance ? low : high) = middle;
  }
  EXPECT_NEAR(low, 31.7, 0.1);
  EXPECT_NEAR(centre(image_of(scene)), low, 2e-3);
}

// In thermal equilibrium, emissivity, dust and smoke have no effect.
TEST(Thermal, FurnaceReadsItsTemperatureEverywhere) {
  Scene scene = wall(37, 0.3);
  scene.objects.push_back(grey_object(sphere_mesh(0.1, 3), pose_from({{0, 0, 700}, {0, 0, 0}})));
  scene.objects[1].material.emissivity = 0.8;
  scene.objects[1].material.temperature_c = 37;
  scene.surroundings_c = 37;
  scene.dust.cover = 0.5;
  scene.dust.up = -Eigen::Vector3d::UnitZ();
  scene.air.extinction_per_m = 3;
  for (const float t : image_of(scene)) EXPECT_NEAR(t, 37, 1e-4);
}

TEST(Thermal, MaterialsWithoutATemperatureHaveThatOfTheSurroundings) {
  Scene scene = wall(0, 0.7);
  scene.objects[0].material.temperature_c.reset();
  scene.surroundings_c = -4;
  EXPECT_NEAR(centre(image_of(scene)), -4, 1e-4);
  scene.objects[0].material.warmer_k = 3;
  scene.objects[0].material.emissivity = 1;
  EXPECT_NEAR(centre(image_of(scene)), -1, 1e-4);
}

TEST(Thermal, SmokeTakesItsShareOverTheDistance) {
  Scene scene = wall(60, 1);
  scene.surroundings_c = 20;
  scene.air.extinction_per_m = 2;
  scene.air.infrared_share = 0.25;
  const double left = std::exp(-0.5);  // transmission over 1 m
  const double expected = apparent_temperature_c(left * black_body_radiance(60) + (1 - left) * black_body_radiance(20));
  EXPECT_NEAR(centre(image_of(scene, {false, false}, {}, 1)), expected, 1e-4);
  Effects clear;
  clear.air = false;
  EXPECT_NEAR(centre(image_of(scene, {false, false}, clear, 1)), 60, 1e-4);
}

// With cover 1, surfaces facing up are completely covered (sim/light/surfaces.cpp): only the dust is visible.
TEST(Thermal, DustIsBetweenTheSurfaceAndTheSurroundings) {
  Scene scene = wall(40, 1);
  scene.surroundings_c = 10;
  scene.dust = {1, 0.35, 60, -Eigen::Vector3d::UnitZ(), 0.6};
  const double dust_c = 10 + 0.6 * 30;
  const double expected = apparent_temperature_c(0.95 * black_body_radiance(dust_c) + 0.05 * black_body_radiance(10));
  EXPECT_NEAR(centre(image_of(scene)), expected, 1e-3);
}

TEST(Thermal, NearThingsHideFarOnes) {
  Scene scene = wall(20, 1);
  scene.objects.push_back(grey_object(plane_mesh(0.2, 0.2), pose_from({{0, 0, 500}, {0, 0, 0}})));
  scene.objects[1].material.temperature_c = 35;
  scene.objects[1].material.emissivity = 1;
  const cv::Mat1f image = image_of(scene);
  EXPECT_NEAR(centre(image), 35, 1e-4);
  EXPECT_NEAR(image(0, 0), 20, 1e-4);
  // The plate is 0.2 m wide at 0.5 m: 24 px, from column 4 to 28, centred at 16.
  EXPECT_NEAR(image(12, 16 - 11), 35, 1e-4);
  EXPECT_NEAR(image(12, 16 - 13), 20, 1e-4);
  const float edge = image(12, 4);  // the plate covers half of this pixel
  EXPECT_GT(edge, 25);
  EXPECT_LT(edge, 30);
}

TEST(Thermal, LooksFromWhereItStands) {
  ThermalCamera thermal = plain_camera();
  thermal.thermal_from_camera.translation = {0.3, 0, 0};  // 300 mm to the left
  Scene scene = wall(20, 1, thermal);
  scene.objects.push_back(grey_object(plane_mesh(0.1, 0.1), pose_from({{-300, 0, 900}, {0, 0, 0}})));
  scene.objects[1].material.temperature_c = 35;
  scene.objects[1].material.emissivity = 1;
  EXPECT_NEAR(centre(image_of(scene)), 35, 1e-4);
}

// The NETD is the noise for a black body at 300 K; the noise is larger for a colder one, whose radiance varies less
// with temperature.
TEST(Thermal, NoiseIsTheNetd) {
  ThermalCamera thermal = plain_camera();
  thermal.lens = {160, 120, 100, 100, 79.5, 59.5, {}};
  thermal.netd_k = 0.05;
  const auto spread = [&](double temperature_c) {
    cv::Scalar mean, deviation;
    cv::meanStdDev(image_of(wall(temperature_c, 1, thermal), {true, false}, {}, 1), mean, deviation);
    EXPECT_NEAR(mean[0], temperature_c, 0.002);
    return deviation[0];
  };
  EXPECT_NEAR(spread(300 - 273.15), 0.05, 0.0015);  // 19200 pixels: the tolerance is about 6 sigma
  const auto slope = [](double t) { return black_body_radiance(t + 1) - black_body_radiance(t - 1); };
  EXPECT_NEAR(spread(-20), 0.05 * slope(26.85) / slope(-20), 0.0025);
}

TEST(Thermal, QuantisedTemperaturesAreHundredthsOfAKelvin) {
  const cv::Mat1f image = image_of(wall(31.23456, 1), {false, true}, {}, 1);
  for (const float t : image) EXPECT_EQ(t, celsius(centikelvin(static_cast<double>(t))));
  EXPECT_NEAR(centre(image), 31.23456, 0.005 + 1e-5);
}

TEST(Thermal, BytesDoNotDependOnTheNumberOfThreads) {
  ThermalCamera thermal = plain_camera();
  thermal.netd_k = 0.05;
  thermal.blur_px = 0.6;
  const Scene scene = wall(30, 0.9, thermal);
  const int threads = cv::getNumThreads();
  cv::setNumThreads(1);
  const cv::Mat1f one = image_of(scene, {});
  cv::setNumThreads(4);
  const cv::Mat1f four = image_of(scene, {});
  cv::setNumThreads(threads);
  EXPECT_EQ(cv::countNonZero(one != four), 0);
}

// A plate 100 mm wide at half the distance to the wall occludes x = -0.1 to 0.1 m of the wall for the camera, and 0.1
// to 0.3 m for the thermal camera, 0.2 m to the left.
TEST(Thermal, TruthKnowsWhatTheThermalCameraSees) {
  ThermalCamera thermal = plain_camera();
  thermal.lens.fx = thermal.lens.fy = 20;
  thermal.thermal_from_camera.translation = {0.2, 0, 0};
  Scene scene = wall(20, 1, thermal);
  scene.objects.push_back(grey_object(plane_mesh(0.1, 1), pose_from({{0, 0, 500}, {0, 0, 0}})));
  scene.objects[1].material.victim = true;
  const TruthFrame truth = VirtualRig(scene, {}).truth_of(0);
  const auto seen = [&](double x_m, double z_m) {
    const int mask = static_cast<int>(truth.mask(24, static_cast<int>(std::lround(32 + 200 * x_m / z_m))));
    return mask & (kTruthThermal | kTruthVictim);
  };
  EXPECT_EQ(seen(0, 0.5), kTruthThermal | kTruthVictim);
  EXPECT_EQ(seen(0.13, 1), 0);
  EXPECT_EQ(seen(-0.13, 1), kTruthThermal);
}

// Complete pipeline on two views of a floor with a ball at skin temperature, a warm box and a ball that is too hot.
TEST(Thermal, ThePipelineFindsWhatMayBeAVictim) {
  Scene scene;
  scene.rig = read_rig(std::filesystem::path(FRINGESLAM_SOURCE_DIR) / "scenes/rigs/rescue.yaml");
  scene.rig.robot_from_camera = Pose{};
  scene.patterns = phase_shift_sequence(1024, 768, {1040, 131, 16.5}, 3, Axis::columns, 8);
  const auto add = [&](Mesh mesh, const Eigen::Vector3d& at_mm, std::optional<double> temperature_c) {
    scene.objects.push_back(grey_object(std::move(mesh), pose_from({at_mm, {0, 0, 0}})));
    scene.objects.back().material.temperature_c = temperature_c;
    scene.objects.back().material.grain = Grain::stone;
  };
  scene.surroundings_c = 12;
  add(plane_mesh(3, 3), {0, 0, 1100}, std::nullopt);
  add(sphere_mesh(0.06, 4), {-150, 50, 1040}, 33);
  add(box_mesh({0.15, 0.12, 0.08}), {120, -60, 1060}, 35);
  add(sphere_mesh(0.05, 4), {100, 150, 1050}, 80);
  scene.objects[1].material.victim = true;
  scene.trajectory = {TimedPose{0, Pose{}}, TimedPose{1, pose_from({{40, 20, 0}, {0, 0, 2}})}};
  VirtualRig rig(scene, {});
  Pipeline pipeline(rig.model(), scene.patterns, {}, Pose{});
  ThermalObserver observer(rig.model(), {});
  while (const auto stack = rig.capture(scene.patterns)) {
    const FrameResult view = pipeline.process(*stack);
    const ThermalView thermal = observer.observe(*stack, view);
    ASSERT_EQ(thermal.temperature_c.size(), view.frame.points_m.size());
    EXPECT_NEAR(thermal.warm.surroundings_c, 12, 0.1);
    ASSERT_NE(view.tracking, Tracking::lost);
  }
  std::vector<WarmObject> victims = observer.warm_objects(pipeline.mapper());
  EXPECT_EQ(victims.size(), 3u);
  std::erase_if(victims, [](const WarmObject& thing) { return !thing.victim; });
  ASSERT_EQ(victims.size(), 1u);
  // The centre of the visible cap lies on the half of the ball that faces the camera.
  EXPECT_LT((victims[0].position_m - Eigen::Vector3d(-0.15, 0.05, 1.04)).norm(), 0.06);
  EXPECT_EQ(victims[0].views, 2);
  EXPECT_NEAR(victims[0].temperature_c, 33 * 0.95 + 12 * 0.05, 0.7);  // approximate: emissivity 0.95
}

}  // namespace
}  // namespace fringeslam::sim
