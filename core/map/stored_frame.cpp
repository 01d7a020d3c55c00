// SPDX-License-Identifier: Apache-2.0
#include "core/map/stored_frame.h"

#include <cmath>
#include <limits>

#include "core/types/parallel.h"

namespace fringeslam {

namespace {

constexpr float kMmPerM = 1e3f, kSteps = 32767;
constexpr short kNone = -32768;
constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();

short rounded(float value) { return static_cast<short>(std::lround(kSteps * value)); }

float sign_of(float value) { return value < 0 ? -1.0f : 1.0f; }

// The unit sphere folded onto a square: the lower half of an octahedron turned outwards.
cv::Vec2s folded(const cv::Vec3f& n) {
  if (std::isnan(n[0])) return {kNone, kNone};
  const float size = std::abs(n[0]) + std::abs(n[1]) + std::abs(n[2]);
  float x = n[0] / size, y = n[1] / size;
  if (n[2] < 0) {
    const float outer = (1 - std::abs(y)) * sign_of(x);
    y = (1 - std::abs(x)) * sign_of(y);
    x = outer;
  }
  return {rounded(x), rounded(y)};
}

cv::Vec3f unfolded(const cv::Vec2s& square) {
  if (square[0] == kNone) return {kNaN, kNaN, kNaN};
  float x = static_cast<float>(square[0]) / kSteps, y = static_cast<float>(square[1]) / kSteps;
  const float z = 1 - std::abs(x) - std::abs(y);
  if (z < 0) {
    const float inner = (1 - std::abs(y)) * sign_of(x);
    y = (1 - std::abs(x)) * sign_of(y);
    x = inner;
  }
  const float scale = 1 / std::sqrt(x * x + y * y + z * z);
  return {scale * x, scale * y, scale * z};
}

}  // namespace

StoredFrame stored(const Frame& frame) {
  StoredFrame result{frame.index, frame.timestamp_s, {}, {}, cv::Mat2s(frame.normals.size()), frame.texture.clone()};
  cv::extractChannel(frame.points_m, result.depth_m, 2);
  cv::convertFp16(cv::Mat1f(kMmPerM * frame.sigma_m), result.sigma);
  for_each_row(frame.height(), [&](int row) {
    for (int col = 0; col < frame.width(); ++col) result.normals(row, col) = folded(frame.normals(row, col));
  });
  return result;
}

Frame restored(const StoredFrame& stored, const PixelRays& rays) {
  Frame frame;
  frame.index = stored.index;
  frame.timestamp_s = stored.timestamp_s;
  frame.texture = stored.texture;
  frame.points_m.create(stored.depth_m.size());
  frame.normals.create(stored.depth_m.size());
  cv::Mat sigma_mm;
  cv::convertFp16(stored.sigma, sigma_mm);
  frame.sigma_m = cv::Mat1f(sigma_mm / kMmPerM);
  for_each_row(stored.depth_m.rows, [&](int row) {
    for (int col = 0; col < stored.depth_m.cols; ++col) {
      const float z = stored.depth_m(row, col);
      const cv::Vec2f& ray = rays(row, col);
      frame.points_m(row, col) = {z * ray[0], z * ray[1], z};
      frame.normals(row, col) = unfolded(stored.normals(row, col));
    }
  });
  return frame;
}

size_t bytes_of(const StoredFrame& stored) {
  return stored.depth_m.total() * (sizeof(float) + sizeof(short) + sizeof(cv::Vec2s) + sizeof(uchar));
}

}  // namespace fringeslam
