// SPDX-License-Identifier: Apache-2.0
#include "sim/light/sample_rays.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>
#include <vector>

#include "core/base/parallel.h"

namespace fringeslam::sim {

namespace {

// Sample positions in the unit pixel, relative to its centre, with zero mean. Rotated grid: no two samples share a row
// or column, so an axis-aligned edge is anti-aliased in as many steps as there are samples.
std::vector<Eigen::Vector2d> sample_offsets(int per_pixel) {
  if (per_pixel == 4) return {{-0.125, -0.375}, {0.375, -0.125}, {0.125, 0.375}, {-0.375, 0.125}};
  const int side = static_cast<int>(std::lround(std::sqrt(per_pixel)));
  std::vector<Eigen::Vector2d> offsets;
  for (int i = 0; i < side * side; ++i) {
    const int col = i % side, row = i / side;
    offsets.emplace_back((col + (row + 0.5) / side) / side - 0.5, (row + (side - col - 0.5) / side) / side - 0.5);
  }
  return offsets;
}

// Few samples of a wide blur would show an edge several times.
constexpr double kWidestBlur_px = 0.4;

// Distribution of a sample's place along an axis: uniform over a pixel's edge, plus a Gaussian blur.
class BlurredPixel {
 public:
  BlurredPixel(double extent_px, double blur_px) : half_px_(extent_px / 2), blur_px_(blur_px) {}

  // Returns the place below which the share lies.
  double quantile(double share) const {
    double low = -half_px_ - 8 * blur_px_, high = -low;
    for (int i = 0; i < 60; ++i) {
      const double middle = (low + high) / 2;
      (share_below(middle) < share ? low : high) = middle;
    }
    return (low + high) / 2;
  }

 private:
  double share_below(double x) const {
    return (integral((x + half_px_) / blur_px_) - integral((x - half_px_) / blur_px_)) * blur_px_ / (2 * half_px_);
  }
  // Integral of the normal distribution function.
  static double integral(double x) {
    return x * 0.5 * std::erfc(-x / std::numbers::sqrt2) + std::exp(-x * x / 2) / std::sqrt(2 * std::numbers::pi);
  }

  double half_px_, blur_px_;
};

// Spreads positions in the unit pixel over a blurred pixel: strata of equal light, with exactly the variance of the positions
// plus that of the blur.
void blur(std::vector<Eigen::Vector2d>& offsets, double extent, double blur_px) {
  const BlurredPixel pixel(extent, blur_px);
  double before = 0, after = 0;
  for (Eigen::Vector2d& offset : offsets) {
    before += offset.squaredNorm() * extent * extent;
    for (double& place : offset) place = pixel.quantile(0.5 + place);
    after += offset.squaredNorm();
  }
  const double wanted = before + 2 * blur_px * blur_px * static_cast<double>(offsets.size());
  for (Eigen::Vector2d& offset : offsets) offset *= std::sqrt(wanted / after);
}

// Maps the square [-1, 1]^2 to the unit disc (concentric mapping).
Eigen::Vector2d on_disc(double a, double b) {
  if (a == 0 && b == 0) return {0, 0};
  const bool wide = std::abs(a) > std::abs(b);
  const double r = wide ? a : b;
  const double phi = wide ? std::numbers::pi / 4 * (b / a) : std::numbers::pi / 2 - std::numbers::pi / 4 * (a / b);
  return {r * std::cos(phi), r * std::sin(phi)};
}

// Midpoints of `side` intervals of (-1, 1) in an order that changes its sign when it is reversed, as different from their own as
// possible.
std::vector<double> shuffled_places(int side) {
  const int half = side / 2;
  std::vector<double> best(static_cast<size_t>(side), 0.0);
  double least = std::numeric_limits<double>::infinity();
  for (int stride = 1; stride <= half; ++stride) {
    if (std::gcd(stride, half) != 1) continue;
    for (int first = 0; first < 2 * half; ++first) {
      std::vector<double> places(best.size(), 0.0);
      double correlation = 0;
      for (int i = 0; i < half; ++i) {
        const double sign = (first + i) % 2 == 0 ? 1 : -1;
        const double place = sign * ((2 * ((first / 2 + i * stride) % half) + 1.0) / side - 1);
        places[static_cast<size_t>(i)] = place;
        places[static_cast<size_t>(side - 1 - i)] = -place;
        correlation += place * (2 * i + 1 - side);
      }
      if (std::abs(correlation) < least) {
        least = std::abs(correlation);
        best = places;
      }
    }
  }
  return best;
}

// Ray origins in about the unit pupil of a pixel's samples, whose positions in the pixel are given. They are the same for all
// pixels, and opposite to each other where the positions are, so that the blur is symmetric: a skew blur would shift edges and
// fringes on a defocused surface, which calibrations take for a translation of the camera. They have the variance of the unit
// disc, 1/4 along each axis, and do not widen or narrow the blur by correlation with the positions in the pixel, so that the
// image of a fringe is blurred alike before and behind the focus.
std::vector<Eigen::Vector2d> pupil_offsets(const std::vector<Eigen::Vector2d>& in_pixel) {
  const auto per_pixel = static_cast<int>(in_pixel.size());
  if (per_pixel == 1) return {{0, 0}};  // a single ray has no depth of field
  Eigen::Matrix2d pixel_moments = Eigen::Matrix2d::Zero();
  for (const Eigen::Vector2d& p : in_pixel) pixel_moments += p * p.transpose();
  std::vector<Eigen::Vector2d> offsets;
  if (per_pixel == 4) {
    // Four starting points cannot be uncorrelated with the positions in the pixel; a quarter turn makes the correlation
    // antisymmetric, so that it cancels in the covariance of the blur.
    const double scale = std::sqrt(0.5 * per_pixel / pixel_moments.trace());
    for (const Eigen::Vector2d& p : in_pixel) offsets.emplace_back(-scale * p.y(), scale * p.x());
    return offsets;
  }
  const int side = static_cast<int>(std::lround(std::sqrt(per_pixel)));
  const std::vector<double> places = shuffled_places(side);
  const auto place = [&](int i) { return places[static_cast<size_t>(i)]; };
  // Rows of the pixel grid map to shuffled columns of the pupil grid. A linear map removes the remaining correlation but for its
  // antisymmetric part, as above.
  Eigen::Matrix2d correlation = Eigen::Matrix2d::Zero(), moments = Eigen::Matrix2d::Zero();
  for (int i = 0; i < per_pixel; ++i) {
    offsets.push_back(on_disc(-place(i / side), place(i % side)));
    correlation += offsets.back() * in_pixel[static_cast<size_t>(i)].transpose();
  }
  const Eigen::Matrix2d pupil_from_pixel = 0.5 * (correlation + correlation.transpose()) * pixel_moments.inverse();
  for (int i = 0; i < per_pixel; ++i) {
    Eigen::Vector2d& offset = offsets[static_cast<size_t>(i)];
    offset -= pupil_from_pixel * in_pixel[static_cast<size_t>(i)];
    moments += offset * offset.transpose() / per_pixel;
  }
  const Eigen::Matrix2d to_disc = 0.5 * Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d>(moments).operatorInverseSqrt();
  for (Eigen::Vector2d& offset : offsets) offset = to_disc * offset;
  return offsets;
}

}  // namespace

double lens_transmission(const Eigen::Vector2d& ray, double vignetting) {
  return std::pow(1 + ray.squaredNorm(), -vignetting / 2);
}

SampleRays sample_rays(const Pinhole& camera, int per_pixel, double extent, double blur_px, double vignetting) {
  std::vector<Eigen::Vector2d> offsets = sample_offsets(per_pixel);
  SampleRays rays;
  rays.per_pixel = per_pixel;
  rays.extent = extent;
  rays.blur_px = per_pixel > 1 ? std::min(blur_px, kWidestBlur_px) : 0;
  if (rays.blur_px > 0)
    blur(offsets, extent, rays.blur_px);
  else
    for (Eigen::Vector2d& offset : offsets) offset *= extent;
  rays.pupil = pupil_offsets(offsets);
  const auto pixels = static_cast<size_t>(camera.width) * static_cast<size_t>(camera.height);
  rays.centres.resize(pixels);
  rays.samples.resize(pixels * offsets.size());
  if (vignetting != 0 && per_pixel > 1) rays.transmission.resize(rays.samples.size());
  for_each_row(camera.height, [&](int row) {
    for (int col = 0; col < camera.width; ++col) {
      const auto pixel = static_cast<size_t>(row * camera.width + col);
      const Eigen::Vector2d centre(col, row);
      rays.centres[pixel] = camera.undistort(centre);
      const double at_centre = rays.transmission.empty() ? 1 : lens_transmission(rays.centres[pixel], vignetting);
      for (size_t s = 0; s < offsets.size(); ++s) {
        const size_t sample = pixel * offsets.size() + s;
        rays.samples[sample] = camera.undistort(centre + offsets[s]);
        if (rays.transmission.empty()) continue;
        const double relative = lens_transmission(rays.samples[sample], vignetting) / at_centre;
        rays.transmission[sample] = std::isnan(relative) ? 1 : static_cast<float>(relative);  // without a ray
      }
    }
  });
  return rays;
}

double remaining_blur_px(double blur_px, double sampled_px) {
  return std::sqrt(std::max(0.0, blur_px * blur_px - sampled_px * sampled_px));
}

}  // namespace fringeslam::sim
