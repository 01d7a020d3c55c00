// SPDX-License-Identifier: Apache-2.0
// Along the ray of a camera pixel the inverse depth is a smooth function of the projector coordinate u: with
// d = (x, y, 1), a = (R d)_x, c = (R d)_z and the normalised undistorted projector column x_p(u) (METHOD §1),
//
//   1/z = (a - x_p c) / (x_p t_z - t_x)
//
// nearly linear, bent a little by t_z and the projector's lens, whose distortion depends on the row as well. So each
// pixel has one polynomial 1/z = sum c_k s^k, s = (u - centre) / half_range, interpolated once a rig through points
// projected with the full lens model. Depth and its derivative are then a few products: no iteration, no lens.
//
//   z = 1 / w(s),   sigma_z = z^2 |dw/ds| sigma_u / half_range
#pragma once

#include <array>

#include "core/base/instruction_set.h"
#include "core/patterns/patterns.h"
#include "core/types/decoded_stack.h"
#include "core/types/frame.h"
#include "core/types/rig_model.h"

namespace fringeslam {

class Triangulation {
 public:
  static constexpr int kDegree = 5;

  // For depths from near_m to far_m, as far as they lie in the beam. Against the exact solution the polynomial is off
  // by less than 1e-7 of the depth for baselines of a few tenths of the distance.
  Triangulation(const RigModel& rig, const PixelRays& rays, double near_m, double far_m, Axis axis = Axis::columns);

  cv::Size size() const { return rays_.size(); }
  const PixelRays& rays() const { return rays_; }
  double near_m() const { return near_m_; }
  double far_m() const { return far_m_; }
  double pixel_angle() const { return pixel_angle_; }  // of a camera pixel on the axis, rad

  // Depth and sigma of one row of coordinates; NaN where there is none, outside [near_m, far_m], or beyond max_sigma_m.
  void row(int row, const float* coordinate_px, const float* sigma_px, float max_sigma_m, float* depth_m,
           float* sigma_m, InstructionSet set) const;

 private:
  PixelRays rays_;
  double near_m_, far_m_, pixel_angle_;
  std::array<cv::Mat1f, kDegree + 1> coefficients_;
  cv::Mat1f centre_, per_px_;  // s = (u - centre) * per_px
};

// A row of depths with its neighbours; rows of NaN beyond the image.
struct DepthRows {
  const float *above, *here, *below, *sigma;
  const cv::Vec2f* rays;
};

// Points of one row, without flying pixels: a pixel that sees two surfaces mixes their phases and comes out somewhere
// between, with a step to both sides, along its row or along its column. A step is more than per_depth * z + 6 sigma.
void points_row(const DepthRows& rows, int width, float per_depth, float* depth, cv::Vec3f* points, float* sigma,
                InstructionSet set);

}  // namespace fringeslam
