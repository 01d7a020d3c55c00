// SPDX-License-Identifier: Apache-2.0
// Projector coordinate + calibration -> Frame: points, sigma, normals, texture, 8-bit depth image.
// triangulation.h has the equations.
#pragma once

#include "core/depth/triangulation.h"
#include "core/types/decoded_stack.h"
#include "core/types/frame.h"
#include "core/types/options.h"
#include "core/types/rig_model.h"

namespace fringeslam {

struct DepthOptions {
  double near_m = 0.4, far_m = 2.5;  // depths outside are dropped
  double max_slope_deg = 89;         // steeper steps between neighbours are discontinuities
  double max_sigma_m = 0.005;
  double footprint_noise = 0.03;
  int normal_radius_px = 5;      // of the largest window; smaller ones near edges
  double max_normal_chi2 = 2.5;  // of the plane fit, per degree of freedom

  template <class Visitor>
  void describe(Visitor& v) {
    v.field("near_m", near_m, {0.01, 100}, "least depth that is kept, m");
    v.field("far_m", far_m, {0.01, 100}, "largest depth that is kept, m");
    v.field("max_slope_deg", max_slope_deg, {10, 89.9}, "slope beyond which a depth step is a discontinuity, degrees");
    v.field("max_sigma_m", max_sigma_m, {0, 10}, "largest depth sigma that is kept, m");
    v.field("footprint_noise", footprint_noise, {0, 1},
            "sigma by what a pixel sees of brightness within itself, of the depth's change over the pixel");
    v.field("normal_radius_px", normal_radius_px, {1, 15}, "half width of the largest window of the normals, px");
    v.field("max_normal_chi2", max_normal_chi2, {0.1, 1e12},
            "largest chi-square per degree of freedom of a normal's plane fit");
  }
};

// Texture, points and sigmas alone; the images of `frame` are used again when they have the right size. Throws Error
// when sizes differ.
void triangulate(Frame& frame, const DecodedStack& decoded, const Triangulation& triangulation,
                 const DepthOptions& options, InstructionSet set = widest_instruction_set());

// The whole frame. Throws Error when sizes differ or options are out of range.
Frame reconstruct(const DecodedStack& decoded, const RigModel& rig, const Triangulation& triangulation,
                  const DepthOptions& options);
Frame reconstruct(const DecodedStack& decoded, const RigModel& rig, const PixelRays& rays, const DepthOptions& options);

// 255 (far - z) / (far - near) rounded, from 1 (far or beyond) to 255 (near or nearer); 0 = no data (METHOD S5).
cv::Mat1b depth_image(const cv::Mat3f& points_m, double near_m, double far_m);

}  // namespace fringeslam
