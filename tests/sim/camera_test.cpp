// SPDX-License-Identifier: Apache-2.0
// Camera model: sample positions, and conversion of electrons to grey values (EMVA 1288).
#include "sim/light/camera.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <opencv2/core.hpp>

#include "tests/sim/test_scenes.h"

namespace fringeslam::sim {
namespace {

SensorModel twelve_bits() { return {12, 0.1, 20, 40000, 50}; }

cv::Mat1f flat(double electrons, int rows = 600, int cols = 800) {
  return cv::Mat1f(rows, cols, static_cast<float>(electrons));
}

// Exposes a sensor without a lens for one second at the given electrons per second.
cv::Mat expose(const cv::Mat1f& electrons, const SensorModel& sensor, const Exposure& exposure) {
  RigModel rig;
  rig.camera = {electrons.cols, electrons.rows, 100, 100, 0, 0, {}};
  rig.sensor = sensor;
  return Camera(rig, Effects::none(), 0, 0).expose(electrons, 1, exposure);
}

struct Moments {
  double mean = 0, variance = 0;
};

Moments moments(const cv::Mat& image) {
  cv::Mat1d values;
  image.convertTo(values, CV_64F);
  cv::Scalar mean, deviation;
  cv::meanStdDev(values, mean, deviation);
  return {mean[0], deviation[0] * deviation[0]};
}

TEST(SampleRays, MeanOfTheSamplesIsThePixelCentre) {
  const Pinhole camera{21, 17, 300, 310, 9.3, 8.1, {}};
  for (const int per_pixel : {1, 4, 9, 16, 64}) {
    const SampleRays rays = sample_rays(camera, per_pixel);
    ASSERT_EQ(rays.centres.size(), 21u * 17u);
    ASSERT_EQ(rays.samples.size(), 21u * 17u * static_cast<size_t>(per_pixel));
    for (size_t pixel = 0; pixel < rays.centres.size(); ++pixel) {
      const Eigen::Vector2d truth((static_cast<double>(pixel % 21) - 9.3) / 300,
                                  (static_cast<double>(pixel / 21) - 8.1) / 310);
      Eigen::Vector2d sum = Eigen::Vector2d::Zero();
      for (int s = 0; s < per_pixel; ++s)
        sum += rays.samples[pixel * static_cast<size_t>(per_pixel) + static_cast<size_t>(s)];
      ASSERT_LT((rays.centres[pixel] - truth).norm(), 1e-14);
      ASSERT_LT((sum / per_pixel - truth).norm(), 1e-14) << per_pixel << " samples";
    }
  }
}

TEST(SampleRays, SamplesAreSpreadOverTheirPixel) {
  const Pinhole camera{3, 3, 1, 1, 0, 0, {}};  // rays are pixel coordinates
  for (const int per_pixel : {4, 9, 16, 64}) {
    const SampleRays rays = sample_rays(camera, per_pixel);
    double x2 = 0, y2 = 0;
    for (int s = 0; s < per_pixel; ++s) {
      const Eigen::Vector2d& ray = rays.samples[static_cast<size_t>(s)];
      ASSERT_LT(std::abs(ray.x()), 0.5);
      ASSERT_LT(std::abs(ray.y()), 0.5);
      x2 += ray.x() * ray.x() / per_pixel, y2 += ray.y() * ray.y() / per_pixel;
    }
    // n positions at the centres of n equal cells have the variance (1 - 1/n^2) / 12; a rotated grid of n samples has n
    // distinct positions along each axis.
    const double n = per_pixel;
    EXPECT_NEAR(x2, (1 - 1 / (n * n)) / 12, 1e-12) << per_pixel;
    EXPECT_NEAR(y2, (1 - 1 / (n * n)) / 12, 1e-12) << per_pixel;
  }
}

// A lens of blur sigma adds sigma^2 to the variance along each axis, without correlation between them; strata of equal light are
// narrow in the middle.
TEST(SampleRays, SamplesContainTheBlurOfTheLens) {
  const Pinhole camera{3, 3, 1, 1, 0, 0, {}};  // rays are pixel coordinates
  for (const double blur_px : {0.1, 0.3, 0.4}) {
    for (const int per_pixel : {4, 9, 16, 64}) {
      for (const double extent : {1.0, 0.25}) {
        const SampleRays rays = sample_rays(camera, per_pixel, extent, blur_px);
        EXPECT_EQ(rays.blur_px, blur_px);
        Eigen::Vector2d mean = Eigen::Vector2d::Zero();
        Eigen::Matrix2d moments = Eigen::Matrix2d::Zero();
        for (int s = 0; s < per_pixel; ++s) {
          const Eigen::Vector2d& ray = rays.samples[static_cast<size_t>(s)];
          mean += ray / per_pixel, moments += ray * ray.transpose() / per_pixel;
        }
        const double n = per_pixel, variance = extent * extent * (1 - 1 / (n * n)) / 12 + blur_px * blur_px;
        EXPECT_LT(mean.norm(), 1e-12) << per_pixel;
        EXPECT_LT((moments - variance * Eigen::Matrix2d::Identity()).norm(), 1e-12) << per_pixel << ' ' << blur_px;
      }
    }
  }
}

// The centroid of a pixel's light moves along the gradient of the lens's transmission by the variance of the samples.
TEST(SampleRays, VignettingMovesTheCentroid) {
  constexpr double kFocal_px = 400, kVignetting = 4, kBlur_px = 0.3;
  const Pinhole camera{301, 3, kFocal_px, kFocal_px, 0, 1, {}};
  const SampleRays rays = sample_rays(camera, 16, 1, kBlur_px, kVignetting);
  for (const int col : {0, 100, 300}) {
    const size_t pixel = 301 + static_cast<size_t>(col);
    Eigen::Vector2d sum = Eigen::Vector2d::Zero();
    double light = 0;
    for (size_t s = 16 * pixel; s < 16 * (pixel + 1); ++s) {
      sum += rays.transmission[s] * (rays.samples[s] - rays.centres[pixel]) * kFocal_px;
      light += rays.transmission[s];
    }
    const double x = col / kFocal_px, variance = (1 - 1.0 / 256) / 12 + kBlur_px * kBlur_px;
    EXPECT_NEAR(sum.x() / light, -variance * kVignetting * x / (1 + x * x) / kFocal_px, 2e-6) << col;
    EXPECT_NEAR(sum.y() / light, 0, 2e-6) << col;
    EXPECT_NEAR(light / 16, 1, 1e-5) << col;
  }
  EXPECT_TRUE(sample_rays(camera, 16, 1, kBlur_px).transmission.empty());
}

TEST(SampleRays, SingleAndFewSamplesLeaveBlurToTheImage) {
  const Pinhole camera{3, 3, 1, 1, 0, 0, {}};
  EXPECT_EQ(sample_rays(camera, 1, 1, 0.3).blur_px, 0);
  EXPECT_EQ(sample_rays(camera, 1, 1, 0.3).samples[0], Eigen::Vector2d(0, 0));
  const double sampled_px = sample_rays(camera, 4, 1, 1.5).blur_px;
  EXPECT_LT(sampled_px, 1.5);
  EXPECT_NEAR(std::hypot(sampled_px, remaining_blur_px(1.5, sampled_px)), 1.5, 1e-12);
}

// The covariance of pixel plus c times pupil positions is that of the pixel positions plus c^2 times that of a disc, for
// c of both signs: before and behind the focus.
TEST(SampleRays, PupilBlursAsADisc) {
  const Pinhole camera{3, 3, 1, 1, 0, 0, {}};  // rays are pixel coordinates
  for (const int per_pixel : {4, 9, 16, 25, 64, 256}) {
    const SampleRays rays = sample_rays(camera, per_pixel);
    ASSERT_EQ(rays.pupil.size(), static_cast<size_t>(per_pixel));
    for (const double c : {-2.0, -0.5, 0.5, 2.0}) {
      Eigen::Vector2d mean = Eigen::Vector2d::Zero();
      Eigen::Matrix2d pixel = Eigen::Matrix2d::Zero(), blurred = Eigen::Matrix2d::Zero();
      for (size_t s = 0; s < rays.pupil.size(); ++s) {
        const Eigen::Vector2d& p = rays.samples[s];
        const Eigen::Vector2d at = p + c * rays.pupil[s];
        mean += at / per_pixel;
        pixel += p * p.transpose() / per_pixel;
        blurred += at * at.transpose() / per_pixel;
        EXPECT_LT(rays.pupil[s].norm(), 1.25) << per_pixel;  // the linear map lets few points leave the disc
      }
      EXPECT_LT(mean.norm(), 1e-12) << per_pixel;
      EXPECT_LT((blurred - pixel - c * c / 4 * Eigen::Matrix2d::Identity()).norm(), 1e-12) << per_pixel << " " << c;
    }
  }
}

// Odd moments would shift edges and fringes before the focus, and by as much the other way behind it.
TEST(SampleRays, PupilDoesNotSkewTheBlur) {
  const Pinhole camera{3, 3, 1, 1, 0, 0, {}};  // rays are pixel coordinates
  for (const int per_pixel : {4, 9, 16, 25, 36, 64}) {
    const SampleRays rays = sample_rays(camera, per_pixel);
    for (const double c : {-2.0, -0.5, 0.5, 2.0}) {
      Eigen::Vector2d cubes = Eigen::Vector2d::Zero();
      for (size_t s = 0; s < rays.pupil.size(); ++s) {
        const Eigen::Vector2d at = rays.samples[s] + c * rays.pupil[s];
        cubes += Eigen::Vector2d(at.array().cube()) / per_pixel;
      }
      EXPECT_LT(cubes.norm(), 1e-12) << per_pixel << " " << c;
    }
  }
}

TEST(SampleRays, DistortionIsTakenOut) {
  const Pinhole camera{101, 81, 300, 300, 50, 40, {-0.2, 0.05, 0.001, -0.001, 0}};
  const SampleRays rays = sample_rays(camera, 1);
  for (size_t pixel = 0; pixel < rays.centres.size(); ++pixel) {
    const Eigen::Vector2d back = camera.project(rays.centres[pixel].homogeneous());
    ASSERT_NEAR(back.x(), static_cast<double>(pixel % 101), 1e-9);
    ASSERT_NEAR(back.y(), static_cast<double>(pixel / 101), 1e-9);
  }
}

// Photon transfer (EMVA 1288): the temporal variance of the grey value is linear in its mean, with the gain as slope
// and the squared read noise in grey values as intercept.
TEST(Expose, PhotonTransferReturnsGainAndReadNoise) {
  for (const bool quantise : {false, true}) {
    const SensorModel sensor = twelve_bits();
    const double rounding = quantise ? 1.0 / 12 : 0;
    const Moments dark = moments(expose(flat(0), sensor, {true, quantise, 1, 0, 0}));
    EXPECT_NEAR(dark.mean, sensor.offset_dn, 0.02);
    EXPECT_NEAR(std::sqrt(dark.variance - rounding) / sensor.gain_dn_per_electron, 20, 0.03 * 20);

    double slope_numerator = 0, slope_denominator = 0;
    for (int level = 1; level <= 8; ++level) {
      const Moments m = moments(expose(flat(3500.0 * level), sensor, {true, quantise, 1, 0, level}));
      const double signal = m.mean - dark.mean, noise = m.variance - dark.variance;
      EXPECT_NEAR(signal, 350.0 * level, 0.05);
      EXPECT_NEAR(noise / signal, sensor.gain_dn_per_electron, 0.03 * sensor.gain_dn_per_electron) << level;
      slope_numerator += signal * noise, slope_denominator += signal * signal;
    }
    EXPECT_NEAR(slope_numerator / slope_denominator, sensor.gain_dn_per_electron, 0.01 * sensor.gain_dn_per_electron);
  }
}

// The noise variance assumed by the decoder equals the variance of the camera model. The light varies by eight grey
// values over the image, so that rounding errors are uniformly distributed, as in a real image.
TEST(Expose, NoiseIsThatOfTheSensorModel) {
  SensorModel sensor;
  sensor.gain_dn_per_electron = 0.0068;
  for (const double electrons : {800.0, 5000.0, 25000.0}) {
    cv::Mat1f light = flat(electrons);
    for (int i = 0; i < light.cols; ++i) light.col(i) += (i / 100.0 - 4) / sensor.gain_dn_per_electron;
    const cv::Mat exact = expose(light, sensor, {false, false, 0, 0, 0});
    cv::Mat1f grey;
    expose(light, sensor, {true, true, 3, 1, 2}).convertTo(grey, CV_32F);
    const double variance = moments(grey - exact).variance;
    EXPECT_NEAR(variance, sensor.variance_dn2(2 + 0.0068 * electrons), 0.03 * variance) << electrons;
  }
}

TEST(Expose, WithoutNoiseAndRoundingIsExact) {
  const SensorModel sensor = twelve_bits();
  cv::Mat1f electrons(1, 6);
  electrons << 0.f, 1.f, 12.5f, 30000.f, 50000.f, 1e6f;  // also far above saturation
  const cv::Mat grey = expose(electrons, sensor, {false, false, 0, 0, 0});
  ASSERT_EQ(grey.type(), CV_32FC1);
  for (int i = 0; i < 6; ++i)
    EXPECT_EQ(grey.at<float>(i), static_cast<float>(50 + 0.1 * static_cast<double>(electrons(i)))) << i;
}

TEST(Expose, RoundsToTheNearestGreyValue) {
  const SensorModel sensor = twelve_bits();
  for (int i = 0; i < 400; ++i) {
    const double electrons = 100 + 0.3 * i;
    const cv::Mat grey = expose(flat(electrons, 1, 1), sensor, {false, true, 0, 0, 0});
    ASSERT_EQ(grey.type(), CV_16UC1);
    EXPECT_NEAR(grey.at<ushort>(0), 50 + 0.1 * electrons, 0.5 + 1e-4) << electrons;
  }
}

TEST(Expose, SaturatesAtTheConverterAndAtTheFullWell) {
  const cv::Mat converter = expose(flat(1e6, 4, 4), {12, 0.2, 20, 1e7, 50}, {false, true, 0, 0, 0});
  EXPECT_EQ(converter.at<ushort>(0), 4095);
  const cv::Mat well = expose(flat(1e6, 4, 4), {12, 0.1, 20, 20000, 50}, {false, true, 0, 0, 0});
  EXPECT_EQ(well.at<ushort>(0), 2050);
  const cv::Mat eight_bits = expose(flat(1e6, 4, 4), {8, 0.0068, 20, 1e7, 2}, {true, true, 0, 0, 0});
  ASSERT_EQ(eight_bits.type(), CV_8UC1);
  EXPECT_EQ(cv::countNonZero(eight_bits != 255), 0);
}

TEST(Expose, DarkImagesClipAtZero) {
  const SensorModel sensor{8, 1, 20, 40000, 0};
  double low = 0, high = 0;
  const cv::Mat image = expose(flat(0), sensor, {true, true, 1, 0, 0});
  cv::minMaxLoc(image, &low, &high);
  EXPECT_EQ(low, 0);
  EXPECT_LT(high, 8 * 20);  // a wrap-around would come out near 255
  EXPECT_NEAR(moments(image).mean, 20 / std::sqrt(2 * kPi), 0.1);
}

TEST(Expose, NoiseIsAFunctionOfSeedStackAndImage) {
  const SensorModel sensor = twelve_bits();
  const auto image = [&](Exposure exposure) { return expose(flat(5000, 60, 80), sensor, exposure); };
  const auto differ = [](const cv::Mat& a, const cv::Mat& b) { return cv::countNonZero(a != b); };
  const cv::Mat reference = image({true, false, 1, 2, 3});
  EXPECT_EQ(differ(reference, image({true, false, 1, 2, 3})), 0);
  EXPECT_GT(differ(reference, image({true, false, 2, 2, 3})), 4700);
  EXPECT_GT(differ(reference, image({true, false, 1, 3, 3})), 4700);
  EXPECT_GT(differ(reference, image({true, false, 1, 2, 4})), 4700);
}

TEST(Expose, NeighboursAreIndependent) {
  const cv::Mat1f noise = expose(flat(10000, 801, 801), twelve_bits(), {true, false, 1, 0, 0});
  const Moments m = moments(noise);
  for (const cv::Point& step : {cv::Point(1, 0), cv::Point(0, 1), cv::Point(1, 1), cv::Point(2, 0)}) {
    const cv::Size size(800 - step.x, 800 - step.y);
    cv::Mat1d a, b;
    noise(cv::Rect({0, 0}, size)).convertTo(a, CV_64F, 1, -m.mean);
    noise(cv::Rect(step, size)).convertTo(b, CV_64F, 1, -m.mean);
    EXPECT_LT(std::abs(a.dot(b)) / size.area() / m.variance, 5 / 800.0) << step;
  }
}

}  // namespace
}  // namespace fringeslam::sim
