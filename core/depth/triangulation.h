// SPDX-License-Identifier: Apache-2.0
// Triangulation (docs/method.md, section 4.1). Along the ray of a camera pixel the inverse depth is a smooth function
// of the projector coordinate u: with d = (x, y, 1), a = (R d)_x, c = (R d)_z and the normalised undistorted projector
// column x_p(u),
//
//   1/z = (a - x_p c) / (x_p t_z - t_x)
//
// which is nearly linear, with a small curvature due to t_z and the projector lens, whose distortion also depends on
// the row. Each pixel therefore has one polynomial 1/z = sum c_k s^k, s = (u - centre) / half_range, interpolated once
// per rig through points projected with the full lens model. Depth and its derivative are then a few multiplications,
// without iteration or lens model:
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

// A row of texture_gradient_row().
struct TextureGradient {
  const float *gradient = nullptr, *noise = nullptr;
};

class Triangulation {
 public:
  static constexpr int kDegree = 5;

  // Interpolates the polynomials for depths from near_m to far_m within the projector's field. The deviation from the
  // exact solution is below 1e-7 of the depth for baselines of a few tenths of the distance. For strong lenses it
  // is larger: errors of more than 0.001 px of the coordinate are added to sigma, and pixels with more than 0.5 px have no depth.
  Triangulation(const RigModel& rig, const PixelRays& rays, double near_m, double far_m, Axis axis = Axis::columns);

  cv::Size size() const { return rays_.size(); }
  const PixelRays& rays() const { return rays_; }
  double near_m() const { return near_m_; }
  double far_m() const { return far_m_; }
  double pixel_angle() const { return pixel_angle_; }  // angle of a camera pixel on the axis, rad

  // Variance of the camera's point spread along each axis, pixel included, at an inverse depth. Defocus is unknown and 0 if
  // none of the lens's pixel_m, f_number and focus_m has been stated.
  struct PointSpread {
    float in_focus_px2 = 0, defocus_px2_m2 = 0, focus_per_m = 0;
    float variance_px2(float inverse_depth) const {
      const float off = inverse_depth - focus_per_m;
      return in_focus_px2 + defocus_px2_m2 * off * off;
    }
  };
  const PointSpread& point_spread() const { return point_spread_; }

  // Computes depth and sigma of one row of coordinates; NaN where unavailable, outside [near_m, far_m], or above
  // max_sigma_m. `texture`, if given, is the result of texture_gradient_row(), whose bias is subtracted from the coordinates.
  void row(int row, const float* coordinate_px, const float* sigma_px, float max_sigma_m, float* depth_m,
           float* sigma_m, InstructionSet set, const TextureGradient& texture = {}) const;

  // False if a nonlinear projector makes the modulation follow the phase, so that its gradients are not those of texture.
  bool modulation_shows_texture() const { return modulation_shows_texture_; }
  // True if the rig states the blur of its camera lens, without which texture under blur is corrected only in part.
  bool blur_is_stated() const { return blur_is_stated_; }

 private:
  PixelRays rays_;
  double near_m_, far_m_, pixel_angle_;
  PointSpread point_spread_;
  bool modulation_shows_texture_, blur_is_stated_;
  std::array<cv::Mat1f, kDegree + 1> coefficients_;
  cv::Mat1f centre_, per_px_;  // s = (u - centre) * per_px
  cv::Mat1f error_px_;         // of the polynomial; empty if negligible
};

// A row of depths with its neighbours; rows beyond the image are NaN.
struct DepthRows {
  const float *above, *here, *below, *sigma;
  const cv::Vec2f* rays;
};

// Computes the points of one row and removes flying pixels: a pixel that sees two surfaces mixes their phases and is
// reconstructed between them, with a step on both sides along its row or along its column. A step exceeds per_depth * z
// + 6 sigma.
void points_row(const DepthRows& rows, int width, float per_depth, float* depth, cv::Vec3f* points, float* sigma,
                InstructionSet set);

}  // namespace fringeslam
