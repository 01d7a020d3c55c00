// SPDX-License-Identifier: Apache-2.0
// Light below translucent surfaces, compared with the Hankel transform and the integrals of its profile, and with exact
// radiative transfer.
#include "sim/light/subsurface.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <complex>

#include "bench/accuracy/half_space.h"
#include "core/decode/decode.h"
#include "core/rig/dataset.h"
#include "core/score/truth_files.h"
#include "sim/random.h"
#include "sim/virtual_rig.h"
#include "tests/sim/test_scenes.h"
#include "tests/support/temp_folder.h"

namespace fringeslam::sim {
namespace {

constexpr double kPath_m = 0.0005;

Effects below_surfaces(int paths) {
  Effects effects = Effects::none();
  effects.subsurface = effects.gloss = true;
  effects.subsurface_paths = paths;
  return effects;
}

// A rig whose projector pixels are half a millimetre wide at 1 m; the projector is turned about the point (0, 0, 1) m.
RigModel fine_rig(double turned_deg) {
  RigModel rig = coaxial_rig();
  rig.camera = {32, 24, 2000, 2000, 15.5, 11.5, {}};
  rig.projector = {257, 193, 2000, 2000, 128, 96, {}};
  const Eigen::Matrix3d turn = Eigen::AngleAxisd(turned_deg * kPi / 180, Eigen::Vector3d::UnitY()).toRotationMatrix();
  rig.projector_from_camera = {turn, Eigen::Vector3d::UnitZ() - turn * Eigen::Vector3d::UnitZ()};
  set_lux_at_1m(rig, kWhiteLux);
  return rig;
}

// A translucent slab that faces the camera at 1 m.
Scene slab(double albedo, double turned_deg = 0, double path_m = kPath_m) {
  Scene scene =
      world_of({grey_object(plane_mesh(2, 2), pose_from({{0, 0, 1000}, {0, 0, 0}}), albedo)}, fine_rig(turned_deg));
  scene.objects[0].material.mean_free_path_m = path_m;
  return scene;
}

// Complex amplitude of a fringe in each pixel from three shifted patterns.
cv::Mat_<std::complex<double>> amplitudes(const Scene& scene, double period_px, const Effects& effects) {
  std::vector<Pattern> patterns;
  for (const double shift : {-2 * kPi / 3, 0.0, 2 * kPi / 3}) patterns.push_back({Axis::columns, period_px, shift, 0});
  const auto images = lux_of(scene, patterns, 1, effects);
  cv::Mat_<std::complex<double>> result(images[0].size());
  for (int row = 0; row < result.rows; ++row) {
    for (int col = 0; col < result.cols; ++col) {
      const auto value = [&](size_t i) { return static_cast<double>(images[i](row, col)); };
      result(row, col) = {2 * value(1) - value(0) - value(2), std::sqrt(3) * (value(0) - value(2))};
    }
  }
  return result;
}

// Mean over the pixels of the slab's fringe relative to that of an opaque surface.
std::complex<double> transfer(Scene scene, double period_px, const Effects& effects) {
  const auto below = amplitudes(scene, period_px, effects);
  scene.objects[0].material.mean_free_path_m = 0;
  const auto opaque = amplitudes(scene, period_px, effects);
  std::complex<double> sum = 0;
  for (int row = 0; row < below.rows; ++row) {
    for (int col = 0; col < below.cols; ++col) sum += below(row, col) / opaque(row, col);
  }
  return sum / static_cast<double>(below.total());
}

// Hankel transform of the profile's two terms: 1 / sqrt(1 + (k d)^2) and the same for 3 d. The far term has the phase
// of its shift.
std::complex<double> closed_form(double albedo, double k, double shift_m) {
  const double d = profile_length_m(albedo, kPath_m);
  return 0.25 / std::hypot(1, k * d) + std::polar(0.75 / std::hypot(1, 3 * k * d), k * shift_m);
}

TEST(Profile, RadiiHaveTheDistributionOfTheProfile) {
  Philox random(3, Stream::subsurface, 1);
  constexpr int kCount = 40000;
  const double d = 0.002;
  std::vector<double> radii(kCount);
  for (double& radius : radii) radius = sample_profile(d, random.uniform()).radius_m;
  for (const double r : {0.1 * d, 0.5 * d, d, 3 * d, 10 * d}) {
    const double share = 1 - 0.25 * std::exp(-r / d) - 0.75 * std::exp(-r / (3 * d));
    const auto within = static_cast<double>(std::count_if(radii.begin(), radii.end(), [&](double x) { return x < r; }));
    EXPECT_NEAR(within / kCount, share, 4 * std::sqrt(share * (1 - share) / kCount)) << r;
  }
}

TEST(Profile, LengthIsThatOfChristensenAndBurley) {
  EXPECT_NEAR(profile_length_m(0.8, 1), 1 / 1.05, 1e-12);
  EXPECT_NEAR(profile_length_m(0.3, 2), 2 / (1.55 + 7 * 0.125), 1e-12);
}

TEST(Profile, RefractiveIndexGivesTheReflectance) {
  for (const double index : {1.0, 1.33, 1.5})
    EXPECT_NEAR(refractive_index(std::pow((index - 1) / (index + 1), 2)), index, 1e-12);
}

// Under uniform light, as much leaves each point as on an opaque surface of this albedo: the beam is wide compared with
// the profile. Its light varies by 1e-3 over the profile's width.
TEST(Subsurface, UniformLightIsReflectedByTheAlbedo) {
  for (const double albedo : {0.2, 0.5, 0.9}) {
    for (const double turned_deg : {0.0, 30.0}) {
      Scene scene = slab(albedo, turned_deg);
      const cv::Mat1f below = lux_of(scene, {constant_pattern(1)}, 1, below_surfaces(64))[0];
      scene.objects[0].material.mean_free_path_m = 0;
      const cv::Mat1f opaque = lux_of(scene, {constant_pattern(1)}, 1, below_surfaces(64))[0];
      EXPECT_NEAR(cv::mean(opaque)[0], albedo * kWhiteLux * std::cos(turned_deg * kPi / 180),
                  5e-3 * albedo * kWhiteLux);
      EXPECT_NEAR(cv::mean(below)[0] / cv::mean(opaque)[0], 1, 2e-3) << albedo << ", " << turned_deg;
    }
  }
}

// A small square is lit; the light that leaves the slab anywhere is the light that entered, times the albedo.
TEST(Subsurface, LightIsNeitherGainedNorLost) {
  Scene scene = slab(0.7, 0, 0.001);
  cv::Mat1f spot(scene.rig.projector.height, scene.rig.projector.width, 0.0f);
  spot(cv::Rect(124, 92, 9, 9)) = 1.0f;
  scene.rig.camera = {96, 96, 1000, 1000, 47.5, 47.5, {}};  // sees 48 mm from the spot's centre
  constexpr int kPaths = 512;
  const double light =
      cv::sum(Renderer(scene, below_surfaces(kPaths), 1)
                  .render(ProjectedPatterns(std::vector<cv::Mat1f>{spot}, scene.rig, {}), {Pose{}}, 0)[0])[0];
  // Nine projector pixels of 0.5 mm are 4.5 camera pixels of 1 mm. Each path that hits the square adds the same, and
  // about kPaths * spot_px of all paths do, in pairs.
  const double spot_px = 4.5 * 4.5;
  EXPECT_NEAR(light / (0.7 * kWhiteLux * spot_px), 1, 4 / std::sqrt(kPaths / 2 * spot_px));
}

TEST(Subsurface, FringesLoseTheModulationOfTheHankelTransform) {
  constexpr int kPaths = 64, kPixels = 32 * 24;
  for (const double albedo : {0.4, 0.8}) {
    for (const double period_px : {4.0, 8.0, 16.0, 64.0}) {
      const double k = 2 * kPi / (period_px * 0.5e-3);
      const double expected = closed_form(albedo, k, 0).real();
      // cos(k x) has the variance (1 + M(2 k)) / 2 - M(k)^2, and pairs on opposite sides carry the same.
      const double variance = 0.5 * (1 + closed_form(albedo, 2 * k, 0).real()) - expected * expected;
      const std::complex<double> measured = transfer(slab(albedo), period_px, below_surfaces(kPaths));
      EXPECT_NEAR(measured.real(), expected, 4 * std::sqrt(variance / (kPaths / 2 * kPixels)) + 1e-3)
          << albedo << ", " << period_px;
      EXPECT_NEAR(measured.imag(), 0, 2e-3);
      EXPECT_LT(expected, 0.995);
    }
  }
}

// The projector is turned, and light entering toward it is seen from below the surface: the phase of the far term.
TEST(Subsurface, ObliqueLightShiftsThePhase) {
  const double turned = 30 * kPi / 180, albedo = 0.8;
  for (const double reflectance : {0.0, 0.04}) {
    Scene scene = slab(albedo, 30);
    scene.objects[0].material.reflectance = reflectance;
    scene.objects[0].material.roughness = 1;
    const double shift_m = far_shift_m(albedo, kPath_m) * std::sin(turned) / refractive_index(reflectance);
    for (const double period_px : {16.0, 64.0}) {
      // The period on the slab is that in the beam over the cosine. Columns increase toward the projector, which lies at
      // positive x.
      const double k = 2 * kPi * std::cos(turned) / (period_px * 0.5e-3);
      const std::complex<double> expected = closed_form(albedo, k, shift_m);
      const std::complex<double> measured = transfer(scene, period_px, below_surfaces(64));
      EXPECT_NEAR(std::arg(measured), std::arg(expected), 0.02 * std::arg(expected) + 1e-3)
          << reflectance << ", " << period_px;
    }
  }
}

// The model against exact radiative transfer, for the surfaces and fringes that occur: in modulation and shift.
TEST(Subsurface, AgreesWithRadiativeTransfer) {
  for (const double albedo : {0.3, 0.5, 0.7, 0.8, 0.9}) {
    const bench::HalfSpace space = bench::HalfSpace::of_albedo(albedo);
    for (const auto& [light_deg, view_deg] : {std::pair{14.0, 0.0}, {25.0, 10.0}, {45.0, 0.0}, {40.0, -20.0}}) {
      const auto direction = [](double deg) {
        return Eigen::Vector3d(std::sin(deg * kPi / 180), 0, std::cos(deg * kPi / 180));
      };
      const Eigen::Vector3d light = direction(light_deg), view = direction(view_deg);
      const double plain = std::abs(space.reflected(light, view, {0, 0}));
      for (const double k : {0.05, 0.2, 0.5, 0.8}) {
        const std::complex<double> exact = space.reflected(light, view, {k, 0}) / plain;
        const std::complex<double> model =
            closed_form(albedo, k / kPath_m, far_shift_m(albedo, kPath_m) * (light.x() - view.x()));
        EXPECT_NEAR(std::abs(model) / std::abs(exact), 1, 0.17) << albedo << ", " << light_deg << ", " << k;
        EXPECT_NEAR(std::arg(model) / std::arg(exact), 1, 0.17) << albedo << ", " << light_deg << ", " << k;
      }
    }
  }
}

// Across the edge of a lit half-plane, the light follows the integral of the profile over lines, (2 a / pi) K0(a x) / 2
// for each term of decay a.
TEST(Subsurface, AnEdgeOfLightSpreadsAsTheProfile) {
  const double albedo = 0.6, path_m = 0.002;
  const double d = profile_length_m(albedo, path_m);
  Scene scene = slab(albedo, 0, path_m);
  cv::Mat1f edge(scene.rig.projector.height, scene.rig.projector.width, 0.0f);
  edge.colRange(129, edge.cols) = 1.0f;
  scene.rig.camera = {33, 24, 2000, 2000, 16, 11.5, {}};
  constexpr int kPaths = 256;
  const cv::Mat1f image = Renderer(scene, below_surfaces(kPaths), 1)
                              .render(ProjectedPatterns(std::vector<cv::Mat1f>{edge}, scene.rig, {}), {Pose{}}, 0)[0];
  // Light at a distance x beyond the edge, relative to that far inside.
  const auto beyond = [&](double x) {
    double sum = 0;
    constexpr int kSteps = 4000;
    for (const auto& [share, a] : {std::pair{0.25, 1 / d}, {0.75, 1 / (3 * d)}}) {
      const double step = 20 / a / kSteps;
      for (int i = 0; i < kSteps; ++i)
        sum += share * step * a / kPi * std::cyl_bessel_k(0.0, a * (x + (i + 0.5) * step));
    }
    return sum;
  };
  // The light is interpolated between pixel centres 128 and 129: its edge is at column 128.5.
  for (const int col : {2, 8, 12, 15, 18, 22, 30}) {
    const double x = (16.5 - col) * 0.5e-3, share = x > 0 ? beyond(x) : 1 - beyond(-x);
    const double measured = cv::mean(image.col(col))[0] / (albedo * kWhiteLux);
    EXPECT_NEAR(measured, share, 4 * std::sqrt(share * (1 - share) / (kPaths / 2 * 24)) + 0.004) << col;
  }
}

// Sigma contains the camera's noise alone: that of the paths must add little to it. Two stacks at one pose differ in their
// paths.
TEST(Subsurface, PathsLeaveTheCameraTheGreaterPhaseNoise) {
  Scene scene = load_scene(std::string(FRINGESLAM_SOURCE_DIR) + "/scenes/flat_board/scene.yaml");
  constexpr int kSize = 60;
  crop(scene.rig.camera, kSize);
  scene.trajectory.resize(2, scene.trajectory.front());
  scene.objects[0].world_from_object = pose_from({{0, 0, 1000}, {8, -12, 0}});
  scene.objects[0].material.mean_free_path_m = kPath_m;
  RenderOptions options;
  options.noise = options.quantise = options.effects.fixed_pattern = false;
  VirtualRig rig(scene, options);
  const DecodedStack a = decode(*rig.capture(scene.patterns), scene.rig, {});
  const DecodedStack b = decode(*rig.capture(scene.patterns), scene.rig, {});
  double squares = 0, variance = 0;
  for (int row = 0; row < kSize; ++row) {
    for (int col = 0; col < kSize; ++col) {
      const float apart = a.coordinate_px(row, col) - b.coordinate_px(row, col);
      ASSERT_FALSE(std::isnan(apart));
      squares += static_cast<double>(apart * apart) / 2;
      variance += static_cast<double>(a.sigma_px(row, col) * a.sigma_px(row, col));
    }
  }
  EXPECT_LT(std::sqrt(squares / variance), 0.5);
  EXPECT_GT(squares, 0);
}

TEST(Subsurface, OpaqueObjectsAreNotAffected) {
  Scene scene = slab(0.5, 20);
  scene.objects[0].material.mean_free_path_m = 0;
  const std::vector<Pattern> patterns = {{Axis::columns, 16, 0, 8}};
  Effects off = below_surfaces(64);
  off.subsurface = false;
  const cv::Mat1f opaque = lux_of(scene, patterns, 4, off)[0];
  EXPECT_EQ(cv::norm(lux_of(scene, patterns, 4, below_surfaces(64))[0], opaque, cv::NORM_INF), 0);
  scene.objects[0].material.mean_free_path_m = kPath_m;
  EXPECT_EQ(cv::norm(lux_of(scene, patterns, 4, off)[0], opaque, cv::NORM_INF), 0);
  EXPECT_GT(cv::norm(lux_of(scene, patterns, 4, below_surfaces(64))[0], opaque, cv::NORM_INF), 0.01 * kWhiteLux);
}

// --- share of indirect light ---

TEST(IndirectShare, IsWhatRenderingWithoutItLacks) {
  RigModel rig = coaxial_rig();
  rig.projector_from_camera.translation = {-0.2, 0, 0};
  Scene scene = world_of({grey_object(box_mesh({1.6, 1.2, 2}), Pose{}, 0.7)}, rig);
  scene.ambient_lux = 500;  // is no light of the projector
  std::vector<Pattern> patterns;
  for (const double shift : {-2 * kPi / 3, 0.0, 2 * kPi / 3}) patterns.push_back({Axis::columns, 24, shift, 0});
  const auto light = [&](int bounces, bool share, TruthFrame* truth) {
    scene.bounces = bounces;
    Effects effects = Effects::none();
    effects.interreflection = true;
    effects.share_paths = share;
    return lux_of(scene, patterns, 4, effects, {}, truth);
  };
  for (const bool share : {false, true}) {
    TruthFrame truth;
    light(2, share, &truth);
    scene.ambient_lux = 0;
    const auto dark = light(2, share, nullptr), dark_direct = light(0, share, nullptr);
    scene.ambient_lux = 500;
    int lit = 0;
    for (int row = 0; row < truth.mask.rows; ++row) {
      for (int col = 0; col < truth.mask.cols; ++col) {
        float total = 0, straight = 0;
        for (size_t i = 0; i < 3; ++i) total += dark[i](row, col), straight += dark_direct[i](row, col);
        if (total == 0) {
          ASSERT_TRUE(std::isnan(truth.indirect_share(row, col)));
          continue;
        }
        ASSERT_NEAR(truth.indirect_share(row, col), 1 - straight / total, 1e-4f) << row << ' ' << col;
        lit += straight > 0.5f * total && straight < 0.99f * total;
      }
    }
    EXPECT_GT(lit, 100);
  }
}

TEST(IndirectShare, IsAllDiffuseLightOfATranslucentSurfaceAndNoneOfTheGloss) {
  Scene scene = slab(0.8);
  scene.objects[0].material.reflectance = 0.04;
  TruthFrame truth;
  const double all = cv::mean(lux_of(scene, {constant_pattern(1)}, 1, below_surfaces(32), {}, &truth)[0])[0];
  scene.objects[0].material.albedo = 0;
  const double gloss = cv::mean(lux_of(scene, {constant_pattern(1)}, 1, below_surfaces(32))[0])[0];
  EXPECT_NEAR(cv::mean(truth.indirect_share)[0], 1 - gloss / all, 1e-3);
  EXPECT_GT(gloss, 0.02 * all);
}

// Files of older versions and of scenes without indirect light lack it.
TEST(IndirectShare, IsStoredWithTheTruthIfKnown) {
  const test::TempFolder folder;
  TruthFrame truth;
  for (const double path_m : {kPath_m, 0.0}) {
    Scene scene = slab(0.8, 0, path_m);
    scene.objects[0].material.reflectance = 0.04;
    truth = {};
    lux_of(scene, {constant_pattern(1)}, 1, below_surfaces(32), {}, &truth);
    write_truth(truth, folder.path());
    const TruthFrame read = read_truth_frame(folder / (stack_name(0) + ".exr"));
    EXPECT_EQ(cv::norm(read.depth_m, truth.depth_m, cv::NORM_INF), 0);
    ASSERT_EQ(read.indirect_share.empty(), path_m == 0);
    if (!read.indirect_share.empty()) {
      EXPECT_EQ(cv::norm(read.indirect_share, truth.indirect_share, cv::NORM_INF), 0);
    }
  }
}

TEST(IndirectShare, IsEmptyWithoutIndirectLight) {
  TruthFrame truth;
  Scene scene = slab(0.5, 0, 0);
  lux_of(scene, {constant_pattern(1)}, 1, below_surfaces(32), {}, &truth);
  EXPECT_TRUE(truth.indirect_share.empty());
  EXPECT_FALSE(truth.depth_m.empty());
}

}  // namespace
}  // namespace fringeslam::sim
