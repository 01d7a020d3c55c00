// SPDX-License-Identifier: Apache-2.0
// Effect of rig motion during a sequence on the phase, and its compensation (docs/method.md, section 9).
//
// When the surface moves relative to a pixel, the projector coordinate that the pixel sees drifts, u(t) = u + u' t.
// With t_k the middle of an exposure relative to the reference time of the result and eps_k = 2 pi u' t_k / p,
//
//   I_k = I' + I'' cos(phi + delta_k + eps_k).
//
// The weights C_k of I'' cos phi and S_k of I'' sin phi sum to zero, so the estimate based on delta_k alone is
//
//   (cos phi_m, sin phi_m) ~ M (cos phi, sin phi),
//   M = sum_k (C_k, S_k)^T (cos(delta_k + eps_k), -sin(delta_k + eps_k))
//
// and phi follows from the inverse of this 2 x 2 matrix, for any steps and drifts. To first order, for N equally spaced
// steps,
//
//   phi_m - phi = (2/N) sum_k sin^2(phi + delta_k) eps_k,
//
// and for three steps -2 pi/3, 0, 2 pi/3 with a drift of eps per step about the middle one, -(eps / sqrt 3) sin 2 phi.
//
// Surface points move with w(P) = -(omega x P + v) relative to a camera with twist (omega, v). At the pixel with ray d
// = (x, y, 1) the depth changes by z' = n.w / (n.d) and the coordinate by u' = du/dz z'.
//
// Not compensated: changes of u' within the sequence, of second order in its duration; and texture and relief below the
// scale of the normals that pass the pixel when the surface moves across the view, an error of first order in their
// change along the path in the image.
#pragma once

#include <vector>

#include "core/decode/decode.h"

namespace fringeslam {

// Twist of the camera in its own frame.
struct CameraTwist {
  Eigen::Vector3d angular_rad_s = Eigen::Vector3d::Zero();
  Eigen::Vector3d velocity_m_s = Eigen::Vector3d::Zero();  // of the camera centre
};

// Returns the drift of the projector coordinate that each pixel sees, px/s, H x W; NaN where the frame has no point.
// `rays` are those of the rig's camera. A point without a normal uses neighbour_normal(). Throws Error if sizes differ.
cv::Mat1f coordinate_rate(const Frame& frame, const RigModel& rig, const PixelRays& rays, const CameraTwist& twist,
                          Axis axis = Axis::columns);

// Transforms coordinates, wrapped phases and orders from the times of the exposures to stack.timestamp_s. `stack` and
// `options` are those passed to decode(). Pixels with a rate of 0 or NaN are unchanged. Throws Error if check_stack()
// does or if sizes differ.
void compensate_motion(DecodedStack& decoded, const FringeStack& stack, const DecodeOptions& options,
                       const cv::Mat1f& rate_px_s, Axis axis = Axis::columns);

}  // namespace fringeslam
