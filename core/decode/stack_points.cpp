// SPDX-License-Identifier: Apache-2.0
#include "core/decode/stack_points.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "core/base/constants.h"
#include "core/base/turns.h"
#include "core/decode/cubic_convolution.h"
#include "core/types/selected_instruction_set.h"

namespace fringeslam {

namespace {

using Lens = PointFollower::Lens;
using Values = PointFollower::Values;

Lens lens_of(const Pinhole& pinhole) {
  const Distortion& d = pinhole.distortion;
  return {pinhole.fx, pinhole.fy, pinhole.cx, pinhole.cy, d.k1, d.k2, d.p1, d.p2, d.k3};
}

// A pose with its rotation by rows.
struct Rigid {
  double r[9], t[3];

  explicit Rigid(const Pose& pose) {
    for (int i = 0; i < 9; ++i) r[i] = pose.rotation(i / 3, i % 3);
    for (int i = 0; i < 3; ++i) t[i] = pose.translation[i];
  }
};

// Derivatives of a lens's distorted image (a', b') with respect to the undistorted (a, b), and a' and b'.
struct Distorted {
  double a, b, aa, ab, bb;
};

FRINGESLAM_INLINE Distorted distort(const Lens& lens, double a, double b) {
  const double r2 = a * a + b * b;
  const double radial = 1 + r2 * (lens.k1 + r2 * (lens.k2 + r2 * lens.k3)),
               slope = lens.k1 + r2 * (2 * lens.k2 + r2 * 3 * lens.k3);
  return {a * radial + 2 * lens.p1 * a * b + lens.p2 * (r2 + 2 * a * a),
          b * radial + lens.p1 * (r2 + 2 * b * b) + 2 * lens.p2 * a * b,
          radial + 2 * a * a * slope + 2 * lens.p1 * b + 6 * lens.p2 * a,
          2 * a * b * slope + 2 * lens.p1 * a + 2 * lens.p2 * b,
          radial + 2 * b * b * slope + 6 * lens.p1 * b + 2 * lens.p2 * a};
}

// Projector coordinate of points in the camera's axes, and its derivatives.
FRINGESLAM_INLINE void coordinate_body(const Values& rig, const double* x, const double* y, const double* z, int count,
                                       double* __restrict lit, double* __restrict by_x, double* __restrict by_y,
                                       double* __restrict by_z) {
  const Lens& lens = rig.projector;
  const double* const r = rig.r;
  const bool columns = rig.axis == 0;
  const double focal = columns ? lens.fx : lens.fy, centre = columns ? lens.cx : lens.cy;
#pragma GCC ivdep
  for (int i = 0; i < count; ++i) {
    const double px = r[0] * x[i] + r[1] * y[i] + r[2] * z[i] + rig.t[0],
                 py = r[3] * x[i] + r[4] * y[i] + r[5] * z[i] + rig.t[1],
                 pz = r[6] * x[i] + r[7] * y[i] + r[8] * z[i] + rig.t[2];
    const double inverse = 1 / pz, a = px * inverse, b = py * inverse;
    const Distorted d = distort(lens, a, b);
    lit[i] = focal * (columns ? d.a : d.b) + centre;
    const double by_px = focal * inverse * (columns ? d.aa : d.ab), by_py = focal * inverse * (columns ? d.ab : d.bb),
                 by_pz = -(by_px * a + by_py * b);
    by_x[i] = by_px * r[0] + by_py * r[3] + by_pz * r[6];
    by_y[i] = by_px * r[1] + by_py * r[4] + by_pz * r[7];
    by_z[i] = by_px * r[2] + by_py * r[5] + by_pz * r[8];
  }
}

// Pixels of the points in `s`, and their derivatives.
FRINGESLAM_INLINE void pixel_body(const Lens& lens, int count, PointSamples& s) {
  const double *const x = s.x.data(), *const y = s.y.data(), *const z = s.z.data();
  double* __restrict const u = s.u.data(), * __restrict const v = s.v.data();
  double *__restrict const u_by_x = s.u_by_x.data(), *__restrict const u_by_y = s.u_by_y.data(),
                           *__restrict const u_by_z = s.u_by_z.data();
  double *__restrict const v_by_x = s.v_by_x.data(), *__restrict const v_by_y = s.v_by_y.data(),
                           *__restrict const v_by_z = s.v_by_z.data();
#pragma GCC ivdep
  for (int i = 0; i < count; ++i) {
    const double inverse = 1 / z[i], a = x[i] * inverse, b = y[i] * inverse;
    const Distorted d = distort(lens, a, b);
    const double at_u = lens.fx * d.a + lens.cx, at_v = lens.fy * d.b + lens.cy;
    const double nowhere = kNaN;
    u[i] = z[i] > 0 ? at_u : nowhere;
    v[i] = z[i] > 0 ? at_v : nowhere;
    const double across = lens.fx * inverse, down = lens.fy * inverse;
    u_by_x[i] = across * d.aa;
    u_by_y[i] = across * d.ab;
    u_by_z[i] = -across * (d.aa * a + d.ab * b);
    v_by_x[i] = down * d.ab;
    v_by_y[i] = down * d.bb;
    v_by_z[i] = -down * (d.ab * a + d.bb * b);
  }
}

FRINGESLAM_INLINE void locate_body(const Lens& lens, const Rigid& pose, const SurfacePoints& points, PointSamples& s) {
  const double *const x = points.x.data(), *const y = points.y.data(), *const z = points.z.data();
  double* __restrict const to_x = s.x.data(), * __restrict const to_y = s.y.data(), * __restrict const to_z = s.z.data();
  const double* const r = pose.r;
#pragma GCC ivdep
  for (int i = 0; i < points.count; ++i) {
    to_x[i] = r[0] * x[i] + r[1] * y[i] + r[2] * z[i] + pose.t[0];
    to_y[i] = r[3] * x[i] + r[4] * y[i] + r[5] * z[i] + pose.t[1];
    to_z[i] = r[6] * x[i] + r[7] * y[i] + r[8] * z[i] + pose.t[2];
  }
  pixel_body(lens, points.count, s);
}

// The factors of a point's brightness: irradiance by a projector without fall-off of its lens, and the cosines of its
// directions to the optical axes of projector and camera.
struct BrightnessFactors {
  PointArray irradiance, at_projector, at_camera;
};

FRINGESLAM_INLINE void brightness_body(const Values& rig, const double* turn, const SurfacePoints& normals,
                                       const double* x, const double* y, const double* z, int count,
                                       BrightnessFactors& out) {
  const double* const r = rig.r;
  const double *const nx = normals.normal_x.data(), *const ny = normals.normal_y.data(),
                      *const nz = normals.normal_z.data();
  double *__restrict const irradiance = out.irradiance.data(), *__restrict const at_projector = out.at_projector.data(),
                           *__restrict const at_camera = out.at_camera.data();
#pragma GCC ivdep
  for (int i = 0; i < count; ++i) {
    const double lx = r[0] * x[i] + r[1] * y[i] + r[2] * z[i] + rig.t[0],
                 ly = r[3] * x[i] + r[4] * y[i] + r[5] * z[i] + rig.t[1],
                 lz = r[6] * x[i] + r[7] * y[i] + r[8] * z[i] + rig.t[2];
    // The normal in the exposure's axes.
    const double mx = turn[0] * nx[i] + turn[1] * ny[i] + turn[2] * nz[i],
                 my = turn[3] * nx[i] + turn[4] * ny[i] + turn[5] * nz[i],
                 mz = turn[6] * nx[i] + turn[7] * ny[i] + turn[8] * nz[i];
    const double facing = (r[0] * mx + r[1] * my + r[2] * mz) * lx + (r[3] * mx + r[4] * my + r[5] * mz) * ly +
                          (r[6] * mx + r[7] * my + r[8] * mz) * lz;
    const double square = lx * lx + ly * ly + lz * lz, distance = std::sqrt(square);
    irradiance[i] = std::abs(facing) / (square * distance);
    at_projector[i] = lz / distance;
    at_camera[i] = z[i] / std::sqrt(x[i] * x[i] + y[i] * y[i] + z[i] * z[i]);
  }
}

FRINGESLAM_INLINE void multiply_body(const double* factor, int count, double* __restrict product) {
#pragma GCC ivdep
  for (int i = 0; i < count; ++i) product[i] *= factor[i];
}

// Turns the sampled grey values into those of the reference pose, and finds the phases of the fringes. `brightness`: that
// of the points in the exposure.
FRINGESLAM_INLINE void shade_body(const SurfacePoints& points, const double* brightness, double offset_dn,
                                  double turns_per_px, double shift_turns, PointSamples& s) {
  const double *const reference = points.brightness.data(), *const lit_there = points.lit_px.data();
  const double *const lit = s.lit_px.data(), *const by_u = s.grey_by_u.data(), *const by_v = s.grey_by_v.data();
  const double *const u_by_x = s.u_by_x.data(), *const u_by_y = s.u_by_y.data(), *const u_by_z = s.u_by_z.data();
  const double *const v_by_x = s.v_by_x.data(), *const v_by_y = s.v_by_y.data(), *const v_by_z = s.v_by_z.data();
  double *__restrict const grey = s.grey.data(), *__restrict const cosine = s.cosine.data(),
                           *__restrict const sine = s.sine.data();
  double *__restrict const texture_x = s.texture_x.data(), *__restrict const texture_y = s.texture_y.data(),
                           *__restrict const texture_z = s.texture_z.data();
#pragma GCC ivdep
  for (int i = 0; i < points.count; ++i) {
    const double share = reference[i] / (brightness[i] > 1e-12 ? brightness[i] : 1e-12);
    grey[i] = offset_dn + share * (grey[i] - offset_dn);
    texture_x[i] = share * (by_u[i] * u_by_x[i] + by_v[i] * v_by_x[i]);
    texture_y[i] = share * (by_u[i] * u_by_y[i] + by_v[i] * v_by_y[i]);
    texture_z[i] = share * (by_u[i] * u_by_z[i] + by_v[i] * v_by_z[i]);
    cosine_sine(shift_turns + turns_per_px * (lit[i] - lit_there[i]), cosine[i], sine[i]);
  }
}

// Sums of the normal equations of (mean, c, s) for the basis (1, cos, -sin).
struct Moments {
  PointArray c, s, cc, cs, ss, grey, grey_c, grey_s;
};

FRINGESLAM_INLINE void add_moments_body(const PointSamples& sample, int count, Moments& m) {
  const double *const grey = sample.grey.data(), *const cosine = sample.cosine.data(), *const sine = sample.sine.data();
  double* __restrict const sum_c = m.c.data(), * __restrict const sum_s = m.s.data(), * __restrict const cc = m.cc.data(), * __restrict const cs = m.cs.data(), * __restrict const ss = m.ss.data();
  double *__restrict const sum_grey = m.grey.data(), *__restrict const grey_c = m.grey_c.data(),
                           *__restrict const grey_s = m.grey_s.data();
#pragma GCC ivdep
  for (int i = 0; i < count; ++i) {
    const double c = cosine[i], s = -sine[i];
    sum_c[i] += c;
    sum_s[i] += s;
    cc[i] += c * c;
    cs[i] += c * s;
    ss[i] += s * s;
    sum_grey[i] += grey[i];
    grey_c[i] += grey[i] * c;
    grey_s[i] += grey[i] * s;
  }
}

// Inverse of the normal equations, and their solution.
struct Solution {
  PointArray i00, i01, i02, i11, i12, i22, c, s;
};

FRINGESLAM_INLINE void solve_body(const Moments& m, double samples, int count, Solution& out, PeriodFits& fits) {
  const double *const sum_c = m.c.data(), *const sum_s = m.s.data(), *const cc = m.cc.data(), *const cs = m.cs.data(),
                      *const ss = m.ss.data();
  const double *const grey = m.grey.data(), *const grey_c = m.grey_c.data(), *const grey_s = m.grey_s.data();
  double *__restrict const i00 = out.i00.data(), *__restrict const i01 = out.i01.data(),
                           *__restrict const i02 = out.i02.data(), *__restrict const i11 = out.i11.data(),
                           *__restrict const i12 = out.i12.data(), *__restrict const i22 = out.i22.data(),
                           *__restrict const of_c = out.c.data(), *__restrict const of_s = out.s.data();
  double* __restrict const mean = fits.mean.data(), * __restrict const modulation = fits.modulation.data();
#pragma GCC ivdep
  for (int i = 0; i < count; ++i) {
    const double c00 = cc[i] * ss[i] - cs[i] * cs[i], c01 = sum_s[i] * cs[i] - sum_c[i] * ss[i],
                 c02 = sum_c[i] * cs[i] - sum_s[i] * cc[i], c11 = samples * ss[i] - sum_s[i] * sum_s[i],
                 c12 = sum_c[i] * sum_s[i] - samples * cs[i], c22 = samples * cc[i] - sum_c[i] * sum_c[i];
    const double scale = 1 / (samples * c00 + sum_c[i] * c01 + sum_s[i] * c02);
    i00[i] = scale * c00;
    i01[i] = scale * c01;
    i02[i] = scale * c02;
    i11[i] = scale * c11;
    i12[i] = scale * c12;
    i22[i] = scale * c22;
    const double c = i01[i] * grey[i] + i11[i] * grey_c[i] + i12[i] * grey_s[i],
                 s = i02[i] * grey[i] + i12[i] * grey_c[i] + i22[i] * grey_s[i];
    of_c[i] = c;
    of_s[i] = s;
    mean[i] = i00[i] * grey[i] + i01[i] * grey_c[i] + i02[i] * grey_s[i];
    modulation[i] = std::sqrt(c * c + s * s);
  }
}

// Adds what one exposure contributes to the variances and derivatives of a period's fits. `averaged`: see fit().
FRINGESLAM_INLINE void add_slopes_body(const Values& rig, const PointSamples& sample, const Solution& solution,
                                       double rad_per_px, double time_s, double averaged, int count, PeriodFits& fits) {
  const double *const i00 = solution.i00.data(), *const i01 = solution.i01.data(), *const i02 = solution.i02.data(),
                      *const i11 = solution.i11.data(), *const i12 = solution.i12.data(),
                      *const i22 = solution.i22.data(), *const of_c = solution.c.data(),
                      *const of_s = solution.s.data();
  const double *const cosine = sample.cosine.data(), *const sine = sample.sine.data(), *const grey = sample.grey.data();
  const double *const x = sample.x.data(), *const y = sample.y.data(), *const z = sample.z.data();
  const double *const texture_x = sample.texture_x.data(), *const texture_y = sample.texture_y.data(),
                      *const texture_z = sample.texture_z.data();
  const double *const lit_by_x = sample.lit_by_x.data(), *const lit_by_y = sample.lit_by_y.data(),
                      *const lit_by_z = sample.lit_by_z.data();
  double* __restrict const mean_variance = fits.mean_variance.data(), * __restrict const phase_variance =
                                                                          fits.phase_variance.data();
  const double by_order[kMotionOrders] = {time_s, time_s * (time_s / 2), time_s * (time_s / 2) * (time_s / 3)};
  double* __restrict const mean_slope = fits.mean_slope[0].data();
  double* __restrict const phase_slope = fits.phase_slope[0].data();
  const double per_sample = 1 / averaged;
#pragma GCC ivdep
  for (int i = 0; i < count; ++i) {
    const double c = of_c[i], s = of_s[i], power = c * c + s * s;
    const double to_mean = i00[i] + i01[i] * cosine[i] - i02[i] * sine[i],
                 to_c = i01[i] + i11[i] * cosine[i] - i12[i] * sine[i],
                 to_s = i02[i] + i12[i] * cosine[i] - i22[i] * sine[i];
    const double to_phase = (c * to_s - s * to_c) / power;
    const double signal = grey[i] - rig.offset_dn;
    const double variance = per_sample * (rig.dark_dn2 + rig.gain_dn * (signal > 0 ? signal : 0));
    mean_variance[i] += to_mean * to_mean * variance;
    phase_variance[i] += to_phase * to_phase * variance;
    // Change of the grey value that the model does not follow, per displacement of the point.
    const double drift = (c * sine[i] + s * cosine[i]) * rad_per_px;
    const double gx = texture_x[i] + drift * lit_by_x[i], gy = texture_y[i] + drift * lit_by_y[i],
                 gz = texture_z[i] + drift * lit_by_z[i];
    const double by_motion[6] = {gy * z[i] - gz * y[i], gz * x[i] - gx * z[i], gx * y[i] - gy * x[i], -gx, -gy, -gz};
    for (int order = 0; order < kMotionOrders; ++order) {
      const double mean_factor = by_order[order] * to_mean, phase_factor = by_order[order] * to_phase;
      for (int k = 0; k < 6; ++k) {
        mean_slope[(6 * order + k) * kPointsTogether + i] += mean_factor * by_motion[k];
        phase_slope[(6 * order + k) * kPointsTogether + i] += phase_factor * by_motion[k];
      }
    }
  }
}

// Multiplies `product` by powers of `factor`.
void raise(const PointArray& factor, double exponent, int count, double* product) {
  constexpr int kMostProducts = 8;
  static const auto multiply = Variants<multiply_body>::of(selected_instruction_set());
  if (exponent >= 0 && exponent <= kMostProducts && exponent == std::floor(exponent)) {
    for (int i = 0; i < static_cast<int>(exponent); ++i) multiply(factor.data(), count, product);
  } else {
    for (int i = 0; i < count; ++i) product[i] *= std::pow(factor[static_cast<size_t>(i)], exponent);
  }
}

typedef float Floats4 __attribute__((vector_size(16)));

// Grey values of an image by cubic convolution (Keys 1981) and their exact gradients. In motion, the gradients of texture
// and of the moving fringes nearly cancel, so that the error of another gradient, such as central differences, would
// dominate the rest.
void sample_image(const cv::Mat1f& image, int count, PointSamples& s) {
  const double right = image.cols - 2, bottom = image.rows - 2;
  for (size_t i = 0; i < static_cast<size_t>(count); ++i) {
    if (!(s.u[i] >= 1 && s.v[i] >= 1 && s.u[i] < right && s.v[i] < bottom)) {
      s.grey[i] = s.grey_by_u[i] = s.grey_by_v[i] = kNaN;
      continue;
    }
    const int col = static_cast<int>(s.u[i]), row = static_cast<int>(s.v[i]);
    const CubicWeights across(static_cast<float>(s.u[i] - col)), down(static_cast<float>(s.v[i] - row));
    Floats4 value = {0, 0, 0, 0}, change = value;  // of the four columns
    for (int j = 0; j < 4; ++j) {
      Floats4 line;
      std::memcpy(&line, image[row - 1 + j] + col - 1, sizeof line);
      value += down.weight[j] * line;
      change += down.slope[j] * line;
    }
    Floats4 weight, slope;
    std::memcpy(&weight, across.weight, sizeof weight);
    std::memcpy(&slope, across.slope, sizeof slope);
    const auto sum = [](const Floats4& v) { return static_cast<double>((v[0] + v[1]) + (v[2] + v[3])); };
    s.grey[i] = sum(weight * value);
    s.grey_by_u[i] = sum(slope * value);
    s.grey_by_v[i] = sum(weight * change);
  }
}

}  // namespace

PointFollower::PointFollower(const RigModel& rig, int axis)
    : projector_fall_off_(rig.projector_lens.vignetting), camera_fall_off_(rig.camera_lens.vignetting) {
  const Rigid pose(rig.projector_from_camera);
  const double offset_dn = rig.sensor.offset_dn, dark_dn2 = rig.sensor.variance_dn2(offset_dn);
  rig_ = {
      lens_of(rig.camera), lens_of(rig.projector), {}, {}, axis, offset_dn, dark_dn2, rig.sensor.gain_dn_per_electron};
  std::copy_n(pose.r, 9, rig_.r);
  std::copy_n(pose.t, 3, rig_.t);
}

void PointFollower::light(SurfacePoints& p, bool with_brightness) const {
  static const auto coordinate = Variants<coordinate_body>::of(selected_instruction_set());
  static const auto brightness = Variants<brightness_body>::of(selected_instruction_set());
  coordinate(rig_, p.x.data(), p.y.data(), p.z.data(), p.count, p.lit_px.data(), p.lit_by_x.data(), p.lit_by_y.data(),
             p.lit_by_z.data());
  p.brightness.fill(1);
  if (!with_brightness) return;
  BrightnessFactors factors;
  brightness(rig_, Rigid(Pose()).r, p, p.x.data(), p.y.data(), p.z.data(), p.count, factors);
  raise(factors.at_projector, projector_fall_off_ - 3, p.count, factors.irradiance.data());
  raise(factors.at_camera, camera_fall_off_, p.count, factors.irradiance.data());
  p.brightness = factors.irradiance;
}

void PointFollower::sample(const Exposure& exposure, double period_px, const SurfacePoints& points,
                           bool with_brightness, PointSamples& out) const {
  static const auto locate = Variants<locate_body>::of(selected_instruction_set());
  static const auto coordinate = Variants<coordinate_body>::of(selected_instruction_set());
  static const auto brightness = Variants<brightness_body>::of(selected_instruction_set());
  static const auto shade = Variants<shade_body>::of(selected_instruction_set());
  const int count = points.count;
  const Rigid pose(exposure.exposure_from_reference);
  locate(rig_.camera, pose, points, out);
  sample_image(*exposure.image, count, out);
  coordinate(rig_, out.x.data(), out.y.data(), out.z.data(), count, out.lit_px.data(), out.lit_by_x.data(),
             out.lit_by_y.data(), out.lit_by_z.data());
  BrightnessFactors factors;
  if (with_brightness) {
    brightness(rig_, pose.r, points, out.x.data(), out.y.data(), out.z.data(), count, factors);
    raise(factors.at_projector, projector_fall_off_ - 3, count, factors.irradiance.data());
    raise(factors.at_camera, camera_fall_off_, count, factors.irradiance.data());
  } else {
    factors.irradiance.fill(1);
  }
  shade(points, factors.irradiance.data(), rig_.offset_dn, 1 / period_px, exposure.shift_rad / kTwoPi, out);
}

void PointFollower::sample_at_rest(const Exposure& exposure, const SurfacePoints& points, int row, const int* cols,
                                   PointSamples& out) const {
  static const auto pixels = Variants<pixel_body>::of(selected_instruction_set());
  static const auto shade = Variants<shade_body>::of(selected_instruction_set());
  out.x = points.x;
  out.y = points.y;
  out.z = points.z;
  pixels(rig_.camera, points.count, out);
  const cv::Mat1f& image = *exposure.image;
  for (size_t i = 0; i < static_cast<size_t>(points.count); ++i) {
    const float* const here = image[row] + cols[i];
    out.grey[i] = static_cast<double>(*here);
    out.grey_by_u[i] = 0.5 * static_cast<double>(here[1] - here[-1]);
    out.grey_by_v[i] = 0.5 * static_cast<double>(image[row + 1][cols[i]] - image[row - 1][cols[i]]);
    // A sample beside a saturated pixel has no gradient.
    if (std::isnan(out.grey_by_u[i]) || std::isnan(out.grey_by_v[i])) out.grey[i] = kNaN;
  }
  out.lit_px = points.lit_px;
  out.lit_by_x = points.lit_by_x;
  out.lit_by_y = points.lit_by_y;
  out.lit_by_z = points.lit_by_z;
  PointArray same;
  same.fill(1);
  shade(points, same.data(), rig_.offset_dn, 0, exposure.shift_rad / kTwoPi, out);
}

void PointFollower::fit(int count, const std::vector<PointSamples>& samples,
                        const std::vector<const Exposure*>& exposures, double period_px, double averaged,
                        PeriodFits& out) const {
  static const auto add_moments = Variants<add_moments_body>::of(selected_instruction_set());
  static const auto solve = Variants<solve_body>::of(selected_instruction_set());
  static const auto add_slopes = Variants<add_slopes_body>::of(selected_instruction_set());
  Moments moments{};
  for (size_t k = 0; k < exposures.size(); ++k) add_moments(samples[k], count, moments);
  Solution solution;
  solve(moments, static_cast<double>(exposures.size()), count, solution, out);
  for (size_t i = 0; i < static_cast<size_t>(count); ++i) out.phase[i] = std::atan2(solution.s[i], solution.c[i]);
  out.mean_variance.fill(0);
  out.phase_variance.fill(0);
  for (PointArray& slope : out.mean_slope) slope.fill(0);
  for (PointArray& slope : out.phase_slope) slope.fill(0);
  for (size_t k = 0; k < exposures.size(); ++k)
    add_slopes(rig_, samples[k], solution, kTwoPi / period_px, exposures[k]->time_s, averaged, count, out);
}

}  // namespace fringeslam
