// SPDX-License-Identifier: Apache-2.0
#include "tools/live/keyframe_points.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <vector>

namespace fringeslam::tools {

namespace {

static_assert(std::endian::native == std::endian::little);

struct Point {
  cv::Vec3f position_m;
  uint8_t grey = 0, sigma = 0;
};

int stride_for(const cv::Size& size, int most) {
  int stride = 1;
  const auto points = [&] { return ((size.width + stride - 1) / stride) * ((size.height + stride - 1) / stride); };
  while (points() > most) ++stride;
  return stride;
}

std::vector<Point> grid_points(const StoredFrame& stored_frame, const PixelRays& rays, int stride) {
  const Frame frame = restored(stored_frame, rays);
  std::vector<Point> points;
  for (int row = 0; row < frame.height(); row += stride) {
    for (int col = 0; col < frame.width(); col += stride) {
      if (!frame.valid(row, col)) continue;
      const double sigma = std::round(static_cast<double>(frame.sigma_m(row, col)) / kSigmaStepM);
      points.push_back(
          {frame.points_m(row, col), frame.texture(row, col), static_cast<uint8_t>(std::min(255.0, sigma))});
    }
  }
  return points;
}

template <class Value>
void append(std::string& bytes, const Value& value) {
  char raw[sizeof value];
  std::memcpy(raw, &value, sizeof value);
  bytes.append(raw, sizeof value);
}

}  // namespace

std::string keyframe_points(const StoredFrame& frame, const PixelRays& rays, int most) {
  const std::vector<Point> points = grid_points(frame, rays, stride_for(frame.depth_m.size(), most));
  float largest = 1e-3f;
  for (const Point& p : points) {
    for (int axis = 0; axis < 3; ++axis) largest = std::max(largest, std::abs(p.position_m[axis]));
  }
  const float step_m = largest / 32767;
  std::string bytes;
  append(bytes, static_cast<uint32_t>(points.size()));
  append(bytes, step_m);
  append(bytes, static_cast<float>(kSigmaStepM));
  for (const Point& p : points) {
    for (int axis = 0; axis < 3; ++axis) append(bytes, static_cast<int16_t>(std::lround(p.position_m[axis] / step_m)));
  }
  for (const Point& p : points) append(bytes, p.grey);
  for (const Point& p : points) append(bytes, p.sigma);
  return bytes;
}

}  // namespace fringeslam::tools
