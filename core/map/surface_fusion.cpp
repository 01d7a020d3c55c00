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

constexpr int kOctant = 64;    // voxels
constexpr int kRun = 64;       // pixels that are prepared together
constexpr int kBandRows = 16;  // rows of pixels that are searched for bricks together
constexpr float kNormalSteps = 32767;
// In octants: where bricks have keys, and what a pixel that is not much larger than a voxel can touch.
constexpr float kMaxOctant = 2 * kMaxBrick - 64, kMaxReach = 32;
constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();

// A brick seen from the camera, and the camera, as the kernels want them.
struct BrickView {
  float origin[3], dx[3], dy[3], dz[3];  // first voxel and the steps to the next, m
  float fx, fy, cx, cy, k1, k2, p1, p2, k3;
  int width, height;
  float truncation_m, steps_per_m;
};

FRINGESLAM_INLINE float lower_half(uint32_t word) { return static_cast<float>(static_cast<int32_t>(word << 16) >> 16); }
FRINGESLAM_INLINE float upper_half(uint32_t word) { return static_cast<float>(static_cast<int32_t>(word) >> 16); }

FRINGESLAM_INLINE bool fuse_body(BrickView view, const PixelPlane* __restrict pixels, uint8_t octants,
                                 uint64_t* __restrict voxels) {
  alignas(64) float across_x[kOctant], across_y[kOctant], across_z[kOctant];
  for (int lane = 0; lane < kOctant; ++lane) {
    const float x = static_cast<float>(lane >> 4), y = static_cast<float>(lane >> 2 & 3),
                z = static_cast<float>(lane & 3);
    across_x[lane] = view.origin[0] + x * view.dx[0] + y * view.dy[0] + z * view.dz[0];
    across_y[lane] = view.origin[1] + x * view.dx[1] + y * view.dy[1] + z * view.dz[1];
    across_z[lane] = view.origin[2] + x * view.dx[2] + y * view.dy[2] + z * view.dz[2];
  }
  bool seen = false;
  for (int octant = 0; octant < 8; ++octant) {
    if ((octants >> octant & 1) == 0) continue;
    const int first_x = octant & 4, first_y = octant << 1 & 4, first_z = octant << 2 & 4;
    // Sixteen runs of four along z, on their way to the cache while the pixels are found.
    uint64_t* const corner = voxels + (first_x * kBrickEdge + first_y) * kBrickEdge + first_z;
    const auto run_at = [](int run) { return ((run >> 2) * kBrickEdge + (run & 3)) * kBrickEdge; };
    for (int run = 0; run < 16; ++run) __builtin_prefetch(corner + run_at(run), 1);
    const float x0 = static_cast<float>(first_x), y0 = static_cast<float>(first_y), z0 = static_cast<float>(first_z);
    const float ox = x0 * view.dx[0] + y0 * view.dy[0] + z0 * view.dz[0];
    const float oy = x0 * view.dx[1] + y0 * view.dy[1] + z0 * view.dz[1];
    const float oz = x0 * view.dx[2] + y0 * view.dy[2] + z0 * view.dz[2];
    alignas(64) float px[kOctant], py[kOctant], pz[kOctant], distance[kOctant];
    alignas(64) int32_t at[kOctant], in_band[kOctant];
    for (int lane = 0; lane < kOctant; ++lane) {
      const float x = across_x[lane] + ox, y = across_y[lane] + oy, z = across_z[lane] + oz;
      const float inverse = 1 / z, a = x * inverse, b = y * inverse, r2 = a * a + b * b;
      const float radial = 1 + r2 * (view.k1 + r2 * (view.k2 + r2 * view.k3));
      const float u = view.fx * (a * radial + 2 * view.p1 * a * b + view.p2 * (r2 + 2 * a * a)) + view.cx + 0.5f;
      const float v = view.fy * (b * radial + view.p1 * (r2 + 2 * b * b) + 2 * view.p2 * a * b) + view.cy + 0.5f;
      const bool inside =
          (z > 0) & (u >= 0) & (v >= 0) & (u < static_cast<float>(view.width)) & (v < static_cast<float>(view.height));
      const int col = static_cast<int>(inside ? u : 0), row = static_cast<int>(inside ? v : 0);
      at[lane] = row * view.width + col;
      in_band[lane] = inside ? 1 : 0;
      px[lane] = x, py[lane] = y, pz[lane] = z;
    }
    alignas(64) uint32_t planes[4 * kOctant];
    for (int lane = 0; lane < kOctant; ++lane) std::memcpy(planes + 4 * lane, pixels + at[lane], sizeof(PixelPlane));
    alignas(64) float floats[4 * kOctant];
    std::memcpy(floats, planes, sizeof planes);
    for (int lane = 0; lane < kOctant; ++lane) {
      const uint32_t xy = planes[4 * lane], z = planes[4 * lane + 1];
      const float along_normal = lower_half(xy) * px[lane] + upper_half(xy) * py[lane] + lower_half(z) * pz[lane];
      const float d = along_normal * (1 / kNormalSteps) - floats[4 * lane + 2];
      in_band[lane] &= std::abs(d) < view.truncation_m ? 1 : 0;  // not for NaN
      distance[lane] = d * view.steps_per_m;
    }
    int any = 0;
    for (int lane = 0; lane < kOctant; ++lane) any |= in_band[lane];
    if (any == 0) continue;
    seen = true;
    // The two halves of each voxel apart: as 32 bits they fill the vectors.
    alignas(64) uint64_t old[kOctant];
    for (int run = 0; run < 16; ++run) std::memcpy(old + 4 * run, corner + run_at(run), 4 * sizeof(uint64_t));
    alignas(64) uint32_t low[kOctant], high[kOctant];
    alignas(64) float weights[kOctant];
    for (int lane = 0; lane < kOctant; ++lane) {
      low[lane] = static_cast<uint32_t>(old[lane]);
      high[lane] = static_cast<uint32_t>(old[lane] >> 32);
    }
    std::memcpy(weights, high, sizeof high);
    for (int lane = 0; lane < kOctant; ++lane) {
      const float old_distance = lower_half(low[lane]), old_grey = static_cast<float>(low[lane] >> 16);
      const float weight = floats[4 * lane + 3], grey = kGreySteps * upper_half(planes[4 * lane + 1]);
      const float new_weight = weights[lane] + weight, part = weight / new_weight;
      // Rounded: what is cut off is never negative.
      const int new_distance =
          static_cast<int>(old_distance + (distance[lane] - old_distance) * part + 32768.5f) - 32768;
      const int new_grey = static_cast<int>(old_grey + (grey - old_grey) * part + 0.5f);
      const int fused = static_cast<int>(static_cast<uint32_t>(new_grey) << 16) | (new_distance & 0xffff);
      low[lane] = in_band[lane] ? static_cast<uint32_t>(fused) : low[lane];
      weights[lane] = in_band[lane] ? new_weight : weights[lane];
    }
    std::memcpy(high, weights, sizeof weights);
    for (int lane = 0; lane < kOctant; ++lane) old[lane] = static_cast<uint64_t>(high[lane]) << 32 | low[lane];
    for (int run = 0; run < 16; ++run) std::memcpy(corner + run_at(run), old + 4 * run, 4 * sizeof(uint64_t));
  }
  return seen;
}

// A run of pixels, with the world and the frame's limits as the kernel wants them.
struct PixelRun {
  const float *points, *normals, *sigma;  // three floats, three and one a pixel
  const uint8_t* grey;
  int count;
  float octants_from_camera[12];  // rotation row by row, then the translation in octants
  float octants_per_m, truncation, half_pixel, min_slope_cos, min_variance;
};

// The octants from low to high, counted over all bricks; none when high < low.
struct OctantBoxes {
  alignas(64) int32_t low[3][kRun], high[3][kRun];
  // 0 where a pixel touches the same as the one before or the one above, as most do.
  alignas(64) int32_t is_new[kRun];
};

FRINGESLAM_INLINE int floor_of(float value) {
  const int cut = static_cast<int>(value);
  return cut - (static_cast<float>(cut) > value ? 1 : 0);
}
FRINGESLAM_INLINE int in_steps(float value) {
  return static_cast<int>(value * kNormalSteps + (kNormalSteps + 0.5f)) - static_cast<int>(kNormalSteps);
}

// The voxels of a pixel's band have their feet on its tangent plane, half a pixel's diagonal away at most. A pixel's
// step across the ray is the footprint, and along the ray the footprint times the slope.
FRINGESLAM_INLINE void prepare_body(PixelRun run, uint32_t* __restrict planes, OctantBoxes& __restrict boxes,
                                    const OctantBoxes& __restrict above) {
  const float* const m = run.octants_from_camera;
  alignas(64) float low[3][kRun], high[3][kRun], numbers[2][kRun];
  alignas(64) uint32_t words[2][kRun];
  for (int i = 0; i < run.count; ++i) {
    const float x = run.points[3 * i], y = run.points[3 * i + 1], z = run.points[3 * i + 2];
    const float nx = run.normals[3 * i], ny = run.normals[3 * i + 1], nz = run.normals[3 * i + 2];
    const bool whole = (nx * nx + ny * ny + nz * nz < 1.01f) & (z > 0);  // not for NaN
    const int qx = in_steps(whole ? nx : 0), qy = in_steps(whole ? ny : 0), qz = in_steps(whole ? nz : 0);
    const double offset =
        (static_cast<double>(qx) * static_cast<double>(x) + static_cast<double>(qy) * static_cast<double>(y) +
         static_cast<double>(qz) * static_cast<double>(z)) /
        static_cast<double>(kNormalSteps);
    const float towards = nx * x + ny * y + nz * z;
    const float range2 = x * x + y * y + z * z, cosine2 = towards * towards / range2;
    const float sigma = towards / z * run.sigma[i], weight = 1 / (sigma * sigma + run.min_variance);
    const bool usable = whole & (towards < 0) & (cosine2 >= run.min_slope_cos * run.min_slope_cos) & (weight > 0);
    words[0][i] = static_cast<uint32_t>((qx & 0xffff) | qy << 16);
    words[1][i] = static_cast<uint32_t>((qz & 0xffff) | static_cast<int>(run.grey[i]) << 16);
    numbers[0][i] = usable ? static_cast<float>(offset) : kNaN;
    numbers[1][i] = weight;
    const float across = run.half_pixel * z;
    // Times the ray in metres it is what the tangent of the slope is to the ray's direction.
    const float slope = across * std::sqrt((1 - cosine2 > 0 ? 1 - cosine2 : 0) / (cosine2 * range2));
    for (int k = 0; k < 3; ++k) {
      const float ray = m[3 * k] * x + m[3 * k + 1] * y + m[3 * k + 2] * z;
      const float normal = m[3 * k] * nx + m[3 * k + 1] * ny + m[3 * k + 2] * nz;
      const float centre = ray * run.octants_per_m + m[9 + k];
      const float reach = run.truncation * std::abs(normal) + across + slope * std::abs(ray);
      const bool fits = usable & (std::abs(centre) < kMaxOctant) & (reach < kMaxReach);
      low[k][i] = fits ? centre - reach : 0;
      high[k][i] = fits ? centre + reach : -1;
    }
  }
  for (int k = 0; k < 3; ++k) {
    for (int i = 0; i < run.count; ++i) boxes.low[k][i] = floor_of(low[k][i]);
    for (int i = 0; i < run.count; ++i) boxes.high[k][i] = floor_of(high[k][i]);
  }
  alignas(64) int32_t from_left[kRun], from_above[kRun];
  from_left[0] = 1;
  for (int i = 1; i < run.count; ++i) {
    int differs = 0;
    for (int k = 0; k < 3; ++k)
      differs |= (boxes.low[k][i] ^ boxes.low[k][i - 1]) | (boxes.high[k][i] ^ boxes.high[k][i - 1]);
    from_left[i] = differs;
  }
  for (int i = 0; i < run.count; ++i) {
    int differs = 0;
    for (int k = 0; k < 3; ++k) differs |= (boxes.low[k][i] ^ above.low[k][i]) | (boxes.high[k][i] ^ above.high[k][i]);
    from_above[i] = differs;
  }
  for (int i = 0; i < run.count; ++i) boxes.is_new[i] = (from_left[i] != 0) & (from_above[i] != 0) ? 1 : 0;
  for (int i = 0; i < run.count; ++i) {
    planes[4 * i] = words[0][i], planes[4 * i + 1] = words[1][i];
    std::memcpy(planes + 4 * i + 2, &numbers[0][i], sizeof(float));
    std::memcpy(planes + 4 * i + 3, &numbers[1][i], sizeof(float));
  }
}

void prepare_portable(const PixelRun& run, uint32_t* planes, OctantBoxes& boxes, const OctantBoxes& above) {
  prepare_body(run, planes, boxes, above);
}
FRINGESLAM_AVX2 void prepare_avx2(const PixelRun& run, uint32_t* planes, OctantBoxes& boxes, const OctantBoxes& above) {
  prepare_body(run, planes, boxes, above);
}
FRINGESLAM_AVX512 void prepare_avx512(const PixelRun& run, uint32_t* planes, OctantBoxes& boxes,
                                      const OctantBoxes& above) {
  prepare_body(run, planes, boxes, above);
}

bool fuse_portable(const BrickView& view, const PixelPlane* pixels, uint8_t octants, uint64_t* voxels) {
  return fuse_body(view, pixels, octants, voxels);
}
FRINGESLAM_AVX2 bool fuse_avx2(const BrickView& view, const PixelPlane* pixels, uint8_t octants, uint64_t* voxels) {
  return fuse_body(view, pixels, octants, voxels);
}
FRINGESLAM_AVX512 bool fuse_avx512(const BrickView& view, const PixelPlane* pixels, uint8_t octants, uint64_t* voxels) {
  return fuse_body(view, pixels, octants, voxels);
}

// Of the neighbour on whose plane a pixel's point lies best, sigmas along that normal; NaN where none holds it.
cv::Vec3f adopted_normal(const Frame& frame, int row, int col, float max_sigmas) {
  cv::Vec3f best = cv::Vec3f::all(kNaN);
  float best2 = max_sigmas * max_sigmas;
  const cv::Vec3f& point = frame.points_m(row, col);
  for (int r = std::max(0, row - 1); r <= std::min(row + 1, frame.height() - 1); ++r) {
    for (int c = std::max(0, col - 1); c <= std::min(col + 1, frame.width() - 1); ++c) {
      const cv::Vec3f &normal = frame.normals(r, c), &origin = frame.points_m(r, c);
      const auto along = [&](const cv::Vec3f& p) { return normal[0] * p[0] + normal[1] * p[1] + normal[2] * p[2]; };
      const float own = along(point) / point[2] * frame.sigma_m(row, col);
      const float other = along(origin) / origin[2] * frame.sigma_m(r, c);
      const float off = along(point - origin), sigmas2 = off * off / (own * own + other * other);
      if (sigmas2 < best2) best = normal, best2 = sigmas2;  // not for NaN
    }
  }
  return best;
}

void fill_normals(const Frame& frame, int row, float max_sigmas, std::vector<cv::Vec3f>& normals) {
  normals.assign(frame.normals[row], frame.normals[row] + frame.width());
  for (int col = 0; col < frame.width(); ++col) {
    if (std::isnan(normals[static_cast<size_t>(col)][2]) && frame.valid(row, col))
      normals[static_cast<size_t>(col)] = adopted_normal(frame, row, col, max_sigmas);
  }
}

void touch(const OctantBoxes& boxes, int count, BrickSet& touched) {
  // Which octants of brick b, of the lower and the upper ones along an axis, lie from low to high.
  const auto halves = [](int b, int low, int high) {
    return ((low <= 2 * b) & (2 * b <= high) ? 1 : 0) | ((low <= 2 * b + 1) & (2 * b + 1 <= high) ? 2 : 0);
  };
  static constexpr std::array<int, 4> kX = {0, 0x0f, 0xf0, 0xff}, kY = {0, 0x33, 0xcc, 0xff},
                                      kZ = {0, 0x55, 0xaa, 0xff};
  for (int i = 0; i < count; ++i) {
    if (boxes.is_new[i] == 0) continue;
    const BrickIndex low = {boxes.low[0][i], boxes.low[1][i], boxes.low[2][i]};
    const BrickIndex high = {boxes.high[0][i], boxes.high[1][i], boxes.high[2][i]};
    for (int x = low[0] >> 1; x <= high[0] >> 1; ++x) {
      const int of_x = kX[static_cast<size_t>(halves(x, low[0], high[0]))];
      for (int y = low[1] >> 1; y <= high[1] >> 1; ++y) {
        const int of_xy = of_x & kY[static_cast<size_t>(halves(y, low[1], high[1]))];
        for (int z = low[2] >> 1; z <= high[2] >> 1; ++z) {
          const int octants = of_xy & kZ[static_cast<size_t>(halves(z, low[2], high[2]))];
          touched.insert({brick_key({x, y, z}), static_cast<uint8_t>(octants)});
        }
      }
    }
  }
}

}  // namespace

void BrickSet::clear() {
  bricks_.clear();
  std::fill(slots_.begin(), slots_.end(), 0);
}

void BrickSet::insert(const TouchedBrick& brick) {
  if (2 * bricks_.size() >= slots_.size()) grow();
  const size_t mask = slots_.size() - 1;
  for (size_t slot = brick.key * 0x9e3779b97f4a7c15u >> 40 & mask;; slot = (slot + 1) & mask) {
    if (slots_[slot] == 0) {
      bricks_.push_back(brick);
      slots_[slot] = static_cast<uint32_t>(bricks_.size());
      return;
    }
    TouchedBrick& there = bricks_[slots_[slot] - 1];
    if (there.key != brick.key) continue;
    there.octants |= brick.octants;
    return;
  }
}

void BrickSet::grow() {
  slots_.assign(std::max<size_t>(1024, 2 * slots_.size()), 0);
  std::vector<TouchedBrick> bricks;
  bricks.swap(bricks_);
  for (const TouchedBrick& brick : bricks) insert(brick);
}

FrameFusion::FrameFusion(const Pinhole& camera, const VoxelScale& scale, double max_slope_deg, double min_sigma_m,
                         double max_off_plane_sigma)
    : camera_(camera),
      scale_(scale),
      min_slope_cos_(static_cast<float>(std::cos(max_slope_deg * std::numbers::pi / 180))),
      min_variance_(static_cast<float>(min_sigma_m * min_sigma_m)),
      max_off_plane_sigma_(static_cast<float>(max_off_plane_sigma)) {}

const std::vector<TouchedBrick>& FrameFusion::begin(const Frame& frame, const Pose& world_from_camera) {
  static const auto prepare = widest(prepare_portable, prepare_avx2, prepare_avx512);
  camera_from_world_ = world_from_camera.inverse();
  pixels_.resize(frame.points_m.total());
  rows_.resize(static_cast<size_t>((frame.height() + kBandRows - 1) / kBandRows));
  const double octants_per_m = 2 / (kBrickEdge * scale_.voxel_m);
  PixelRun all{};
  for (int i = 0; i < 9; ++i) all.octants_from_camera[i] = static_cast<float>(world_from_camera.rotation(i / 3, i % 3));
  for (int i = 0; i < 3; ++i)
    all.octants_from_camera[9 + i] = static_cast<float>(world_from_camera.translation[i] * octants_per_m);
  all.octants_per_m = static_cast<float>(octants_per_m);
  all.truncation = static_cast<float>(scale_.truncation_m * octants_per_m);
  all.half_pixel = static_cast<float>(0.71 / std::min(camera_.fx, camera_.fy) * octants_per_m);
  all.min_slope_cos = min_slope_cos_;
  all.min_variance = min_variance_;
  for_each_row(static_cast<int>(rows_.size()), [&](int band) {
    BrickSet& touched = rows_[static_cast<size_t>(band)];
    touched.clear();
    std::vector<OctantBoxes> boxes(static_cast<size_t>((frame.width() + kRun - 1) / kRun));
    for (OctantBoxes& first : boxes) std::fill_n(first.low[0], kRun, INT32_MAX);  // like no row's
    OctantBoxes above;
    std::vector<cv::Vec3f> normals;
    for (int row = band * kBandRows; row < std::min((band + 1) * kBandRows, frame.height()); ++row) {
      fill_normals(frame, row, max_off_plane_sigma_, normals);
      for (int col = 0; col < frame.width(); col += kRun) {
        PixelRun run = all;
        run.count = std::min(kRun, frame.width() - col);
        run.points = frame.points_m[row][col].val;
        run.normals = normals[static_cast<size_t>(col)].val;
        run.sigma = frame.sigma_m[row] + col;
        run.grey = frame.texture[row] + col;
        PixelPlane* const planes = pixels_.data() + row * frame.width() + col;
        OctantBoxes& here = boxes[static_cast<size_t>(col / kRun)];
        above = here;
        prepare(run, reinterpret_cast<uint32_t*>(planes), here, above);
        touch(here, run.count, touched);
      }
    }
  });
  bricks_.clear();
  for (const BrickSet& touched : rows_) {
    for (const TouchedBrick& brick : touched.bricks()) bricks_.insert(brick);
  }
  return bricks_.bricks();
}

bool FrameFusion::fuse(const TouchedBrick& brick, int64_t* voxels, InstructionSet set) const {
  const BrickIndex index = brick_of(brick.key);
  const Eigen::Vector3d corner = kBrickEdge * scale_.voxel_m * Eigen::Vector3d(index[0], index[1], index[2]);
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
  if (set == InstructionSet::avx512) return fuse_avx512(view, pixels_.data(), brick.octants, bits);
  if (set == InstructionSet::avx2) return fuse_avx2(view, pixels_.data(), brick.octants, bits);
  return fuse_portable(view, pixels_.data(), brick.octants, bits);
}

}  // namespace fringeslam
