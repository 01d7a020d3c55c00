// SPDX-License-Identifier: Apache-2.0
#include "sim/light/beam.h"

#include <bit>
#include <cmath>
#include <numbers>

#include "core/base/constants.h"
#include "core/types/selected_instruction_set.h"
#include "sim/light/photometry.h"

namespace fringeslam::sim {

namespace {

// Least blur of the pixel comb, px: beyond it, three harmonics suffice.
constexpr float kLeastCombBlur = 0.2f;

double blur_at(const ProjectorLens& lens, double fx, double z) {
  const double circle_px = lens.aperture_m * fx * std::abs(1 / z - 1 / lens.focus_m);
  return std::sqrt(lens.blur_px * lens.blur_px + circle_px * circle_px / 16);
}

// e^x for x <= 0, to a relative error of 2e-7.
FRINGESLAM_INLINE float exponential(float x) {
  const float t = std::max(x, -80.0f) * 1.44269504f;
  const auto whole = static_cast<int32_t>(t - 0.5f);
  const float r = (t - static_cast<float>(whole)) * 0.69314718f;  // in [-ln 2 / 2, ln 2 / 2]
  const float p = 1 + r * (1 + r * (0.5f + r * (1 / 6.0f + r * (1 / 24.0f + r * (1 / 120.0f + r * (1 / 720.0f))))));
  return p * std::bit_cast<float>((whole + 127) << 23);
}

// cos(2 pi u) for u >= -1/2, to 1e-7.
FRINGESLAM_INLINE float cosine_of_turns(float u) {
  const float shifted = u - static_cast<float>(static_cast<int32_t>(u));  // in (-1, 1)
  const float part = std::abs(shifted);                                   // cosine is even
  const float folded = part > 0.5f ? 1 - part : part;                     // in [0, 1/2]; cosine falls from 1 to -1
  const float x = (0.25f - folded) * 6.2831853f;                          // cos = sin x, |x| <= pi / 2
  const float x2 = x * x;
  return x * (1 - x2 * (1 / 6.0f - x2 * (1 / 120.0f - x2 * (1 / 5040.0f - x2 * (1 / 362880.0f - x2 / 39916800.0f)))));
}

}  // namespace

// Parameters of Beam::light as plain numbers, for vectorisation.
struct BeamKernel {
  double r[9], t[3], position[3];
  double fx, fy, cx, cy, k1, k2, k3, p1, p2;
  double lux_at_1m;
  double left, right, top, bottom;  // image borders, px
  double max_r2;                    // bound on rays that may hit the image
  bool defocus, gap;
  float blur2, circle_px_m, inverse_focus;  // sigma^2 = blur2 + (circle |1/z - 1/focus|)^2
  float comb[3];                            // harmonic amplitudes of the pixel comb

  FRINGESLAM_INLINE void light(const Points& points, BeamPacket& result, double* z, double* margin) const {
#pragma GCC ivdep
    for (int i = 0; i < kPacket; ++i) {
      const double px = points.x[i], py = points.y[i], pz = points.z[i];
      const double tx = position[0] - px, ty = position[1] - py, tz = position[2] - pz;
      const double distance = std::sqrt(tx * tx + ty * ty + tz * tz), nearness = 1 / distance;
      result.distance[i] = distance;
      result.to_light.x[i] = tx * nearness;
      result.to_light.y[i] = ty * nearness;
      result.to_light.z[i] = tz * nearness;
      z[i] = r[6] * px + r[7] * py + r[8] * pz + t[2];
      const double shrink = 1 / z[i];
      const double x = (r[0] * px + r[1] * py + r[2] * pz + t[0]) * shrink;
      const double y = (r[3] * px + r[4] * py + r[5] * pz + t[1]) * shrink;
      const double r2 = x * x + y * y;
      const double radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3));
      const double column = fx * (x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)) + cx;
      const double row = fy * (y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y) + cy;
      result.column[i] = column;
      result.row[i] = row;
      // Signed distance to the nearest border, positive inside; comparisons would prevent vectorisation. max_r2 rejects
      // rays far off the axis that the distortion polynomial folds back into the image.
      const double width = std::min(column - left, right - column), height = std::min(row - top, bottom - row);
      margin[i] = std::min(std::min(width, height), std::min(z[i], max_r2 - r2));
      result.lux[i] = static_cast<float>(lux_at_1m * nearness * nearness);
      result.blur_px[i] = 0;
    }
    if (defocus) {
#pragma GCC ivdep
      for (int i = 0; i < kPacket; ++i) {
        const float circle = circle_px_m * (1 / static_cast<float>(z[i]) - inverse_focus);
        result.blur_px[i] = std::sqrt(blur2 + circle * circle);
      }
    }
    if (gap) {
#pragma GCC ivdep
      for (int i = 0; i < kPacket; ++i) {
        const float blur = std::max(result.blur_px[i], kLeastCombBlur);
        const float q = exponential(static_cast<float>(-2 * kPi * kPi) * blur * blur), q4 = q * q * q * q;
        const float a1 = comb[0] * q, a2 = comb[1] * q4, a3 = comb[2] * (q4 * q4 * q);
        // Clamp coordinates outside the image; they are unused but must not overflow.
        const float c = cosine_of_turns(static_cast<float>(std::min(std::max(result.column[i], left), right)));
        const float d = cosine_of_turns(static_cast<float>(std::min(std::max(result.row[i], top), bottom)));
        const float along = 1 + a1 * c + a2 * (2 * c * c - 1) + a3 * c * (4 * c * c - 3);
        const float across = 1 + a1 * d + a2 * (2 * d * d - 1) + a3 * d * (4 * d * d - 3);
        result.lux[i] *= along * across;
      }
    }
  }
};

namespace {

FRINGESLAM_INLINE void light_body(const BeamKernel& kernel, const Points& points, BeamPacket& result, double* z,
                                  double* margin) {
  kernel.light(points, result, z, margin);
}

}  // namespace

Beam::Beam(const RigModel& rig, const Effects& effects, const Pose& world_from_camera)
    : kernel_(std::make_shared<BeamKernel>()) {
  const ProjectorLens& lens = rig.projector_lens;
  const Pinhole& p = rig.projector;
  const Pose projector_from_world = rig.projector_from_camera * world_from_camera.inverse();
  position_ = projector_from_world.inverse().translation;
  excess_falloff_ = effects.vignetting ? lens.vignetting - 3 : 0;
  BeamKernel& k = *kernel_;
  for (int i = 0; i < 9; ++i) k.r[i] = projector_from_world.rotation(i / 3, i % 3);
  for (int i = 0; i < 3; ++i) k.t[i] = projector_from_world.translation[i], k.position[i] = position_[i];
  const Distortion& d = p.distortion;
  k.fx = p.fx, k.fy = p.fy, k.cx = p.cx, k.cy = p.cy;
  k.k1 = d.k1, k.k2 = d.k2, k.k3 = d.k3, k.p1 = d.p1, k.p2 = d.p2;
  k.lux_at_1m = projector_lux_at_1m(rig);
  k.left = k.top = -0.5, k.right = p.width - 0.5, k.bottom = p.height - 0.5;
  k.max_r2 = p.largest_r2();
  k.defocus = effects.defocus;
  k.gap = effects.pixel_gap && lens.pixel_fill < 1;
  k.blur2 = static_cast<float>(lens.blur_px * lens.blur_px);
  k.circle_px_m = static_cast<float>(lens.aperture_m * p.fx / 4);
  k.inverse_focus = static_cast<float>(1 / lens.focus_m);
  for (int i = 0; i < 3; ++i) {
    const double x = kPi * (i + 1) * lens.pixel_fill;
    k.comb[i] = static_cast<float>(2 * std::sin(x) / x);
  }
}

void Beam::light(const Points& points, LaneMask active, BeamPacket& result) const {
  static const auto kernel = Variants<light_body>::of(selected_instruction_set());
  alignas(64) double z[kPacket];
  alignas(64) double margin[kPacket];
  kernel(*kernel_, points, result, z, margin);
  result.inside = 0;
  for (int i = 0; i < kPacket; ++i) result.inside |= static_cast<LaneMask>(margin[i] > 0) << i;
  result.inside &= active;
  if (excess_falloff_ == 0) return;
  for (int i = 0; i < kPacket; ++i) {
    if (has(result.inside, i))
      result.lux[i] *= static_cast<float>(std::pow(z[i] / result.distance[i], excess_falloff_));
  }
}

BlurRange Beam::blur_range(const RigModel& rig, const Effects& effects, double near_m, double far_m) {
  if (!effects.defocus) return {};
  const double fx = rig.projector.fx;
  return {rig.projector_lens.blur_px,
          std::max(blur_at(rig.projector_lens, fx, near_m), blur_at(rig.projector_lens, fx, far_m))};
}

}  // namespace fringeslam::sim
