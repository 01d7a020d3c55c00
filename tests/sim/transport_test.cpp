// SPDX-License-Identifier: Apache-2.0
// Light transport between surfaces and through air, compared with closed-form solutions.
#include <gtest/gtest.h>

#include <Eigen/Geometry>

#include "sim/light/air.h"
#include "sim/light/gloss.h"
#include "sim/random.h"
#include "sim/virtual_rig.h"
#include "tests/sim/test_scenes.h"

namespace fringeslam::sim {
namespace {

double mean(const cv::Mat1f& image) { return cv::mean(image)[0]; }
double at_centre(const cv::Mat1f& image) { return static_cast<double>(image(image.rows / 2, image.cols / 2)); }

Effects with_paths(bool Effects::*effect, int paths = 16) {
  Effects effects = only(effect);
  effects.bounce_paths = paths;
  return effects;
}

// In a closed room with albedo and emission 1/2, W = 1/2 + 1/4 + ... = 1 everywhere; with n bounces, 1/2^(n+1) is
// missing. All paths carry the same light, so there is no noise.
TEST(Furnace, AlbedoAHalfAndEmissionAHalfMakeOne) {
  Scene scene = world_of({grey_object(box_mesh({2, 3, 2.5}), Pose{}, 0.5),
                          grey_object(sphere_mesh(0.2, 2), pose_from({{100, 50, 700}, {0, 0, 0}}), 0.5)},
                         coaxial_rig());
  for (Object& object : scene.objects) object.material.emission_lux = 0.5;
  for (const int bounces : {0, 1, 2, 5, 24}) {
    scene.bounces = bounces;
    const cv::Mat1f image = lux_of(scene, {constant_pattern(0)}, 1, with_paths(&Effects::interreflection, 2))[0];
    double low = 0, high = 0;
    cv::minMaxLoc(image, &low, &high);
    EXPECT_NEAR(low, 1 - std::pow(0.5, bounces + 1), 1e-5) << bounces;
    EXPECT_NEAR(high, 1 - std::pow(0.5, bounces + 1), 1e-5) << bounces;
  }
}

// Form factor from a small patch to a parallel rectangle of 2a x 2b, centred above it at the distance 1.
double form_factor(double a, double b) {
  const double p = std::sqrt(1 + a * a), q = std::sqrt(1 + b * b);
  return 2 / kPi * (a / p * std::atan(b / p) + b / q * std::atan(a / q));
}

// The camera is between two facing planes and looks at one; the other emits light.
Scene facing_planes(double half_x, double half_y, double gap) {
  Scene scene = world_of({grey_object(plane_mesh(20, 20), pose_from({{0, 0, 1e3 * 0.4 * gap}, {0, 0, 0}}), 0.8),
                          grey_object(plane_mesh(2 * half_x * gap, 2 * half_y * gap),
                                      pose_from({{0, 0, -1e3 * 0.6 * gap}, {0, 0, 0}}), 0)},
                         coaxial_rig());
  scene.rig.camera = {5, 5, 4000, 4000, 2, 2, {}};  // images a small patch
  scene.objects[1].material.emission_lux = 1000;
  scene.bounces = 1;
  return scene;
}

TEST(Interreflection, OfTwoFacingPlanesIsTheFormFactor) {
  for (const auto& [a, b] : {std::pair{0.3, 0.3}, {1.0, 1.0}, {2.0, 0.5}}) {
    const double truth = 0.8 * 1000 * form_factor(a, b);
    const double image = mean(
        lux_of(facing_planes(a, b, 0.7), {constant_pattern(0)}, 1, with_paths(&Effects::interreflection, 4096))[0]);
    EXPECT_NEAR(image, truth, 0.01 * truth) << a << " x " << b;
  }
}

// Each path carries the light of all patterns: three fringes shifted by 120 degrees add up to 3/2 of white.
TEST(Interreflection, PathsCarryAllPatternsAlike) {
  RigModel rig = coaxial_rig();
  rig.projector_from_camera.translation = {-0.2, 0, 0};
  Scene scene = world_of({grey_object(box_mesh({1.6, 1.2, 2}), Pose{}, 0.7)}, rig);
  scene.bounces = 3;
  std::vector<Pattern> patterns = {constant_pattern(1)};
  for (const double shift : {-2 * kPi / 3, 0.0, 2 * kPi / 3}) patterns.push_back({Axis::columns, 24, shift, 0});
  const auto images = lux_of(scene, patterns, 4, with_paths(&Effects::interreflection));
  const auto direct = lux_of(scene, patterns, 4);
  EXPECT_GT(mean(images[0]), 1.02 * mean(direct[0]));
  for (int row = 0; row < images[0].rows; row += 5) {
    for (int col = 0; col < images[0].cols; col += 5) {
      const float sum = images[1](row, col) + images[2](row, col) + images[3](row, col);
      ASSERT_NEAR(sum, 1.5f * images[0](row, col), 1e-4f * sum) << row << ' ' << col;
    }
  }
}

TEST(Interreflection, MorePathsAreLessNoiseAboutTheSameMean) {
  const Scene scene = facing_planes(0.5, 0.5, 1);
  const double truth = 800 * form_factor(0.5, 0.5);
  double spread[2];
  for (const int many : {0, 1}) {
    double squares = 0;
    const Effects effects = with_paths(&Effects::interreflection, many ? 1024 : 16);
    const cv::Mat1f image = lux_of(scene, {constant_pattern(0)}, 1, effects)[0];
    for (const float value : image) squares += std::pow(static_cast<double>(value) - truth, 2) / 25;
    spread[many] = std::sqrt(squares);
  }
  EXPECT_LT(spread[1], spread[0] / 4);
}

// Returns the path noise relative to the camera noise, from the difference of two stacks taken at the same pose.
double noise_of_paths(Scene scene, bool share) {
  scene.trajectory.assign(2, TimedPose{});
  RenderOptions options{4, false, false, Effects::none()};
  options.effects.interreflection = options.effects.air = true;
  options.effects.share_paths = share;
  options.effects.bounce_paths = 8;
  VirtualRig rig(scene, options);
  const PatternSequence sequence{129, 97, {{Axis::columns, 16, 0, 8}}};
  const cv::Mat1f a = rig.capture(sequence)->images[0], b = rig.capture(sequence)->images[0];
  double squares = 0, variance = 0;
  for (int i = 0; i < a.rows * a.cols; ++i) {
    squares += std::pow(static_cast<double>(a(i) - b(i)), 2) / 2;
    variance += scene.rig.sensor.variance_dn2(static_cast<double>(a(i)));
  }
  return std::sqrt(squares / variance);
}

TEST(Interreflection, SharedPathsLeaveTheCameraTheGreaterNoise) {
  RigModel rig = coaxial_rig();
  rig.near_m = 0.5, rig.far_m = 2;
  rig.projector_from_camera.translation = {-0.2, 0, 0};
  rig.projector_lens.flux_lm *= 0.5;
  Scene scene = world_of({grey_object(plane_mesh(4, 4), pose_from({{0, 0, 1000}, {0, 30, 0}}), 0.6),
                          grey_object(box_mesh({0.12, 0.1, 0.3}), pose_from({{50, 20, 900}, {20, 10, 0}}), 0.5)},
                         rig);
  scene.rig.sensor.gain_dn_per_electron = 0.003;
  scene.bounces = 2;
  EXPECT_LT(noise_of_paths(scene, true), 0.6);
  EXPECT_GT(noise_of_paths(scene, false), 2 * noise_of_paths(scene, true));
  scene.bounces = 0;
  scene.air = {0.3, 0.9, 0.5};
  EXPECT_LT(noise_of_paths(scene, true), 0.6);
  EXPECT_GT(noise_of_paths(scene, false), 2 * noise_of_paths(scene, true));
}

// Smoothing preserves the mean light over a room.
TEST(Interreflection, SharingKeepsTheMean) {
  RigModel rig = coaxial_rig();
  rig.projector_from_camera.translation = {-0.2, 0, 0};
  Scene scene = world_of({grey_object(box_mesh({1.6, 1.2, 2}), Pose{}, 0.7),
                          grey_object(sphere_mesh(0.15, 4), pose_from({{100, 50, 800}, {0, 0, 0}}), 0.4)},
                         rig);
  scene.bounces = 3;
  scene.air = {0.2, 0.9, 0.4};
  Effects effects = Effects::none();
  effects.interreflection = effects.air = true;
  effects.bounce_paths = 256;
  const std::vector<Pattern> patterns = {constant_pattern(1), constant_pattern(0)};
  const auto plain = lux_of(scene, patterns, 4, effects);
  effects.share_paths = true;
  const auto shared = lux_of(scene, patterns, 4, effects);
  EXPECT_NEAR(mean(shared[0]), mean(plain[0]), 2e-3 * mean(plain[0]));
  EXPECT_GT(cv::countNonZero(shared[0] != plain[0]), 1000);
}

// Returns the image of boards of albedo 0.6 and 0 alone in uniform light; expects sharing to change nothing: each pixel is as
// bright as the share that the white covers, also where that is a part.
cv::Mat1f light_that_sharing_keeps(const std::vector<Object>& boards) {
  Scene scene = world_of(boards, coaxial_rig());
  scene.ambient_lux = 500;
  scene.bounces = 2;
  Effects effects = with_paths(&Effects::interreflection, 4);
  const cv::Mat1f plain = lux_of(scene, {constant_pattern(0)}, 16, effects)[0];
  effects.share_paths = true;
  const cv::Mat1f shared = lux_of(scene, {constant_pattern(0)}, 16, effects)[0];
  EXPECT_LT(cv::norm(shared, plain, cv::NORM_INF), 1e-3);
  EXPECT_GT(cv::countNonZero((plain > 1) & (plain < 299)), 50);
  return plain;
}

TEST(Interreflection, SharingKeepsTheLightOfSilhouettes) {
  const cv::Mat1f image =
      light_that_sharing_keeps({grey_object(plane_mesh(0.3, 0.2), pose_from({{0, 0, 1000}, {0, 0, 17}}), 0.6)});
  EXPECT_NEAR(at_centre(image), 500 * 0.6, 1e-3);
}

// White print beside black ink, of which a pixel sees parts.
TEST(Interreflection, SharingKeepsTheLightBesideBlackSurfaces) {
  std::vector<Object> boards = {grey_object(plane_mesh(1, 1), pose_from({{0, 0, 1000}, {0, 0, 17}}), 0)};
  for (int i = -8; i <= 8; ++i)
    boards.push_back(grey_object(plane_mesh(0.012, 0.6), pose_from({{30.0 * i, 0, 999.99}, {0, 0, 17}}), 0.6));
  light_that_sharing_keeps(boards);
}

// --- air ---

TEST(Air, ABoardFadesByBeerAndLambert) {
  RigModel rig = coaxial_rig();
  Scene scene = world_of({grey_object(plane_mesh(8, 8), pose_from({{0, 0, 1200}, {0, 0, 0}}), 0.6)}, rig);
  scene.ambient_lux = 100;
  const double clear = at_centre(lux_of(scene, {constant_pattern(1)})[0]);
  scene.air = {0.7, 0, 0};  // absorbs without scattering
  EXPECT_NEAR(at_centre(lux_of(scene, {constant_pattern(1)}, 1, with_paths(&Effects::air))[0]),
              (clear - 60) * std::exp(-2 * 0.7 * 1.2) + 60 * std::exp(-0.7 * 1.2), 1e-5 * clear);
  EXPECT_NEAR(at_centre(lux_of(scene, {constant_pattern(1)})[0]), clear, 1e-6);  // the effect can be disabled
}

// Haze through which hardly a photon passes: its transmission underflows in single precision.
TEST(Air, DenseHazeHidesInterreflection) {
  Scene scene = world_of({grey_object(box_mesh({3, 3, 3}), Pose{}, 0.7)}, coaxial_rig());
  scene.bounces = 2;
  scene.ambient_lux = 300;
  scene.air = {100, 0.5, 0};
  Effects effects = with_paths(&Effects::air);
  effects.interreflection = effects.share_paths = true;
  const cv::Mat1f image = lux_of(scene, {constant_pattern(0)}, 4, effects)[0];
  double least = 0, most = 0;
  cv::minMaxLoc(image, &least, &most);
  EXPECT_TRUE(cv::checkRange(image));
  EXPECT_NEAR(least, 300 * 0.5, 0.1);
  EXPECT_NEAR(most, 300 * 0.5, 0.1);
}

TEST(Air, PhaseFunctionIsNormalisedAndHasItsMeanCosine) {
  for (const double g : {-0.6, 0.0, 0.5, 0.9}) {
    constexpr int kSteps = 200000;
    double total = 0, cosine = 0;
    for (int i = 0; i < kSteps; ++i) {
      const double c = -1 + 2 * (i + 0.5) / kSteps, density = 2 * kPi * henyey_greenstein(g, c) * 2 / kSteps;
      total += density, cosine += density * c;
    }
    EXPECT_NEAR(total, 1, 1e-6);
    EXPECT_NEAR(cosine, g, 1e-6);
  }
}

// Backscatter of the beam into a camera beside the projector, compared with the integral along the ray.
TEST(Air, BackscatterIsTheIntegralAlongTheRay) {
  RigModel rig = coaxial_rig();
  rig.projector = {2001, 1501, 400, 400, 1000, 750, {}};
  rig.projector_from_camera.translation = {-0.3, 0, 0};
  set_lux_at_1m(rig, kWhiteLux);
  Scene scene = world_of({grey_object(plane_mesh(8, 8), pose_from({{0, 0, 1500}, {0, 0, 0}}), 0)}, rig);
  scene.air = {0.4, 0.8, 0.3};
  double truth = 0;
  constexpr int kSteps = 20000;
  for (int i = 0; i < kSteps; ++i) {
    const double z = 1.5 * (i + 0.5) / kSteps, r = std::hypot(z, 0.3);
    if (0.3 / z > 1000.5 / 400) continue;  // out of the beam
    // Light arrives from (0.3, 0, 0): the cosine of the scattering angle towards the camera is -z / r.
    truth += kPi * 0.8 * 0.4 * henyey_greenstein(0.3, -z / r) * kWhiteLux / (r * r) * std::exp(-0.4 * (z + r)) * 1.5 /
             kSteps;
  }
  double sum = 0;
  const cv::Mat1f image = lux_of(scene, {constant_pattern(1)}, 256, with_paths(&Effects::air))[0];
  for (int k = -2; k <= 2; ++k) sum += static_cast<double>(image(24 + k, 32)) / 5;
  EXPECT_NEAR(sum, truth, 0.01 * truth);
}

TEST(Air, AmbientLightMakesAVeil) {
  Scene scene = world_of({grey_object(plane_mesh(8, 8), pose_from({{0, 0, 2000}, {0, 0, 0}}), 0)}, coaxial_rig());
  scene.ambient_lux = 300;
  scene.air = {0.5, 0.9, 0};
  EXPECT_NEAR(at_centre(lux_of(scene, {constant_pattern(0)}, 1, with_paths(&Effects::air))[0]),
              300 * 0.9 * (1 - std::exp(-1.0)), 0.01);
}

// --- gloss ---

Eigen::Vector3d direction(double theta, double phi) {
  return {std::sin(theta) * std::cos(phi), std::sin(theta) * std::sin(phi), std::cos(theta)};
}

TEST(Gloss, IsReciprocal) {
  Philox random(1, Stream::shape, 1);
  for (int i = 0; i < 200; ++i) {
    const Reflection surface{random.uniform(), random.uniform(), random.uniform(0.01, 1)};
    const Eigen::Vector3d a = direction(random.uniform(0, 1.5), random.uniform(0, 6)),
                          b = direction(random.uniform(0, 1.5), random.uniform(0, 6));
    EXPECT_NEAR(reflected(surface, Eigen::Vector3d::UnitZ(), a, b), reflected(surface, Eigen::Vector3d::UnitZ(), b, a),
                1e-9);
  }
}

TEST(Gloss, WithoutReflectanceIsLambertian) {
  EXPECT_EQ(reflected({0.4, 0, 0.2}, Eigen::Vector3d::UnitZ(), direction(0.3, 1), direction(1.2, 4)), 0.4);
  EXPECT_EQ(reflected({0.4, 0.04, 0.2}, Eigen::Vector3d::UnitZ(), direction(1.8, 1), direction(1.2, 4)), 0);
}

// Total reflected light by importance sampling and by integration over the hemisphere; it never exceeds the incident
// light.
TEST(Gloss, DrawnDirectionsCarryTheIntegralOfTheLobes) {
  for (const Reflection& surface : {Reflection{0.5, 0.04, 0.3}, Reflection{0, 0.8, 0.09}, Reflection{0.2, 0.5, 0.6}}) {
    for (const double view_angle : {0.1, 0.8, 1.3}) {
      const Eigen::Vector3d viewer = direction(view_angle, 0.4), normal = Eigen::Vector3d::UnitZ();
      double integral = 0;
      constexpr int kTheta = 600, kPhi = 1200;
      for (int i = 0; i < kTheta; ++i) {
        const double theta = kPi / 2 * (i + 0.5) / kTheta;
        const double area = std::sin(theta) * std::cos(theta) / kPi * (kPi / 2 / kTheta) * (2 * kPi / kPhi);
        for (int k = 0; k < kPhi; ++k)
          integral += reflected(surface, normal, direction(theta, 2 * kPi * k / kPhi), viewer) * area;
      }
      double drawn = 0;
      constexpr int kDraws = 40000;
      const Philox random(3, Stream::paths, 0);
      for (uint32_t i = 0; i < kDraws; ++i) {
        const auto u = random.uniforms(i);
        const BrdfSample ray = scatter(surface, normal, viewer, u[2], u[0], u[1]);
        drawn += ray.weight / kDraws;
      }
      EXPECT_NEAR(drawn, integral, 0.015) << surface.reflectance << ", view at " << view_angle;
      EXPECT_LE(integral, 1.001);
    }
  }
}

// A metal plate reflects the projector light in the mirror direction and little elsewhere.
TEST(Gloss, AMetalShinesWhereItMirrors) {
  Scene scene = world_of({grey_object(plane_mesh(4, 4), pose_from({{0, 0, 1000}, {0, 0, 0}}), 0.8)}, coaxial_rig());
  scene.objects[0].material.metal = true;
  scene.objects[0].material.roughness = 0.3;
  const cv::Mat1f metal = lux_of(scene, {constant_pattern(1)}, 1, with_paths(&Effects::gloss))[0];
  const cv::Mat1f matt = lux_of(scene, {constant_pattern(1)})[0];
  EXPECT_GT(metal(24, 32), 10 * matt(24, 32));
  EXPECT_LT(metal(0, 0) / metal(24, 32), 0.5 * matt(0, 0) / matt(24, 32));
}

}  // namespace
}  // namespace fringeslam::sim
