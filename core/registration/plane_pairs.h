// SPDX-License-Identifier: Apache-2.0
// Pairs of source points and the target pixels they fall on, and their normal equations; see icp.h. Sixteen points are
// processed at a time in single precision: residuals are of the order of 1e-5 m, rounding of positions 1e-7 m.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "core/types/frame.h"
#include "core/types/pinhole.h"
#include "core/types/pose.h"

namespace fringeslam {

// Normal equations over all pairs, and statistics of the fit.
struct PlaneSums {
  Matrix6d information = Matrix6d::Zero();
  Vector6d gradient = Vector6d::Zero();
  double squares_m2 = 0, squares_sigma = 0;
  int pairs = 0;
  int seen = 0;  // points that fall on a target pixel with a normal, paired or not
};

// Vector used as a pair's normal in the sums.
enum class PairNormal {
  mean,            // of both frames' normals
  half_difference  // its sums estimate the noise of the mean, since the two normals' noise is independent
};

struct PlaneGates {
  double distance_m = 0;     // limit of the point-to-plane residual
  double outlier_sigma = 0;  // Tukey's cut-off
};

class PlanePairs {
 public:
  // Throws Error if the target frame's images are not contiguous. The frames must outlive this object.
  PlanePairs(const Frame& target, const Frame& source, const Pinhole& camera, double max_normal_deg);

  // Number of points at a stride of 1, 2, 4, 8 or 16: every `stride`-th source pixel with a normal in every
  // `stride`-th row.
  int points(int stride) { return level(stride).count; }
  // Computes the normal equations at a pose. With half_difference the information is that induced by the normals'
  // noise; pairs, weights and residuals are those of the mean normal, and the gradient is meaningless.
  PlaneSums linearise(const Pose& target_from_source, const PlaneGates& gates, int stride,
                      PairNormal normal = PairNormal::mean);

 private:
  // x, y, z, normal and sigma of `count` points, padded with NaN to a multiple of the kernels' lanes.
  class Points {
   public:
    explicit Points(int points);
    int count, padded;
    float* array(int quantity) { return values_.get() + quantity * padded; }
    const float* array(int quantity) const { return values_.get() + quantity * padded; }
    void set(int i, const Frame& frame, int row, int col);

   private:
    std::unique_ptr<float[]> values_;
  };
  static Points sampled(const Frame& frame, int stride);
  const Points& level(int stride);  // computed on first use

  Pinhole camera_;
  float largest_r2_;
  float min_normal_cos_;
  const Frame& target_;
  // During linearise(): each point's target pixel, and the number of points of each half on each pixel; uses_ is zero
  // otherwise.
  std::vector<int32_t> pixel_;
  std::array<std::vector<int32_t>, 2> uses_;
  std::vector<std::optional<Points>> levels_;
  const Frame& source_;
};

}  // namespace fringeslam
