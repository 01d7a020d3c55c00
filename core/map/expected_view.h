// SPDX-License-Identifier: Apache-2.0
// The depth that known frames let a camera expect at a predicted pose, and its standard deviation: what `predicted`
// unwrapping takes its fringe orders from (METHOD S3).
//
// Each point p of a known frame is moved into the current camera, x = R p + t, and covers 3 x 3 pixels there with its
// tangent plane. A plane n.X = D is linear in inverse depth, so with the ray d = (x, y, 1) of a pixel
//
//   1/z = m.d,   m = n / D
//
// and planes come out exactly, whatever their slope and the lens. The largest 1/z covers what is behind it; of the
// points whose planes agree with it within their noise, the one that falls nearest to the pixel's centre decides. So
// nothing shines through between the points of a surface until it is stretched threefold.
//
// With cov, the covariance of (R, t) in the tangent of retract(), sigma_p of the point's depth along its ray d_p, and
// X = z d what the pixel sees, to first order
//
//   sigma_z^2 = (g^T cov g + (n.R d_p)^2 sigma_p^2) / (n.d)^2,   g = ((X - t) x n, n)
//
// Where a surface ends, a pose that is a little wrong makes a pixel show another surface, which no derivative tells.
// The step from each pixel to the next known ones of its row and column is what their distance from one another's
// tangent planes is; pixels as near to it as the pose's error may shift the image have the step in their sigma, too.
#pragma once

#include <vector>

#include "core/types/frame.h"
#include "core/types/options.h"
#include "core/types/pinhole.h"
#include "core/types/pose.h"

namespace fringeslam {

struct ExpectedViewOptions {
  double surface_sigmas = 6;  // planes that differ by less are one surface
  double shift_sigmas = 3;    // how far from a step its two surfaces may be taken for one another

  template <class Visitor>
  void describe(Visitor& v) {
    v.field("surface_sigmas", surface_sigmas, {1, 1000}, "points whose planes differ by less are one surface, sigmas");
    v.field("shift_sigmas", shift_sigmas, {0, 100},
            "distance from a depth step within which a pixel may show either surface, sigmas of the image's shift");
  }
};

// What was seen before, and how far its pose against the current camera is known.
struct KnownView {
  const Frame* frame = nullptr;
  Pose current_from_known;
  Matrix6d covariance = Matrix6d::Zero();  // of current_from_known, in the tangent of retract()
};

// H x W of the current camera; NaN where nothing is known.
struct ExpectedView {
  cv::Mat1f depth_m, sigma_m;
};

// `rays` are those of `camera`. Throws Error when sizes differ.
ExpectedView expected_view(const std::vector<KnownView>& known, const Pinhole& camera, const PixelRays& rays,
                           const ExpectedViewOptions& options = {});

}  // namespace fringeslam
