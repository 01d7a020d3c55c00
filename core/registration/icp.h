// SPDX-License-Identifier: Apache-2.0
// Registration of two organised frames: point-to-plane ICP with projective association and weights from
// the depth sigmas (METHOD S22, `point_to_plane`).
//
// A source point p is moved into the target's camera, x = T p, and projected; the pixel it falls on gives
// the partner q. Both must have normals that agree; n is the mean of the two, so that curvature does not pull (S.
// Rusinkiewicz, A symmetric objective function for ICP, 2019). With r = n.(x - q), m source points that fall on q, and
//
//   sigma^2 = m (n.d_q)^2 sigma_q^2 + (n.R d_p)^2 sigma_p^2      (d = the pixel's ray, d_z = 1)
//
// Gauss-Newton minimises sum rho(r / sigma) over T, rho = Tukey's biweight. The information matrix
// sum g g^T / sigma^2, g = (R p x n, n), is that of the tangent of retract(): a mean over m points knows q once.
//
// Normals are measured too, and their noise looks like surfaces of all directions: a bare plane that is seen dimly
// would seem to hold the view sideways. The noise of the two normals n_p, n_q is independent, so that sums with (n_p -
// n_q)/2 instead of their mean are that feigned part on the average (the errors-in-variables bias of the normal
// equations); it is taken off the information.
#pragma once

#include "core/types/frame.h"
#include "core/types/options.h"
#include "core/types/pinhole.h"
#include "core/types/pose.h"

namespace fringeslam {

struct IcpOptions {
  int max_iterations = 40;
  double max_distance_m = 0.08;  // of partners, in the first iteration; shrinks as the fit improves
  double max_normal_deg = 30;    // between the normals of partners
  double outlier_sigma = 6;      // Tukey's cut-off, in sigmas
  double min_overlap = 0.15;     // share of source points with a partner
  double max_rms_sigma = 2.5;    // of the residuals in sigmas, for "converged"
  int stride = 1;                // of the source points' rows and columns

  template <class Visitor>
  void describe(Visitor& v) {
    v.field("max_iterations", max_iterations, {1, 10000}, "Gauss-Newton iterations");
    v.field("stride", stride, {1, 16}, "every so many-th point of a row and of a column counts: 1, 2, 4, 8 or 16");
    v.field("max_distance_m", max_distance_m, {1e-6, 10}, "largest distance of partners at the start, m");
    v.field("max_normal_deg", max_normal_deg, {1, 180}, "largest angle between the normals of partners, degrees");
    v.field("outlier_sigma", outlier_sigma, {1, 1000}, "Tukey cut-off of residuals, sigmas");
    v.field("min_overlap", min_overlap, {0, 1}, "least share of source points with a partner");
    v.field("max_rms_sigma", max_rms_sigma, {0.1, 1000}, "largest RMS residual of a good fit, sigmas");
  }
};

struct IcpResult {
  Pose target_from_source;
  bool converged = false;
  int iterations = 0;
  int pairs = 0;
  double overlap = 0;      // pairs / source points that count
  double consistency = 0;  // pairs / source points that fall where the target has a surface: others look through it
  double rms_m = 0;        // of the point-to-plane distances
  double rms_sigma = 0;    // of r / sigma; 1 when the sigmas are right
  // By how many sigmas the surfaces would still move the result if partners within 5 mm all counted again: a motion
  // that is right stays, one that slid to rest beside its place, where few things contradict it, goes.
  // 0 without convergence.
  double reopened_sigma = 0;
  Matrix6d information = Matrix6d::Zero();
};

// `prior` is the information of `initial`, in the tangent of retract(), where it comes from other measurements than
// depth (landmarks' texture): it joins the normal equations, and with them the result's information. It decides the
// directions in which the surfaces could slide. Zero: `initial` is only where to start.
IcpResult point_to_plane_icp(const Frame& target, const Frame& source, const Pinhole& camera, const Pose& initial,
                             const IcpOptions& options, const Matrix6d& prior = Matrix6d::Zero());

// The same from no start at all: the frames are of one place, turned against each other by up to about 20 degrees and
// moved by up to 15 cm, and nothing else is known. Starts all round are followed with few points; the pose at which
// most points of both frames lie on one another is refined.
IcpResult register_frames(const Frame& target, const Frame& source, const Pinhole& camera, const IcpOptions& options);

}  // namespace fringeslam
