// SPDX-License-Identifier: Apache-2.0
// Pairs of a source point and the target pixel that it falls on, and what they say of the motion; see icp.h for the
// equations. Sixteen points at a time, in single precision: residuals are of 1e-5 m where positions are of 1e-7 m.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "core/types/frame.h"
#include "core/types/pinhole.h"
#include "core/types/pose.h"

namespace fringeslam {

// Normal equations over all pairs, with what tells how well they fit.
struct PlaneSums {
  Matrix6d information = Matrix6d::Zero();
  Vector6d gradient = Vector6d::Zero();
  double squares_m2 = 0, squares_sigma = 0;
  int pairs = 0;
  int seen = 0;  // points that fall on a target pixel with a normal, whether a pair or not
};

// Which vector stands for a pair's normal in the sums.
enum class PairNormal {
  mean,            // of both frames' normals
  half_difference  // of them: what the noise of the mean has on the average, as that of the two is independent
};

struct PlaneGates {
  double distance_m = 0;     // residuals beyond are no pairs
  double outlier_sigma = 0;  // Tukey's cut-off
};

class PlanePairs {
 public:
  PlanePairs(const Frame& target, const Frame& source, const Pinhole& camera, double max_normal_deg);

  // Points are every `stride`-th source pixel of every `stride`-th row that has a normal; strides are 1, 2, 4, 8 or 16.
  int points(int stride) { return level(stride).count; }
  // With half_difference the information is that which the normals' noise feigns; pairs, weights and residuals are
  // those of the mean, and the gradient means nothing.
  PlaneSums linearise(const Pose& target_from_source, const PlaneGates& gates, int stride,
                      PairNormal normal = PairNormal::mean);

 private:
  // x, y, z, the normal's three and sigma of `count` points, then NaN up to a multiple of the kernels' lanes.
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
  const Points& level(int stride);  // made when first asked for

  Pinhole camera_;
  float min_normal_cos_;
  const Frame& target_;
  // Within linearise(): the target pixel of each point, and how many fall on each; zeros outside of it.
  std::vector<int32_t> pixel_, uses_;
  std::vector<std::optional<Points>> levels_;
  const Frame& source_;
};

}  // namespace fringeslam
