// SPDX-License-Identifier: Apache-2.0
// What motion of the rig during a sequence does to the phase, and how to undo it (METHOD, motion during the sequence).
//
// While the surface moves before a pixel, the projector coordinate that the pixel sees drifts, u(t) = u + u' t. With
// t_k the time of an image from that to which the result shall belong and eps_k = 2 pi u' t_k / p,
//
//   I_k = I' + I'' cos(phi + delta_k + eps_k).
//
// The weights C_k of I'' cos phi and S_k of I'' sin phi add up to zero, so what was estimated with the delta_k alone is
//
//   (cos phi_m, sin phi_m) ~ M (cos phi, sin phi),   M = sum_k (C_k, S_k)^T (cos(delta_k + eps_k), -sin(delta_k +
//   eps_k))
//
// and phi follows by the inverse of this 2 x 2 matrix, for whatever steps and drifts. To first order, for N equally
// spaced steps,
//
//   phi_m - phi = (2/N) sum_k sin^2(phi + delta_k) eps_k,
//
// for three steps -2 pi/3, 0, 2 pi/3 with a drift of eps a step about the middle one -(eps / sqrt 3) sin 2 phi.
//
// The surface's points move with w(P) = -(omega x P + v) relative to a camera of twist (omega, v). At the pixel of ray
// d = (x, y, 1) the depth changes by z' = n.w / (n.d), and the coordinate by u' = du/dz z'.
//
// What this does not undo: that u' changes within the sequence, of second order in its duration, and what passes the
// pixel when the surface moves across the view: other texture, and relief finer than the normals know. That is of first
// order, too, in their change over the path in the image.
#pragma once

#include <vector>

#include "core/decode/decode.h"

namespace fringeslam {

// Of the camera, in its own frame.
struct CameraTwist {
  Eigen::Vector3d angular_rad_s = Eigen::Vector3d::Zero();
  Eigen::Vector3d velocity_m_s = Eigen::Vector3d::Zero();  // of its centre
};

// Of images taken at the camera's rate, from the middle of the sequence.
std::vector<double> image_times_s(size_t images, const Timing& timing);

// Drift of the coordinate that each pixel sees, px/s, H x W; NaN where the frame has no point. `rays` are those of the
// rig's camera. A point without a normal takes that of its neighbours. Throws Error when sizes differ.
cv::Mat1f coordinate_rate(const Frame& frame, const RigModel& rig, const PixelRays& rays, const CameraTwist& twist,
                          Axis axis = Axis::columns);

// Moves coordinates, with their wrapped phases and orders, to the time 0 of the images' times, one for each image of
// the sequence. `options` are those of decode(). Nothing changes where the rate is 0 or NaN. Throws Error when sizes
// differ.
void compensate_motion(DecodedStack& decoded, const PatternSequence& sequence, const DecodeOptions& options,
                       const cv::Mat1f& rate_px_s, const std::vector<double>& times_s, Axis axis = Axis::columns);

}  // namespace fringeslam
