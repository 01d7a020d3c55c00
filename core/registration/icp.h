// SPDX-License-Identifier: Apache-2.0
// Registration of two organised frames: point-to-plane ICP with projective association, weighted by the depth sigmas
// (docs/method.md, section 7.1, `point_to_plane`).
//
// A source point p is moved into the target's camera, x = T p, and projected; the pixel it falls on gives the
// correspondence q. Both normals must agree; n is their mean, which removes the bias of curved surfaces (S.
// Rusinkiewicz, A symmetric objective function for ICP, 2019). With r = n.(x - q), m source points that fall on q, and
//
//   sigma^2 = m (n.d_q)^2 sigma_q^2 + (n.R d_p)^2 sigma_p^2      (d = the pixel's ray, d_z = 1)
//
// Gauss-Newton minimises sum rho(r / sigma) over T, rho = Tukey's biweight. The information matrix
// sum g g^T / sigma^2, g = (R p x n, n), refers to the tangent of retract(). The factor m accounts for the fact that m
// residuals share one measurement of q.
//
// Normals are noisy too, and their noise imitates surfaces of all orientations: a bare plane with a low signal would
// seem to constrain sideways motion. The noise of the two normals n_p and n_q is independent, so the sums with
// (n_p - n_q)/2 instead of their mean equal this noise-induced information on average (the errors-in-variables bias of
// the normal equations); it is subtracted from the information.
#pragma once

#include "core/types/frame.h"
#include "core/types/options.h"
#include "core/types/pinhole.h"
#include "core/types/pose.h"

namespace fringeslam {

struct IcpOptions {
  int max_iterations = 40;
  double max_distance_m = 0.08;  // of a correspondence in the first iteration; decreases as the fit improves
  double max_normal_deg = 30;    // between the normals of a correspondence
  double outlier_sigma = 6;      // Tukey's cut-off, in sigmas
  double min_overlap = 0.15;     // share of source points with a correspondence
  double max_rms_sigma = 2.5;    // of the residuals in sigmas, required for convergence
  int stride = 1;                // step between source points along rows and columns

  template <class Visitor>
  void describe(Visitor& v) {
    v.field("max_iterations", max_iterations, {1, 10000}, "Gauss-Newton iterations");
    v.field("stride", stride, {1, 16}, "use every n-th point of every n-th row; n is 1, 2, 4, 8 or 16");
    v.field("max_distance_m", max_distance_m, {1e-6, 10},
            "largest point-to-plane distance of a correspondence at the start, m");
    v.field("max_normal_deg", max_normal_deg, {1, 180},
            "largest angle between the normals of a correspondence, degrees");
    v.field("outlier_sigma", outlier_sigma, {1, 1000}, "Tukey cut-off of residuals, sigmas");
    v.field("min_overlap", min_overlap, {0, 1}, "least share of source points with a correspondence");
    v.field("max_rms_sigma", max_rms_sigma, {0.1, 1000}, "largest RMS residual of a converged fit, sigmas");
  }
};

struct IcpResult {
  Pose target_from_source;
  bool converged = false;
  int iterations = 0;
  int pairs = 0;
  double overlap = 0;      // pairs / source points with a normal
  double consistency = 0;  // pairs / source points that fall on a target surface; the rest contradict it
  double rms_m = 0;        // of the point-to-plane distances
  double rms_sigma = 0;    // of r / sigma; 1 if the sigmas are correct
  // By how many sigmas the surfaces would move the result if all correspondences within 5 mm were admitted again:
  // small for a correct motion, large for one that converged to a wrong place with little contradicting evidence. 0
  // without convergence.
  double reopened_sigma = 0;
  Matrix6d information = Matrix6d::Zero();
};

// Registers `source` to `target`, starting from `initial`. `prior` is the information of `initial` from measurements
// other than depth (texture of landmarks), in the tangent of retract(): it is added to the normal equations and to the
// result's information, and determines directions that the surfaces leave free. With zero, `initial` is only a
// starting point. Throws Error for options out of range.
IcpResult point_to_plane_icp(const Frame& target, const Frame& source, const Pinhole& camera, const Pose& initial,
                             const IcpOptions& options, const Matrix6d& prior = Matrix6d::Zero());

// Registers two frames of the same place without an initial pose, for rotations up to about 20 degrees and
// translations up to 15 cm: many starts are refined on few points, and the pose with the best agreement is refined
// further. Throws Error for options out of range.
IcpResult register_frames(const Frame& target, const Frame& source, const Pinhole& camera, const IcpOptions& options);

}  // namespace fringeslam
