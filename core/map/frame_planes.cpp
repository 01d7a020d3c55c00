// SPDX-License-Identifier: Apache-2.0
#include "core/map/frame_planes.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <numbers>

#include "core/base/constants.h"
#include "core/base/parallel.h"
#include "core/types/selected_instruction_set.h"

namespace fringeslam {

namespace {

constexpr int kRun = 64, kSquares = kRun / 2;  // pixels prepared together; 2 x 2 squares of two rows
constexpr int kBandRows = 16;                  // rows of pixels searched for bricks together
// In octants: the range in which bricks have keys, and the largest reach of a pixel.
constexpr float kMaxOctant = 2 * kMaxBrick - 64, kMaxReach = 32, kNone = 1 << 24;

// A run of pixels, with the pose and the frame's limits in the kernel's form.
struct PixelRun {
  const float *points, *normals, *sigma;  // three, three and one floats per pixel
  const uint8_t* grey;
  int count;
  float octants_from_camera[12];  // rotation row by row, then the translation in octants
  float octants_per_m, truncation, half_pixel, min_slope_cos, min_variance;
};

// Range of octants (over all bricks) touched by each pixel; empty if high < low.
struct OctantBoxes {
  alignas(64) int32_t low[3][kRun], high[3][kRun];
};

// Union of the ranges of each square of four pixels.
struct SquareBoxes {
  alignas(64) int32_t low[3][kSquares], high[3][kSquares];
  // 1 if the four are not adjacent in space, so that their union contains octants that none touches.
  alignas(64) int32_t apart[kSquares];
  // 0 if a square touches the same octants as the previous one or the one above, or none.
  alignas(64) int32_t is_new[kSquares];
};

FRINGESLAM_INLINE int floor_of(float value) {
  const int cut = static_cast<int>(value);
  return cut - (static_cast<float>(cut) > value ? 1 : 0);
}
FRINGESLAM_INLINE int in_steps(float value) {
  return static_cast<int>(value * kNormalSteps + (kNormalSteps + 0.5f)) - static_cast<int>(kNormalSteps);
}

// The voxels of a pixel's band project onto its tangent plane at most half a pixel's diagonal away. A pixel's extent
// is the footprint across the ray, and the footprint times the slope along the ray.
FRINGESLAM_INLINE void prepare_body(PixelRun run, uint32_t* __restrict planes, OctantBoxes& __restrict boxes) {
  const float* const m = run.octants_from_camera;
  alignas(64) float low[3][kRun], high[3][kRun], numbers[2][kRun];
  alignas(64) uint32_t words[2][kRun];
  for (int i = 0; i < run.count; ++i) {
    const float x = run.points[3 * i], y = run.points[3 * i + 1], z = run.points[3 * i + 2];
    const float nx = run.normals[3 * i], ny = run.normals[3 * i + 1], nz = run.normals[3 * i + 2];
    const bool whole = (nx * nx + ny * ny + nz * nz < 1.01f) & (z > 0);  // false for NaN
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
    // Multiplied by the ray in metres, this is the extent along the ray.
    const float slope = across * std::sqrt((1 - cosine2 > 0 ? 1 - cosine2 : 0) / (cosine2 * range2));
    for (int k = 0; k < 3; ++k) {
      const float ray = m[3 * k] * x + m[3 * k + 1] * y + m[3 * k + 2] * z;
      const float normal = m[3 * k] * nx + m[3 * k + 1] * ny + m[3 * k + 2] * nz;
      const float centre = ray * run.octants_per_m + m[9 + k];
      const float reach = run.truncation * std::abs(normal) + across + slope * std::abs(ray);
      const bool fits = usable & (std::abs(centre) < kMaxOctant) & (reach < kMaxReach);
      low[k][i] = fits ? centre - reach : kNone;
      high[k][i] = fits ? centre + reach : -kNone;
    }
  }
  for (int k = 0; k < 3; ++k) {
    for (int i = 0; i < run.count; ++i) boxes.low[k][i] = floor_of(low[k][i]);
    for (int i = 0; i < run.count; ++i) boxes.high[k][i] = floor_of(high[k][i]);
  }
  for (int i = 0; i < run.count; ++i) {
    planes[4 * i] = words[0][i], planes[4 * i + 1] = words[1][i];
    std::memcpy(planes + 4 * i + 2, &numbers[0][i], sizeof(float));
    std::memcpy(planes + 4 * i + 3, &numbers[1][i], sizeof(float));
  }
}

FRINGESLAM_INLINE void unite_body(const OctantBoxes& __restrict upper, const OctantBoxes& __restrict lower,
                                  const SquareBoxes& __restrict above, SquareBoxes& __restrict squares) {
  alignas(64) int32_t apart[kSquares];
  for (int i = 0; i < kSquares; ++i) apart[i] = 0;
  const auto most = [](int a, int b) { return a > b ? a : b; };
  const auto least = [](int a, int b) { return a < b ? a : b; };
  for (int k = 0; k < 3; ++k) {
    const int32_t *const low_1 = upper.low[k], *const low_2 = lower.low[k];
    const int32_t *const high_1 = upper.high[k], *const high_2 = lower.high[k];
    for (int i = 0; i < kSquares; ++i) {
      const int a = low_1[2 * i], b = low_1[2 * i + 1], c = low_2[2 * i], d = low_2[2 * i + 1];
      const int p = high_1[2 * i], q = high_1[2 * i + 1], r = high_2[2 * i], s = high_2[2 * i + 1];
      const int low = least(least(a, b), least(c, d)), high = most(most(p, q), most(r, s));
      const int widest = most(most(p - a, q - b), most(r - c, s - d));
      apart[i] |= high - low > widest + 1 ? 1 : 0;
      squares.low[k][i] = low, squares.high[k][i] = high;
    }
  }
  alignas(64) int32_t from_left[kSquares];
  from_left[0] = 1;
  for (int i = 1; i < kSquares; ++i) {
    int other = apart[i - 1];
    for (int k = 0; k < 3; ++k)
      other |= (squares.low[k][i] ^ squares.low[k][i - 1]) | (squares.high[k][i] ^ squares.high[k][i - 1]);
    from_left[i] = other;
  }
  for (int i = 0; i < kSquares; ++i) {
    int other = above.apart[i];
    for (int k = 0; k < 3; ++k)
      other |= (squares.low[k][i] ^ above.low[k][i]) | (squares.high[k][i] ^ above.high[k][i]);
    const bool any = squares.low[0][i] <= squares.high[0][i];
    squares.is_new[i] = any & ((apart[i] != 0) | ((other != 0) & (from_left[i] != 0))) ? 1 : 0;
    squares.apart[i] = apart[i];
  }
}

// Returns the normal of the neighbour whose plane fits the pixel's point best, in sigmas along that normal; NaN if
// none is within `max_sigmas`.
cv::Vec3f neighbour_plane_normal(const Frame& frame, int row, int col, float max_sigmas) {
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
      if (sigmas2 < best2) best = normal, best2 = sigmas2;  // false for NaN
    }
  }
  return best;
}

void fill_normals(const Frame& frame, int row, float max_sigmas, std::vector<cv::Vec3f>& normals) {
  normals.assign(frame.normals[row], frame.normals[row] + frame.width());
  for (int col = 0; col < frame.width(); ++col) {
    if (std::isnan(normals[static_cast<size_t>(col)][2]) && frame.valid(row, col))
      normals[static_cast<size_t>(col)] = neighbour_plane_normal(frame, row, col, max_sigmas);
  }
}

void touch(const BrickIndex& low, const BrickIndex& high, BrickSet& touched) {
  // Bit mask of the octants of brick b (lower, upper) that lie between low and high along an axis.
  const auto halves = [&](int b, size_t axis) {
    return static_cast<size_t>((low[axis] <= 2 * b ? 1 : 0) & (2 * b <= high[axis] ? 1 : 0)) |
           static_cast<size_t>((low[axis] <= 2 * b + 1 ? 2 : 0) & (2 * b + 1 <= high[axis] ? 2 : 0));
  };
  static constexpr std::array<uint64_t, 4> kX = {0, 0x0f, 0xf0, 0xff}, kY = {0, 0x33, 0xcc, 0xff},
                                           kZ = {0, 0x55, 0xaa, 0xff};
  for (int x = low[0] >> 1; x <= high[0] >> 1; ++x) {
    const uint64_t of_x = kX[halves(x, 0)];
    for (int y = low[1] >> 1; y <= high[1] >> 1; ++y) {
      const uint64_t of_xy = of_x & kY[halves(y, 1)];
      for (int z = low[2] >> 1; z <= high[2] >> 1; ++z)
        touched.insert({brick_key({x, y, z}), of_xy & kZ[halves(z, 2)]});
    }
  }
}

template <class Boxes>
void touch(const Boxes& boxes, int i, BrickSet& touched) {
  touch({boxes.low[0][i], boxes.low[1][i], boxes.low[2][i]}, {boxes.high[0][i], boxes.high[1][i], boxes.high[2][i]},
        touched);
}

// Inserts what squares touch in addition to the previous ones and those above; `upper` and `lower` belong to their
// pixels.
void touch(const SquareBoxes& squares, const OctantBoxes& upper, const OctantBoxes& lower, BrickSet& touched) {
  for (int i = 0; i < kSquares; ++i) {
    if (squares.is_new[i] == 0) continue;
    if (squares.apart[i] == 0) {
      touch(squares, i, touched);
      continue;
    }
    for (const OctantBoxes* row : {&upper, &lower}) touch(*row, 2 * i, touched), touch(*row, 2 * i + 1, touched);
  }
}

}  // namespace

void BrickSet::clear() {
  bricks_.clear();
  recent_.fill({});
  std::fill(slots_.begin(), slots_.end(), 0);
}

void BrickSet::insert(const TouchedBrick& brick) {
  const uint64_t hash = brick.key * 0x9e3779b97f4a7c15u;
  TouchedBrick& recent = recent_[hash >> 32 & (recent_.size() - 1)];
  if (recent.key == brick.key && (brick.octants & ~recent.octants) == 0) return;
  if (2 * bricks_.size() >= slots_.size()) grow();
  const size_t mask = slots_.size() - 1;
  size_t slot = hash >> 40 & mask;
  while (slots_[slot] != 0 && bricks_[slots_[slot] - 1].key != brick.key) slot = (slot + 1) & mask;
  if (slots_[slot] == 0) {
    bricks_.push_back({brick.key, 0});
    slots_[slot] = static_cast<uint32_t>(bricks_.size());
  }
  TouchedBrick& there = bricks_[slots_[slot] - 1];
  there.octants |= brick.octants;
  recent = there;
}

void BrickSet::grow() {
  slots_.assign(std::max<size_t>(1024, 2 * slots_.size()), 0);
  std::vector<TouchedBrick> bricks;
  bricks.swap(bricks_);
  recent_.fill({});
  for (const TouchedBrick& brick : bricks) insert(brick);
}

FramePlanes::FramePlanes(const Pinhole& camera, const VoxelScale& scale, const PlaneLimits& limits)
    : camera_(camera), scale_(scale), limits_(limits) {
  planes_.assign(static_cast<size_t>(stride() * (camera.height + 2)), PixelPlane{0, 0, kNaN, 0});
  bands_.resize(static_cast<size_t>((camera.height + kBandRows - 1) / kBandRows));
}

void FramePlanes::take(const Frame& frame, const Pose& world_from_camera) {
  static const auto prepare = Variants<prepare_body>::of(selected_instruction_set());
  static const auto unite = Variants<unite_body>::of(selected_instruction_set());
  camera_from_world_ = world_from_camera.inverse();
  const double octants_per_m = 2 / (kBrickEdge * scale_.voxel_m);
  const double min_slope_cos = std::cos(limits_.max_slope_deg * std::numbers::pi / 180);
  PixelRun all{};
  for (int i = 0; i < 9; ++i) all.octants_from_camera[i] = static_cast<float>(world_from_camera.rotation(i / 3, i % 3));
  for (int i = 0; i < 3; ++i)
    all.octants_from_camera[9 + i] = static_cast<float>(world_from_camera.translation[i] * octants_per_m);
  all.octants_per_m = static_cast<float>(octants_per_m);
  all.truncation = static_cast<float>(scale_.truncation_m * octants_per_m);
  all.half_pixel = static_cast<float>(0.71 / std::min(camera_.fx, camera_.fy) * octants_per_m);
  all.min_slope_cos = static_cast<float>(min_slope_cos);
  all.min_variance = static_cast<float>(limits_.min_sigma_m * limits_.min_sigma_m);
  for_each_row(static_cast<int>(bands_.size()), [&](int band) {
    BrickSet& touched = bands_[static_cast<size_t>(band)];
    touched.clear();
    std::vector<SquareBoxes> squares(static_cast<size_t>((frame.width() + kRun - 1) / kRun));
    for (SquareBoxes& first : squares) std::fill_n(first.apart, kSquares, 1);  // as if there were no squares above
    std::vector<cv::Vec3f> normals;
    std::array<std::vector<OctantBoxes>, 2> rows;
    OctantBoxes none;
    std::fill_n(none.low[0], 3 * kRun, static_cast<int>(kNone));
    std::fill_n(none.high[0], 3 * kRun, static_cast<int>(-kNone));
    for (int first = band * kBandRows; first < std::min((band + 1) * kBandRows, frame.height()); first += 2) {
      for (int lower = 0; lower < 2; ++lower) {
        const int row = first + lower;
        rows[static_cast<size_t>(lower)].assign(squares.size(), none);
        if (row >= frame.height()) continue;
        fill_normals(frame, row, static_cast<float>(limits_.max_off_plane_sigma), normals);
        for (int col = 0; col < frame.width(); col += kRun) {
          PixelRun run = all;
          run.count = std::min(kRun, frame.width() - col);
          run.points = frame.points_m[row][col].val;
          run.normals = normals[static_cast<size_t>(col)].val;
          run.sigma = frame.sigma_m[row] + col;
          run.grey = frame.texture[row] + col;
          PixelPlane* const planes = planes_.data() + (row + 1) * stride() + col + 1;
          prepare(run, reinterpret_cast<uint32_t*>(planes),
                  rows[static_cast<size_t>(lower)][static_cast<size_t>(col / kRun)]);
        }
      }
      for (size_t run = 0; run < squares.size(); ++run) {
        const SquareBoxes above = squares[run];
        unite(rows[0][run], rows[1][run], above, squares[run]);
        touch(squares[run], rows[0][run], rows[1][run], touched);
      }
    }
  });
}

void FramePlanes::collect(int number, BrickSet& bricks) const {
  for (const BrickSet& touched : bands_) {
    for (const TouchedBrick& brick : touched.bricks()) bricks.insert({brick.key, brick.octants << 8 * number});
  }
}

}  // namespace fringeslam
