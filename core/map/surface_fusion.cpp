// SPDX-License-Identifier: Apache-2.0
#include "core/map/surface_fusion.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <numbers>

#include "core/types/parallel.h"

namespace fringeslam {

namespace {

constexpr int kLanes = 16;
constexpr int kPixelFloats = 8;
constexpr int kBandRows = 16;  // rows of pixels that are searched for bricks together
constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();

// A brick seen from the camera, and the camera, as the kernels want them.
struct BrickView {
  float origin[3], dx[3], dy[3], dz[3];  // first voxel and the steps to the next, m
  float fx, fy, cx, cy, k1, k2, p1, p2, k3;
  int width, height;
  float truncation_m, steps_per_m;
};

FRINGESLAM_INLINE bool fuse_body(const BrickView& view, const float* __restrict pixels, uint64_t* __restrict voxels) {
  // Sixteen voxels are two runs of eight along z.
  alignas(64) float across[3][kLanes];
  for (int lane = 0; lane < kLanes; ++lane) {
    for (int i = 0; i < 3; ++i)
      across[i][lane] =
          view.origin[i] + static_cast<float>(lane >> 3) * view.dy[i] + static_cast<float>(lane & 7) * view.dz[i];
  }
  bool seen = false;
  for (int block = 0; block < kBrickVoxels / kLanes; ++block) {
    const float along_x = static_cast<float>(block >> 2), along_y = static_cast<float>(2 * (block & 3));
    const float ox = along_x * view.dx[0] + along_y * view.dy[0], oy = along_x * view.dx[1] + along_y * view.dy[1],
                oz = along_x * view.dx[2] + along_y * view.dy[2];
    alignas(64) float distance[kLanes];
    alignas(64) int32_t at[kLanes], in_band[kLanes];
    int any = 0;
    for (int lane = 0; lane < kLanes; ++lane) {
      const float x = across[0][lane] + ox, y = across[1][lane] + oy, z = across[2][lane] + oz;
      const float inverse = 1 / z, a = x * inverse, b = y * inverse, r2 = a * a + b * b;
      const float radial = 1 + r2 * (view.k1 + r2 * (view.k2 + r2 * view.k3));
      const float u = view.fx * (a * radial + 2 * view.p1 * a * b + view.p2 * (r2 + 2 * a * a)) + view.cx + 0.5f;
      const float v = view.fy * (b * radial + view.p1 * (r2 + 2 * b * b) + 2 * view.p2 * a * b) + view.cy + 0.5f;
      const bool inside =
          (z > 0) & (u >= 0) & (v >= 0) & (u < static_cast<float>(view.width)) & (v < static_cast<float>(view.height));
      const int col = static_cast<int>(inside ? u : 0), row = static_cast<int>(inside ? v : 0);
      const int pixel = (row * view.width + col) * kPixelFloats;
      const float d = pixels[pixel] * x + pixels[pixel + 1] * y + pixels[pixel + 2] * z - pixels[pixel + 3];
      const int in = inside & (std::abs(d) < view.truncation_m) ? 1 : 0;  // false for NaN
      distance[lane] = d * view.steps_per_m;
      at[lane] = pixel;
      in_band[lane] = in;
      any |= in;
    }
    if (any == 0) continue;
    seen = true;
    uint64_t* const sixteen = voxels + block * kLanes;
    for (int lane = 0; lane < kLanes; ++lane) {
      const uint64_t old = sixteen[lane];
      const float old_distance = voxel_distance(old), old_grey = voxel_grey(old), old_weight = voxel_weight(old);
      const float weight = pixels[at[lane] + 4], grey = pixels[at[lane] + 5];
      const float sum = old_weight + weight, part = weight / sum;
      // Rounded: what is cut off is never negative.
      const auto new_distance =
          static_cast<int32_t>(old_distance + (distance[lane] - old_distance) * part + 32768.5f) - 32768;
      const auto new_grey = static_cast<int32_t>(old_grey + (grey - old_grey) * part + 0.5f);
      const uint64_t fused = (static_cast<uint64_t>(new_distance) & 0xffff) | static_cast<uint64_t>(new_grey) << 16 |
                             static_cast<uint64_t>(std::bit_cast<uint32_t>(sum)) << 32;
      sixteen[lane] = in_band[lane] ? fused : old;
    }
  }
  return seen;
}

bool fuse_portable(const BrickView& view, const float* pixels, uint64_t* voxels) {
  return fuse_body(view, pixels, voxels);
}
FRINGESLAM_AVX2 bool fuse_avx2(const BrickView& view, const float* pixels, uint64_t* voxels) {
  return fuse_body(view, pixels, voxels);
}
FRINGESLAM_AVX512 bool fuse_avx512(const BrickView& view, const float* pixels, uint64_t* voxels) {
  return fuse_body(view, pixels, voxels);
}

}  // namespace

void BrickSet::clear() {
  keys_.clear();
  std::fill(slots_.begin(), slots_.end(), 0);
}

void BrickSet::insert(uint64_t key) {
  if (2 * keys_.size() >= slots_.size()) grow();
  const size_t mask = slots_.size() - 1;
  for (size_t slot = key * 0x9e3779b97f4a7c15u >> 40 & mask;; slot = (slot + 1) & mask) {
    if (slots_[slot] == key + 1) return;
    if (slots_[slot] != 0) continue;
    slots_[slot] = key + 1;
    keys_.push_back(key);
    return;
  }
}

void BrickSet::grow() {
  slots_.assign(std::max<size_t>(1024, 2 * slots_.size()), 0);
  std::vector<uint64_t> keys;
  keys.swap(keys_);
  for (const uint64_t key : keys) insert(key);
}

FrameFusion::FrameFusion(const Pinhole& camera, const VoxelScale& scale, double max_slope_deg, double min_sigma_m)
    : camera_(camera),
      scale_(scale),
      min_slope_cos_(static_cast<float>(std::cos(max_slope_deg * std::numbers::pi / 180))),
      min_variance_(static_cast<float>(min_sigma_m * min_sigma_m)) {}

const std::vector<uint64_t>& FrameFusion::begin(const Frame& frame, const Pose& world_from_camera) {
  camera_from_world_ = world_from_camera.inverse();
  pixels_.resize(frame.points_m.total() * kPixelFloats);
  rows_.resize(static_cast<size_t>((frame.height() + kBandRows - 1) / kBandRows));
  float pose[12];  // world -> bricks
  const double bricks_per_m = 1 / (kBrickEdge * scale_.voxel_m);
  for (int i = 0; i < 9; ++i) pose[i] = static_cast<float>(world_from_camera.rotation(i / 3, i % 3));
  for (int i = 0; i < 3; ++i) pose[9 + i] = static_cast<float>(world_from_camera.translation[i] * bricks_per_m);
  for_each_row(static_cast<int>(rows_.size()), [&](int band) {
    BrickSet& touched = rows_[static_cast<size_t>(band)];
    touched.clear();
    for (int row = band * kBandRows; row < std::min((band + 1) * kBandRows, frame.height()); ++row)
      begin_row(frame, row, pose, touched);
  });
  bricks_.clear();
  for (const BrickSet& touched : rows_) {
    for (const uint64_t key : touched.keys()) bricks_.insert(key);
  }
  return bricks_.keys();
}

// The voxels of a pixel's band have their feet on its tangent plane, half a pixel's diagonal away at most. A pixel's
// step across the ray is the footprint, and along the ray the footprint times the slope.
void FrameFusion::begin_row(const Frame& frame, int row, const float world_from_camera[12], BrickSet& touched) {
  const float* const m = world_from_camera;
  const auto bricks_per_m = static_cast<float>(1 / (kBrickEdge * scale_.voxel_m));
  const auto truncation = static_cast<float>(scale_.truncation_m) * bricks_per_m;
  const auto half_pixel = static_cast<float>(0.71 / std::min(camera_.fx, camera_.fy)) * bricks_per_m;
  BrickIndex last_low{}, last_high{INT32_MIN, 0, 0};
  for (int col = 0; col < frame.width(); ++col) {
    const cv::Vec3f &p = frame.points_m(row, col), &n = frame.normals(row, col);
    float* const pixel = pixels_.data() + static_cast<size_t>(row * frame.width() + col) * kPixelFloats;
    const double plane =
        static_cast<double>(n[0]) * p[0] + static_cast<double>(n[1]) * p[1] + static_cast<double>(n[2]) * p[2];
    const auto offset = static_cast<float>(plane);
    const float range = std::sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]), cosine = -offset / range;
    const float sigma = offset / p[2] * frame.sigma_m(row, col);
    const float weight = 1 / (sigma * sigma + min_variance_);
    const bool usable = (cosine >= min_slope_cos_) & (weight > 0);  // false for NaN
    for (int i = 0; i < 3; ++i) pixel[i] = n[i];
    pixel[3] = usable ? offset : kNaN;
    pixel[4] = weight;
    pixel[5] = kGreySteps * static_cast<float>(frame.texture(row, col));
    if (!usable) continue;
    const float tangent = std::sqrt(std::max(0.0f, 1 - cosine * cosine)) / cosine;
    const float across = half_pixel * p[2], along = across * tangent / range;
    BrickIndex low, high;
    for (int i = 0; i < 3; ++i) {
      const float ray = m[3 * i] * p[0] + m[3 * i + 1] * p[1] + m[3 * i + 2] * p[2];
      const float normal = m[3 * i] * n[0] + m[3 * i + 1] * n[1] + m[3 * i + 2] * n[2];
      const float centre = ray * bricks_per_m + m[9 + i];
      const float reach = truncation * std::abs(normal) + across + along * std::abs(ray);
      low[static_cast<size_t>(i)] = static_cast<int32_t>(std::floor(centre - reach));
      high[static_cast<size_t>(i)] = static_cast<int32_t>(std::floor(centre + reach));
    }
    if (low == last_low && high == last_high) continue;
    last_low = low, last_high = high;
    for (int x = low[0]; x <= high[0]; ++x) {
      for (int y = low[1]; y <= high[1]; ++y) {
        for (int z = low[2]; z <= high[2]; ++z) touched.insert(brick_key({x, y, z}));
      }
    }
  }
}

bool FrameFusion::fuse(const BrickIndex& brick, int64_t* voxels, InstructionSet set) const {
  const Eigen::Vector3d corner = kBrickEdge * scale_.voxel_m * Eigen::Vector3d(brick[0], brick[1], brick[2]);
  const Eigen::Vector3d origin = camera_from_world_ * corner;
  const Eigen::Matrix3d steps = scale_.voxel_m * camera_from_world_.rotation;
  const auto single = [](double value) { return static_cast<float>(value); };
  BrickView view;
  for (int i = 0; i < 3; ++i) {
    view.origin[i] = single(origin[i]);
    view.dx[i] = single(steps(i, 0)), view.dy[i] = single(steps(i, 1)), view.dz[i] = single(steps(i, 2));
  }
  view.fx = single(camera_.fx), view.fy = single(camera_.fy), view.cx = single(camera_.cx),
  view.cy = single(camera_.cy);
  const Distortion& lens = camera_.distortion;
  view.k1 = single(lens.k1), view.k2 = single(lens.k2), view.k3 = single(lens.k3);
  view.p1 = single(lens.p1), view.p2 = single(lens.p2);
  view.width = camera_.width, view.height = camera_.height;
  view.truncation_m = single(scale_.truncation_m);
  view.steps_per_m = single(static_cast<double>(kDistanceSteps) / scale_.truncation_m);
  auto* const bits = reinterpret_cast<uint64_t*>(voxels);
  if (set == InstructionSet::avx512) return fuse_avx512(view, pixels_.data(), bits);
  if (set == InstructionSet::avx2) return fuse_avx2(view, pixels_.data(), bits);
  return fuse_portable(view, pixels_.data(), bits);
}

}  // namespace fringeslam
