// SPDX-License-Identifier: Apache-2.0
#include "core/decode/motion_alignment.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>

#include "core/base/constants.h"
#include "core/base/cubic_spline.h"
#include "core/base/parallel.h"
#include "core/base/symmetric_filter.h"
#include "core/types/error.h"
#include "core/types/irradiance.h"
#include "core/types/projection.h"
#include "core/types/selected_instruction_set.h"

namespace fringeslam {

namespace {

// Projects the points of a row, seen along `ray` at `depth`; u and v are NaN behind the lens.
FRINGESLAM_INLINE void project_body(const Projection& p, const float* ray, const float* depth, int width,
                                    float* __restrict u, float* __restrict v) {
#pragma GCC ivdep
  for (int i = 0; i < width; ++i) {
    const float z = depth[i], px = z * ray[2 * i], py = z * ray[2 * i + 1];
    const float x = p.r[0] * px + p.r[1] * py + p.r[2] * z + p.t[0];
    const float y = p.r[3] * px + p.r[4] * py + p.r[5] * z + p.t[1];
    const float w = p.r[6] * px + p.r[7] * py + p.r[8] * z + p.t[2];
    const float a = x / w, b = y / w, r2 = a * a + b * b, radial = 1 + r2 * (p.k1 + r2 * (p.k2 + r2 * p.k3));
    const float at_u = p.fx * (a * radial + 2 * p.p1 * a * b + p.p2 * (r2 + 2 * a * a)) + p.cx;
    const float at_v = p.fy * (b * radial + p.p1 * (r2 + 2 * b * b) + 2 * p.p2 * a * b) + p.cy;
    u[i] = w > 0 ? at_u : kNaN;
    v[i] = w > 0 ? at_v : kNaN;
  }
}

// Rows of the image of viewing rays and of the smooth depth: above, at and below a row.
struct SurfaceRows {
  const float *ray[3], *depth[3];
};

// Writes six values per point of a row: the derivatives of the logarithm of its brightness, with the normal of the smooth
// surface.
FRINGESLAM_INLINE void brightness_body(const Irradiance<float>& irradiance, const SurfaceRows& rows, int width,
                                       float* __restrict out) {
  const float *const ray = rows.ray[1], *const ray_above = rows.ray[0], *const ray_below = rows.ray[2];
  const float *const level = rows.depth[1], *const above = rows.depth[0], *const below = rows.depth[2];
#pragma GCC ivdep
  for (int i = 1; i < width - 1; ++i) {
    const float across_z = level[i + 1] - level[i - 1], down_z = below[i] - above[i];
    const float across_x = level[i + 1] * ray[2 * i + 2] - level[i - 1] * ray[2 * i - 2],
                across_y = level[i + 1] * ray[2 * i + 3] - level[i - 1] * ray[2 * i - 1];
    const float down_x = below[i] * ray_below[2 * i] - above[i] * ray_above[2 * i],
                down_y = below[i] * ray_below[2 * i + 1] - above[i] * ray_above[2 * i + 1];
    const float normal[3] = {across_y * down_z - across_z * down_y, across_z * down_x - across_x * down_z,
                             across_x * down_y - across_y * down_x};
    const float point[3] = {level[i] * ray[2 * i], level[i] * ray[2 * i + 1], level[i]};
    const auto slope = irradiance.slope(point, normal);
    for (int k = 0; k < 3; ++k) {
      out[k * width + i] = slope.by_shift[k];
      out[(3 + k) * width + i] = slope.by_turn[k];
    }
  }
}

// Converts grey values at a moved pose to those at the reference pose, to second order. The change is limited, because
// normals at depth steps are those of no surface.
FRINGESLAM_INLINE void rescale_body(const Projection& p, const float* turn, const float* ray, const float* depth,
                                    const float* slope, float offset, int width, float* __restrict grey) {
#pragma GCC ivdep
  for (int i = 1; i < width - 1; ++i) {
    const float z = depth[i], px = z * ray[2 * i], py = z * ray[2 * i + 1];
    const float x = (p.r[0] - 1) * px + p.r[1] * py + p.r[2] * z + p.t[0];
    const float y = p.r[3] * px + (p.r[4] - 1) * py + p.r[5] * z + p.t[1];
    const float w = p.r[6] * px + p.r[7] * py + (p.r[8] - 1) * z + p.t[2];
    const float change = slope[i] * x + slope[width + i] * y + slope[2 * width + i] * w +
                         slope[3 * width + i] * turn[0] + slope[4 * width + i] * turn[1] +
                         slope[5 * width + i] * turn[2];
    constexpr float kMost = 0.1f;
    const float brighter = change > kMost ? kMost : (change < -kMost ? -kMost : change);
    grey[i] = offset + (1 - brighter * (1 - 0.5f * brighter)) * (grey[i] - offset);
  }
}

float sample(const cv::Mat1f& coefficients, float u, float v) {
  const int col = static_cast<int>(u), row = static_cast<int>(v);  // both at least 1
  const SplineWeights across(u - static_cast<float>(col)), down(v - static_cast<float>(row));
  return weighted_sum(coefficients[row - 1] + col - 1, static_cast<std::ptrdiff_t>(coefficients.step1()), across.weight,
                      down.weight);
}

// True at pixels whose spline weights, from one row and column before to two behind, include a saturated pixel. Empty: no
// pixel is saturated.
cv::Mat1b saturated_support(const cv::Mat& image, double clip_dn) {
  cv::Mat1b saturated;
  cv::compare(image, clip_dn, saturated, cv::CMP_GE);
  if (cv::countNonZero(saturated) == 0) return {};
  constexpr int kSupport = 4;
  cv::Mat1b support;
  cv::dilate(saturated, support, cv::Mat1b::ones(kSupport, kSupport), {1, 1});
  return support;
}

void sample_row(const cv::Mat1f& coefficients, const cv::Mat1b& saturated, const float* u, const float* v, float* grey,
                float* drift) {
  const auto right = static_cast<float>(coefficients.cols - 2), bottom = static_cast<float>(coefficients.rows - 2);
  for (int i = 0; i < coefficients.cols; ++i) {
    const bool inside = u[i] >= 1 && v[i] >= 1 && u[i] < right && v[i] < bottom;
    grey[i] = inside ? sample(coefficients, u[i], v[i]) : 0.0f;
    const bool hidden = inside && !saturated.empty() && saturated(static_cast<int>(v[i]), static_cast<int>(u[i])) != 0;
    if (!inside || hidden) drift[i] = kNaN;
  }
}

}  // namespace

AlignedStack align_stack(const FringeStack& stack, const RigModel& rig, const PixelRays& rays, const cv::Mat1f& depth_m,
                         const CameraMotion& motion, double clip_dn, Axis axis) {
  check_stack(stack);
  static const auto project = Variants<project_body>::of(selected_instruction_set());
  static const auto brightness = Variants<brightness_body>::of(selected_instruction_set());
  static const auto rescale = Variants<rescale_body>::of(selected_instruction_set());
  const cv::Size size = rays.size();
  if (depth_m.size() != size || stack.images.front().size() != size)
    throw Error("motion: the images, the depth and the camera differ in size");
  const size_t images = stack.images.size();
  std::vector<Projection> camera, projector;
  std::vector<bool> moved;
  std::vector<std::array<float, 3>> turn;
  for (const double time_s : stack.exposure_time_s) {
    const Pose exposure_from_reference = motion.at(time_s - stack.timestamp_s).inverse();
    camera.emplace_back(exposure_from_reference, rig.camera);
    projector.emplace_back(rig.projector_from_camera * exposure_from_reference, rig.projector);
    moved.push_back(time_s != stack.timestamp_s);
    const Eigen::Vector3d rotation = rotation_log(exposure_from_reference.rotation);
    turn.push_back(
        {static_cast<float>(rotation.x()), static_cast<float>(rotation.y()), static_cast<float>(rotation.z())});
  }
  const auto filter = spline_prefilter();
  const std::vector<float> half(filter.begin() + filter.size() / 2, filter.end());
  std::vector<cv::Mat1f> coefficients(images);
  std::vector<cv::Mat1b> saturated(images);
  for_each_row(static_cast<int>(images), [&](int image) {
    const auto k = static_cast<size_t>(image);
    if (!moved[k]) return;
    coefficients[k] = filtered(stack.images[k], half, FilterBorder::mirrored, selected_instruction_set());
    // The bits of a code may be saturated.
    if (stack.patterns.patterns[k].coding == Coding::fringe) saturated[k] = saturated_support(stack.images[k], clip_dn);
  });
  // Normals at the scale of a few fringes: the depths' noise averages out.
  constexpr int kSmooth_px = 11;
  cv::Mat1f smooth_m;
  cv::blur(filled_depth(depth_m, rig.middle_range_m()), smooth_m, {kSmooth_px, kSmooth_px});
  cv::blur(smooth_m, smooth_m, {kSmooth_px, kSmooth_px});
  const Irradiance<float> irradiance(rig);
  const auto offset_dn = static_cast<float>(rig.sensor.offset_dn);
  const Projection reference(rig.projector_from_camera, rig.projector);
  AlignedStack aligned;
  for (size_t k = 0; k < images; ++k) {
    aligned.images.emplace_back(size);
    aligned.drift_px.emplace_back(size);
  }
  for_each_range(size.height, [&](int first, int end) {
    const auto width = static_cast<size_t>(size.width);
    std::vector<float> buffer(10 * width);
    float *const u = buffer.data(), *const v = u + width, *const at = v + width, *const other = at + width,
                 *const slope = other + width;
    for (int row = first; row < end; ++row) {
      const float *const ray = &rays[row][0][0], *const depth = depth_m[row];
      project(reference, ray, depth, size.width, at, other);
      if (axis == Axis::rows) std::copy_n(other, width, at);
      const int above = std::max(row - 1, 0), below = std::min(row + 1, size.height - 1);
      brightness(irradiance,
                 {{&rays[above][0][0], ray, &rays[below][0][0]}, {smooth_m[above], smooth_m[row], smooth_m[below]}},
                 size.width, slope);
      for (size_t k = 0; k < images; ++k) {
        const cv::Mat& image = stack.images[k];
        float *const grey = aligned.images[k][row], *const drift = aligned.drift_px[k][row];
        if (!moved[k]) {
          image.row(row).convertTo(aligned.images[k].row(row), CV_32F);
          std::fill_n(drift, width, 0.0f);
          continue;
        }
        project(projector[k], ray, depth, size.width, u, v);
        const float* coordinate = axis == Axis::columns ? u : v;
        for (size_t i = 0; i < width; ++i) drift[i] = coordinate[i] - at[i];
        project(camera[k], ray, depth, size.width, u, v);
        sample_row(coefficients[k], saturated[k], u, v, grey, drift);
        rescale(camera[k], turn[k].data(), ray, depth, slope, offset_dn, size.width, grey);
      }
    }
  });
  return aligned;
}

namespace {

// Variance of a coordinate relative to that of unit noise and modulation, by least squares for mean, cosine and sine;
// infinite if the samples do not determine them, NaN if one is missing.
double coordinate_variance(const AlignedStack& aligned, const FringeGroup& group, int row, int col) {
  double cosines = 0, sines = 0, cc = 0, ss = 0, cs = 0;
  for (size_t i = 0; i < group.images.size(); ++i) {
    const float drift_px = aligned.drift_px[static_cast<size_t>(group.images[i])](row, col);
    const double phase = group.shifts_rad[i] + kTwoPi * static_cast<double>(drift_px) / group.period_px;
    const double c = std::cos(phase), s = std::sin(phase);
    cosines += c;
    sines += s;
    cc += c * c;
    ss += s * s;
    cs += c * s;
  }
  const auto n = static_cast<double>(group.images.size());
  cc -= cosines * cosines / n;
  ss -= sines * sines / n;
  cs -= cosines * sines / n;
  const double determinant = cc * ss - cs * cs, infinite = std::numeric_limits<double>::infinity();
  if (std::isnan(determinant)) return determinant;
  return determinant > 0 ? group.period_px * group.period_px * (cc + ss) / determinant : infinite;
}

}  // namespace

std::optional<double> median_drift_px(const RigModel& rig, const std::vector<Eigen::Vector3d>& points_m,
                                      const Pose& exposure_from_reference, Axis axis) {
  const int coordinate = axis == Axis::columns ? 0 : 1;
  std::vector<double> drifts_px;
  for (const Eigen::Vector3d& point : points_m) {
    const Eigen::Vector3d here = rig.projector_from_camera * point,
                          there = rig.projector_from_camera * (exposure_from_reference * point);
    if (here.z() > 0 && there.z() > 0)
      drifts_px.push_back((rig.projector.project(there) - rig.projector.project(here))[coordinate]);
  }
  if (drifts_px.empty()) return std::nullopt;
  const auto middle = drifts_px.begin() + static_cast<std::ptrdiff_t>(drifts_px.size() / 2);
  std::nth_element(drifts_px.begin(), middle, drifts_px.end());
  return *middle;
}

size_t most_accurate_group(const AlignedStack& aligned, const std::vector<FringeGroup>& groups) {
  constexpr int kStride = 16;
  size_t best = groups.size() - 1;
  double least = std::numeric_limits<double>::infinity();
  for (size_t g = groups.size(); g-- > 0;) {
    const cv::Mat1f& drift_px = aligned.drift_px[static_cast<size_t>(groups[g].images.front())];
    std::vector<double> variances;
    for (int row = kStride / 2; row < drift_px.rows; row += kStride) {
      for (int col = kStride / 2; col < drift_px.cols; col += kStride) {
        const double variance = coordinate_variance(aligned, groups[g], row, col);
        if (!std::isnan(variance)) variances.push_back(variance);
      }
    }
    if (variances.empty()) continue;
    const auto middle = variances.begin() + static_cast<std::ptrdiff_t>(variances.size() / 2);
    std::nth_element(variances.begin(), middle, variances.end());
    if (*middle < least) {
      least = *middle;
      best = g;
    }
  }
  return best;
}

cv::Mat1f filled_depth(const cv::Mat1f& depth_m, double otherwise_m) {
  if (cv::checkRange(depth_m, true)) return depth_m;
  // Halves the image until one pixel is left, averaging what is known; then fills from there.
  std::vector<cv::Mat1f> levels = {depth_m};
  while (levels.back().rows > 1 || levels.back().cols > 1) {
    const cv::Mat1f& fine = levels.back();
    cv::Mat1f coarse((fine.rows + 1) / 2, (fine.cols + 1) / 2);
    for_each_row(coarse.rows, [&](int row) {
      const float *const above = fine[2 * row], *const below = fine[std::min(2 * row + 1, fine.rows - 1)];
      for (int col = 0; col < coarse.cols; ++col) {
        const int left = 2 * col, right = std::min(2 * col + 1, fine.cols - 1);
        float sum = 0, count = 0;
        for (const float depth : {above[left], above[right], below[left], below[right]}) {
          const bool known = depth == depth;
          sum += known ? depth : 0;
          count += known;
        }
        coarse[row][col] = count > 0 ? sum / count : kNaN;
      }
    });
    levels.push_back(std::move(coarse));
  }
  if (std::isnan(levels.back()(0, 0))) levels.back()(0, 0) = static_cast<float>(otherwise_m);
  levels.front() = depth_m.clone();
  for (size_t level = levels.size() - 1; level-- > 0;) {
    cv::Mat1f& fine = levels[level];
    const cv::Mat1f& coarse = levels[level + 1];
    for_each_row(fine.rows, [&](int row) {
      float* const to = fine[row];
      const float* const from = coarse[row / 2];
      for (int col = 0; col < fine.cols; ++col) to[col] = std::isnan(to[col]) ? from[col / 2] : to[col];
    });
  }
  return levels.front();
}

}  // namespace fringeslam
