// SPDX-License-Identifier: Apache-2.0
#include "core/decode/stack_residuals.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "core/base/constants.h"
#include "core/base/parallel.h"
#include "core/decode/cubic_convolution.h"
#include "core/decode/motion_alignment.h"
#include "core/decode/normal_equations.h"
#include "core/decode/steps.h"
#include "core/patterns/waveform.h"

namespace fringeslam {

namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;
using ProjectionDerivative = Eigen::Matrix<double, 2, 3>;

// Pixel of a point, and its derivative with respect to the point.
Vector2d project(const Pinhole& lens, const Vector3d& point, ProjectionDerivative& derivative) {
  const double a = point.x() / point.z(), b = point.y() / point.z(), r2 = a * a + b * b;
  const Distortion& d = lens.distortion;
  const double radial = 1 + r2 * (d.k1 + r2 * (d.k2 + r2 * d.k3)), slope = d.k1 + r2 * (2 * d.k2 + r2 * 3 * d.k3);
  const double aa = radial + 2 * a * a * slope + 2 * d.p1 * b + 6 * d.p2 * a;
  const double ab = 2 * a * b * slope + 2 * d.p1 * a + 2 * d.p2 * b;
  const double bb = radial + 2 * b * b * slope + 6 * d.p1 * b + 2 * d.p2 * a;
  derivative << lens.fx * aa, lens.fx * ab, -lens.fx * (aa * a + ab * b), lens.fy * ab, lens.fy * bb,
      -lens.fy * (ab * a + bb * b);
  derivative /= point.z();
  return {lens.fx * (a * radial + 2 * d.p1 * a * b + d.p2 * (r2 + 2 * a * a)) + lens.cx,
          lens.fy * (b * radial + d.p1 * (r2 + 2 * b * b) + 2 * d.p2 * a * b) + lens.cy};
}

// Grey value of an image by cubic convolution (Keys 1981), as align_stack() interpolates, and its exact gradient. In
// motion, the gradients of texture and of the moving fringes nearly cancel, so that the error of another gradient, such
// as central differences, would dominate the rest.
struct Sample {
  double grey = 0;
  Eigen::RowVector2d gradient = Eigen::RowVector2d::Zero();
};

bool sample(const cv::Mat1f& image, const Vector2d& at, Sample& out) {
  if (!(at.x() >= 1 && at.y() >= 1 && at.x() < image.cols - 2 && at.y() < image.rows - 2)) return false;
  const int col = static_cast<int>(at.x()), row = static_cast<int>(at.y());
  const CubicWeights u(static_cast<float>(at.x() - col)), v(static_cast<float>(at.y() - row));
  float grey = 0, across = 0, down = 0;
  for (int j = 0; j < 4; ++j) {
    const float* line = image[row - 1 + j] + col - 1;
    float value = 0, change = 0;
    for (int i = 0; i < 4; ++i) {
      value += u.weight[i] * line[i];
      change += u.slope[i] * line[i];
    }
    grey += v.weight[j] * value;
    across += v.weight[j] * change;
    down += v.slope[j] * value;
  }
  out.grey = static_cast<double>(grey);
  out.gradient << static_cast<double>(across), static_cast<double>(down);
  return true;
}

// One exposure: its time, its pattern, and where it sees the points of the reference time.
struct Exposure {
  double time_s = 0, shift_rad = 0;
  Pose exposure_from_reference;
};

// Cosine and sine of an image's phase shift, and the weights of its grey value in the least-squares solution
// (mean, c, s) of grey = mean + c cos - s sin.
struct PhaseStep {
  double cosine = 0, sine = 0;
  Vector3d weights;
};

struct Period {
  double period_px = 0;
  std::vector<size_t> images;
  std::vector<PhaseStep> at_rest;  // of the images, if the camera stands still
  // Errors that a nonlinear projector causes: of the phase over the measured phase, turns; of the mean relative to the
  // modulation over the true phase, which is shifted for steps that are not centred on zero. Empty: none.
  std::vector<float> phase_error_turns;
  std::vector<double> mean_ripple;
  double centre_turns = 0;
};

// A surface point, where the reference exposure sees it, and the derivatives of its pixel and of its projector coordinate
// with respect to its displacement.
struct PixelSurface {
  int row = 0, col = 0;
  Vector3d point, normal;
  ProjectionDerivative pixel_by_point;
  Vector2d lit;
  Vector3d coordinate_by_point;
};

// A pixel's estimates from one period, and their derivatives with respect to the motion.
struct PeriodFit {
  double mean = 0, phase = 0, mean_variance = 0, phase_variance = 0, modulation = 0;
  MotionVector mean_slope, phase_slope;
};

// Gaussian blur, at a lower resolution if it is wide.
cv::Mat1f blurred_image(const cv::Mat1f& image, double sigma_px) {
  constexpr double kFinest_px = 3;
  cv::Mat1f blurred;
  const double scale = std::max(1.0, sigma_px / kFinest_px);
  if (scale < 2) {
    cv::GaussianBlur(image, blurred, {}, sigma_px);
    return blurred;
  }
  cv::Mat1f small;
  cv::resize(image, small, {}, 1 / scale, 1 / scale, cv::INTER_AREA);
  cv::GaussianBlur(small, small, {}, kFinest_px);
  cv::resize(small, blurred, image.size(), 0, 0, cv::INTER_CUBIC);
  return blurred;
}

// Sums over the pixels of one row of the image.
struct RowSums {
  RowProducts products;
  double squares = 0, cost = 0;
  int residuals = 0;
};

}  // namespace

class StackResiduals::Impl {
 public:
  Impl(const FringeStack& stack, const RigModel& rig, const PixelRays& rays, Axis axis)
      : rig_(rig), rays_(rays), row_(axis == Axis::columns ? 0 : 1) {
    DecodeOptions all;
    for (const FringeGroup& group : select_groups(stack.patterns, axis, all)) {
      Period period{group.period_px, {}, {}, {}, {}, 0};
      for (const int image : group.images) period.images.push_back(static_cast<size_t>(image));
      if (stack.patterns.inverse_response.empty()) set_errors(period, group);
      periods_.push_back(std::move(period));
    }
    for (size_t k = 0; k < stack.images.size(); ++k) {
      exposures_.push_back({stack.exposure_time_s[k] - stack.timestamp_s, stack.patterns.patterns[k].shift_rad, {}});
      images_.emplace_back();
      stack.images[k].convertTo(images_.back(), CV_32F);
    }
    blurred_.resize(images_.size());
    blur(0);
  }

  size_t periods() const { return periods_.size(); }

  std::vector<DepthSlope> slopes(const cv::Mat1f& known_m, const CameraMotion& motion, int stride) {
    move(motion);
    const int rows = (rays_.rows + stride - 1) / stride;
    std::vector<std::vector<DepthSlope>> of_rows(static_cast<size_t>(rows));
    const Period& finest = periods_.back();
    for_each_row(rows, [&](int i) {
      PeriodFit fitted;
      PixelSurface pixel;
      for (int col = 0; col < rays_.cols; col += stride) {
        const int row = i * stride;
        if (std::isnan(known_m(row, col)) || !surface(row, col, pixel) || !fit(pixel, finest, fitted)) continue;
        const double px_per_m = pixel.coordinate_by_point.dot(pixel.point) / pixel.point.z();
        of_rows[static_cast<size_t>(i)].push_back(
            {row, col, finest.period_px / (kTwoPi * px_per_m) * fitted.phase_slope.head<12>()});
      }
    });
    std::vector<DepthSlope> all;
    for (const auto& some : of_rows) all.insert(all.end(), some.begin(), some.end());
    return all;
  }

  void blur(double sigma_px) {
    blur_px_ = sigma_px;
    for (size_t k = 0; k < images_.size(); ++k) {
      cv::Mat1f blurred = images_[k];
      if (sigma_px > 0) blurred = blurred_image(images_[k], sigma_px);
      blurred_[k] = blurred;
    }
  }

  void set_depth(const cv::Mat1f& depth_m, bool with_normals) {
    depth_m_ = depth_m;
    if (!with_normals) return;
    constexpr double kSmooth_px = 6;  // slopes at depth steps and noise would exceed those of the surfaces
    smooth_m_ = blurred_image(depth_m, kSmooth_px);
  }

  MotionSums linearise(const CameraMotion& motion, int stride, double outlier_sigma) {
    move(motion);
    const int rows = (rays_.rows + stride - 1) / stride;
    std::vector<RowSums> of_rows(static_cast<size_t>(rows));
    for_each_row(rows, [&](int i) {
      std::vector<PeriodFit> fits(periods_.size());
      RowSums& sums = of_rows[static_cast<size_t>(i)];
      for (int col = 0; col < rays_.cols; col += stride) add_pixel(i * stride, col, outlier_sigma, fits, sums);
      sums.products.flush();
    });
    MotionSums total;
    for (const RowSums& sums : of_rows) {
      total.information += sums.products.block<kMotionUnknowns, kMotionUnknowns>(0, 0);
      total.gradient += sums.products.block<kMotionUnknowns, 1>(0, kMotionUnknowns);
      total.squares += sums.squares;
      total.cost += sums.cost;
      total.residuals += sums.residuals;
    }
    return total;
  }

 private:
  void set_errors(Period& period, const FringeGroup& group) const {
    period.phase_error_turns = correction_of(group, rig_.phase_correction);
    if (period.phase_error_turns.empty() || rig_.projector_response.empty()) return;
    period.mean_ripple = mean_ripple_of(rig_.projector_response, rig_.phase_correction.steps);
    period.mean_ripple.push_back(period.mean_ripple.front());
    period.centre_turns = turns_from_centred(group.shifts_rad);
  }

  // Removes the errors of a nonlinear projector.
  static void correct(const Period& period, PeriodFit& fit) {
    if (period.phase_error_turns.empty()) return;
    const auto entries = static_cast<double>(period.phase_error_turns.size());
    double turns = fit.phase / kTwoPi;
    turns -= std::floor(turns);
    const double at = turns * entries, low = std::floor(at), share = at - low;
    const auto first = static_cast<size_t>(low) % period.phase_error_turns.size();
    const size_t second = (first + 1) % period.phase_error_turns.size();
    fit.phase -= kTwoPi * ((1 - share) * static_cast<double>(period.phase_error_turns[first]) +
                           share * static_cast<double>(period.phase_error_turns[second]));
    if (period.mean_ripple.empty()) return;
    const double place = fit.phase / kTwoPi + period.centre_turns;
    fit.mean -= fit.modulation * interpolate_table(period.mean_ripple, place - std::floor(place));
  }

  void move(const CameraMotion& motion) {
    for (Exposure& exposure : exposures_) exposure.exposure_from_reference = motion.at(exposure.time_s).inverse();
    at_rest_ = motion.is_still();
    for (Period& period : periods_) set_steps_at_rest(period);
  }

  void set_steps_at_rest(Period& period) const {
    Eigen::Matrix3d moments = Eigen::Matrix3d::Zero();
    period.at_rest.resize(period.images.size());
    for (size_t k = 0; k < period.images.size(); ++k) {
      PhaseStep& step = period.at_rest[k];
      step.cosine = std::cos(exposures_[period.images[k]].shift_rad);
      step.sine = std::sin(exposures_[period.images[k]].shift_rad);
      step.weights = {1, step.cosine, -step.sine};
      moments += step.weights * step.weights.transpose();
    }
    const Eigen::Matrix3d inverse = moments.inverse();
    for (PhaseStep& step : period.at_rest) step.weights = inverse * step.weights;
  }

  // Returns false at the border of the image.
  bool surface(int row, int col, PixelSurface& out) const {
    const cv::Vec2f& ray = rays_(row, col);
    if (std::isnan(ray[0]) || row < 1 || col < 1 || row + 1 >= rays_.rows || col + 1 >= rays_.cols) return false;
    out.row = row;
    out.col = col;
    out.point = static_cast<double>(depth_m_(row, col)) * Vector3d(ray[0], ray[1], 1);
    ProjectionDerivative derivative;
    out.lit = ::fringeslam::project(rig_.projector, rig_.projector_from_camera * out.point, derivative);
    out.coordinate_by_point = (derivative.row(row_) * rig_.projector_from_camera.rotation).transpose();
    if (at_rest_) {
      ::fringeslam::project(rig_.camera, out.point, out.pixel_by_point);
    } else if (!smooth_m_.empty()) {
      const Vector3d across = smooth_point(row, col + 1) - smooth_point(row, col - 1),
                     down = smooth_point(row + 1, col) - smooth_point(row - 1, col);
      out.normal = across.cross(down).normalized();
    }
    return true;
  }

  // Point of the smooth depth at a pixel inside the image.
  Vector3d smooth_point(int row, int col) const {
    const cv::Vec2f& ray = rays_(row, col);
    return static_cast<double>(smooth_m_(row, col)) * Vector3d(ray[0], ray[1], 1);
  }

  // Illumination of a point and brightness of its pixel, up to a factor: the projector's irradiance on a surface with
  // this normal, and the fall-off of the camera's lens.
  double brightness(const Vector3d& point, const Vector3d& normal) const {
    const Vector3d from_projector = rig_.projector_from_camera * point;
    const double distance = from_projector.norm(), cosine = from_projector.z() / distance;
    const double facing = std::abs((rig_.projector_from_camera.rotation * normal).dot(from_projector));
    return facing / (distance * distance * distance) * power(cosine, rig_.projector_lens.vignetting - 3) *
           power(point.z() / point.norm(), rig_.camera_lens.vignetting);
  }

  // The usual exponents need no std::pow().
  static double power(double x, double exponent) {
    if (exponent == 0) return 1;
    if (exponent == 1) return x;
    return exponent == 4 ? x * x * x * x : std::pow(x, exponent);
  }

  bool fit(const PixelSurface& pixel, const Period& period, PeriodFit& out) const {
    constexpr size_t kMaxSteps = 64;
    std::array<double, kMaxSteps> grey;
    std::array<Vector3d, kMaxSteps> texture, coordinate;  // derivatives of grey value and coordinate w.r.t. the point
    std::array<PhaseStep, kMaxSteps> moving_steps;
    const size_t count = period.images.size();
    Vector3d solution = Vector3d::Zero();
    const PhaseStep* steps = period.at_rest.data();
    if (at_rest_) {
      for (size_t k = 0; k < count; ++k) {
        const cv::Mat1f& image = blurred_[period.images[k]];
        const float *const line = image[pixel.row] + pixel.col, *const above = image[pixel.row - 1] + pixel.col,
                           *const below = image[pixel.row + 1] + pixel.col;
        const Eigen::RowVector2d gradient(0.5 * static_cast<double>(line[1] - line[-1]),
                                          0.5 * static_cast<double>(*below - *above));
        grey[k] = static_cast<double>(*line);
        texture[k] = (gradient * pixel.pixel_by_point).transpose();
        coordinate[k] = pixel.coordinate_by_point;
        solution += grey[k] * steps[k].weights;
      }
    } else {
      if (!sample_in_motion(pixel, period, grey.data(), texture.data(), coordinate.data(), moving_steps.data()))
        return false;
      Eigen::Matrix3d moments = Eigen::Matrix3d::Zero();
      Vector3d right = Vector3d::Zero();
      for (size_t k = 0; k < count; ++k) {
        const Vector3d& basis = moving_steps[k].weights;
        moments += basis * basis.transpose();
        right += grey[k] * basis;
      }
      const Eigen::Matrix3d inverse = moments.inverse();
      for (size_t k = 0; k < count; ++k) moving_steps[k].weights = inverse * moving_steps[k].weights;
      solution = inverse * right;
      steps = moving_steps.data();
    }
    const double rad_per_px = kTwoPi / period.period_px;
    const double c = solution[1], s = solution[2], power = c * c + s * s;
    out.mean = solution[0];
    out.modulation = std::sqrt(power);
    out.phase = std::atan2(s, c);
    correct(period, out);
    out.mean_variance = out.phase_variance = 0;
    out.mean_slope.setZero();
    out.phase_slope.setZero();
    for (size_t k = 0; k < count; ++k) {
      const Exposure& exposure = exposures_[period.images[k]];
      const auto& [cosine, sine, weights] = steps[k];
      const double to_phase = (c * weights[2] - s * weights[1]) / power;
      const double variance = rig_.sensor.variance_dn2(grey[k]) / noise_averaging();
      out.mean_variance += weights[0] * weights[0] * variance;
      out.phase_variance += to_phase * to_phase * variance;
      // Change of the grey value that the model does not follow, per displacement of the point.
      const Vector3d change = texture[k] + (c * sine + s * cosine) * rad_per_px * coordinate[k];
      const Vector3d moved = at_rest_ ? pixel.point : exposure.exposure_from_reference * pixel.point;
      Vector6d by_displacement;
      by_displacement << change.cross(moved), -change;
      double power_of_time = 1;
      for (int order = 0; order < 3; ++order) {
        power_of_time *= exposure.time_s / (order + 1);
        out.mean_slope.segment<6>(6 * order) += power_of_time * weights[0] * by_displacement;
        out.phase_slope.segment<6>(6 * order) += power_of_time * to_phase * by_displacement;
      }
    }
    return true;
  }

  // Samples the images of a period where they see the point, as if exposed from the reference pose. The steps' weights
  // are those of the basis (1, cos, -sin). Returns false if an image does not show the point.
  bool sample_in_motion(const PixelSurface& pixel, const Period& period, double* grey, Vector3d* texture,
                        Vector3d* coordinate, PhaseStep* steps) const {
    const double rad_per_px = kTwoPi / period.period_px;
    const bool with_brightness = !smooth_m_.empty();
    const double at_reference = with_brightness ? brightness(pixel.point, pixel.normal) : 0;
    ProjectionDerivative derivative;
    for (size_t k = 0; k < period.images.size(); ++k) {
      const Exposure& exposure = exposures_[period.images[k]];
      const Vector3d moved = exposure.exposure_from_reference * pixel.point;
      if (!(moved.z() > 0)) return false;
      const Vector2d seen = ::fringeslam::project(rig_.camera, moved, derivative);
      Sample here;
      if (!sample(blurred_[period.images[k]], seen, here)) return false;
      double share = 1;
      if (with_brightness) {
        const Vector3d turned = exposure.exposure_from_reference.rotation * pixel.normal;
        share = at_reference / std::max(1e-12, brightness(moved, turned));
      }
      grey[k] = rig_.sensor.offset_dn + share * (here.grey - rig_.sensor.offset_dn);
      texture[k] = share * (here.gradient * derivative).transpose();
      const Vector2d lit = ::fringeslam::project(rig_.projector, rig_.projector_from_camera * moved, derivative);
      coordinate[k] = (derivative.row(row_) * rig_.projector_from_camera.rotation).transpose();
      const double theta = exposure.shift_rad + rad_per_px * (lit - pixel.lit)[row_];
      steps[k].cosine = std::cos(theta);
      steps[k].sine = std::sin(theta);
      steps[k].weights = {1, steps[k].cosine, -steps[k].sine};
    }
    return true;
  }

  // Blurring averages the noise of about 4 pi sigma^2 pixels.
  double noise_averaging() const { return 1 + 4 * kPi * blur_px_ * blur_px_; }

  void add_pixel(int row, int col, double outlier_sigma, std::vector<PeriodFit>& fits, RowSums& sums) const {
    constexpr double kMinModulation = 4;
    PixelSurface pixel;
    if (!surface(row, col, pixel)) return;
    for (size_t g = 0; g < periods_.size(); ++g) {
      if (!fit(pixel, periods_[g], fits[g])) return;
    }
    const PeriodFit& finest = fits.back();
    // Fringes that drift by about 60 degrees against their shifts leave mean and phase of their period nearly
    // undetermined, which amplifies errors that are not noise.
    constexpr double kMaxAmplification = 6;
    const size_t best = static_cast<size_t>(
        std::min_element(fits.begin(), fits.end(),
                         [](const PeriodFit& a, const PeriodFit& b) { return a.mean_variance < b.mean_variance; }) -
        fits.begin());
    const auto amplified = [&](const PeriodFit& fit) {
      return fit.mean_variance > kMaxAmplification * fits[best].mean_variance;
    };
    for (size_t g = 0; g < fits.size(); ++g) {
      if (g == best || amplified(fits[g])) continue;
      add(fits[g].mean - fits[best].mean, fits[g].mean_slope - fits[best].mean_slope,
          fits[g].mean_variance + fits[best].mean_variance, outlier_sigma, sums);
    }
    const double expected_px = pixel.lit[row_];
    const bool fringes = finest.modulation > kMinModulation && blur_px_ == 0;
    if (blur_px_ == 0 && !fringes) return;
    if (amplified(finest)) return;
    for (size_t g = 0; g + 1 < periods_.size(); ++g) {
      const PeriodFit& here = fits[g];
      if (!fringes || here.modulation <= kMinModulation) continue;
      // The depth determines the order of the coarser phase; its multiple predicts the finest phase up to whole turns.
      const double ratio = periods_[g].period_px / periods_.back().period_px;
      const double order = std::round((expected_px + 0.5) / periods_[g].period_px - here.phase / kTwoPi);
      const double difference = std::remainder(ratio * (here.phase + kTwoPi * order) - finest.phase, kTwoPi);
      const double variance = ratio * ratio * here.phase_variance + finest.phase_variance;
      if (variance > 0.3) continue;  // ambiguous
      add(difference, ratio * here.phase_slope - finest.phase_slope, variance, outlier_sigma, sums);
    }
  }

  static void add(double residual, const MotionVector& slope, double variance, double outlier_sigma, RowSums& sums) {
    // Tukey's biweight.
    const double square = residual * residual / variance, limit = outlier_sigma * outlier_sigma;
    const double left = std::max(0.0, 1 - square / limit);
    ++sums.residuals;
    sums.squares += std::min(square, limit);
    sums.cost += limit / 6 * (1 - left * left * left);
    if (left <= 0) return;
    const double root = left / std::sqrt(variance);
    double* const row = sums.products.next_row();
    for (int i = 0; i < kMotionUnknowns; ++i) row[i] = root * slope[i];
    row[kMotionUnknowns] = root * residual;
  }

  const RigModel& rig_;
  const PixelRays& rays_;
  int row_;
  std::vector<Exposure> exposures_;
  std::vector<Period> periods_;
  std::vector<cv::Mat1f> images_, blurred_;
  cv::Mat1f depth_m_, smooth_m_;
  double blur_px_ = 0;
  bool at_rest_ = false;
};

StackResiduals::StackResiduals(const FringeStack& stack, const RigModel& rig, const PixelRays& rays, Axis axis)
    : impl_(std::make_unique<Impl>(stack, rig, rays, axis)) {}
StackResiduals::~StackResiduals() = default;

size_t StackResiduals::periods() const { return impl_->periods(); }
void StackResiduals::blur(double sigma_px) { impl_->blur(sigma_px); }
void StackResiduals::set_depth(const cv::Mat1f& depth_m, bool with_normals) { impl_->set_depth(depth_m, with_normals); }

MotionSums StackResiduals::linearise(const CameraMotion& motion, int stride, double outlier_sigma) {
  return impl_->linearise(motion, stride, outlier_sigma);
}

std::vector<DepthSlope> StackResiduals::slopes(const cv::Mat1f& known_m, const CameraMotion& motion, int stride) {
  return impl_->slopes(known_m, motion, stride);
}

}  // namespace fringeslam
