// SPDX-License-Identifier: Apache-2.0
#include "core/map/surface_fusion.h"

#include <array>
#include <cmath>
#include <cstring>

namespace fringeslam {

namespace {

constexpr int kOctants = 8, kOctant = 64;  // octants per brick; voxels per octant

// Offsets of an octant's voxels from its centre, in voxels.
struct Offsets {
  alignas(64) std::array<float, kOctant> x, y, z;
};
constexpr Offsets offsets() {
  Offsets all{};
  for (size_t i = 0; i < kOctant; ++i) {
    all.x[i] = static_cast<float>(i >> 4) - 1.5f;
    all.y[i] = static_cast<float>(i >> 2 & 3) - 1.5f;
    all.z[i] = static_cast<float>(i & 3) - 1.5f;
  }
  return all;
}
constexpr Offsets kOffsets = offsets();

// The voxels of a brick during fusion, octant by octant; within an octant in the order of the brick.
struct BrickSums {
  // sum(w d), steps; sum(w grey), steps; W
  alignas(64) float distance[kBrickVoxels], grey[kBrickVoxels], weight[kBrickVoxels];
};

// Position of a brick relative to a camera, and the camera, in the kernels' form.
struct BrickView {
  float origin[3], step[3][3];  // first voxel, and steps to the next one along x, y and z; m
  float fx, fy, cx, cy, k1, k2, p1, p2, k3;
  float last_col, last_row;  // of the planes
  int stride;
  float voxel_m, truncation_m, steps_per_m;
};

// Octant centres in the camera frame, their positions in the plane image, and the change of these per voxel.
struct OctantViews {
  alignas(32) float x[kOctants], y[kOctants], z[kOctants], u[kOctants], v[kOctants], du[3][kOctants], dv[3][kOctants];
};

FRINGESLAM_INLINE float lower_half(uint32_t word) { return static_cast<float>(static_cast<int32_t>(word << 16) >> 16); }
FRINGESLAM_INLINE float upper_half(uint32_t word) { return static_cast<float>(static_cast<int32_t>(word) >> 16); }

FRINGESLAM_INLINE void find_octants(BrickView view, OctantViews& __restrict octants) {
  for (int i = 0; i < kOctants; ++i) {
    const float right = static_cast<float>(i & 4) + 1.5f, down = static_cast<float>(i << 1 & 4) + 1.5f,
                on = static_cast<float>(i << 2 & 4) + 1.5f;
    const auto along = [&](int k) {
      return view.origin[k] + right * view.step[0][k] + down * view.step[1][k] + on * view.step[2][k];
    };
    const float x = along(0), y = along(1), z = along(2);
    const float inverse = 1 / z, a = x * inverse, b = y * inverse, r2 = a * a + b * b;
    const float radial = 1 + r2 * (view.k1 + r2 * (view.k2 + r2 * view.k3));
    const float slope = 2 * (view.k1 + r2 * (2 * view.k2 + r2 * 3 * view.k3));
    octants.x[i] = x, octants.y[i] = y, octants.z[i] = z;
    octants.u[i] = view.fx * (a * radial + 2 * view.p1 * a * b + view.p2 * (r2 + 2 * a * a)) + view.cx;
    octants.v[i] = view.fy * (b * radial + view.p1 * (r2 + 2 * b * b) + 2 * view.p2 * a * b) + view.cy;
    const float mixed = a * b * slope + 2 * view.p1 * a + 2 * view.p2 * b;
    const float of_a = radial + a * a * slope + 2 * view.p1 * b + 6 * view.p2 * a;
    const float of_b = radial + b * b * slope + 6 * view.p1 * b + 2 * view.p2 * a;
    for (int k = 0; k < 3; ++k) {
      const float da = (view.step[k][0] - a * view.step[k][2]) * inverse;
      const float db = (view.step[k][1] - b * view.step[k][2]) * inverse;
      octants.du[k][i] = view.fx * (of_a * da + mixed * db);
      octants.dv[k][i] = view.fy * (mixed * da + of_b * db);
    }
  }
}

FRINGESLAM_INLINE bool add_body(BrickView view, const PixelPlane* __restrict planes, unsigned touched,
                                BrickSums& __restrict sums) {
  OctantViews octants;
  find_octants(view, octants);
  bool seen = false;
  for (int octant = 0; octant < kOctants; ++octant) {
    if ((touched >> octant & 1) == 0 || !(octants.z[octant] > 4 * view.voxel_m)) continue;
    const float u0 = octants.u[octant], v0 = octants.v[octant];
    const float ux = octants.du[0][octant], uy = octants.du[1][octant], uz = octants.du[2][octant];
    const float vx = octants.dv[0][octant], vy = octants.dv[1][octant], vz = octants.dv[2][octant];
    alignas(64) int32_t at[kOctant];
    for (int lane = 0; lane < kOctant; ++lane) {
      const float i = kOffsets.x[lane], j = kOffsets.y[lane], k = kOffsets.z[lane];
      const float u = u0 + i * ux + j * uy + k * uz, v = v0 + i * vx + j * vy + k * vz;
      // Voxels outside the image map to its border.
      const float after_first_col = u > 0 ? u : 0, after_first_row = v > 0 ? v : 0;
      const float col = after_first_col < view.last_col ? after_first_col : view.last_col;
      const float row = after_first_row < view.last_row ? after_first_row : view.last_row;
      at[lane] = static_cast<int>(row) * view.stride + static_cast<int>(col);
    }
    alignas(64) uint32_t words[4 * kOctant];
    for (int lane = 0; lane < kOctant; ++lane) std::memcpy(words + 4 * lane, planes + at[lane], sizeof(PixelPlane));
    // All four words are loaded at once: otherwise the compiler does not fully vectorise this loop.
    alignas(64) uint32_t normal_xy[kOctant], normal_z_grey[kOctant], offset_bits[kOctant], weight_bits[kOctant];
    for (int lane = 0; lane < kOctant; ++lane) {
      normal_xy[lane] = words[4 * lane], normal_z_grey[lane] = words[4 * lane + 1];
      offset_bits[lane] = words[4 * lane + 2], weight_bits[lane] = words[4 * lane + 3];
    }
    alignas(64) float offset[kOctant], of_pixel[kOctant];
    std::memcpy(offset, offset_bits, sizeof offset);
    std::memcpy(of_pixel, weight_bits, sizeof of_pixel);
    const float x0 = octants.x[octant], y0 = octants.y[octant], z0 = octants.z[octant];
    alignas(64) float distance[kOctant], weight[kOctant];
    alignas(64) int32_t in_band[kOctant];
    int any = 0;
    for (int lane = 0; lane < kOctant; ++lane) {
      const float i = kOffsets.x[lane], j = kOffsets.y[lane], k = kOffsets.z[lane];
      const float x = x0 + i * view.step[0][0] + j * view.step[1][0] + k * view.step[2][0];
      const float y = y0 + i * view.step[0][1] + j * view.step[1][1] + k * view.step[2][1];
      const float z = z0 + i * view.step[0][2] + j * view.step[1][2] + k * view.step[2][2];
      const float along_normal =
          lower_half(normal_xy[lane]) * x + upper_half(normal_xy[lane]) * y + lower_half(normal_z_grey[lane]) * z;
      const float d = along_normal * (1 / kNormalSteps) - offset[lane], steps = d * view.steps_per_m;
      const bool inside = std::abs(d) < view.truncation_m;  // false for NaN
      in_band[lane] = inside ? 1 : 0;
      distance[lane] = inside ? steps : 0;
      weight[lane] = inside ? of_pixel[lane] : 0;
    }
    for (int lane = 0; lane < kOctant; ++lane) any |= in_band[lane];
    if (any == 0) continue;
    seen = true;
    float* const sum_d = sums.distance + octant * kOctant;
    float* const sum_grey = sums.grey + octant * kOctant;
    float* const sum_w = sums.weight + octant * kOctant;
    for (int lane = 0; lane < kOctant; ++lane) {
      sum_d[lane] += weight[lane] * distance[lane];
      sum_grey[lane] += weight[lane] * (kGreySteps * upper_half(normal_z_grey[lane]));
      sum_w[lane] += weight[lane];
    }
  }
  return seen;
}

// Index in the brick of an octant's voxels that are consecutive along z.
constexpr int kRunLength = 4, kRuns = kOctant / kRunLength;
FRINGESLAM_INLINE int run_at(int octant, int run) {
  const int x = (octant & 4) + (run >> 2), y = (octant << 1 & 4) + (run & 3), z = octant << 2 & 4;
  return (x * kBrickEdge + y) * kBrickEdge + z;
}

FRINGESLAM_INLINE void load_body(const int64_t* __restrict voxels, BrickSums& __restrict sums) {
  for (int octant = 0; octant < kOctants; ++octant) {
    alignas(64) uint64_t bits[kOctant];
    for (int run = 0; run < kRuns; ++run)
      std::memcpy(bits + kRunLength * run, voxels + run_at(octant, run), kRunLength * sizeof(uint64_t));
    alignas(64) uint32_t low[kOctant], high[kOctant];
    for (int lane = 0; lane < kOctant; ++lane) {
      low[lane] = static_cast<uint32_t>(bits[lane]);
      high[lane] = static_cast<uint32_t>(bits[lane] >> 32);
    }
    float* const sum_w = sums.weight + octant * kOctant;
    std::memcpy(sum_w, high, sizeof high);
    for (int lane = 0; lane < kOctant; ++lane) {
      sums.distance[octant * kOctant + lane] = sum_w[lane] * lower_half(low[lane]);
      sums.grey[octant * kOctant + lane] = sum_w[lane] * static_cast<float>(low[lane] >> 16);
    }
  }
}

FRINGESLAM_INLINE void store_body(const BrickSums& __restrict sums, int64_t* __restrict voxels) {
  for (int octant = 0; octant < kOctants; ++octant) {
    const float* const sum_w = sums.weight + octant * kOctant;
    alignas(64) uint32_t low[kOctant], high[kOctant];
    std::memcpy(high, sum_w, sizeof high);
    for (int lane = 0; lane < kOctant; ++lane) {
      const float share = sum_w[lane] > 0 ? 1 / sum_w[lane] : 0;
      // Rounds to nearest: the truncated value is never negative.
      const int distance = static_cast<int>(sums.distance[octant * kOctant + lane] * share + 32768.5f) - 32768;
      const int grey = static_cast<int>(sums.grey[octant * kOctant + lane] * share + 0.5f);
      low[lane] = static_cast<uint32_t>(grey) << 16 | static_cast<uint32_t>(distance & 0xffff);
    }
    alignas(64) uint64_t bits[kOctant];
    for (int lane = 0; lane < kOctant; ++lane) bits[lane] = static_cast<uint64_t>(high[lane]) << 32 | low[lane];
    for (int run = 0; run < kRuns; ++run)
      std::memcpy(voxels + run_at(octant, run), bits + kRunLength * run, kRunLength * sizeof(uint64_t));
  }
}

struct BrickFrames {
  std::array<BrickView, kMaxFusedFrames> views;
  std::array<const PixelPlane*, kMaxFusedFrames> planes;
  std::array<unsigned, kMaxFusedFrames> octants;
  size_t count = 0;
};

FRINGESLAM_INLINE bool fuse_body(const BrickFrames& frames, int64_t* voxels) {
  BrickSums sums;
  load_body(voxels, sums);
  bool seen = false;
  for (size_t i = 0; i < frames.count; ++i)
    seen |= add_body(frames.views[i], frames.planes[i], frames.octants[i], sums);
  if (seen) store_body(sums, voxels);
  return seen;
}

BrickView view_of(const FramePlanes& frame, const Eigen::Vector3d& corner) {
  const Pinhole& camera = frame.camera();
  const Eigen::Vector3d origin = frame.camera_from_world() * corner;
  const auto single = [](double value) { return static_cast<float>(value); };
  BrickView view;
  for (int k = 0; k < 3; ++k) {
    view.origin[k] = single(origin[k]);
    for (int axis = 0; axis < 3; ++axis)
      view.step[axis][k] = single(frame.scale().voxel_m * frame.camera_from_world().rotation(k, axis));
  }
  // Pixel (0, 0) lies behind the border and extends half a pixel from its centre.
  constexpr double kFirst = 1.5;
  view.fx = single(camera.fx), view.fy = single(camera.fy);
  view.cx = single(camera.cx + kFirst), view.cy = single(camera.cy + kFirst);
  const Distortion& lens = camera.distortion;
  view.k1 = single(lens.k1), view.k2 = single(lens.k2), view.k3 = single(lens.k3);
  view.p1 = single(lens.p1), view.p2 = single(lens.p2);
  view.stride = frame.stride();
  view.last_col = static_cast<float>(camera.width + 1), view.last_row = static_cast<float>(camera.height + 1);
  view.voxel_m = single(frame.scale().voxel_m);
  view.truncation_m = single(frame.scale().truncation_m);
  view.steps_per_m = single(static_cast<double>(kDistanceSteps) / frame.scale().truncation_m);
  return view;
}

}  // namespace

bool fuse(const std::vector<FramePlanes>& frames, const TouchedBrick& brick, int64_t* voxels, InstructionSet set) {
  const BrickIndex index = brick_of(brick.key);
  BrickFrames with;
  for (size_t i = 0; i < frames.size(); ++i) {
    const auto octants = static_cast<unsigned>(brick.octants >> 8 * i & 0xff);
    if (octants == 0) continue;
    const double edge_m = kBrickEdge * frames[i].scale().voxel_m;
    with.views[with.count] = view_of(frames[i], edge_m * Eigen::Vector3d(index[0], index[1], index[2]));
    with.planes[with.count] = frames[i].planes();
    with.octants[with.count++] = octants;
  }
  return Variants<fuse_body>::of(set)(with, voxels);
}

}  // namespace fringeslam
