// SPDX-License-Identifier: Apache-2.0
#include "core/decode/stack_residuals.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "core/base/constants.h"
#include "core/base/parallel.h"
#include "core/base/symmetric_filter.h"
#include "core/decode/motion_alignment.h"
#include "core/decode/normal_equations.h"
#include "core/decode/stack_points.h"
#include "core/decode/steps.h"
#include "core/patterns/waveform.h"
#include "core/types/selected_instruction_set.h"

namespace fringeslam {

namespace {

using Eigen::Vector3d;
using Exposure = PointFollower::Exposure;

static_assert(kMotionParameters == kMotionUnknowns);

struct Period {
  double period_px = 0;
  std::vector<size_t> images;
  std::vector<const Exposure*> exposures;  // of the images
  // Errors that a nonlinear projector causes with steps centred on zero: of the phase over the measured phase, turns; of the
  // mean relative to the modulation over the true phase. Empty: none.
  std::vector<float> phase_error_turns;
  std::vector<double> mean_ripple;
  double phase_error_rad2 = 0, mean_ripple2 = 0;  // mean squares of these errors
  std::vector<double> shifts_rad;                 // of the images
  // At the current motion.
  bool correctable = true;
  double centre_turns = 0;  // shift of the tables' phases
  // Variances of the errors that remain: rad^2, and relative to the squared modulation.
  double phase_variance = 0, ripple_variance = 0;
};

// Gaussian blur, at a lower resolution if it is wide.
cv::Mat1f blurred_image(const cv::Mat1f& image, double sigma_px) {
  constexpr double kFinest_px = 3;
  const auto blurred_by = [](const cv::Mat1f& sharp, double sigma) {
    return filtered(sharp, gaussian_half(sigma), FilterBorder::mirrored, selected_instruction_set());
  };
  const double scale = std::max(1.0, sigma_px / kFinest_px);
  if (scale < 2) return blurred_by(image, sigma_px);
  cv::Mat1f small, blurred;
  cv::resize(image, small, {}, 1 / scale, 1 / scale, cv::INTER_AREA);
  cv::resize(blurred_by(small, kFinest_px), blurred, image.size(), 0, 0, cv::INTER_CUBIC);
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
  Impl(const FringeStack& stack, const RigModel& rig, const PixelRays& rays, double clip_dn, Axis axis, int steps)
      : rig_(rig), rays_(rays), axis_(axis), follower_(rig, axis == Axis::columns ? 0 : 1) {
    DecodeOptions selected;
    selected.steps = steps;
    for (const FringeGroup& group : select_groups(stack.patterns, axis, selected)) {
      Period period;
      period.period_px = group.period_px;
      for (const int image : group.images) period.images.push_back(static_cast<size_t>(image));
      if (stack.patterns.inverse_response.empty()) set_errors(period, group);
      periods_.push_back(std::move(period));
    }
    for (size_t k = 0; k < stack.images.size(); ++k) {
      cv::Mat1b saturated;
      cv::compare(stack.images[k], clip_dn, saturated, cv::CMP_GE);
      saturated_.push_back(cv::countNonZero(saturated) > 0 ? saturated : cv::Mat1b());
      exposures_.push_back(
          {nullptr, stack.exposure_time_s[k] - stack.timestamp_s, stack.patterns.patterns[k].shift_rad, {}});
      images_.emplace_back();
      stack.images[k].convertTo(images_.back(), CV_32F);
    }
    blurred_.resize(images_.size());
    for (Period& period : periods_) {
      most_images_ = std::max(most_images_, period.images.size());
      for (const size_t k : period.images) period.exposures.push_back(&exposures_[k]);
    }
    blur(0);
  }

  size_t periods() const { return periods_.size(); }

  std::vector<DepthSlope> slopes(const cv::Mat1f& known_m, const CameraMotion& motion, double period_px, int stride) {
    const auto found = std::find_if(periods_.begin(), periods_.end(),
                                    [period_px](const Period& period) { return period.period_px == period_px; });
    if (found == periods_.end()) return {};
    const Period& of = *found;
    move(motion, known_m);
    const int rows = (rays_.rows + stride - 1) / stride;
    std::vector<std::vector<DepthSlope>> of_rows(static_cast<size_t>(rows));
    for_each_range(rows, [&](int first, int end) {
      Group group(most_images_, 1);
      for (int i = first; i < end; ++i) {
        const int row = i * stride;
        const auto known = [&](int col) { return !std::isnan(known_m(row, col)); };
        for_each_group(row, stride, known, group, [&] {
          fit(group, of, group.fits[0]);
          const SurfacePoints& points = group.points;
          for (size_t p = 0; p < group.size(); ++p) {
            if (std::isnan(group.fits[0].mean[p])) continue;
            const double px_per_m = (points.lit_by_x[p] * points.x[p] + points.lit_by_y[p] * points.y[p] +
                                     points.lit_by_z[p] * points.z[p]) /
                                    points.z[p];
            DepthSlope slope{row, group.cols[p], {}};
            for (size_t k = 0; k < 12; ++k)
              slope.by_motion[static_cast<Eigen::Index>(k)] =
                  period_px / (kTwoPi * px_per_m) * group.fits[0].phase_slope[k][p];
            of_rows[static_cast<size_t>(i)].push_back(slope);
          }
        });
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
      if (!saturated_[k].empty()) {
        // Saturated pixels have no sample. Those beside them that the blur mixes with them have none either.
        const int reach = static_cast<int>(std::ceil(2 * sigma_px));
        cv::Mat1b hidden = saturated_[k];
        if (reach > 0) cv::dilate(hidden, hidden, cv::Mat1b::ones(2 * reach + 1, 2 * reach + 1));
        blurred = blurred.clone();
        blurred.setTo(kNaN, hidden);
      }
      blurred_[k] = blurred;
      exposures_[k].image = &blurred_[k];
    }
  }

  void set_depth(const cv::Mat1f& depth_m, bool with_normals) {
    depth_m_ = depth_m;
    if (!with_normals) return;
    constexpr double kSmooth_px = 6;  // slopes at depth steps and noise would exceed those of the surfaces
    smooth_m_ = blurred_image(depth_m, kSmooth_px);
  }

  MotionSums linearise(const CameraMotion& motion, int stride, double outlier_sigma) {
    move(motion, depth_m_);
    const int rows = (rays_.rows + stride - 1) / stride;
    std::vector<RowSums> of_rows(static_cast<size_t>(rows));
    for_each_range(rows, [&](int first, int end) {
      Group group(most_images_, periods_.size());
      for (int i = first; i < end; ++i) {
        RowSums& sums = of_rows[static_cast<size_t>(i)];
        for_each_group(
            i * stride, stride, [](int) { return true; }, group,
            [&] {
              for (size_t g = 0; g < periods_.size(); ++g) fit(group, periods_[g], group.fits[g]);
              for (size_t p = 0; p < group.size(); ++p) add_pixel(group, p, outlier_sigma, sums);
            });
        sums.products.flush();
      }
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
  void set_errors(Period& period, FringeGroup group) const {
    period.shifts_rad = group.shifts_rad;
    const auto steps = static_cast<double>(group.shifts_rad.size());
    for (size_t k = 0; k < group.shifts_rad.size(); ++k)
      group.shifts_rad[k] = kTwoPi * (static_cast<double>(k) - (steps - 1) / 2) / steps;
    period.phase_error_turns = correction_of(group, rig_.phase_correction);
    const auto mean_square_of = [](const auto& table) {
      double sum = 0;
      for (const auto error : table) sum += static_cast<double>(error) * static_cast<double>(error);
      return table.empty() ? 0.0 : sum / static_cast<double>(table.size());
    };
    period.phase_error_rad2 = kTwoPi * kTwoPi * mean_square_of(period.phase_error_turns);
    if (period.phase_error_turns.empty() || rig_.projector_response.empty()) return;
    period.mean_ripple = mean_ripple_of(rig_.projector_response, rig_.phase_correction.steps);
    period.mean_ripple.push_back(period.mean_ripple.front());
    period.mean_ripple2 = mean_square_of(period.mean_ripple);
  }

  // Points that represent the surfaces.
  std::vector<Vector3d> some_points(const cv::Mat1f& depth_m) const {
    constexpr int kStride = 32;
    std::vector<Vector3d> points_m;
    for (int row = kStride / 2; row < rays_.rows; row += kStride) {
      for (int col = kStride / 2; col < rays_.cols; col += kStride) {
        const auto z = static_cast<double>(depth_m(row, col));
        const cv::Vec2f& ray = rays_(row, col);
        if (!std::isnan(z) && !std::isnan(ray[0])) points_m.push_back(z * Vector3d(ray[0], ray[1], 1));
      }
    }
    return points_m;
  }

  // The drift changes the shifts: errors are those of the nearest equally spaced ones, like in decode().
  void set_shifts(Period& period, const std::vector<Vector3d>& points_m) const {
    std::vector<double> shifts_rad = period.shifts_rad;
    for (size_t k = 0; k < shifts_rad.size() && !at_rest_; ++k)
      shifts_rad[k] +=
          kTwoPi * median_drift_px(rig_, points_m, period.exposures[k]->exposure_from_reference, axis_).value_or(0) /
          period.period_px;
    const EvenShifts even = nearest_even(shifts_rad);
    period.correctable = even.near();
    period.centre_turns = turns_from_centred(even.shifts_rad);
    period.phase_variance = even.remaining() * period.phase_error_rad2;
    period.ripple_variance = even.remaining() * period.mean_ripple2;
  }

  // Points of a row of the image, and their fits.
  struct Group {
    SurfacePoints points;
    int row = 0;
    std::array<int, kPointsTogether> cols;
    std::vector<PointSamples> samples;
    std::vector<PeriodFits> fits;

    Group(size_t images, size_t periods) : samples(images), fits(periods) {}
    size_t size() const { return static_cast<size_t>(points.count); }
  };

  // Removes the errors of a nonlinear projector from a point's fit.
  static void correct(const Period& period, PeriodFits& fits, size_t p) {
    const auto entries = static_cast<double>(period.phase_error_turns.size());
    double turns = fits.phase[p] / kTwoPi + period.centre_turns;
    if (std::isnan(turns)) return;
    fits.phase_variance[p] += period.phase_variance;
    fits.mean_variance[p] += period.ripple_variance * fits.modulation[p] * fits.modulation[p];
    if (!period.correctable) return;
    turns -= std::floor(turns);
    const double at = turns * entries, low = std::floor(at), share = at - low;
    const auto first = static_cast<size_t>(low) % period.phase_error_turns.size();
    const size_t second = (first + 1) % period.phase_error_turns.size();
    fits.phase[p] -= kTwoPi * ((1 - share) * static_cast<double>(period.phase_error_turns[first]) +
                               share * static_cast<double>(period.phase_error_turns[second]));
    if (period.mean_ripple.empty()) return;
    const double place = fits.phase[p] / kTwoPi + period.centre_turns;
    fits.mean[p] -= fits.modulation[p] * interpolate_table(period.mean_ripple, place - std::floor(place));
  }

  void move(const CameraMotion& motion, const cv::Mat1f& depth_m) {
    for (Exposure& exposure : exposures_) exposure.exposure_from_reference = motion.at(exposure.time_s).inverse();
    at_rest_ = motion.is_still();
    std::vector<Vector3d> points_m;
    for (Period& period : periods_) {
      if (period.phase_error_turns.empty()) continue;
      if (points_m.empty() && !at_rest_) points_m = some_points(depth_m);
      set_shifts(period, points_m);
    }
  }

  bool with_brightness() const { return !at_rest_ && !smooth_m_.empty(); }

  // Calls `use` with every `stride`-th point of a row that is inside the image's border and `wanted`, in groups.
  template <class Wanted, class Use>
  void for_each_group(int row, int stride, const Wanted& wanted, Group& group, const Use& use) const {
    if (row < 1 || row + 1 >= rays_.rows) return;
    group.points.count = 0;
    const auto flush = [&] {
      if (group.points.count == 0) return;
      follower_.light(group.points, with_brightness());
      group.row = row;
      use();
      group.points.count = 0;
    };
    for (int col = 0; col + 1 < rays_.cols; col += stride) {
      if (col < 1 || std::isnan(rays_(row, col)[0]) || !wanted(col)) continue;
      add_point(row, col, group);
      if (group.points.count == kPointsTogether) flush();
    }
    flush();
  }

  void add_point(int row, int col, Group& group) const {
    const cv::Vec2f& ray = rays_(row, col);
    SurfacePoints& points = group.points;
    const auto p = static_cast<size_t>(points.count++);
    group.cols[p] = col;
    const auto z = static_cast<double>(depth_m_(row, col));
    points.x[p] = z * static_cast<double>(ray[0]);
    points.y[p] = z * static_cast<double>(ray[1]);
    points.z[p] = z;
    if (!with_brightness()) return;
    const Vector3d across = smooth_point(row, col + 1) - smooth_point(row, col - 1),
                   down = smooth_point(row + 1, col) - smooth_point(row - 1, col);
    const Vector3d normal = across.cross(down).normalized();
    points.normal_x[p] = normal.x();
    points.normal_y[p] = normal.y();
    points.normal_z[p] = normal.z();
  }

  // Point of the smooth depth at a pixel inside the image.
  Vector3d smooth_point(int row, int col) const {
    const cv::Vec2f& ray = rays_(row, col);
    return static_cast<double>(smooth_m_(row, col)) * Vector3d(ray[0], ray[1], 1);
  }

  void fit(Group& group, const Period& period, PeriodFits& fits) const {
    for (size_t k = 0; k < period.exposures.size(); ++k) {
      const Exposure& exposure = *period.exposures[k];
      if (at_rest_)
        follower_.sample_at_rest(exposure, group.points, group.row, group.cols.data(), group.samples[k]);
      else
        follower_.sample(exposure, period.period_px, group.points, with_brightness(), group.samples[k]);
    }
    follower_.fit(group.points.count, group.samples, period.exposures, period.period_px, noise_averaging(), fits);
    if (period.phase_error_turns.empty()) return;
    for (size_t p = 0; p < group.size(); ++p) correct(period, fits, p);
  }

  // Blurring averages the noise of about 4 pi sigma^2 pixels.
  double noise_averaging() const { return 1 + 4 * kPi * blur_px_ * blur_px_; }

  // Adds the residuals of point `p`, if all exposures show it.
  void add_pixel(const Group& group, size_t p, double outlier_sigma, RowSums& sums) const {
    constexpr double kMinModulation = 4;
    const std::vector<PeriodFits>& fits = group.fits;
    for (const PeriodFits& fit : fits) {
      if (std::isnan(fit.mean[p])) return;
    }
    // Fringes that drift by about 60 degrees against their shifts leave mean and phase of their period nearly
    // undetermined, which amplifies errors that are not noise.
    constexpr double kMaxAmplification = 6;
    const PeriodFits& best = *std::min_element(fits.begin(), fits.end(), [p](const PeriodFits& a, const PeriodFits& b) {
      return a.mean_variance[p] < b.mean_variance[p];
    });
    const auto amplified = [&](const PeriodFits& fit) {
      return fit.mean_variance[p] > kMaxAmplification * best.mean_variance[p];
    };
    for (const PeriodFits& fit : fits) {
      if (&fit == &best || amplified(fit)) continue;
      add(fit.mean[p] - best.mean[p], {1, fit.mean_slope, best.mean_slope, p},
          fit.mean_variance[p] + best.mean_variance[p], outlier_sigma, sums);
    }
    if (blur_px_ > 0) return;
    // Motions that would leave the finest fringes undetermined are tested by the next coarser ones.
    size_t finest = fits.size() - 1;
    while (finest > 0 && amplified(fits[finest])) --finest;
    const PeriodFits& fine = fits[finest];
    if (fine.modulation[p] <= kMinModulation) return;
    const double expected_px = group.points.lit_px[p];
    for (size_t g = 0; g < finest; ++g) {
      const PeriodFits& here = fits[g];
      if (here.modulation[p] <= kMinModulation) continue;
      // The depth determines the order of the coarser phase; its multiple predicts the finest phase up to whole turns.
      const double ratio = periods_[g].period_px / periods_[finest].period_px;
      const double order = std::round((expected_px + 0.5) / periods_[g].period_px - here.phase[p] / kTwoPi);
      const double difference = std::remainder(ratio * (here.phase[p] + kTwoPi * order) - fine.phase[p], kTwoPi);
      const double variance = ratio * ratio * here.phase_variance[p] + fine.phase_variance[p];
      if (variance > 0.3) continue;  // ambiguous
      add(difference, {ratio, here.phase_slope, fine.phase_slope, p}, variance, outlier_sigma, sums);
    }
  }

  // Derivative of a residual: that of `ratio` times one estimate minus another, at point `p`.
  struct SlopeDifference {
    double ratio;
    const std::array<PointArray, kMotionParameters>&of, &minus;
    size_t p;

    double operator[](size_t i) const { return ratio * of[i][p] - minus[i][p]; }
  };

  static void add(double residual, const SlopeDifference& slope, double variance, double outlier_sigma, RowSums& sums) {
    // Tukey's biweight.
    const double square = residual * residual / variance, limit = outlier_sigma * outlier_sigma;
    const double left = std::max(0.0, 1 - square / limit);
    ++sums.residuals;
    sums.squares += std::min(square, limit);
    sums.cost += limit / 6 * (1 - left * left * left);
    if (left <= 0) return;
    const double root = left / std::sqrt(variance);
    double* const row = sums.products.next_row();
    for (size_t i = 0; i < kMotionParameters; ++i) row[i] = root * slope[i];
    row[kMotionParameters] = root * residual;
  }

  const RigModel& rig_;
  const PixelRays& rays_;
  Axis axis_;
  PointFollower follower_;
  std::vector<Exposure> exposures_;
  std::vector<Period> periods_;
  size_t most_images_ = 0;
  std::vector<cv::Mat1f> images_, blurred_;
  std::vector<cv::Mat1b> saturated_;  // by image; empty: no pixel is
  cv::Mat1f depth_m_, smooth_m_;
  double blur_px_ = 0;
  bool at_rest_ = false;
};

StackResiduals::StackResiduals(const FringeStack& stack, const RigModel& rig, const PixelRays& rays, double clip_dn,
                               Axis axis, int steps)
    : impl_(std::make_unique<Impl>(stack, rig, rays, clip_dn, axis, steps)) {}
StackResiduals::~StackResiduals() = default;

size_t StackResiduals::periods() const { return impl_->periods(); }
void StackResiduals::blur(double sigma_px) { impl_->blur(sigma_px); }
void StackResiduals::set_depth(const cv::Mat1f& depth_m, bool with_normals) { impl_->set_depth(depth_m, with_normals); }

MotionSums StackResiduals::linearise(const CameraMotion& motion, int stride, double outlier_sigma) {
  return impl_->linearise(motion, stride, outlier_sigma);
}

std::vector<DepthSlope> StackResiduals::slopes(const cv::Mat1f& known_m, const CameraMotion& motion, double period_px,
                                               int stride) {
  return impl_->slopes(known_m, motion, period_px, stride);
}

}  // namespace fringeslam
