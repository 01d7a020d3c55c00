// SPDX-License-Identifier: Apache-2.0
// Projector coordinate + calibration -> Frame: points, sigma, normals, texture, 8-bit depth image. The equations are in
// triangulation.h.
#pragma once

#include <optional>

#include "core/depth/triangulation.h"
#include "core/types/decoded_stack.h"
#include "core/types/frame.h"
#include "core/types/options.h"
#include "core/types/rig_model.h"
#include "core/types/selected_instruction_set.h"

namespace fringeslam {

// When sigma accounts for light from nearby surfaces: for `micro`, whose orders survive indirect light, or always.
enum class IndirectLight { automatic, never, always };

constexpr auto choices(IndirectLight) {
  using enum IndirectLight;
  return std::to_array<Choice<IndirectLight>>({{automatic, "auto"}, {never, "never"}, {always, "always"}});
}

struct DepthOptions {
  double near_m = 0.4, far_m = 2.5;  // depths outside are rejected
  double max_slope_deg = 89;         // steeper depth steps between neighbours are discontinuities
  double max_sigma_m = 0.005;
  bool texture_correction = true;
  double footprint_noise = 0.03;
  int normal_radius_px = 5;      // of the largest window; smaller ones are used near edges
  double max_normal_chi2 = 2.5;  // of the plane fit, per degree of freedom
  IndirectLight indirect_light = IndirectLight::automatic;
  double indirect_albedo = 0.8;

  template <class Visitor>
  void describe(Visitor& v) {
    v.field("near_m", near_m, {0.01, 100}, "minimum depth, m");
    v.field("far_m", far_m, {0.01, 100}, "maximum depth, m");
    v.field("max_slope_deg", max_slope_deg, {10, 89.9},
            "surface slope beyond which a depth step is a discontinuity, degrees");
    v.field("max_sigma_m", max_sigma_m, {0, 10}, "maximum depth sigma, m");
    v.field("texture_correction", texture_correction,
            "corrects points beside texture for the camera's blur: pixel, blur_px and defocus of the rig's lens");
    v.field("footprint_noise", footprint_noise, {0, 1},
            "depth sigma due to texture within a pixel, as a fraction of the depth change across it");
    v.field("normal_radius_px", normal_radius_px, {1, 15}, "half width of the largest window for normals, px");
    v.field("max_normal_chi2", max_normal_chi2, {0.1, 1e12},
            "maximum chi-square per degree of freedom of the plane fit of a normal");
    v.field("indirect_light", indirect_light,
            "sigma accounts for light that nearby surfaces reflect onto each other (auto, never, always); auto: "
            "except where several long periods or a spatial path give the orders");
    v.field("indirect_albedo", indirect_albedo, {0, 1}, "albedo of the surfaces assumed for that light");
  }
};

// Computes only texture, points and sigmas; reuses the images of `frame` if they have the right size. Throws Error if
// sizes differ.
void triangulate(Frame& frame, const DecodedStack& decoded, const Triangulation& triangulation,
                 const DepthOptions& options, InstructionSet set = selected_instruction_set());

// Returns the variance of the point spread in the camera image, px^2, of a surface at `distance_m`, if reconstruct() corrects
// points for texture under it (docs/method.md, section 4.1); empty if it does not, or if the rig does not state its lens's blur.
std::optional<double> corrected_spread_px2(const DecodedStack& decoded, const Triangulation& triangulation,
                                           const DepthOptions& options, double distance_m);

// Computes the complete frame. Throws Error if sizes differ or options are out of range.
Frame reconstruct(const DecodedStack& decoded, const RigModel& rig, const Triangulation& triangulation,
                  const DepthOptions& options);
Frame reconstruct(const DecodedStack& decoded, const RigModel& rig, const PixelRays& rays, const DepthOptions& options);

// Returns the depth image: 255 (far - z) / (far - near), rounded and clamped to 1 (far or beyond) ... 255 (near or
// closer); 0 = no data (docs/method.md, section 4.2).
cv::Mat1b depth_image(const cv::Mat3f& points_m, double near_m, double far_m);

}  // namespace fringeslam
