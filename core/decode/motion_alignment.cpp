// SPDX-License-Identifier: Apache-2.0
#include "core/decode/motion_alignment.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "core/base/constants.h"
#include "core/base/instruction_set.h"
#include "core/base/parallel.h"
#include "core/decode/cubic_convolution.h"
#include "core/types/error.h"
#include "core/types/projection.h"

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

void project_portable(const Projection& p, const float* ray, const float* depth, int width, float* u, float* v) {
  project_body(p, ray, depth, width, u, v);
}
FRINGESLAM_AVX2 void project_avx2(const Projection& p, const float* ray, const float* depth, int width, float* u,
                                  float* v) {
  project_body(p, ray, depth, width, u, v);
}
FRINGESLAM_AVX512 void project_avx512(const Projection& p, const float* ray, const float* depth, int width, float* u,
                                      float* v) {
  project_body(p, ray, depth, width, u, v);
}

template <class Grey>
float sample(const cv::Mat& image, float u, float v) {
  const int col = static_cast<int>(u), row = static_cast<int>(v);  // both at least 1
  const CubicWeights across(u - static_cast<float>(col)), along(v - static_cast<float>(row));
  float sum = 0;
  for (int j = 0; j < 4; ++j) {
    const Grey* grey = image.ptr<Grey>(row - 1 + j) + col - 1;
    float line = 0;
    for (int i = 0; i < 4; ++i) line += across.weight[i] * static_cast<float>(grey[i]);
    sum += along.weight[j] * line;
  }
  return sum;
}

template <class Grey>
void sample_row(const cv::Mat& image, const float* u, const float* v, float* grey, float* drift) {
  const auto right = static_cast<float>(image.cols - 2), bottom = static_cast<float>(image.rows - 2);
  for (int i = 0; i < image.cols; ++i) {
    const bool inside = u[i] >= 1 && v[i] >= 1 && u[i] < right && v[i] < bottom;
    grey[i] = inside ? sample<Grey>(image, u[i], v[i]) : 0.0f;
    if (!inside) drift[i] = kNaN;
  }
}

// Factors that give grey values the brightness of the reference time: one image per exposure, a pixel for each
// kCell x kCell pixels of the camera, within which brightness changes hardly.
constexpr int kCell = 8;

std::vector<cv::Mat1f> brightness_shares(const RigModel& rig, const PixelRays& rays, const cv::Mat1f& depth_m,
                                         const std::vector<Pose>& exposures_from_reference) {
  // At depth steps and in grazing light, the normal of the averaged surface is not that of any surface.
  constexpr double kLeastCosine = 0.3;
  const cv::Size size((depth_m.cols + kCell - 1) / kCell, (depth_m.rows + kCell - 1) / kCell);
  cv::Mat1f depth;
  cv::Mat2f directions;
  cv::resize(depth_m, depth, size, 0, 0, cv::INTER_AREA);
  cv::resize(rays, directions, size, 0, 0, cv::INTER_AREA);
  const auto point_at = [&](int row, int col) {
    const cv::Vec2f& ray = directions(row, col);
    const auto z = static_cast<double>(depth(row, col));
    return Eigen::Vector3d(z * static_cast<double>(ray[0]), z * static_cast<double>(ray[1]), z);
  };
  std::vector<cv::Mat1f> shares(exposures_from_reference.size());
  for (cv::Mat1f& share : shares) share = cv::Mat1f(size, 1.0f);
  for (int row = 1; row + 1 < size.height; ++row) {
    for (int col = 1; col + 1 < size.width; ++col) {
      const Eigen::Vector3d point = point_at(row, col);
      Eigen::Vector3d normal = (point_at(row, col + 1) - point_at(row, col - 1))
                                   .cross(point_at(row + 1, col) - point_at(row - 1, col))
                                   .normalized();
      const Eigen::Vector3d lit = rig.projector_from_camera * point;
      const Eigen::Vector3d light = rig.projector_from_camera.rotation.transpose() * lit.normalized();
      if (!(std::abs(normal.dot(light)) > kLeastCosine)) normal = light;
      const double reference = relative_brightness(rig, point, normal);
      for (size_t k = 0; k < shares.size(); ++k) {
        const Pose& exposure = exposures_from_reference[k];
        const double share = reference / relative_brightness(rig, exposure * point, exposure.rotation * normal);
        if (std::isfinite(share)) shares[k](row, col) = static_cast<float>(share);
      }
    }
  }
  for (cv::Mat1f& share : shares) {
    if (size.width > 2 && size.height > 2)
      cv::copyMakeBorder(share(cv::Rect(1, 1, size.width - 2, size.height - 2)), share, 1, 1, 1, 1,
                         cv::BORDER_REPLICATE | cv::BORDER_ISOLATED);
  }
  return shares;
}

}  // namespace

double relative_brightness(const RigModel& rig, const Eigen::Vector3d& point, const Eigen::Vector3d& normal) {
  const Eigen::Vector3d from_projector = rig.projector_from_camera * point;
  const double distance = from_projector.norm(), cosine = from_projector.z() / distance;
  const double facing = std::abs((rig.projector_from_camera.rotation * normal).dot(from_projector));
  return facing / (distance * distance * distance) * std::pow(cosine, rig.projector_lens.vignetting - 3) *
         std::pow(point.z() / point.norm(), rig.camera_lens.vignetting);
}

AlignedStack align_stack(const FringeStack& stack, const RigModel& rig, const PixelRays& rays, const cv::Mat1f& depth_m,
                         const CameraMotion& motion, Axis axis) {
  check_stack(stack);
  static const auto project = widest(project_portable, project_avx2, project_avx512);
  const cv::Size size = rays.size();
  if (depth_m.size() != size || stack.images.front().size() != size)
    throw Error("motion: the images, the depth and the camera differ in size");
  const size_t images = stack.images.size();
  std::vector<Projection> camera, projector;
  std::vector<bool> moved;
  std::vector<Pose> exposures_from_reference;
  for (const double time_s : stack.exposure_time_s) {
    const Pose exposure_from_reference = motion.at(time_s - stack.timestamp_s).inverse();
    exposures_from_reference.push_back(exposure_from_reference);
    camera.emplace_back(exposure_from_reference, rig.camera);
    projector.emplace_back(rig.projector_from_camera * exposure_from_reference, rig.projector);
    moved.push_back(time_s != stack.timestamp_s);
  }
  const Projection reference(rig.projector_from_camera, rig.projector);
  AlignedStack aligned;
  for (size_t k = 0; k < images; ++k) {
    aligned.images.emplace_back(size);
    aligned.drift_px.emplace_back(size);
  }
  const std::vector<cv::Mat1f> shares = brightness_shares(rig, rays, depth_m, exposures_from_reference);
  const auto offset = static_cast<float>(rig.sensor.offset_dn);
  for_each_range(size.height, [&](int first, int end) {
    const auto width = static_cast<size_t>(size.width);
    std::vector<float> buffer(4 * width);
    float *const u = buffer.data(), *const v = u + width, *const at = v + width, *const other = at + width;
    for (int row = first; row < end; ++row) {
      const float *const ray = &rays[row][0][0], *const depth = depth_m[row];
      project(reference, ray, depth, size.width, at, other);
      if (axis == Axis::rows) std::copy_n(other, width, at);
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
        if (image.depth() == CV_8U)
          sample_row<uchar>(image, u, v, grey, drift);
        else if (image.depth() == CV_16U)
          sample_row<ushort>(image, u, v, grey, drift);
        else
          sample_row<float>(image, u, v, grey, drift);
        const float* const share = shares[k][row / kCell];
        for (size_t i = 0; i < width; ++i) grey[i] = offset + share[i / kCell] * (grey[i] - offset);
      }
    }
  });
  return aligned;
}

cv::Mat1f filled_depth(const cv::Mat1f& depth_m, double otherwise_m) {
  // Halves the image until one pixel is left, averaging what is known; then fills from there.
  std::vector<cv::Mat1f> levels = {depth_m};
  while (levels.back().rows > 1 || levels.back().cols > 1) {
    const cv::Mat1f& fine = levels.back();
    cv::Mat1f coarse((fine.rows + 1) / 2, (fine.cols + 1) / 2);
    for (int row = 0; row < coarse.rows; ++row) {
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
    }
    levels.push_back(std::move(coarse));
  }
  if (std::isnan(levels.back()(0, 0))) levels.back()(0, 0) = static_cast<float>(otherwise_m);
  levels.front() = depth_m.clone();
  for (size_t level = levels.size() - 1; level-- > 0;) {
    cv::Mat1f& fine = levels[level];
    const cv::Mat1f& coarse = levels[level + 1];
    for (int row = 0; row < fine.rows; ++row) {
      const float* from = coarse[row / 2];
      for (int col = 0; col < fine.cols; ++col) {
        if (std::isnan(fine[row][col])) fine[row][col] = from[col / 2];
      }
    }
  }
  return levels.front();
}

}  // namespace fringeslam
