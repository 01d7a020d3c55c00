// SPDX-License-Identifier: Apache-2.0
#include "core/registration/plane_pairs.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>

#include "core/base/constants.h"
#include "core/base/parallel.h"
#include "core/types/error.h"
#include "core/types/projection.h"
#include "core/types/selected_instruction_set.h"

namespace fringeslam {

namespace {

constexpr int kLanes = 16;
constexpr int kChunk = 512;  // points whose sums are accumulated in single precision

struct PointArrays {
  const float *x, *y, *z, *nx, *ny, *nz, *sigma;
};

// The target's images, and the number of points that fall on each pixel.
struct TargetImages {
  const float *points, *normals, *sigma;  // three, three and one values per pixel
  std::array<const int32_t*, 2> uses;     // of each half of the points
};

// Writes the target pixel of each point, or -1 outside the image, whose points have at most `largest_r2` (Pinhole).
FRINGESLAM_INLINE void associate_body(PointArrays source, int count, Projection p, float largest_r2,
                                      int32_t* __restrict pixel) {
  for (int i = 0; i < count; ++i) {
    const float sx = source.x[i], sy = source.y[i], sz = source.z[i];
    const float x = p.r[0] * sx + p.r[1] * sy + p.r[2] * sz + p.t[0];
    const float y = p.r[3] * sx + p.r[4] * sy + p.r[5] * sz + p.t[1];
    const float z = p.r[6] * sx + p.r[7] * sy + p.r[8] * sz + p.t[2];
    const float a = x / z, b = y / z, r2 = a * a + b * b, radial = 1 + r2 * (p.k1 + r2 * (p.k2 + r2 * p.k3));
    const float u = p.fx * (a * radial + 2 * p.p1 * a * b + p.p2 * (r2 + 2 * a * a)) + p.cx + 0.5f;
    const float v = p.fy * (b * radial + p.p1 * (r2 + 2 * b * b) + 2 * p.p2 * a * b) + p.cy + 0.5f;
    const bool inside = (z > 0) & (r2 <= largest_r2) & (u >= 0) & (v >= 0) & (u < static_cast<float>(p.width)) &
                        (v < static_cast<float>(p.height));
    const int col = static_cast<int>(inside ? u : 0), row = static_cast<int>(inside ? v : 0);
    pixel[i] = inside ? row * p.width + col : -1;
  }
}

// Correspondences of a chunk's points: point, normal, sigma, and the number of points on the pixel.
struct alignas(64) Partners {
  float quantity[8][kChunk];
  const float* operator[](int k) const { return quantity[k]; }
};

// Kept out of the kernels, where compilers split gathers into scalar loads.
void gather(const int32_t* pixel, int count, const TargetImages& target, Partners& partners) {
  for (int i = 0; i < count; ++i) {
    const int at = std::max(pixel[i], 0);
    for (int k = 0; k < 3; ++k) {
      partners.quantity[k][i] = target.points[3 * at + k];
      partners.quantity[3 + k][i] = target.normals[3 * at + k];
    }
    partners.quantity[6][i] = target.sigma[at];
    partners.quantity[7][i] = static_cast<float>(target.uses[0][at] + target.uses[1][at]);
  }
}

// Limits for pairs.
struct Gates {
  float distance, outlier_sigma, normal_cos;
  float other;  // +1: mean normal in the sums, -1: half the difference
};

constexpr int kSums = 21 + 6 + 4;
struct alignas(64) LaneSum {
  float value[kLanes];
  float& operator[](int lane) { return value[lane]; }
};
using LaneSums = std::array<LaneSum, kSums>;

// Computes the sums of a chunk of points, lane by lane. `count` is a multiple of the lanes.
FRINGESLAM_INLINE void linearise_body(PointArrays source, const int32_t* pixel, int count, Projection p,
                                      const Partners& partner, Gates gates, LaneSums& sums) {
  for (LaneSum& lanes : sums) {
    for (float& value : lanes.value) value = 0;
  }
  const float cut_off = gates.outlier_sigma * gates.outlier_sigma;
  for (int first = 0; first < count; first += kLanes) {
    alignas(64) float g[6][kLanes], weight[kLanes], pull[kLanes], residual2[kLanes], square2[kLanes], paired[kLanes],
        seen[kLanes];
    for (int lane = 0; lane < kLanes; ++lane) {
      const int i = first + lane;
      const float sx = source.x[i], sy = source.y[i], sz = source.z[i];
      const float mx = source.nx[i], my = source.ny[i], mz = source.nz[i];
      const float rx = p.r[0] * sx + p.r[1] * sy + p.r[2] * sz, px = p.r[0] * mx + p.r[1] * my + p.r[2] * mz;
      const float ry = p.r[3] * sx + p.r[4] * sy + p.r[5] * sz, py = p.r[3] * mx + p.r[4] * my + p.r[5] * mz;
      const float rz = p.r[6] * sx + p.r[7] * sy + p.r[8] * sz, pz = p.r[6] * mx + p.r[7] * my + p.r[8] * mz;
      const float qx = partner[0][i], qy = partner[1][i], qz = partner[2][i], q_sigma = partner[6][i];
      const float q_nx = partner[3][i], q_ny = partner[4][i], q_nz = partner[5][i];
      // The mean of both normals: two points on a curved surface lie at equal distances on opposite sides of each
      // other's tangent planes, and the mean plane passes through both (Rusinkiewicz, A symmetric objective function
      // for ICP, 2019).
      const float cosine = px * q_nx + py * q_ny + pz * q_nz, scale = 1 / std::sqrt(2 + 2 * cosine);
      const float nx = scale * (px + q_nx), ny = scale * (py + q_ny), nz = scale * (pz + q_nz);
      const float residual = nx * (rx + p.t[0] - qx) + ny * (ry + p.t[1] - qy) + nz * (rz + p.t[2] - qz);
      const float sigma_q = (nx * qx + ny * qy + nz * qz) / qz * q_sigma;
      const float sigma_p = (nx * rx + ny * ry + nz * rz) / sz * source.sigma[i];
      // Several points on one pixel share its single measurement.
      const float variance = partner[7][i] * sigma_q * sigma_q + sigma_p * sigma_p;
      const float square = residual * residual / variance, scaled = square / cut_off;
      // Without a normal there is no pair: the pixel sees an edge, and its point may lie on either side of it.
      const bool is_pair =
          (pixel[i] >= 0) & (cosine >= gates.normal_cos) & (std::abs(residual) <= gates.distance) & (scaled < 1);
      const float robust = (1 - scaled) * (1 - scaled);  // Tukey's weight
      weight[lane] = is_pair ? robust / variance : 0;
      pull[lane] = is_pair ? robust / variance * residual : 0;
      residual2[lane] = is_pair ? residual * residual : 0;
      square2[lane] = is_pair ? square : 0;
      paired[lane] = is_pair ? 1.0f : 0.0f;
      seen[lane] = (pixel[i] >= 0) & (cosine >= -2) ? 1.0f : 0.0f;  // false for NaN
      const float gx = scale * (px + gates.other * q_nx), gy = scale * (py + gates.other * q_ny),
                  gz = scale * (pz + gates.other * q_nz);
      g[0][lane] = is_pair ? ry * gz - rz * gy : 0;
      g[1][lane] = is_pair ? rz * gx - rx * gz : 0;
      g[2][lane] = is_pair ? rx * gy - ry * gx : 0;
      g[3][lane] = is_pair ? gx : 0;
      g[4][lane] = is_pair ? gy : 0;
      g[5][lane] = is_pair ? gz : 0;
    }
    size_t k = 0;
    for (int a = 0; a < 6; ++a) {
      alignas(64) float weighted[kLanes];
      for (int lane = 0; lane < kLanes; ++lane) weighted[lane] = weight[lane] * g[a][lane];
      for (int b = a; b < 6; ++b, ++k) {
        for (int lane = 0; lane < kLanes; ++lane) sums[k][lane] += weighted[lane] * g[b][lane];
      }
    }
    for (int a = 0; a < 6; ++a, ++k) {
      for (int lane = 0; lane < kLanes; ++lane) sums[k][lane] += pull[lane] * g[a][lane];
    }
    for (int lane = 0; lane < kLanes; ++lane) {
      sums[k][lane] += residual2[lane];
      sums[k + 1][lane] += square2[lane];
      sums[k + 2][lane] += paired[lane];
      sums[k + 3][lane] += seen[lane];
    }
  }
}

void add(const LaneSums& lanes, PlaneSums& total) {
  std::array<double, kSums> sums{};
  for (size_t k = 0; k < kSums; ++k) {
    for (const float lane : lanes[k].value) sums[k] += static_cast<double>(lane);
  }
  size_t k = 0;
  for (int a = 0; a < 6; ++a) {
    for (int b = a; b < 6; ++b) total.information(a, b) += sums[k++];
  }
  for (int a = 0; a < 6; ++a) total.gradient[a] += sums[k++];
  total.squares_m2 += sums[k++];
  total.squares_sigma += sums[k++];
  total.pairs += static_cast<int>(sums[k++]);
  total.seen += static_cast<int>(sums[k]);
}

}  // namespace

PlanePairs::PlanePairs(const Frame& target, const Frame& source, const Pinhole& camera, double max_normal_deg)
    : camera_(camera),
      largest_r2_(static_cast<float>(camera.largest_r2())),
      min_normal_cos_(static_cast<float>(std::cos(max_normal_deg * std::numbers::pi / 180))),
      target_(target),
      levels_(5),
      source_(source) {
  if (!target.points_m.isContinuous() || !target.normals.isContinuous() || !target.sigma_m.isContinuous())
    throw Error("registration: the target frame's images must be contiguous; clone them");
  for (std::vector<int32_t>& uses : uses_) uses.assign(target.points_m.total(), 0);
}

PlanePairs::Points::Points(int points)
    : count(points),
      padded((points + kLanes - 1) / kLanes * kLanes),
      values_(std::make_unique_for_overwrite<float[]>(static_cast<size_t>(7 * padded))) {
  for (int k = 0; k < 7; ++k) std::fill(array(k) + count, array(k) + padded, kNaN);
}

void PlanePairs::Points::set(int i, const Frame& frame, int row, int col) {
  const cv::Vec3f &p = frame.points_m(row, col), &n = frame.normals(row, col);
  for (int k = 0; k < 3; ++k) array(k)[i] = p[k], array(3 + k)[i] = n[k];
  array(6)[i] = frame.sigma_m(row, col);
}

PlanePairs::Points PlanePairs::sampled(const Frame& frame, int stride) {
  // Index of each row's first point.
  const int rows = (frame.height() + stride - 1) / stride;
  std::vector<int> first(static_cast<size_t>(rows) + 1, 0);
  const auto for_each_point = [&](int row, const auto& visit) {
    for (int col = 0; col < frame.width(); col += stride) {
      if (!std::isnan(frame.normals(row * stride, col)[2])) visit(col);
    }
  };
  for_each_row(rows, [&](int row) { for_each_point(row, [&](int) { ++first[static_cast<size_t>(row) + 1]; }); });
  std::partial_sum(first.begin(), first.end(), first.begin());
  Points points(first.back());
  for_each_row(rows, [&](int row) {
    int i = first[static_cast<size_t>(row)];
    for_each_point(row, [&](int col) { points.set(i++, frame, row * stride, col); });
  });
  return points;
}

const PlanePairs::Points& PlanePairs::level(int stride) {
  std::optional<Points>& points = levels_[static_cast<size_t>(std::countr_zero(static_cast<unsigned>(stride)))];
  if (!points) points = sampled(source_, stride);
  return *points;
}

PlaneSums PlanePairs::linearise(const Pose& target_from_source, const PlaneGates& gates, int stride,
                                PairNormal normal) {
  static const auto associate = Variants<associate_body>::of(selected_instruction_set());
  static const auto linearise_chunk = Variants<linearise_body>::of(selected_instruction_set());
  const Points& points = level(stride);
  const auto from = [&](int first) {
    const auto at = [&](int quantity) { return points.array(quantity) + first; };
    return PointArrays{at(0), at(1), at(2), at(3), at(4), at(5), at(6)};
  };
  const Projection projection(target_from_source, camera_);
  const Gates limits{static_cast<float>(gates.distance_m), static_cast<float>(gates.outlier_sigma), min_normal_cos_,
                     normal == PairNormal::mean ? 1.0f : -1.0f};
  const int chunks = (points.padded + kChunk - 1) / kChunk;
  pixel_.resize(static_cast<size_t>(points.padded));
  for_each_row(chunks, [&](int chunk) {
    const int first = chunk * kChunk;
    associate(from(first), std::min(kChunk, points.padded - first), projection, largest_r2_, pixel_.data() + first);
  });
  // Each half of the points has its own counts, so that two threads can count them.
  const auto for_each_use = [&](const auto& visit) {
    for_each_row(2, [&](int half) {
      const size_t middle = pixel_.size() / 2, end = half == 0 ? middle : pixel_.size();
      std::vector<int32_t>& uses = uses_[static_cast<size_t>(half)];
      for (size_t i = half == 0 ? 0 : middle; i < end; ++i) {
        if (pixel_[i] >= 0) visit(uses[static_cast<size_t>(pixel_[i])]);
      }
    });
  };
  for_each_use([](int32_t& uses) { ++uses; });
  const TargetImages target{target_.points_m.ptr<float>(),
                            target_.normals.ptr<float>(),
                            target_.sigma_m.ptr<float>(),
                            {uses_[0].data(), uses_[1].data()}};
  std::vector<LaneSums> sums(static_cast<size_t>(chunks));
  for_each_row(chunks, [&](int chunk) {
    const int first = chunk * kChunk, count = std::min(kChunk, points.padded - first);
    Partners partners;
    gather(pixel_.data() + first, count, target, partners);
    linearise_chunk(from(first), pixel_.data() + first, count, projection, partners, limits,
                    sums[static_cast<size_t>(chunk)]);
  });
  for_each_use([](int32_t& uses) { uses = 0; });
  PlaneSums total;
  for (const LaneSums& chunk : sums) add(chunk, total);
  total.information.triangularView<Eigen::StrictlyLower>() = total.information.transpose();
  return total;
}

}  // namespace fringeslam
