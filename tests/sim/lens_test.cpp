// SPDX-License-Identifier: Apache-2.0
// Effects of lenses, projector response and motion on fringes, compared with closed-form solutions.
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <complex>

#include "core/types/camera_pupil.h"
#include "sim/light/camera.h"
#include "sim/virtual_rig.h"
#include "tests/sim/test_scenes.h"

namespace fringeslam::sim {
namespace {

Scene board(const RigModel& rig, double distance = 1) {
  return world_of({grey_object(plane_mesh(8, 8), pose_from({{0, 0, 1e3 * distance}, {0, 0, 0}}), 0.6)}, rig);
}

std::vector<Pattern> three_steps(double period, int bits) {
  std::vector<Pattern> patterns;
  for (const double shift : {-2 * kPi / 3, 0.0, 2 * kPi / 3}) patterns.push_back({Axis::columns, period, shift, bits});
  return patterns;
}

// Returns a complex number whose magnitude is modulation over mean and whose argument is the phase [C eq. 1-3].
std::complex<double> fringe(const std::vector<cv::Mat1f>& i, int row, int col) {
  const double a = i[0](row, col), b = i[1](row, col), c = i[2](row, col);
  return std::complex<double>(2 * b - a - c, std::sqrt(3.0) * (a - c)) / (a + b + c);
}

// --- projector ---

// Blur with sigma from the circle of confusion reduces the modulation of 32 px fringes by exp(-2 pi^2 sigma^2 / p^2);
// for quantised patterns, square pixels reduce it further by sinc(1/p).
TEST(Defocus, KeepsTheModulationOfAGaussian) {
  constexpr double kPeriod = 32;
  RigModel rig = coaxial_rig();
  rig.projector_lens.aperture_m = 0.05;
  rig.projector_lens.focus_m = 1;
  rig.projector_lens.blur_px = 0.5;
  for (const double distance : {0.6, 0.8, 1.0, 1.6, 3.0}) {
    const double circle = 0.05 * 200 * std::abs(1 / distance - 1);
    const double sigma2 = 0.25 + circle * circle / 16;
    const double kept = std::exp(-2 * kPi * kPi * sigma2 / (kPeriod * kPeriod));
    for (const int bits : {0, 16}) {
      const double pixels = bits == 0 ? 1 : std::sin(kPi / kPeriod) / (kPi / kPeriod);
      const auto images = lux_of(board(rig, distance), three_steps(kPeriod, bits), 1, only(&Effects::defocus));
      for (int col = 1; col < 64; col += 7)
        ASSERT_NEAR(std::abs(fringe(images, 24, col)), kept * pixels, 2e-3) << distance << " m, " << bits << " bits";
    }
  }
}

// The staircase of square pixels is also smoothed correctly for sigmas between two tabulated levels: its first spectral
// images have the amplitude (1/p) / (1 -+ 1/p) exp(-2 pi^2 sigma^2 (1 -+ 1/p)^2) relative to the fringe.
TEST(Defocus, SmoothsTheStaircaseOfPixels) {
  constexpr double kPeriod = 16.5;
  RigModel rig = coaxial_rig();
  rig.camera = {65, 49, 3200, 3200, 32, 24, {}};  // sixteen camera pixels per projector pixel
  rig.projector_lens.aperture_m = 0.06;
  for (const double sigma : {0.45, 0.5, 0.63}) {
    // The in-focus blur is smaller: at 1 m, out of focus, sigma lies above the first tabulated level.
    rig.projector_lens.blur_px = 0.4;
    const double circle = 4 * std::sqrt(sigma * sigma - 0.16);
    rig.projector_lens.focus_m = 1 / (1 + circle / (0.06 * 200));
    const auto images = lux_of(board(rig), three_steps(kPeriod, 16), 1, only(&Effects::defocus));
    double left = 0;
    for (const double image : {1 - 1 / kPeriod, 1 + 1 / kPeriod})
      left += 1 / kPeriod / image * std::exp(-2 * kPi * kPi * sigma * sigma * image * image);
    double largest = 0;
    for (int col = 0; col < 65; ++col) {
      const double phase = 2 * kPi * (64 + (col - 32) / 16.0 + 0.5) / kPeriod;
      largest = std::max(largest, std::abs(std::arg(fringe(images, 24, col) * std::polar(1.0, -phase))));
    }
    EXPECT_NEAR(largest, left, 0.25 * left + 3e-4) << sigma;
  }
}

TEST(Defocus, DoesNotMoveTheFringes) {
  RigModel rig = coaxial_rig();
  rig.projector_lens.aperture_m = 0.05;
  rig.projector_lens.blur_px = 0.5;
  const auto sharp = lux_of(board(rig, 1.5), three_steps(24, 16)),
             soft = lux_of(board(rig, 1.5), three_steps(24, 16), 1, only(&Effects::defocus));
  for (int col = 1; col < 64; ++col)
    ASSERT_NEAR(std::arg(fringe(sharp, 24, col) / fringe(soft, 24, col)), 0, 2e-4) << col;
}

// Comb of square pixels with fill factor 0.8, sampled at sixteen camera pixels per projector pixel: its mean is 1 and
// its first harmonic 2 sinc(0.8) exp(-2 pi^2 sigma^2).
TEST(PixelGap, IsACombOfMeanOne) {
  RigModel rig = coaxial_rig();
  rig.camera = {65, 49, 3200, 3200, 32, 24, {}};
  rig.projector_lens.pixel_fill = 0.8;
  rig.projector_lens.blur_px = 0.3;
  Effects effects = Effects::none();
  effects.pixel_gap = effects.defocus = true;
  const cv::Mat1f white = lux_of(board(rig), {constant_pattern(1)})[0];
  const cv::Mat1f gaps = lux_of(board(rig), {constant_pattern(1)}, 1, effects)[0];
  std::complex<double> harmonic = 0;
  double total = 0;
  for (int row = 8; row < 40; ++row) {
    for (int col = 16; col < 48; ++col) {
      const double ratio = static_cast<double>(gaps(row, col) / white(row, col)) / 1024;
      total += ratio;
      harmonic += ratio * std::polar(1.0, 2 * kPi * (col - 32) / 16.0);
    }
  }
  const double amplitude = std::sin(0.8 * kPi) / (0.8 * kPi) * std::exp(-2 * kPi * kPi * 0.09);
  EXPECT_NEAR(total, 1, 2e-3);
  EXPECT_NEAR(harmonic.real(), amplitude, 2e-3);
  EXPECT_NEAR(harmonic.imag(), 0, 2e-3);
}

// The illuminance of a flat screen falls off as cos^n of the off-axis angle.
TEST(Vignetting, OfTheProjectorIsThatOfAFlatScreen) {
  RigModel rig = coaxial_rig();
  rig.projector_lens.vignetting = 6;
  set_lux_at_1m(rig, kWhiteLux);
  const cv::Mat1f image = lux_of(board(rig), {constant_pattern(1)}, 1, only(&Effects::vignetting))[0];
  for (int col = 0; col < 65; ++col) {
    const double cosine = 1 / std::hypot(1, (col - 32) / 200.0);
    ASSERT_NEAR(image(24, col), 0.6 * kWhiteLux * std::pow(cosine, 6), 0.02) << col;
  }
}

// The flux arriving on a screen is independent of the vignetting exponent.
TEST(Photometry, LumensOfTheProjectorArriveOnTheScreen) {
  for (const double exponent : {0.0, 3.0, 8.0}) {
    RigModel rig = coaxial_rig();
    rig.projector_lens.vignetting = exponent;
    rig.projector_lens.flux_lm = 500;
    rig.camera = {129, 97, 200, 200, 64, 48, {}};
    rig.camera_lens.vignetting = 0;
    Scene scene = board(rig);
    scene.objects[0].material.albedo = 1;
    const cv::Mat1f lux = lux_of(scene, {constant_pattern(1)}, 16, only(&Effects::vignetting))[0];
    EXPECT_NEAR(cv::sum(lux)[0] / (200 * 200), 500, 1) << exponent;  // a pixel covers 5 x 5 mm at 1 m
  }
}

// A gamma response causes the phase error (r4 - r2) sin 3 phi with r_{k+1} = r_k (gamma - k) / (gamma + k + 1).
TEST(Response, OfAGammaBendsThePhaseByItsHarmonics) {
  for (const double gamma : {1.2, 2.2}) {
    RigModel rig = coaxial_rig();
    for (int i = 0; i <= 1024; ++i) rig.projector_response.push_back(std::pow(i / 1024.0, gamma));
    constexpr double kPeriod = 31;
    const auto images = lux_of(board(rig), three_steps(kPeriod, 16));
    double amplitude = 0;
    for (int col = 0; col < 62; ++col) {
      const double phase = 2 * kPi * (col + 32.5) / kPeriod;
      const double error = std::arg(fringe(images, 24, col) * std::polar(1.0, -phase));
      amplitude += error * std::sin(3 * phase) / 31;
    }
    double r = (gamma - 1) / (gamma + 2);
    const double r2 = r;
    for (int k = 2; k < 4; ++k) r *= (gamma - k) / (gamma + k + 1);
    EXPECT_NEAR(amplitude, r - r2, 0.03 * r2) << gamma;
  }
}

// --- camera ---

TEST(CameraLens, PhotonsByHand) {
  RigModel rig;
  rig.camera = {100, 100, 2000, 2000, 49.5, 49.5, {}};
  rig.camera_lens = {10e-6, 8, 1e9, 0.9, 0, 0};
  // Pupil 20 mm / 8 = 2.5 mm; 1 lx gives (0.0025 m)^2 / 4 / 2000^2 * 0.9 = 3.52e-13 lm, at 300 lm/W and 550 nm
  // (3.612e-19 J per photon) 3244 photons per second.
  EXPECT_NEAR(camera_pupil_m(rig), 0.0025, 1e-9);
  EXPECT_NEAR(photons_per_lux_s(rig), 3.515625e-13 / 300 / 3.6117e-19, 1);
}

TEST(CameraLens, DoublingTheExposureDoublesTheElectrons) {
  RigModel rig = coaxial_rig();
  rig.sensor = {12, 0.01, 0, 1e9, 0};
  const Camera camera(rig, Effects::none(), 1, 0);
  const cv::Mat1f rate = camera.electrons_per_s(cv::Mat1f(49, 65, 1000.0f));
  const Exposure exact{false, false};
  const cv::Mat1f once = camera.expose(rate, 0.002, exact), twice = camera.expose(rate, 0.004, exact);
  EXPECT_GT(once(3, 4), 1);
  EXPECT_FLOAT_EQ(twice(3, 4), 2 * once(3, 4));
  EXPECT_NEAR(once(3, 4), 0.01 * 1000 * photons_per_lux_s(rig) * 0.002 * rig.sensor.quantum_efficiency, 1e-3);
}

TEST(CameraLens, VignettingIsCosineToTheFourth) {
  RigModel rig = coaxial_rig();
  rig.camera_lens.vignetting = 4;
  const Camera camera(rig, only(&Effects::vignetting), 1, 0);
  const cv::Mat1f image = camera.electrons_per_s(cv::Mat1f(49, 65, 1.0f));
  EXPECT_NEAR(image(24, 0) / image(24, 32), std::pow(1 + 0.16 * 0.16, -2), 1e-6);
}

TEST(CameraLens, BlurKeepsTheModulationOfAGaussian) {
  for (const double blur_px : {0.2, 0.3, 0.5, 1.5}) {
    RigModel rig = coaxial_rig();
    rig.camera_lens.blur_px = blur_px;
    const Camera camera(rig, only(&Effects::lens_blur), 1, 0);
    cv::Mat1f fringes(49, 65);
    for (int col = 0; col < 65; ++col) fringes.col(col) = 1 + std::cos(2 * kPi * (col - 32) / 16.0);
    const cv::Mat1f image = camera.electrons_per_s(fringes), even = camera.electrons_per_s(cv::Mat1f(49, 65, 1.0f));
    const double kept = std::exp(-2 * kPi * kPi * blur_px * blur_px / 256);
    EXPECT_NEAR(image(24, 32) / even(24, 32), 1 + kept, 2e-4) << blur_px;
    EXPECT_NEAR(image(24, 40) / even(24, 40), 1 - kept, 2e-4) << blur_px;
  }
}

// The image of a line has the variance of the point spread, however narrow.
TEST(CameraLens, BlurHasItsVariance) {
  for (const double blur_px : {0.1, 0.3, 0.5, 0.8, 3.0}) {
    RigModel rig = coaxial_rig();
    rig.camera_lens.blur_px = blur_px;
    cv::Mat1f line(49, 65, 0.0f);
    line.col(32) = 1;
    const cv::Mat1f image = Camera(rig, only(&Effects::lens_blur), 1, 0).electrons_per_s(line);
    double sum = 0, second = 0;
    for (int col = 0; col < 65; ++col) {
      const double light = image(24, col);
      sum += light, second += light * (col - 32) * (col - 32);
    }
    EXPECT_NEAR(second / sum, blur_px * blur_px, 1e-4 * blur_px * blur_px);
  }
}

// Variance of the blur of an edge across an axis, px^2.
double edge_variance_px2(const RigModel& rig, const Eigen::Vector3d& velocity_m_s, int axis, int samples,
                         const Effects& effects) {
  constexpr int kShifts = 32;  // of the edge, so that pixels add the variance of a uniform distribution over one pixel
  double sum = 0, first = 0, second = 0;
  for (int shift = 0; shift < kShifts; ++shift) {
    Scene scene = board(rig);
    const double edge_mm = 1000 * shift / (rig.camera.fx * kShifts) - 2000;
    scene.objects.push_back(grey_object(
        plane_mesh(4, 4), pose_from({{axis == 0 ? edge_mm : 0, axis == 1 ? edge_mm : 0, 999.9}, {0, 0, 0}}), 0));
    scene.ambient_lux = 20000;
    scene.motion.velocity_m_s = velocity_m_s;
    VirtualRig camera(scene, {samples, false, false, effects});
    const FringeStack stack = *camera.capture({129, 97, {constant_pattern(0)}});
    cv::Mat1f image(stack.images[0] - rig.sensor.offset_dn), profile;
    cv::reduce(image, profile, axis == 0 ? 0 : 1, cv::REDUCE_AVG);
    const double edge_px = static_cast<double>(shift) / kShifts;
    for (int i = 1; i < static_cast<int>(profile.total()); ++i) {
      const double rise = profile(i) - profile(i - 1), at = i - edge_px;
      if (std::abs(rise) < 1e-3 * profile(static_cast<int>(profile.total()) - 1)) continue;
      sum += rise, first += rise * at, second += rise * at * at;
    }
  }
  return second / sum - first * first / (sum * sum) - 1 / 12.0;
}

// Narrow blur is in the samples, wide blur partly in the image; an edge has the variance of both.
TEST(CameraLens, BlurOfAnEdgeHasItsVariance) {
  for (const double blur_px : {0.15, 0.3, 0.6, 1.5}) {
    for (const int samples : {4, 16}) {
      RigModel rig = coaxial_rig();
      rig.camera_lens.blur_px = blur_px;
      const double pixel = (1 - 1.0 / (samples * samples)) / 12;
      for (const int axis : {0, 1})
        EXPECT_NEAR(edge_variance_px2(rig, {0, 0, 0}, axis, samples, only(&Effects::lens_blur)),
                    pixel + blur_px * blur_px, 0.03 * (pixel + blur_px * blur_px))
            << blur_px << ' ' << samples << ' ' << axis;
    }
  }
}

// At x px from an edge, a square pixel behind a lens of blur s collects s (L((x - 1/2) / s) - L((x + 1/2) / s)) of the other
// side's light, L(z) = phi(z) - z Q(z): 5.9e-3 at one pixel for s = 0.3.
TEST(CameraLens, BlurDoesNotReachBeyondItsTail) {
  constexpr double kBlur_px = 0.3;
  RigModel rig = coaxial_rig();
  rig.camera_lens.blur_px = kBlur_px;
  const auto tail = [&](double z) {
    return std::exp(-z * z / 2) / std::sqrt(2 * kPi) - z * 0.5 * std::erfc(z / std::sqrt(2.0));
  };
  for (const double x_px : {0.5, 0.75, 1.0, 1.25, 1.5}) {
    Scene scene = board(rig);
    const double edge_mm = 1000 * (x_px - 1) / rig.camera.fx - 2000;  // column 31 is dark, x_px from the edge
    scene.objects.push_back(grey_object(plane_mesh(4, 4), pose_from({{edge_mm, 0, 999.9}, {0, 0, 0}}), 0));
    scene.ambient_lux = 20000;
    VirtualRig camera(scene, {64, false, false, only(&Effects::lens_blur)});
    const cv::Mat1f image((*camera.capture({129, 97, {constant_pattern(0)}})).images[0] - rig.sensor.offset_dn);
    const double share = image(24, 31) / image(24, 60);
    const double expected = kBlur_px * (tail((x_px - 0.5) / kBlur_px) - tail((x_px + 0.5) / kBlur_px));
    EXPECT_NEAR(share, expected, 0.01) << x_px;
  }
}

// The derivative of a defocused bright-dark edge has the variance (c / 4)^2 of a uniform disc of diameter c.
TEST(DepthOfField, BlursByTheCircleOfConfusion) {
  RigModel rig = coaxial_rig();
  rig.camera = {65, 49, 1000, 1000, 32, 24, {}};
  rig.camera_lens.f_number = 0.5;
  rig.camera_lens.focus_m = 1;
  Scene scene = board(rig, 2);
  scene.objects.push_back(grey_object(plane_mesh(4, 4), pose_from({{-2000, 0, 1999.9}, {0, 0, 0}}), 0));
  scene.ambient_lux = 1000;
  const cv::Mat1f image = lux_of(scene, {constant_pattern(0)}, 256, only(&Effects::depth_of_field))[0];
  double mean = 0, variance = 0;
  for (int col = 1; col < 65; ++col) {
    const double step = static_cast<double>(image(24, col) - image(24, col - 1)) / 600;
    mean += step * (col - 0.5);
    variance += step * (col - 0.5) * (col - 0.5);
  }
  variance -= mean * mean;
  const double circle = camera_pupil_m(rig) * 1000 * (1 - 0.5);
  EXPECT_NEAR(mean, 32, 0.05);
  EXPECT_NEAR(std::sqrt(variance - 1.0 / 6), circle / 4, 0.05 * circle / 4);  // pixel and difference: 1/12 each
  // An edge in focus is sharp.
  Scene sharp = board(rig, 1);
  sharp.objects.push_back(grey_object(plane_mesh(4, 4), pose_from({{-2000, 0, 999.9}, {0, 0, 0}}), 0));
  sharp.ambient_lux = 1000;
  const cv::Mat1f edge = lux_of(sharp, {constant_pattern(0)}, 256, only(&Effects::depth_of_field))[0];
  EXPECT_NEAR(edge(24, 31), 0, 1);
  EXPECT_NEAR(edge(24, 33), 600, 1);
}

// Few samples blur a fringe as much as many, before and behind the focus: by exp(-2 pi^2 (c / 4)^2 / p^2).
TEST(DepthOfField, FewSamplesBlurFringesAsMuchAsMany) {
  constexpr double kPeriod = 32;
  RigModel rig = coaxial_rig();
  rig.camera_lens.f_number = 0.015;
  rig.camera_lens.focus_m = 1;
  for (const double distance : {0.8, 1.3}) {
    const double circle = camera_pupil_m(rig) * 200 * std::abs(1 / distance - 1 / rig.camera_lens.focus_m);
    const double kept = std::exp(-2 * kPi * kPi * circle * circle / 16 / (kPeriod * kPeriod));
    ASSERT_LT(kept, 0.97) << distance;
    for (const int samples : {4, 9, 64}) {
      const auto sharp = lux_of(board(rig, distance), three_steps(kPeriod, 0), samples);
      const auto soft = lux_of(board(rig, distance), three_steps(kPeriod, 0), samples, only(&Effects::depth_of_field));
      for (int col = 8; col < 57; col += 3)
        ASSERT_NEAR(std::abs(fringe(soft, 24, col) / fringe(sharp, 24, col)), kept, 4e-3)
            << samples << " samples, " << distance << " m, column " << col;
    }
  }
}

// EMVA 1288: without temporal noise, DSNU is the standard deviation over the pixels in the dark and PRNU the relative
// one under uniform light.
TEST(Nonuniformity, IsThatOfTheSensor) {
  RigModel rig = coaxial_rig();
  rig.camera = {400, 300, 1000, 1000, 199.5, 149.5, {}};
  rig.sensor = {12, 0.1, 0, 1e9, 100, 1, 500, 40, 0.02};
  const Camera camera(rig, only(&Effects::fixed_pattern), 7, 0), other(rig, only(&Effects::fixed_pattern), 8, 0);
  const Exposure exact{false, false};
  const cv::Mat1f none(300, 400, 0.0f), light(300, 400, 1000.0f);
  const cv::Mat1f dark = camera.expose(camera.electrons_per_s(none), 0.01, exact);
  const cv::Mat1f bright = camera.expose(camera.electrons_per_s(light), 0.01, exact);
  cv::Scalar mean, deviation;
  cv::meanStdDev(dark, mean, deviation);
  EXPECT_NEAR(mean[0], 100 + 0.1 * 500 * 0.01, 0.05);
  EXPECT_NEAR(deviation[0] / 0.1, 40, 0.4);
  cv::meanStdDev(cv::Mat1f(bright - dark), mean, deviation);
  EXPECT_NEAR(deviation[0] / mean[0], 0.02, 2e-4);
  EXPECT_GT(cv::countNonZero(dark != other.expose(other.electrons_per_s(none), 0.01, exact)), 100000);
  EXPECT_EQ(cv::countNonZero(dark != camera.expose(camera.electrons_per_s(none), 0.01, {false, false, 5, 6, 7})), 0);
}

TEST(AutoExposure, FillsFourFifthsOfTheRange) {
  Scene scene = board(coaxial_rig());
  scene.rig.near_m = 0.5, scene.rig.far_m = 2;
  scene.auto_exposure = true;
  PatternSequence sequence{129, 97, {constant_pattern(1), constant_pattern(0.2)}};
  for (const double flux : {5.0, 50.0, 5000.0}) {
    scene.rig.projector_lens.flux_lm = flux;
    RenderOptions options{1, false, true, Effects::none()};
    const FringeStack stack = *VirtualRig(scene, options).capture(sequence);
    double low = 0, high = 0;
    cv::minMaxLoc(stack.images[0], &low, &high);
    const double longest = 1 / scene.rig.timing.pattern_rate_hz;
    if (stack.exposure_s[0] < longest) {
      EXPECT_NEAR(high, 2 + 0.8 * 253, 4) << flux;
    } else {
      EXPECT_LT(high, 2 + 0.8 * 253) << flux;
    }
    EXPECT_LE(stack.exposure_s[0], longest);
  }
}

// --- motion ---

// A phase drift of epsilon per step causes the three-step phase error -(epsilon / sqrt 3) sin 2 phi.
TEST(Motion, BendsThePhaseByTwiceItsFrequency) {
  RigModel rig = coaxial_rig();
  rig.camera = {65, 49, 2000, 2000, 32, 24, {}};
  rig.projector = {129, 97, 2000, 2000, 64 - 500, 48, {}};
  rig.projector_from_camera.translation = {0.25, 0, 0};  // u = 2000 (x + 0.25 / z) + cx
  rig.near_m = 0.7, rig.far_m = 1.4;
  set_lux_at_1m(rig, 100);
  Scene scene = board(rig);
  constexpr double kPeriod = 20, kEpsilon = 0.08;
  // du/dz = -2000 0.25 / z^2; the board approaches as the robot moves forward.
  scene.motion.velocity_m_s.z() = kEpsilon * kPeriod / (2 * kPi) / 500 * rig.timing.camera_rate_hz;
  const PatternSequence sequence{129, 97, three_steps(kPeriod, 0)};
  Effects effects = only(&Effects::motion);
  const auto [stack, truth] = *VirtualRig(scene, {1, false, false, effects}).simulate(sequence);
  std::vector<cv::Mat1f> images;
  for (const cv::Mat& image : stack.images) images.push_back(cv::Mat1f(image - rig.sensor.offset_dn));
  for (int col = 2; col < 63; ++col) {
    const double phase = 2 * kPi * (static_cast<double>(truth.projector_column(24, col)) + 0.5) / kPeriod;
    const double error = std::arg(fringe(images, 24, col) * std::polar(1.0, -phase));
    ASSERT_NEAR(error, -kEpsilon / std::sqrt(3.0) * std::sin(2 * phase), 0.05 * kEpsilon) << col;
  }
  // With the effect disabled, there is no phase error.
  VirtualRig still(scene, {1, false, false, Effects::none()});
  const FringeStack good = *still.capture(sequence);
  images.clear();
  for (const cv::Mat& image : good.images) images.push_back(cv::Mat1f(image - rig.sensor.offset_dn));
  const double phase = 2 * kPi * (static_cast<double>(truth.projector_column(24, 20)) + 0.5) / kPeriod;
  EXPECT_NEAR(std::arg(fringe(images, 24, 20) * std::polar(1.0, -phase)), 0, 1e-4);
}

// An edge moving through the image at v px/s is smeared over v t during an exposure t.
TEST(Motion, WithinAnExposureSmearsEdges) {
  RigModel rig = coaxial_rig();
  rig.near_m = 0.7, rig.far_m = 1.4;
  Scene scene = board(rig);
  scene.objects.push_back(grey_object(plane_mesh(4, 4), pose_from({{-2000, 0, 999.9}, {0, 0, 0}}), 0));
  scene.ambient_lux = 20000;
  const double smear_px = 12;
  scene.motion.velocity_m_s.x() = smear_px / 200 / rig.timing.exposure_s;
  Effects effects = only(&Effects::motion);
  effects.exposure_steps = 16;
  VirtualRig moving(scene, {16, false, false, effects});
  const FringeStack stack = *moving.capture({129, 97, {constant_pattern(0)}});
  const cv::Mat1f image(stack.images[0] - rig.sensor.offset_dn);
  const float full = image(24, 60);
  for (const int k : {-8, -4, 0, 4, 8}) {
    const double share = std::clamp(0.5 + k / smear_px, 0.0, 1.0);
    EXPECT_NEAR(image(24, 32 + k) / full, share, 0.07) << k;
  }
}

// Variance of the blur of an edge, px^2, of a board that moves by `smear_px` along the axis during an exposure of `steps` poses.
double moving_edge_variance_px2(double smear_px, int axis, int samples, int steps) {
  RigModel rig = coaxial_rig();
  rig.near_m = 0.7, rig.far_m = 1.4;
  Effects effects = only(&Effects::motion);
  effects.exposure_steps = steps;
  Eigen::Vector3d velocity_m_s = Eigen::Vector3d::Zero();
  velocity_m_s[axis] = smear_px / rig.camera.fx / rig.timing.exposure_s;
  return edge_variance_px2(rig, velocity_m_s, axis, samples, effects);
}

// The few samples of a pixel are taken at different places and times, which should not depend on each other. Of four, they do.
TEST(Motion, BlurIsNearlyTheSameInAllDirections) {
  constexpr double kSmear_px = 2;
  struct Case {
    int samples, asked, steps;  // the steps share the samples evenly
    double tolerance;
  };
  for (const auto [samples, asked, steps, tolerance] : {Case{4, 4, 4, 0.45},
                                                        {4, 2, 2, 0.1},
                                                        {9, 4, 9, 0.1},
                                                        {16, 4, 4, 0.1},
                                                        {16, 8, 8, 0.1},
                                                        {16, 16, 16, 0.1},
                                                        {25, 4, 5, 0.1}}) {
    // Sum of the variances of the places in a pixel and of the times.
    const double places = samples == 4 ? (0.125 * 0.125 + 0.375 * 0.375) / 2 : (1 - 1.0 / samples) / 12;
    const double expected = places + kSmear_px * kSmear_px * (1 - 1.0 / (steps * steps)) / 12;
    for (const int axis : {0, 1}) {
      for (const double smear_px : {-kSmear_px, kSmear_px})
        EXPECT_NEAR(moving_edge_variance_px2(smear_px, axis, samples, asked), expected, tolerance * expected)
            << samples << ' ' << asked << ' ' << axis << ' ' << smear_px;
    }
  }
}

}  // namespace
}  // namespace fringeslam::sim
