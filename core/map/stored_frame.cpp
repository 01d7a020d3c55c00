// SPDX-License-Identifier: Apache-2.0
#include "core/map/stored_frame.h"

#include <xxhash.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/base/constants.h"
#include "core/base/parallel.h"
#include "core/types/error.h"
#include "core/types/selected_instruction_set.h"

namespace fringeslam {

namespace {

constexpr float kMmPerM = 1e3f, kSteps = 32767;
constexpr short kNone = -32768;

FRINGESLAM_INLINE short rounded(float steps) {
  return static_cast<short>(static_cast<int>(steps + kSteps + 0.5f) - static_cast<int>(kSteps));
}

// Octahedral encoding: maps the unit sphere to a square, with the lower half of the octahedron folded outwards. Three
// values per normal, two per encoded normal.
FRINGESLAM_INLINE void fold_body(const float* normals, int count, short* __restrict squares) {
  for (int i = 0; i < count; ++i) {
    const float nx = normals[3 * i], ny = normals[3 * i + 1], nz = normals[3 * i + 2];
    const float size = std::abs(nx) + std::abs(ny) + std::abs(nz);
    const bool none = !(size > 0);  // also for NaN
    const float x = none ? 0 : nx / size, y = none ? 0 : ny / size;
    const float outer_x = (1 - std::abs(y)) * (x < 0 ? -1.0f : 1.0f),
                outer_y = (1 - std::abs(x)) * (y < 0 ? -1.0f : 1.0f);
    const short to_x = rounded(kSteps * (nz < 0 ? outer_x : x)), to_y = rounded(kSteps * (nz < 0 ? outer_y : y));
    squares[2 * i] = none ? kNone : to_x, squares[2 * i + 1] = none ? kNone : to_y;
  }
}

FRINGESLAM_INLINE void unfold_body(const short* squares, int count, float* __restrict normals) {
  for (int i = 0; i < count; ++i) {
    const short to_x = squares[2 * i], to_y = squares[2 * i + 1];
    const float x = static_cast<float>(to_x) / kSteps, y = static_cast<float>(to_y) / kSteps;
    const float z = 1 - std::abs(x) - std::abs(y);
    const float inner_x = (1 - std::abs(y)) * (x < 0 ? -1.0f : 1.0f),
                inner_y = (1 - std::abs(x)) * (y < 0 ? -1.0f : 1.0f);
    const float nx = z < 0 ? inner_x : x, ny = z < 0 ? inner_y : y;
    const float scale = 1 / std::sqrt(nx * nx + ny * ny + z * z), whole = to_x == kNone ? kNaN : scale;
    normals[3 * i] = whole * nx, normals[3 * i + 1] = whole * ny, normals[3 * i + 2] = whole * z;
  }
}

FRINGESLAM_INLINE void place_body(const float* depths, const float* rays, int count, float* __restrict points) {
  for (int i = 0; i < count; ++i) {
    const float z = depths[i];
    points[3 * i] = z * rays[2 * i], points[3 * i + 1] = z * rays[2 * i + 1], points[3 * i + 2] = z;
  }
}

constexpr int kLanes = 16;

// Smallest and largest world coordinate of a row's points per lane; `m` is the axis' row of the camera's pose.
struct AxisBounds {
  float low[kLanes], high[kLanes];
};

FRINGESLAM_INLINE void bounds_body(const float* depths, const float* rays, int count, const float* m,
                                   AxisBounds& __restrict bounds) {
  for (int first = 0; first < count; first += kLanes) {
    const int lanes = count - first < kLanes ? count - first : kLanes;
    for (int lane = 0; lane < lanes; ++lane) {
      const int i = first + lane;
      const float z = depths[i] > 0 ? depths[i] : kNaN;
      const float at = z * (m[0] * rays[2 * i] + m[1] * rays[2 * i + 1] + m[2]);
      bounds.low[lane] = at < bounds.low[lane] ? at : bounds.low[lane];
      bounds.high[lane] = at > bounds.high[lane] ? at : bounds.high[lane];
    }
  }
}

}  // namespace

std::vector<WorldBox> boxes_of(const StoredFrame& stored, const PixelRays& rays, const Pose& world_from_camera) {
  static const auto bounds = Variants<bounds_body>::of(selected_instruction_set());
  if (stored.check) stored.check->check(stored);  // damaged depths could span any number of boxes
  constexpr int kBlock = 64;                      // pixels
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  constexpr double kRounding = 1e-6;  // of floats, relative
  const cv::Mat1f& depth_m = stored.depth_m;
  std::vector<WorldBox> boxes;
  for (int top = 0; top < depth_m.rows; top += kBlock) {
    for (int left = 0; left < depth_m.cols; left += kBlock) {
      WorldBox box;
      bool empty = false;
      for (int k = 0; k < 3; ++k) {
        AxisBounds axis;
        std::fill_n(axis.low, kLanes, kInfinity), std::fill_n(axis.high, kLanes, -kInfinity);
        // The position of the camera is added at the end, since floats are too coarse far from the origin.
        const float m[3] = {static_cast<float>(world_from_camera.rotation(k, 0)),
                            static_cast<float>(world_from_camera.rotation(k, 1)),
                            static_cast<float>(world_from_camera.rotation(k, 2))};
        for (int row = top; row < std::min(top + kBlock, depth_m.rows); ++row)
          bounds(depth_m[row] + left, rays[row][left].val, std::min(kBlock, depth_m.cols - left), m, axis);
        const auto low = static_cast<double>(*std::min_element(axis.low, axis.low + kLanes));
        const auto high = static_cast<double>(*std::max_element(axis.high, axis.high + kLanes));
        empty |= !(low <= high);
        const double rounding = kRounding * (std::abs(low) + std::abs(high));
        box.low_m[k] = world_from_camera.translation[k] + low - rounding;
        box.high_m[k] = world_from_camera.translation[k] + high + rounding;
      }
      if (!empty) boxes.push_back(box);
    }
  }
  return boxes;
}

uint64_t checksum_of(const StoredFrame& frame) {
  uint64_t sum = 0;
  for (const cv::Mat& image :
       {cv::Mat(frame.depth_m), cv::Mat(frame.sigma), cv::Mat(frame.normals), cv::Mat(frame.texture)})
    sum = XXH64(image.data, image.total() * image.elemSize(), sum);
  return sum;
}

void FrameCheck::check(const StoredFrame& frame) const {
  std::call_once(once_, [&] {
    if (checksum_of(frame) != checksum_)
      throw Error(where_ + ": is damaged (the checksum of a frame is wrong); create the map again");
  });
}

StoredFrame stored(const Frame& frame) {
  StoredFrame result{frame.index, frame.timestamp_s, {}, {}, cv::Mat2s(frame.normals.size()), frame.texture.clone(),
                     {}};
  cv::extractChannel(frame.points_m, result.depth_m, 2);
  cv::convertFp16(cv::Mat1f(kMmPerM * frame.sigma_m), result.sigma);
  static const auto fold = Variants<fold_body>::of(selected_instruction_set());
  for_each_row(frame.height(),
               [&](int row) { fold(frame.normals[row]->val, frame.width(), result.normals[row]->val); });
  return result;
}

Frame restored(const StoredFrame& stored, const PixelRays& rays) {
  if (stored.check) stored.check->check(stored);
  Frame frame;
  frame.index = stored.index;
  frame.timestamp_s = stored.timestamp_s;
  frame.texture = stored.texture;
  frame.points_m.create(stored.depth_m.size());
  frame.normals.create(stored.depth_m.size());
  cv::Mat sigma_mm;
  cv::convertFp16(stored.sigma, sigma_mm);
  frame.sigma_m = cv::Mat1f(sigma_mm / kMmPerM);
  static const auto place = Variants<place_body>::of(selected_instruction_set());
  static const auto unfold = Variants<unfold_body>::of(selected_instruction_set());
  for_each_row(stored.depth_m.rows, [&](int row) {
    place(stored.depth_m[row], rays[row]->val, stored.depth_m.cols, frame.points_m[row]->val);
    unfold(stored.normals[row]->val, stored.depth_m.cols, frame.normals[row]->val);
  });
  return frame;
}

size_t bytes_of(const StoredFrame& stored) {
  return stored.depth_m.total() * (sizeof(float) + sizeof(short) + sizeof(cv::Vec2s) + sizeof(uchar));
}

}  // namespace fringeslam
