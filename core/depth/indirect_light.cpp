// SPDX-License-Identifier: Apache-2.0
#include "core/depth/indirect_light.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "core/base/constants.h"
#include "core/base/parallel.h"
#include "core/types/error.h"

namespace fringeslam {

namespace {

// Samples of the surroundings, denser near the pixel; each stands for an area of `pixels`.
struct Offset {
  int row = 0, col = 0;
  float pixels = 1;
};

std::vector<Offset> offsets_within(int radius, int unit) {
  constexpr int kDense = 4, kMedium = 12;
  std::vector<Offset> offsets;
  for (int row = -radius; row <= radius; ++row) {
    for (int col = -radius; col <= radius; ++col) {
      const int distance = std::max(std::abs(row), std::abs(col));
      const int step = unit * (distance <= kDense * unit ? 1 : distance <= kMedium * unit ? 2 : 4);
      if (distance == 0 || row % step != 0 || col % step != 0) continue;
      offsets.push_back({row, col, static_cast<float>(step * step)});
    }
  }
  return offsets;
}

// What a pixel throws at its surroundings: fringes as phasors, so that their sum shows how much of them averages out.
struct Emitter {
  cv::Vec3f point_m, normal;
  float area_m2 = 0;           // of the surface that one pixel sees; 0: no surface
  float cosine = 0, sine = 0;  // modulation times the phasor of the coordinate
};

std::vector<Emitter> emitters_of(const Frame& frame, const DecodedStack& decoded, const RigModel& rig) {
  const auto per_px = static_cast<float>(kTwoPi / decoded.finest_period_px);
  const auto pixel_area = static_cast<float>(1 / (rig.camera.fx * rig.camera.fy));
  constexpr float kLeastCosine = 0.05f;  // more oblique surfaces are hardly measured
  std::vector<Emitter> emitters(frame.points_m.total());
  for_each_row(frame.height(), [&](int row) {
    for (int col = 0; col < frame.width(); ++col) {
      const cv::Vec3f &p = frame.points_m(row, col), &n = frame.normals(row, col);
      const float coordinate = decoded.coordinate_px(row, col), modulation = decoded.modulation(row, col);
      if (std::isnan(p[2]) || std::isnan(n[2]) || std::isnan(coordinate)) continue;
      const float distance = std::sqrt(p.dot(p)), cosine = std::max(kLeastCosine, std::abs(p.dot(n)) / distance);
      emitters[static_cast<size_t>(row) * static_cast<size_t>(frame.width()) + static_cast<size_t>(col)] = {
          p, n, pixel_area * p[2] * distance / cosine, modulation * std::cos(per_px * coordinate),
          modulation * std::sin(per_px * coordinate)};
    }
  });
  return emitters;
}

}  // namespace

cv::Mat1f indirect_sigma_px(const Frame& frame, const DecodedStack& decoded, const RigModel& rig, double albedo) {
  if (frame.normals.size() != frame.points_m.size() || decoded.coordinate_px.size() != frame.points_m.size())
    throw Error("indirect light: the frame and the decoded images differ in size");
  constexpr double kPeriods = 2.5;    // light from farther away averages out
  constexpr int kSamplesAcross = 32;  // from a pixel to the end of its surroundings
  constexpr float kFlat = 0.05f;  // sine of the angle above the horizon: flatter surfaces throw no light at each other
  constexpr double kSigmas = 4, kMostAlbedo = 0.95;
  constexpr int kSpread_px = 2, kWithoutNormal_px = 3;
  const int height = frame.height(), width = frame.width();
  cv::Mat1f sigma_px(height, width, 0.0f);
  if (!(decoded.finest_period_px > 0)) return sigma_px;
  const double period = decoded.finest_period_px * rig.camera.fx / rig.projector.fx;  // camera pixels
  const int unit = std::max(1, static_cast<int>(std::lround(kPeriods * period / kSamplesAcross)));
  const std::vector<Offset> offsets = offsets_within(unit * kSamplesAcross, unit);
  const std::vector<Emitter> emitters = emitters_of(frame, decoded, rig);
  const auto at = [&](int row, int col) -> const Emitter& {
    return emitters[static_cast<size_t>(row) * static_cast<size_t>(width) + static_cast<size_t>(col)];
  };
  constexpr auto per_pi = static_cast<float>(1 / kPi);
  const auto bounced = static_cast<float>(std::min(albedo, kMostAlbedo) / kPi);
  const auto scale =
      static_cast<float>(albedo / kPi * decoded.finest_period_px / kTwoPi / kSigmas);  // phase error to sigma
  for_each_row(height, [&](int row) {
    for (int col = 0; col < width; ++col) {
      const Emitter& here = at(row, col);
      const float modulation = decoded.modulation(row, col);
      if (here.area_m2 == 0 || !(modulation > 0)) continue;
      float cosine = 0, sine = 0, sky = 0;
      for (const Offset& offset : offsets) {
        const int there_row = row + offset.row, there_col = col + offset.col;
        if (there_row < 0 || there_row >= height || there_col < 0 || there_col >= width) continue;
        const Emitter& there = at(there_row, there_col);
        if (there.area_m2 == 0) continue;
        const cv::Vec3f ray = there.point_m - here.point_m;
        const float square = ray.dot(ray), least = kFlat * std::sqrt(square);
        const float received = ray.dot(here.normal), sent = -ray.dot(there.normal);
        if (received <= least || sent <= least) continue;
        const float area = offset.pixels * there.area_m2;
        // Form factor of a disc, times pi: near ones fill no more than the sky.
        const float share = received * sent * area / (square * (square + per_pi * area));
        sky += share;
        cosine += share * there.cosine;
        sine += share * there.sine;
      }
      // Further bounces between the same surfaces form a geometric series.
      const float bounces = 1 / (1 - bounced * std::min(sky, 0.5f * kTwoPiFloat));
      sigma_px(row, col) = bounces * scale * std::sqrt(cosine * cosine + sine * sine) / modulation;
    }
  });
  // Normals are unknown at the crease itself, and the sum's phase changes within a few pixels.
  const auto largest = [](const cv::Mat1f& image, int radius_px) {
    cv::Mat1f result;
    cv::dilate(image, result, cv::Mat1b(2 * radius_px + 1, 2 * radius_px + 1, uchar{1}));
    return result;
  };
  const cv::Mat1f near = largest(sigma_px, kWithoutNormal_px);
  for_each_row(height, [&](int row) {
    for (int col = 0; col < width; ++col) {
      if (at(row, col).area_m2 == 0) sigma_px(row, col) = near(row, col);
    }
  });
  return largest(sigma_px, kSpread_px);
}

}  // namespace fringeslam
