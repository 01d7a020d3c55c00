// SPDX-License-Identifier: Apache-2.0
#include "core/registration/image_residuals.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "core/base/constants.h"
#include "core/base/cubic_spline.h"
#include "core/base/parallel.h"
#include "core/base/symmetric_filter.h"
#include "core/types/error.h"
#include "core/types/irradiance.h"
#include "core/types/projection.h"
#include "core/types/selected_instruction_set.h"

namespace fringeslam {

namespace {

using Eigen::Vector3d;

constexpr int kLanes = 16;
constexpr int kChunk = 512;  // points whose sums are accumulated in single precision
constexpr int kParameters = kImageParameters;
// Least cosine between the line of sight and the normal. The fringes of a surface seen at a grazing angle seem to move by
// far more than the camera, so a few such points whose normals are slightly wrong would decide the pose.
constexpr float kLeastFacing = 0.15f;

// Values of a point. kBrighter and kTurned are the derivatives of the logarithm of its irradiance with respect to its
// displacement and to a rotation of its surface; kTexture is that of I' with respect to a displacement of the camera's
// pixel, as a vector of the point's displacement.
enum Quantity {
  kX,
  kY,
  kZ,
  kMean,  // above the black level
  kModulation,
  // Covariance of the errors of I', I'' and I'' phi.
  kMeanMean,
  kMeanModulation,
  kMeanPhase,
  kModulationModulation,
  kModulationPhase,
  kPhasePhase,
  kBrighterX,
  kBrighterY,
  kBrighterZ,
  kTurnedX,
  kTurnedY,
  kTurnedZ,
  kTextureX,
  kTextureY,
  kTextureZ,
  kNormalX,
  kNormalY,
  kNormalZ,
  kBias,  // of the column that the images show beside texture, px
  kQuantities
};

struct PointValues {
  const float* of[kQuantities];
};

// Samples of the image at a chunk's points.
struct alignas(64) Samples {
  float u[kChunk], v[kChunk];  // pixel; NaN behind the lens
  float grey[kChunk];
  float noise[kChunk];  // variance of the interpolated value, for a variance of 1 in all pixels; 0 outside the image
};

FRINGESLAM_INLINE void locate_body(const PointValues& points, int count, const Projection& p, Samples& samples) {
  const float *const px = points.of[kX], *const py = points.of[kY], *const pz = points.of[kZ];
  for (int i = 0; i < count; ++i) {
    const float x = p.r[0] * px[i] + p.r[1] * py[i] + p.r[2] * pz[i] + p.t[0];
    const float y = p.r[3] * px[i] + p.r[4] * py[i] + p.r[5] * pz[i] + p.t[1];
    const float z = p.r[6] * px[i] + p.r[7] * py[i] + p.r[8] * pz[i] + p.t[2];
    const float a = x / z, b = y / z, r2 = a * a + b * b, radial = 1 + r2 * (p.k1 + r2 * (p.k2 + r2 * p.k3));
    const float u = p.fx * (a * radial + 2 * p.p1 * a * b + p.p2 * (r2 + 2 * a * a)) + p.cx;
    const float v = p.fy * (b * radial + p.p1 * (r2 + 2 * b * b) + 2 * p.p2 * a * b) + p.cy;
    samples.u[i] = z > 0 ? u : kNaN;
    samples.v[i] = z > 0 ? v : kNaN;
  }
}

// Grey values of the spline with these coefficients. Kept out of the kernels, where compilers split gathers into scalar loads.
void sample_chunk(const cv::Mat1f& coefficients, int count, Samples& s) {
  const auto right = static_cast<float>(coefficients.cols - 2), bottom = static_cast<float>(coefficients.rows - 2);
  for (int n = 0; n < count; ++n) {
    if (!(s.u[n] >= 1 && s.v[n] >= 1 && s.u[n] < right && s.v[n] < bottom)) {
      s.grey[n] = s.noise[n] = 0;
      continue;
    }
    const int col = static_cast<int>(s.u[n]), row = static_cast<int>(s.v[n]);
    const float right_of = s.u[n] - static_cast<float>(col), below = s.v[n] - static_cast<float>(row);
    const SplineWeights across(right_of), down(below);
    s.grey[n] = weighted_sum(coefficients[row - 1] + col - 1, static_cast<std::ptrdiff_t>(coefficients.step1()),
                             across.weight, down.weight);
    s.noise[n] = spline_noise(right_of) * spline_noise(below);
  }
}

}  // namespace

bool has_image_model(const Pattern& pattern) {
  return pattern.coding != Coding::product &&
         !(pattern.coding == Coding::gray && (pattern.carrier_px > 0 || pattern.code_bits > 0));
}

namespace {

// A pattern as a function of the projector coordinate u: cos(2 pi (turns_per_px u + turns)), or the sign of it.
struct Wave {
  float turns_per_px = 0, turns = 0;
  bool square = false;
  float edge = 0;       // square: |cos| below this is too close to an edge
  bool columns = true;  // coded axis
};

Wave wave_of(const Pattern& pattern) {
  Wave wave;
  wave.columns = pattern.axis == Axis::columns;
  switch (pattern.coding) {
    case Coding::fringe:
    case Coding::extra:
      wave.turns_per_px = static_cast<float>(1 / pattern.period_px);
      wave.turns = static_cast<float>(0.5 / pattern.period_px + pattern.shift_rad / kTwoPi);
      break;
    case Coding::gray: {
      if (!has_image_model(pattern))
        throw Error("image pose: Gray bits combined by XOR or with long runs have no model");
      // The bit with cells of c is 1 from c to 3 c, and so on with a period of 4 c.
      constexpr double kEdge_px = 2;
      const double period_px = 4 * pattern.period_px;
      wave.turns_per_px = static_cast<float>(1 / period_px);
      wave.turns = static_cast<float>(0.5 / period_px + (pattern.inverted ? 0 : 0.5));
      wave.square = true;
      wave.edge = static_cast<float>(std::sin(std::min(0.25 * kTwoPi, kTwoPi * kEdge_px / period_px)));
      break;
    }
    case Coding::flat:
      wave.turns = static_cast<float>(std::acos(std::clamp(2 * pattern.level - 1, -1.0, 1.0)) / kTwoPi);
      break;
    case Coding::product:
      throw Error("image pose: images of products of cosines have no model; use fringes, Gray codes or flat images");
  }
  return wave;
}

// Quantities that are the same for all points.
struct Setting {
  Projection camera, projector;  // projector: from the reference
  float from_camera[9];          // rotation, projector from camera
  float turn[3];                 // rotation vector of camera_from_reference
  Wave wave;
  float gain, contrast;
  float offset, noise_constant, noise_per_dn, prnu2;
  float cut_off;         // sigmas squared
  float reference_px;    // of the reference's fringes per radian
  bool reference_noise;  // ImageInformation
};

constexpr int kInformation = kParameters * (kParameters + 1) / 2;
constexpr int kSums = kInformation + kParameters + 4;
struct alignas(64) PixelSum {
  float value[kLanes];
};
using PixelSums = std::array<PixelSum, kSums>;

// Gradient of one image coordinate with respect to the point, in the axes of the device; `along` selects u or v.
struct LensGradient {
  float x, y, z;
};

FRINGESLAM_INLINE LensGradient lens_gradient(const Projection& p, float a, float b, float inverse_z, float weight_u,
                                             float weight_v) {
  const float r2 = a * a + b * b, radial = 1 + r2 * (p.k1 + r2 * (p.k2 + r2 * p.k3)),
              slope = p.k1 + r2 * (2 * p.k2 + r2 * 3 * p.k3);
  const float aa = radial + 2 * a * a * slope + 2 * p.p1 * b + 6 * p.p2 * a;
  const float ab = 2 * a * b * slope + 2 * p.p1 * a + 2 * p.p2 * b;
  const float bb = radial + 2 * b * b * slope + 6 * p.p1 * b + 2 * p.p2 * a;
  const float by_a = weight_u * p.fx * aa + weight_v * p.fy * ab, by_b = weight_u * p.fx * ab + weight_v * p.fy * bb;
  return {by_a * inverse_z, by_b * inverse_z, -(by_a * a + by_b * b) * inverse_z};
}

struct Vector {
  float x, y, z;
};

FRINGESLAM_INLINE Vector turned(const float* r, float x, float y, float z) {
  return {r[0] * x + r[1] * y + r[2] * z, r[3] * x + r[4] * y + r[5] * z, r[6] * x + r[7] * y + r[8] * z};
}

// Computes the sums of a chunk of points, lane by lane. `count` is a multiple of the lanes.
FRINGESLAM_INLINE void sum_body(const PointValues& points, const Samples& samples, int count, const Setting& s,
                                PixelSums& sums) {
  for (PixelSum& lanes : sums) {
    for (float& value : lanes.value) value = 0;
  }
  const float along_u = s.wave.columns ? 1.0f : 0.0f, along_v = s.wave.columns ? 0.0f : 1.0f;
  for (int first = 0; first < count; first += kLanes) {
    alignas(64) float g[kParameters][kLanes], weight[kLanes], pull[kLanes], square[kLanes], cost[kLanes], shown[kLanes],
        inlier[kLanes];
    for (int lane = 0; lane < kLanes; ++lane) {
      const int i = first + lane;
      const Projection& c = s.camera;
      const float px = points.of[kX][i], py = points.of[kY][i], pz = points.of[kZ][i];
      // Turned, and moved as well.
      const float qx = c.r[0] * px + c.r[1] * py + c.r[2] * pz, x = qx + c.t[0];
      const float qy = c.r[3] * px + c.r[4] * py + c.r[5] * pz, y = qy + c.t[1];
      const float qz = c.r[6] * px + c.r[7] * py + c.r[8] * pz, z = qz + c.t[2];
      const Projection& l = s.projector;
      const float lx = l.r[0] * px + l.r[1] * py + l.r[2] * pz + l.t[0];
      const float ly = l.r[3] * px + l.r[4] * py + l.r[5] * pz + l.t[1];
      const float lz = l.r[6] * px + l.r[7] * py + l.r[8] * pz + l.t[2];
      const float la = lx / lz, lb = ly / lz, r2 = la * la + lb * lb,
                  radial = 1 + r2 * (l.k1 + r2 * (l.k2 + r2 * l.k3));
      const float column = l.fx * (la * radial + 2 * l.p1 * la * lb + l.p2 * (r2 + 2 * la * la)) + l.cx;
      const float row = l.fy * (lb * radial + l.p1 * (r2 + 2 * lb * lb) + 2 * l.p2 * la * lb) + l.cy;
      const float coordinate = along_u * (column + points.of[kBias][i]) + along_v * row;

      // Cosine and sine by the half angle, at most a quarter turn.
      const float phase = s.wave.turns_per_px * coordinate + s.wave.turns;
      const float half = std::numbers::pi_v<float> * (phase - std::floor(phase + 0.5f)), h2 = half * half;
      const float half_sine =
          half * (1 + h2 * (-1.6666667e-1f +
                            h2 * (8.3333333e-3f + h2 * (-1.9841270e-4f + h2 * (2.7557319e-6f - h2 * 2.5052108e-8f)))));
      const float half_cosine =
          1 + h2 * (-0.5f +
                    h2 * (4.1666667e-2f +
                          h2 * (-1.3888889e-3f + h2 * (2.4801587e-5f + h2 * (-2.7557319e-7f + h2 * 2.0876757e-9f)))));
      const float cosine = 1 - 2 * half_sine * half_sine, sine = 2 * half_sine * half_cosine;
      const float value = s.wave.square ? (cosine > 0 ? 1.0f : -1.0f) : cosine;
      const float value_slope = s.wave.square ? 0.0f : -kTwoPiFloat * s.wave.turns_per_px * sine;  // per projector px

      // Irradiance relative to the reference, to second order.
      const float brighter = points.of[kBrighterX][i] * (x - px) + points.of[kBrighterY][i] * (y - py) +
                             points.of[kBrighterZ][i] * (z - pz) + points.of[kTurnedX][i] * s.turn[0] +
                             points.of[kTurnedY][i] * s.turn[1] + points.of[kTurnedZ][i] * s.turn[2];
      const float share = (1 + s.gain) * (1 + brighter * (1 + 0.5f * brighter));
      const float mean = share * points.of[kMean][i], fringe = share * points.of[kModulation][i];
      const float modulated = (1 + s.contrast) * fringe;
      const float predicted = mean + modulated * value;
      const float signal = samples.grey[i] - s.offset, residual = signal - predicted;

      // Change of the residual with a displacement of the point. Texture moves with the point. The fringes at a pixel
      // change with the depth of the surface there, so with the displacement along the normal.
      const LensGradient by_light = lens_gradient(l, la, lb, 1 / lz, along_u, along_v);
      const Vector light = turned(s.from_camera, x, y, z);
      const float per_depth = (by_light.x * light.x + by_light.y * light.y + by_light.z * light.z);
      const Vector n = turned(c.r, points.of[kNormalX][i], points.of[kNormalY][i], points.of[kNormalZ][i]);
      const Vector t = turned(c.r, points.of[kTextureX][i], points.of[kTextureY][i], points.of[kTextureZ][i]);
      const float facing = -(n.x * x + n.y * y + n.z * z);
      const float by_normal = modulated * value_slope * per_depth / facing;
      const float texture = predicted / points.of[kMean][i];
      const float cx = texture * t.x + by_normal * n.x, cy = texture * t.y + by_normal * n.y,
                  cz = texture * t.z + by_normal * n.z;

      const float bright = signal > 0 ? signal : 0;
      // A phase error of the reference displaces the fringes of other periods by the same distance.
      const float slope = s.reference_px * value_slope;
      const float of_reference =
          share * share *
          (points.of[kMeanMean][i] +
           value * (value * points.of[kModulationModulation][i] + 2 * points.of[kMeanModulation][i]) +
           slope * (slope * points.of[kPhasePhase][i] + 2 * points.of[kMeanPhase][i] +
                    2 * value * points.of[kModulationPhase][i]));
      const float variance =
          samples.noise[i] * (s.noise_constant + bright * (s.noise_per_dn + bright * s.prnu2)) + of_reference;
      const float squared = residual * residual / variance, scaled = squared / s.cut_off;
      const bool is_shown = (samples.noise[i] > 0) & (lz > 0) & (column > -0.5f) & (row > -0.5f) &
                            (column < static_cast<float>(l.width) - 0.5f) & (facing > kLeastFacing * z) &
                            (row < static_cast<float>(l.height) - 0.5f) & (std::abs(cosine) >= s.wave.edge) &
                            (squared >= 0);
      const bool is_inlier = is_shown & (scaled < 1);
      const float left = is_inlier ? 1 - scaled : 0, robust = left * left / variance;
      weight[lane] = is_inlier ? (s.reference_noise ? robust * robust * of_reference : robust) : 0;
      pull[lane] = is_inlier ? robust * residual : 0;
      square[lane] = is_shown ? (is_inlier ? squared : s.cut_off) : 0;
      cost[lane] = is_shown ? s.cut_off / 6 * (1 - left * left * left) : 0;
      shown[lane] = is_shown ? 1.0f : 0.0f;
      inlier[lane] = is_inlier ? 1.0f : 0.0f;
      g[0][lane] = is_inlier ? qy * cz - qz * cy : 0;
      g[1][lane] = is_inlier ? qz * cx - qx * cz : 0;
      g[2][lane] = is_inlier ? qx * cy - qy * cx : 0;
      g[3][lane] = is_inlier ? cx : 0;
      g[4][lane] = is_inlier ? cy : 0;
      g[5][lane] = is_inlier ? cz : 0;
      g[6][lane] = is_inlier ? -predicted : 0;
      g[7][lane] = is_inlier ? -fringe * value : 0;
    }
    size_t k = 0;
    for (int a = 0; a < kParameters; ++a) {
      alignas(64) float weighted[kLanes];
      for (int lane = 0; lane < kLanes; ++lane) weighted[lane] = weight[lane] * g[a][lane];
      for (int b = a; b < kParameters; ++b, ++k) {
        for (int lane = 0; lane < kLanes; ++lane) sums[k].value[lane] += weighted[lane] * g[b][lane];
      }
    }
    for (int a = 0; a < kParameters; ++a, ++k) {
      for (int lane = 0; lane < kLanes; ++lane) sums[k].value[lane] += pull[lane] * g[a][lane];
    }
    for (int lane = 0; lane < kLanes; ++lane) {
      sums[k].value[lane] += square[lane];
      sums[k + 1].value[lane] += cost[lane];
      sums[k + 2].value[lane] += shown[lane];
      sums[k + 3].value[lane] += inlier[lane];
    }
  }
}

void add_chunk(const PixelSums& lanes, ImageSums& total) {
  std::array<double, kSums> sums{};
  for (size_t k = 0; k < kSums; ++k) {
    for (const float lane : lanes[k].value) sums[k] += static_cast<double>(lane);
  }
  size_t k = 0;
  for (int a = 0; a < kParameters; ++a) {
    for (int b = a; b < kParameters; ++b) total.information(a, b) += sums[k++];
  }
  for (int a = 0; a < kParameters; ++a) total.gradient[a] += sums[k++];
  total.squares += sums[k++];
  total.cost += sums[k++];
  total.points += static_cast<int>(sums[k++]);
  total.inliers += static_cast<int>(sums[k]);
}

// Derivative of the pixel with respect to the point.
Eigen::Matrix<double, 2, 3> pixel_derivative(const Pinhole& lens, const Vector3d& point) {
  constexpr double kStep = 1e-5;
  Eigen::Matrix<double, 2, 3> derivative;
  for (int k = 0; k < 3; ++k) {
    const Vector3d step = kStep * Vector3d::Unit(k);
    derivative.col(k) = (lens.project(point + step) - lens.project(point - step)) / (2 * kStep);
  }
  return derivative;
}

}  // namespace

// How the reference's images determine a point's I', I'' cos phi and -I'' sin phi.
struct ImageResiduals::Estimator {
  double coordinate_px = 0, px_per_m = 0, phase_rad = 0;
  std::vector<Vector3d> moved;  // the point, as the camera of each image sees it
  std::vector<Vector3d> basis;  // (1, cos, -sin) of each image's phase shift, with the drift of the fringes
  Eigen::Matrix3d covariance;   // of I', I'' cos phi and I'' sin phi, for a variance of 1
};

ImageResiduals::Estimator ImageResiduals::estimator_of(const Vector3d& point) const {
  constexpr double kStep = 1e-4;
  const auto column = [&](const Vector3d& at) { return projector_.project(projector_from_camera_ * at).x(); };
  Estimator result;
  result.coordinate_px = column(point);
  result.px_per_m = (column(point * (1 + kStep)) - result.coordinate_px) / (kStep * point.z());
  result.phase_rad = kTwoPi * (result.coordinate_px + 0.5) / period_px_;
  Eigen::Matrix3d moments = Eigen::Matrix3d::Zero();
  for (size_t k = 0; k < shifts_rad_.size(); ++k) {
    result.moved.push_back(motion_.at(times_s_[k]).inverse() * point);
    const double shift = shifts_rad_[k] + kTwoPi * (column(result.moved.back()) - result.coordinate_px) / period_px_;
    result.basis.emplace_back(1, std::cos(shift), -std::sin(shift));
    moments += result.basis.back() * result.basis.back().transpose();
  }
  result.covariance = moments.inverse();
  return result;
}

ImageResiduals::ImageResiduals(const RigModel& rig, const ImageReference& reference, int stride)
    : camera_(rig.camera),
      projector_(rig.projector),
      projector_from_camera_(rig.projector_from_camera),
      sensor_(rig.sensor),
      period_px_(std::max(1.0, reference.period_px)),
      shifts_rad_(reference.shifts_rad),
      times_s_(reference.times_s),
      motion_(reference.motion) {
  if (shifts_rad_.empty()) {
    shifts_rad_ = {-kTwoPi / 3, 0, kTwoPi / 3};
    times_s_.assign(3, 0.0);
  }
  if (shifts_rad_.size() != times_s_.size() || shifts_rad_.size() < 3)
    throw Error("image pose: the reference needs a time for each of at least three phase shifts");
  const Frame& frame = reference.frame;
  const cv::Size size = frame.points_m.size();
  if (frame.sigma_m.size() != size || frame.normals.size() != size || reference.mean_dn.size() != size ||
      reference.modulation_dn.size() != size ||
      (!reference.coordinate_px.empty() && reference.coordinate_px.size() != size) ||
      size != cv::Size(rig.camera.width, rig.camera.height))
    throw Error("image pose: the images of the reference and the camera differ in size");
  // Gradients of the images themselves would be mostly noise, which biases the pose and makes it look too certain. Without
  // the gradients of shading, smooth errors of the predicted brightness do not look like a motion.
  constexpr double kTextureBlur_px = 1;
  constexpr int kShading_px = 21;
  cv::Mat1f shading;
  cv::Mat1f smooth =
      filtered(reference.mean_dn, gaussian_half(kTextureBlur_px), FilterBorder::mirrored, selected_instruction_set());
  cv::blur(smooth, shading, {kShading_px, kShading_px});
  smooth -= shading;
  constexpr float kMinModulation_dn = 3;
  constexpr int kCoarse = 4;
  std::vector<cv::Point> pixels, others;
  for (int row = stride; row + 1 < size.height; row += stride) {
    for (int col = stride; col + 1 < size.width; col += stride) {
      if (!(frame.points_m(row, col)[2] > 0) || !(frame.sigma_m(row, col) >= 0) ||
          std::isnan(frame.normals(row, col)[2]) || !(reference.modulation_dn(row, col) >= kMinModulation_dn))
        continue;
      (row / stride % kCoarse == 0 && col / stride % kCoarse == 0 ? pixels : others).emplace_back(col, row);
    }
  }
  coarse_ = static_cast<int>(pixels.size());
  pixels.insert(pixels.end(), others.begin(), others.end());
  points_ = static_cast<int>(pixels.size());
  padded_ = (points_ + kLanes - 1) / kLanes * kLanes;
  values_ = std::make_unique<float[]>(static_cast<size_t>(kQuantities * padded_));
  std::fill_n(values_.get(), kQuantities * padded_, kNaN);
  const Irradiance<double> irradiance(rig);
  for_each_row(points_, [&](int i) {
    const cv::Point& at = pixels[static_cast<size_t>(i)];
    const cv::Vec3f &p = frame.points_m(at), &n = frame.normals(at);
    const Vector3d point(p[0], p[1], p[2]), normal(n[0], n[1], n[2]);
    const auto set = [&](int quantity, double value) { values_[quantity * padded_ + i] = static_cast<float>(value); };
    for (int k = 0; k < 3; ++k) set(kX + k, point[k]);
    const double sigma_m = static_cast<double>(frame.sigma_m(at)),
                 mean = static_cast<double>(reference.mean_dn(at)) - sensor_.offset_dn,
                 modulation = static_cast<double>(reference.modulation_dn(at));
    set(kMean, mean);
    set(kModulation, modulation);
    const Estimator estimator = estimator_of(point);
    set(kBias, reference.coordinate_px.empty()
                   ? 0
                   : static_cast<double>(reference.coordinate_px(at)) - estimator.coordinate_px);
    // From the errors of I', I'' cos phi and I'' sin phi to those of I', I'' and I'' phi.
    Eigen::Matrix3d to_polar = Eigen::Matrix3d::Identity();
    const double c = std::cos(estimator.phase_rad), sn = std::sin(estimator.phase_rad);
    to_polar.bottomRightCorner<2, 2>() << c, sn, -sn, c;
    Eigen::Matrix3d covariance =
        sensor_.variance_dn2(sensor_.offset_dn + mean) * to_polar * estimator.covariance * to_polar.transpose();
    covariance(0, 0) += sensor_.prnu * sensor_.prnu * mean * mean;
    // The sigma of the depth contains texture within the pixel as well.
    const double phase_sigma = kTwoPi / period_px_ * estimator.px_per_m * sigma_m;
    covariance(2, 2) = std::max(covariance(2, 2), phase_sigma * phase_sigma * modulation * modulation);
    for (int k = 0, entry = kMeanMean; k < 3; ++k) {
      for (int l = k; l < 3; ++l) set(entry++, covariance(k, l));
    }
    const Eigen::RowVector2d gradient(0.5 * static_cast<double>(smooth(at.y, at.x + 1) - smooth(at.y, at.x - 1)),
                                      0.5 * static_cast<double>(smooth(at.y + 1, at.x) - smooth(at.y - 1, at.x)));
    const Vector3d texture = pixel_derivative(rig.camera, point).transpose() * gradient.transpose();
    for (int k = 0; k < 3; ++k) set(kTextureX + k, texture[k]), set(kNormalX + k, normal[k]);
    const auto slope = irradiance.slope(point.data(), normal.data());
    for (int k = 0; k < 3; ++k) set(kBrighterX + k, slope.by_shift[k]), set(kTurnedX + k, slope.by_turn[k]);
  });
}

cv::Mat1f spline_coefficients(const cv::Mat& image) {
  static const auto filter = spline_prefilter();
  static const std::vector<float> half(filter.begin() + filter.size() / 2, filter.end());
  return filtered(image, half, FilterBorder::mirrored, selected_instruction_set());
}

Eigen::Matrix<double, kImageParameters, 12> ImageResiduals::motion_coupling(const Pattern& pattern,
                                                                            const ImageParameters& at) const {
  constexpr int kEvery = 3;
  Eigen::Matrix<double, kImageParameters, 12> sum = decltype(sum)::Zero();
  if (pattern.coding != Coding::fringe || pattern.period_px != period_px_ || pattern.axis != Axis::columns) return sum;
  const Pose& pose = at.camera_from_reference;
  int used = 0;
  for (int i = 0; i < coarse_; i += kEvery, ++used) {
    const auto value = [&](int quantity) { return static_cast<double>(array(quantity)[i]); };
    const auto vector = [&](int quantity) {
      return Vector3d(value(quantity), value(quantity + 1), value(quantity + 2));
    };
    const Vector3d point = vector(kX), texture = vector(kTextureX), normal = vector(kNormalX);
    if (!(-normal.dot(point) > static_cast<double>(kLeastFacing) * point.z())) continue;
    const Estimator estimator = estimator_of(point);
    const Vector3d turned = pose.rotation * point, moved = turned + pose.translation;
    const double coordinate = projector_.project(projector_from_camera_ * moved).x();
    const double shift = pattern.shift_rad + kTwoPi * (coordinate - estimator.coordinate_px) / period_px_;
    const Vector3d basis(1, std::cos(shift), -std::sin(shift));
    // Change of an image's grey value with the displacement of the point along its texture and its normal.
    const double ratio = value(kModulation) / value(kMean),
                 by_normal =
                     value(kModulation) * kTwoPi / period_px_ * estimator.px_per_m * point.z() / normal.dot(point);
    const auto change = [&](const Vector3d& of) -> Vector3d {
      const double cosine = std::cos(estimator.phase_rad), sine = std::sin(estimator.phase_rad);
      const double in_phase = cosine * of[1] + sine * of[2], quadrature = sine * of[1] - cosine * of[2];
      return (1 + ratio * in_phase) * texture + by_normal * quadrature * normal;
    };
    const Vector3d here = pose.rotation * change(basis);
    ImageVector jacobian;
    jacobian << turned.cross(here), here, 0, 0;
    const double cosine = std::cos(estimator.phase_rad + shift), sine = std::sin(estimator.phase_rad + shift);
    const double variance =
        sensor_.variance_dn2(sensor_.offset_dn + value(kMean) + value(kModulation) * cosine) + value(kMeanMean) +
        cosine * (cosine * value(kModulationModulation) + 2 * value(kMeanModulation)) +
        sine * (sine * value(kPhasePhase) - 2 * value(kMeanPhase) - 2 * cosine * value(kModulationPhase));
    Vector12d by_motion = Vector12d::Zero();
    for (size_t k = 0; k < times_s_.size(); ++k) {
      const double weight = basis.dot(estimator.covariance * estimator.basis[k]), time_s = times_s_[k];
      const Vector3d by_shift = change(estimator.basis[k]);
      Vector6d rate;
      rate << by_shift.cross(estimator.moved[k]), -by_shift;
      by_motion.head<6>() += weight * time_s * rate;
      by_motion.tail<6>() += weight * 0.5 * time_s * time_s * rate;
    }
    if (variance > 0) sum += jacobian * by_motion.transpose() / variance;
  }
  return sum * (static_cast<double>(points_) / std::max(1, used));
}

ImageSums ImageResiduals::linearise(const cv::Mat1f& coefficients, const Pattern& pattern, const ImageParameters& at,
                                    double outlier_sigma, int points, ImageInformation information) const {
  static const auto locate = Variants<locate_body>::of(selected_instruction_set());
  static const auto sum = Variants<sum_body>::of(selected_instruction_set());
  const Pose& pose = at.camera_from_reference;
  const Vector3d turn = rotation_log(pose.rotation);
  Setting setting{Projection(pose, camera_),
                  Projection(projector_from_camera_ * pose, projector_),
                  {},
                  {},
                  wave_of(pattern),
                  static_cast<float>(at.gain),
                  static_cast<float>(at.contrast),
                  static_cast<float>(sensor_.offset_dn),
                  static_cast<float>(sensor_.variance_dn2(sensor_.offset_dn)),
                  static_cast<float>(sensor_.gain_dn_per_electron),
                  static_cast<float>(sensor_.prnu * sensor_.prnu),
                  static_cast<float>(outlier_sigma * outlier_sigma),
                  static_cast<float>(period_px_ / kTwoPi),
                  information == ImageInformation::reference_noise};
  for (int k = 0; k < 9; ++k)
    setting.from_camera[k] = static_cast<float>(projector_from_camera_.rotation(k / 3, k % 3));
  for (int k = 0; k < 3; ++k) setting.turn[k] = static_cast<float>(turn[k]);
  const int padded = std::min(padded_, (points + kLanes - 1) / kLanes * kLanes),
            chunks = (padded + kChunk - 1) / kChunk;
  std::vector<PixelSums> sums(static_cast<size_t>(chunks));
  for_each_range(chunks, [&](int begin, int end) {
    Samples samples;
    for (int chunk = begin; chunk < end; ++chunk) {
      const int first = chunk * kChunk, count = std::min(kChunk, padded - first);
      PointValues values;
      for (int k = 0; k < kQuantities; ++k) values.of[k] = array(k) + first;
      locate(values, count, setting.camera, samples);
      sample_chunk(coefficients, count, samples);
      sum(values, samples, count, setting, sums[static_cast<size_t>(chunk)]);
    }
  });
  ImageSums total;
  for (const PixelSums& chunk : sums) add_chunk(chunk, total);
  total.information.triangularView<Eigen::StrictlyLower>() = total.information.transpose();
  return total;
}

}  // namespace fringeslam
