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
#include "core/types/selected_instruction_set.h"

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

// Light that the pixels reflect onto their surroundings. Fringes are phasors, whose sum shows how much of them averages out.
// The images have margins, so that every neighbour of a pixel exists; pixels without surface have no area.
struct Emitters {
  int margin;
  cv::Mat1f x, y, z, nx, ny, nz;  // point and normal
  cv::Mat1f area;                 // of the surface that a pixel sees, m^2
  cv::Mat1f cosine, sine;         // modulation times the phasor of the coordinate

  Emitters(const Frame& frame, const DecodedStack& decoded, const RigModel& rig, int radius) : margin(radius) {
    const int height = frame.height(), width = frame.width();
    for (cv::Mat1f* image : {&x, &y, &z, &nx, &ny, &nz, &area, &cosine, &sine})
      *image = cv::Mat1f::zeros(height, width + 2 * margin);
    const auto per_px = static_cast<float>(kTwoPi / decoded.finest_period_px);
    const auto pixel_area = static_cast<float>(1 / (rig.camera.fx * rig.camera.fy));
    constexpr float kLeastCosine = 0.05f;  // more oblique surfaces are hardly measured
    for_each_row(height, [&](int row) {
      for (int col = 0; col < width; ++col) {
        const cv::Vec3f &p = frame.points_m(row, col), &n = frame.normals(row, col);
        const float coordinate = decoded.coordinate_px(row, col), modulation = decoded.modulation(row, col);
        if (std::isnan(p[2]) || std::isnan(n[2]) || std::isnan(coordinate) || !(modulation > 0)) continue;
        const int at = col + margin;
        x(row, at) = p[0], y(row, at) = p[1], z(row, at) = p[2];
        nx(row, at) = n[0], ny(row, at) = n[1], nz(row, at) = n[2];
        const float facing_m = std::max(kLeastCosine * std::sqrt(p.dot(p)), std::abs(p.dot(n)));
        area(row, at) = pixel_area * p[2] * p[2] * p[2] / facing_m;
        cosine(row, at) = modulation * std::cos(per_px * coordinate);
        sine(row, at) = modulation * std::sin(per_px * coordinate);
      }
    });
  }

  bool exists(int row, int col) const { return area(row, col + margin) > 0; }
};

// One row of pixels, or of their neighbours.
struct EmitterRow {
  const float *x, *y, *z, *nx, *ny, *nz, *area, *cosine, *sine;

  EmitterRow(const Emitters& all, int row, int col)
      : x(all.x[row] + col),
        y(all.y[row] + col),
        z(all.z[row] + col),
        nx(all.nx[row] + col),
        ny(all.ny[row] + col),
        nz(all.nz[row] + col),
        area(all.area[row] + col),
        cosine(all.cosine[row] + col),
        sine(all.sine[row] + col) {}
};

// Sums over the neighbours: form factors times pi, and the light with them.
struct Received {
  float *sky, *cosine, *sine;
};

FRINGESLAM_INLINE void receive_body(EmitterRow here, EmitterRow there, float pixels, int width, Received sums) {
  // Flatter surfaces reflect no light onto each other: square of the sine of the angle above the horizon.
  constexpr float kFlat = 0.05f * 0.05f, kPerPi = static_cast<float>(1 / kPi);
#pragma GCC ivdep
  for (int i = 0; i < width; ++i) {
    const float x = there.x[i] - here.x[i], y = there.y[i] - here.y[i], z = there.z[i] - here.z[i];
    const float square = x * x + y * y + z * z, area = pixels * there.area[i];
    const float received = x * here.nx[i] + y * here.ny[i] + z * here.nz[i],
                sent = -(x * there.nx[i] + y * there.ny[i] + z * there.nz[i]);
    const float least = kFlat * square;
    const bool sees = (received > 0) & (sent > 0) & (received * received > least) & (sent * sent > least);
    // Form factor of a disc: near ones fill no more than the sky.
    const float factor = received * sent * area / (square * (square + kPerPi * area));
    const float share = sees ? factor : 0.0f;
    sums.sky[i] += share;
    sums.cosine[i] += share * there.cosine[i];
    sums.sine[i] += share * there.sine[i];
  }
}

}  // namespace

cv::Mat1f indirect_sigma_px(const Frame& frame, const DecodedStack& decoded, const RigModel& rig, double albedo) {
  if (frame.normals.size() != frame.points_m.size() || decoded.coordinate_px.size() != frame.points_m.size() ||
      decoded.modulation.size() != frame.points_m.size())
    throw Error("indirect light: the frame and the decoded images differ in size");
  constexpr double kPeriods = 2.5;    // light from farther away averages out
  constexpr int kSamplesAcross = 32;  // from a pixel to the end of its surroundings
  constexpr double kSigmas = 4, kMostAlbedo = 0.95;
  constexpr int kSpread_px = 2, kWithoutNormal_px = 3;
  const int height = frame.height(), width = frame.width();
  cv::Mat1f sigma_px(height, width, 0.0f);
  if (!(decoded.finest_period_px > 0)) return sigma_px;
  static const auto receive = Variants<receive_body>::of(selected_instruction_set());
  const double period = decoded.finest_period_px * rig.camera.fx / rig.projector.fx;  // camera pixels
  const int unit = std::max(1, static_cast<int>(std::lround(kPeriods * period / kSamplesAcross)));
  const std::vector<Offset> offsets = offsets_within(unit * kSamplesAcross, unit);
  const Emitters emitters(frame, decoded, rig, unit * kSamplesAcross);
  const auto bounced = static_cast<float>(std::min(albedo, kMostAlbedo) / kPi);
  const auto scale =
      static_cast<float>(albedo / kPi * decoded.finest_period_px / kTwoPi / kSigmas);  // phase error to sigma
  for_each_range(height, [&](int first, int end) {
    std::vector<float> sky(static_cast<size_t>(width)), cosine(sky.size()), sine(sky.size());
    for (int row = first; row < end; ++row) {
      for (std::vector<float>* sums : {&sky, &cosine, &sine}) std::fill(sums->begin(), sums->end(), 0.0f);
      const EmitterRow here(emitters, row, emitters.margin);
      for (const Offset& offset : offsets) {
        if (row + offset.row < 0 || row + offset.row >= height) continue;
        const EmitterRow there(emitters, row + offset.row, emitters.margin + offset.col);
        receive(here, there, offset.pixels, width, {sky.data(), cosine.data(), sine.data()});
      }
      for (int col = 0; col < width; ++col) {
        if (!emitters.exists(row, col)) continue;
        const auto i = static_cast<size_t>(col);
        // Further bounces between the same surfaces form a geometric series.
        const float bounces = 1 / (1 - bounced * std::min(sky[i], 0.5f * kTwoPiFloat));
        sigma_px(row, col) =
            bounces * scale * std::sqrt(cosine[i] * cosine[i] + sine[i] * sine[i]) / decoded.modulation(row, col);
      }
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
      if (!emitters.exists(row, col)) sigma_px(row, col) = near(row, col);
    }
  });
  return largest(sigma_px, kSpread_px);
}

}  // namespace fringeslam
