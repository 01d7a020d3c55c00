// SPDX-License-Identifier: Apache-2.0
#include "core/depth/depth.h"

#include <cmath>
#include <limits>
#include <numbers>

#include "core/base/constants.h"
#include "core/base/parallel.h"
#include "core/depth/indirect_light.h"
#include "core/depth/normals.h"
#include "core/depth/texture_bias.h"
#include "core/types/error.h"

namespace fringeslam {

namespace {

// Maximum depth step between neighbours on one surface: the extent of a pixel on a surface of the maximum slope, plus
// noise.
struct StepLimit {
  float per_depth = 0;
  float operator()(float depth, float sigma) const { return per_depth * depth + 6 * sigma; }
};

}  // namespace

cv::Mat1b depth_image(const cv::Mat3f& points_m, double near_m, double far_m) {
  cv::Mat1b image(points_m.size());
  const double per_m = 255 / (far_m - near_m);
  for_each_row(points_m.rows, [&](int row) {
    const float* const points = points_m[row]->val;
    for (int col = 0; col < points_m.cols; ++col) {
      const double level = per_m * (far_m - static_cast<double>(points[3 * col + 2]));
      const double grey = std::min(std::max(level, 1.0), 255.0);
      image[row][col] = level == level ? static_cast<uchar>(static_cast<int>(grey + 0.5)) : uchar{0};
    }
  });
  return image;
}

namespace {

// Adds the noise caused by texture finer than the pixels. A pixel measures the mean phase over its footprint, weighted
// by brightness; the unknown position of the weighted mean causes an error proportional to the depth change across the
// pixel. It is negligible relative to the camera noise except at grazing incidence.
cv::Mat1f with_footprint_noise(const cv::Mat1f& sigma_m, const FitImage& image, double share, StepLimit limit) {
  cv::Mat1f result(sigma_m.size());
  const auto per_px = static_cast<float>(share);
  for_each_row(sigma_m.rows, [&](int row) {
    const float *const z = image.z[row], *const above = image.z[row - 1], *const below = image.z[row + 1];
    const float* const own = sigma_m[row];
    for (int col = 0; col < sigma_m.cols; ++col) {
      const float most = limit(z[col], own[col]);
      const auto change = [&](float depth) {
        const float step = std::abs(depth - z[col]);
        return step <= most ? step : 0.0f;
      };
      const float across = std::max(change(z[col - 1]), change(z[col + 1])),
                  along = std::max(change(above[col]), change(below[col]));
      result[row][col] = std::sqrt(own[col] * own[col] + per_px * per_px * (across * across + along * along));
    }
  });
  return result;
}

// The members of an ensemble modulate differently, so that a change of member looks like texture.
bool corrects_texture(const DecodedStack& decoded, const Triangulation& triangulation, const DepthOptions& options) {
  return options.texture_correction && decoded.finest_period_px > 0 && decoded.unwrapping != Unwrapping::ensemble &&
         decoded.modulation.size() == decoded.coordinate_px.size() && triangulation.modulation_shows_texture();
}

StepLimit step_limit(const Triangulation& triangulation, const DepthOptions& options) {
  return {static_cast<float>(std::tan(options.max_slope_deg * std::numbers::pi / 180) * triangulation.pixel_angle())};
}

}  // namespace

std::optional<double> corrected_spread_px2(const DecodedStack& decoded, const Triangulation& triangulation,
                                           const DepthOptions& options, double distance_m) {
  if (!corrects_texture(decoded, triangulation, options) || !triangulation.blur_is_stated()) return std::nullopt;
  return triangulation.point_spread().variance_px2(static_cast<float>(1 / distance_m));
}

void triangulate(Frame& frame, const DecodedStack& decoded, const Triangulation& triangulation,
                 const DepthOptions& options, InstructionSet set) {
  const cv::Size size = decoded.coordinate_px.size();
  if (size != triangulation.size())
    throw Error("depth: the images are " + std::to_string(size.width) + "x" + std::to_string(size.height) +
                " but the rig's camera has " + std::to_string(triangulation.size().width) + "x" +
                std::to_string(triangulation.size().height));
  if (decoded.sigma_px.size() != size || decoded.mean.size() != size)
    throw Error("depth: needs coordinate_px, sigma_px and mean (the texture) of the same size");
  frame.index = decoded.index;
  frame.timestamp_s = decoded.timestamp_s;
  frame.points_m.create(size);
  frame.sigma_m.create(size);
  frame.texture.create(size);
  cv::Mat1f depth(size.height + 2, size.width), sigma(size);
  depth.row(0).setTo(kNaN);
  depth.row(size.height + 1).setTo(kNaN);
  const float per_depth = step_limit(triangulation, options).per_depth;
  const auto max_sigma = static_cast<float>(options.max_sigma_m);
  const auto to_grey = static_cast<float>(255 / decoded.full_scale_dn);
  const bool corrects = corrects_texture(decoded, triangulation, options);
  const auto phase_per_px = static_cast<float>(corrects ? 2 * std::numbers::pi / decoded.finest_period_px : 0);
  for_each_range(size.height, [&](int first, int end) {
    std::vector<float> gradient(static_cast<size_t>(size.width)), noise(gradient.size());
    const std::vector<float> none(gradient.size(), 0.0f);
    for (int row = first; row < end; ++row) {
      TextureGradient texture{none.data(), none.data()};
      if (corrects && row >= kTextureBorder && row + kTextureBorder < size.height) {
        const auto rows = [&](const cv::Mat1f& image) {
          return FiveRows{image[row - 2], image[row - 1], image[row], image[row + 1], image[row + 2]};
        };
        texture_gradient_row(
            {rows(decoded.coordinate_px), rows(decoded.modulation), decoded.sigma_px[row], phase_per_px}, size.width,
            gradient.data(), noise.data(), set);
        texture = {gradient.data(), noise.data()};
      }
      triangulation.row(row, decoded.coordinate_px[row], decoded.sigma_px[row], max_sigma, depth[row + 1], sigma[row],
                        set, texture);
      const float* mean = decoded.mean[row];
      for (int col = 0; col < size.width; ++col)
        frame.texture[row][col] = static_cast<uchar>(std::clamp(to_grey * mean[col] + 0.5f, 0.0f, 255.0f));
    }
  });
  for_each_range(size.height, [&](int first, int end) {
    std::vector<float> kept(static_cast<size_t>(size.width));
    for (int row = first; row < end; ++row)
      points_row({depth[row], depth[row + 1], depth[row + 2], sigma[row], triangulation.rays()[row]}, size.width,
                 per_depth, kept.data(), frame.points_m[row], frame.sigma_m[row], set);
  });
}

namespace {

// True for codings that decode pixels beside creases with a bias that no residual shows. Several long periods contradict
// each other there, so that these pixels are dropped.
bool keeps_pixels_beside_creases(const DecodedStack& decoded) {
  const auto method = decoded.unwrapping;
  return decoded.filled_by_prediction || method == Unwrapping::predicted || method == Unwrapping::geometric ||
         method == Unwrapping::micro || method == Unwrapping::modulated || method == Unwrapping::gray ||
         method == Unwrapping::ensemble || method == Unwrapping::heterodyne;
}

bool accounts_for_indirect_light(const DecodedStack& decoded, const DepthOptions& options) {
  if (decoded.finest_period_px <= 0) return false;
  return options.indirect_light == IndirectLight::always ||
         (options.indirect_light == IndirectLight::automatic && keeps_pixels_beside_creases(decoded));
}

// Adds the coordinate's sigma due to nearby surfaces. `noise_m` is the sigma due to that of the coordinate alone.
void add_indirect_light(Frame& frame, const cv::Mat1f& noise_m, const DecodedStack& decoded, const RigModel& rig,
                        const DepthOptions& options) {
  const cv::Mat1f indirect_px = indirect_sigma_px(frame, decoded, rig, options.indirect_albedo);
  const auto most = static_cast<float>(options.max_sigma_m);
  for_each_row(frame.height(), [&](int row) {
    for (int col = 0; col < frame.width(); ++col) {
      const float added = indirect_px(row, col) * noise_m(row, col) / decoded.sigma_px(row, col);
      float& sigma = frame.sigma_m(row, col);
      if (!(added > 0)) continue;
      sigma = std::sqrt(sigma * sigma + added * added);
      if (sigma <= most) continue;
      sigma = kNaN;
      frame.points_m(row, col) = frame.normals(row, col) = cv::Vec3f::all(kNaN);
    }
  });
}

}  // namespace

Frame reconstruct(const DecodedStack& decoded, const RigModel& rig, const Triangulation& triangulation,
                  const DepthOptions& options) {
  check_options(options, "depth");
  Frame frame;
  triangulate(frame, decoded, triangulation, options);
  const StepLimit limit = step_limit(triangulation, options);
  const FitImage image(frame.points_m, triangulation.rays(), frame.sigma_m, options.normal_radius_px);
  frame.normals =
      estimate_normals(image, {options.normal_radius_px, limit.per_depth, static_cast<float>(options.max_normal_chi2)});
  const cv::Mat1f noise_m = frame.sigma_m;
  frame.sigma_m = with_footprint_noise(noise_m, image, options.footprint_noise, limit);
  if (accounts_for_indirect_light(decoded, options)) add_indirect_light(frame, noise_m, decoded, rig, options);
  frame.depth_image = depth_image(frame.points_m, rig.near_m, rig.far_m);
  return frame;
}

Frame reconstruct(const DecodedStack& decoded, const RigModel& rig, const PixelRays& rays,
                  const DepthOptions& options) {
  check_options(options, "depth");
  return reconstruct(decoded, rig, Triangulation(rig, rays, options.near_m, options.far_m), options);
}

}  // namespace fringeslam
