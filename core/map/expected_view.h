// SPDX-License-Identifier: Apache-2.0
// Predicts the depth seen by a camera at a given pose from known frames, and its standard deviation; the `predicted`
// unwrapping takes its fringe orders from it (docs/method.md, section 3.2).
//
// Each point p of a known frame is moved into the current camera, x = R p + t, where its tangent plane covers 3 x 3
// pixels. A plane n.X = D is linear in inverse depth, so with the ray d = (x, y, 1) of a pixel
//
//   1/z = m.d,   m = n / D
//
// and planes are reproduced exactly, for any slope and lens. The largest 1/z occludes what lies behind it; among the
// points whose planes agree with it within their noise, the one projected nearest to the pixel's centre wins.
// Background therefore does not show through a surface until its points are stretched apart threefold.
//
// With cov, the covariance of (R, t) in the tangent of retract(), sigma_p of the point's depth along its ray d_p, and
// X = z d the predicted point, to first order
//
//   sigma_z^2 = (g^T cov g + (n.R d_p)^2 sigma_p^2) / (n.d)^2,   g = ((X - t) x n, n)
//
// Where a surface ends, a small pose error makes a pixel see another surface, which a first-order model does not
// cover. The step between a pixel and the next known pixels in its row and column is measured by their distance from
// each other's tangent planes; pixels within reach of the image shift caused by the pose error have this step added to
// their sigma.
#pragma once

#include <vector>

#include "core/types/frame.h"
#include "core/types/options.h"
#include "core/types/pinhole.h"
#include "core/types/pose.h"

namespace fringeslam {

struct ExpectedViewOptions {
  double surface_sigmas = 6;  // planes that differ by less belong to one surface
  double shift_sigmas = 3;    // distance from a step within which its surfaces may be confused

  template <class Visitor>
  void describe(Visitor& v) {
    v.field("surface_sigmas", surface_sigmas, {1, 1000},
            "points whose planes differ by less belong to one surface, sigmas");
    v.field("shift_sigmas", shift_sigmas, {0, 100},
            "distance from a depth step within which a pixel may show either surface, sigmas of the image shift");
  }
};

// A known frame and the uncertainty of its pose relative to the current camera.
struct KnownView {
  const Frame* frame = nullptr;
  Pose current_from_known;
  Matrix6d covariance = Matrix6d::Zero();  // of current_from_known, in the tangent of retract()
};

// H x W of the current camera; NaN where no depth is predicted.
struct ExpectedView {
  cv::Mat1f depth_m, sigma_m;
};

// Predicts the depth and its sigma from the known frames, at most 254; earlier ones take precedence where several show
// the same surface. `rays` are those of `camera`. Throws Error if sizes differ or options are out of range.
ExpectedView expected_view(const std::vector<KnownView>& known, const Pinhole& camera, const PixelRays& rays,
                           const ExpectedViewOptions& options = {});

}  // namespace fringeslam
