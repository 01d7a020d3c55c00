// SPDX-License-Identifier: Apache-2.0
#include "core/decode/rolling_phase.h"

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <opencv2/imgproc.hpp>
#include <string>
#include <vector>

#include "core/base/constants.h"
#include "core/base/parallel.h"
#include "core/types/error.h"

namespace fringeslam {

namespace {

constexpr size_t kMostRollingImages = 64;
constexpr double kMostDriftRad = 1.2, kMostDriftChangeRad = 0.3, kMostHarmonic = 0.3;
// The residual of a pixel, in units of its expected variance, above which its weight in the drift falls off: pixels that
// change from one surface to another do not follow the model.
constexpr double kOutlyingResidual = 9;
// Variance of a drift that no pixel determines, rad^2.
constexpr double kUnknownVariance = 1e3;

// The images that a result depends on, and the window among them.
struct RollingImages {
  std::vector<cv::Mat1f> images;
  std::vector<double> shift_rad, tau;  // tau: time from the reference, in mean image intervals
  size_t window = 0, steps = 0;        // first image of the window, number of its images
  double interval_s = 0;
  bool mean_drift = false, drift_change = false;  // whether A' and a are estimated
  int pixel_unknowns() const { return mean_drift ? 4 : 3; }
  int height() const { return images.front().rows; }
  int width() const { return images.front().cols; }
};

RollingImages rolling_images(const FringeStack& recording, size_t first, int steps, int neighbours,
                             RollingPhase& result) {
  check_stack(recording);
  const std::vector<Pattern>& patterns = recording.patterns.patterns;
  for (size_t i = 0; i < patterns.size(); ++i) {
    if (patterns[i].coding != Coding::fringe || patterns[i].axis != patterns[0].axis ||
        patterns[i].period_px != patterns[0].period_px)
      throw Error("rolling window: image " + std::to_string(i) +
                  " does not show fringes of the same period and axis as "
                  "image 0; decode stacks of several periods with decode()");
  }
  const auto count = static_cast<size_t>(std::max(steps, 0));
  if (steps < 3 || count > kMostRollingImages / 2)
    throw Error("rolling window: " + std::to_string(steps) + " steps; there must be 3 to " +
                std::to_string(kMostRollingImages / 2));
  if (first > patterns.size() || count > patterns.size() - first)
    throw Error("rolling window: images " + std::to_string(first) + " to " + std::to_string(first + count - 1) +
                " were requested, but the recording has " + std::to_string(patterns.size()) + " images");
  const auto beside = static_cast<size_t>(std::min(neighbours, static_cast<int>(kMostRollingImages / 4)));
  const size_t begin = first - std::min(first, beside), end = std::min(first + count + beside, patterns.size());
  if (end - begin < 4)
    throw Error("rolling window: three images do not determine the drift; use at least one neighbouring image");

  RollingImages out;
  out.window = first - begin;
  out.steps = count;
  double reference_s = 0;  // relative to the first image: absolute times may be large
  for (size_t k = first; k < first + count; ++k)
    reference_s += (recording.exposure_time_s[k] - recording.exposure_time_s[first]) / static_cast<double>(count);
  out.interval_s =
      (recording.exposure_time_s[end - 1] - recording.exposure_time_s[begin]) / static_cast<double>(end - begin - 1);
  for (size_t k = begin; k < end; ++k) {
    if (k > begin && !(recording.exposure_time_s[k] > recording.exposure_time_s[k - 1]))
      throw Error("rolling window: the exposure of image " + std::to_string(k) +
                  " is not later than that of the image before it");
    cv::Mat1f image;
    recording.images[k].convertTo(image, CV_32F);
    out.images.push_back(image);
    out.shift_rad.push_back(patterns[k].shift_rad);
    out.tau.push_back((recording.exposure_time_s[k] - recording.exposure_time_s[first] - reference_s) / out.interval_s);
  }
  out.mean_drift = end - begin >= 5;
  out.drift_change = end - begin >= 6;
  result.reference_time_s = recording.exposure_time_s[first] + reference_s;
  result.first_used = begin;
  result.used = end - begin;
  return out;
}

using StepWeights = Eigen::Matrix<double, 3, Eigen::Dynamic>;

// Weights of the least-squares estimates of (A, B cos phi, B sin phi) at rest from `steps` images starting at `begin`.
StepWeights resting_weights(const RollingImages& in, size_t begin) {
  const auto steps = static_cast<Eigen::Index>(in.steps);
  Eigen::MatrixX3d basis(steps, 3);
  for (Eigen::Index k = 0; k < steps; ++k) {
    const double shift = in.shift_rad[begin + static_cast<size_t>(k)];
    basis.row(k) << 1, std::cos(shift), -std::sin(shift);
  }
  const Eigen::Matrix3d normal = basis.transpose() * basis;
  if (!(normal.determinant() > 1e-3 * static_cast<double>(in.steps)))
    throw Error("rolling window: the phase shifts of " + std::to_string(in.steps) +
                " consecutive images do not determine the phase; the recording must repeat its shifts every " +
                std::to_string(in.steps) + " images");
  return normal.inverse() * basis.transpose();
}

// Unknowns that each iteration updates; all images are H x W. Phasors are B exp(i phi) at the reference time.
struct RollingState {
  cv::Mat1b usable;
  cv::Mat1d mean, cosine, sine, mean_drift;
  cv::Mat1d weight;                                    // 1 / variance of a grey value
  cv::Mat1d drift_rad, drift_change_rad;               // eps, a
  cv::Mat1d residual;                                  // weighted sum of squares
  Eigen::Vector2d harmonic = Eigen::Vector2d::Zero();  // h_c, h_s
};

void blur(cv::Mat1d& image, double sigma_px) { cv::GaussianBlur(image, image, {0, 0}, sigma_px, sigma_px); }

// Starts with the phases of the window at rest and with the mean phase difference of consecutive windows.
RollingState first_state(const RollingImages& in, const SensorModel& sensor, const RollingPhaseOptions& options) {
  const cv::Size size = in.images.front().size();
  RollingState state;
  state.usable = cv::Mat1b::zeros(size);
  for (cv::Mat1d* image : {&state.mean, &state.cosine, &state.sine, &state.mean_drift, &state.weight, &state.drift_rad,
                           &state.drift_change_rad, &state.residual})
    *image = cv::Mat1d::zeros(size);
  std::vector<StepWeights> weights;
  for (size_t begin = 0; begin + in.steps <= in.images.size(); ++begin) weights.push_back(resting_weights(in, begin));
  cv::Mat1d same(size, 0.0), turned(size, 0.0);
  for_each_row(size.height, [&](int row) {
    for (int col = 0; col < size.width; ++col) {
      float largest = 0;
      for (const cv::Mat1f& image : in.images) largest = std::max(largest, image(row, col));
      Eigen::Vector3d before = Eigen::Vector3d::Zero();
      double along = 0, across = 0;
      for (size_t begin = 0; begin < weights.size(); ++begin) {
        Eigen::Vector3d fit = Eigen::Vector3d::Zero();
        for (size_t k = 0; k < in.steps; ++k)
          fit += weights[begin].col(static_cast<Eigen::Index>(k)) * static_cast<double>(in.images[begin + k](row, col));
        if (begin > 0) {
          along += before[1] * fit[1] + before[2] * fit[2];
          across += before[1] * fit[2] - before[2] * fit[1];
        }
        if (begin == in.window) {
          state.mean(row, col) = fit[0];
          state.cosine(row, col) = fit[1];
          state.sine(row, col) = fit[2];
        }
        before = fit;
      }
      state.weight(row, col) = 1 / sensor.variance_dn2(state.mean(row, col));
      if (!(largest < options.saturation * sensor.saturation_dn()) ||
          !(std::hypot(state.cosine(row, col), state.sine(row, col)) >= options.min_modulation_dn))
        continue;
      state.usable(row, col) = 1;
      same(row, col) = along;
      turned(row, col) = across;
    }
  });
  blur(same, options.smoothing_px);
  blur(turned, options.smoothing_px);
  for (int row = 0; row < size.height; ++row) {
    for (int col = 0; col < size.width; ++col) {
      if (same(row, col) != 0 || turned(row, col) != 0)
        state.drift_rad(row, col) =
            std::clamp(std::atan2(turned(row, col), same(row, col)), -kMostDriftRad, kMostDriftRad);
    }
  }
  return state;
}

// The model of one pixel linearised at the current drift and at the phasor (c, s). `columns` are those of the pixel's own unknowns (A, B cos phi,
// B sin phi, A'), `shared` the derivatives with respect to (eps, a, h_c, h_s).
struct RollingPixel {
  size_t images = 0;
  std::array<Eigen::Vector4d, kMostRollingImages> columns;
  std::array<Eigen::Vector4d, kMostRollingImages> shared;
  std::array<double, kMostRollingImages> grey;  // less the harmonic

  RollingPixel(const RollingImages& in, const RollingState& state, int row, int col, double c, double s)
      : images(in.images.size()) {
    const double drift = state.drift_rad(row, col), change = state.drift_change_rad(row, col);
    const double modulation = std::hypot(c, s), phase = std::atan2(s, c);
    const auto multiple = static_cast<double>(in.steps - 1);
    for (size_t k = 0; k < images; ++k) {
      const double tau = in.tau[k];
      const double moved = in.shift_rad[k] + drift * tau + 0.5 * change * tau * tau;
      const double cosine = std::cos(moved), sine = -std::sin(moved);
      const double angle = multiple * (phase + moved);
      const Eigen::Vector2d waves(modulation * std::cos(angle), modulation * std::sin(angle));
      const double by_phase = sine * c - cosine * s;  // derivative of the fringe with respect to its phase
      columns[k] = {1, cosine, sine, in.mean_drift ? tau : 0};
      shared[k] = {tau * by_phase, in.drift_change ? 0.5 * tau * tau * by_phase : 0, waves[0], waves[1]};
      grey[k] = static_cast<double>(in.images[k](row, col)) - state.harmonic.dot(waves);
    }
  }
};

struct RollingNormal {
  Eigen::Matrix4d columns = Eigen::Matrix4d::Zero();
  Eigen::Matrix4d mixed = Eigen::Matrix4d::Zero();
  Eigen::Matrix4d shared = Eigen::Matrix4d::Zero();
  Eigen::Vector4d columns_grey = Eigen::Vector4d::Zero();
  Eigen::Vector4d shared_grey = Eigen::Vector4d::Zero();
  double grey = 0;

  RollingNormal(const RollingPixel& pixel, double mean) {
    for (size_t k = 0; k < pixel.images; ++k) {
      const double above = pixel.grey[k] - mean;
      columns += pixel.columns[k] * pixel.columns[k].transpose();
      mixed += pixel.columns[k] * pixel.shared[k].transpose();
      shared += pixel.shared[k] * pixel.shared[k].transpose();
      columns_grey += pixel.columns[k] * above;
      shared_grey += pixel.shared[k] * above;
      grey += above * above;
    }
    if (columns(3, 3) == 0) columns(3, 3) = 1;
  }
};

// Normal equations of (eps, a, h_c, h_s) after elimination of the pixels' own unknowns, averaged over blocks of
// pixels: one image per entry. Averages over many pixels are regular where a pixel's equations are not.
struct SharedNormal {
  std::array<cv::Mat1d, 10> matrix;  // upper triangle, row by row
  std::array<cv::Mat1d, 4> right;
  cv::Mat1d residual, freedom;

  template <class Body>
  void for_each_image(const Body& body) {
    for (cv::Mat1d& image : matrix) body(image);
    for (cv::Mat1d& image : right) body(image);
    body(residual);
    body(freedom);
  }
  Eigen::Matrix4d matrix_at(int row, int col) const {
    Eigen::Matrix4d out;
    size_t entry = 0;
    for (int i = 0; i < 4; ++i) {
      for (int j = i; j < 4; ++j) out(i, j) = out(j, i) = matrix[entry++](row, col);
    }
    return out;
  }
  Eigen::Vector4d right_at(int row, int col) const {
    return {right[0](row, col), right[1](row, col), right[2](row, col), right[3](row, col)};
  }
};

// Fits the pixels' own unknowns and eliminates them.
SharedNormal eliminate_pixels(const RollingImages& in, RollingState& state) {
  const cv::Size size = in.images.front().size();
  SharedNormal out;
  out.for_each_image([&](cv::Mat1d& image) { image = cv::Mat1d::zeros(size); });
  const double freedom = static_cast<double>(in.images.size()) - in.pixel_unknowns();
  for_each_row(size.height, [&](int row) {
    for (int col = 0; col < size.width; ++col) {
      if (!state.usable(row, col)) continue;
      const RollingNormal sums({in, state, row, col, state.cosine(row, col), state.sine(row, col)},
                               state.mean(row, col));
      const Eigen::LLT<Eigen::Matrix4d> factor(sums.columns);
      const Eigen::Vector4d fit = factor.solve(sums.columns_grey);
      const Eigen::Matrix4d slopes = factor.solve(sums.mixed);
      const double weight = state.weight(row, col);
      const double residual = std::max(0.0, sums.grey - fit.dot(sums.columns_grey)) * weight;
      const double trust = weight / (1 + (freedom > 0 ? residual / freedom / kOutlyingResidual : 0));
      const Eigen::Matrix4d matrix = trust * (sums.shared - sums.mixed.transpose() * slopes);
      Eigen::Vector4d right = trust * (sums.shared_grey - slopes.transpose() * sums.columns_grey);
      // Full values instead of steps, because the neighbours are linearised elsewhere.
      right += matrix * Eigen::Vector4d(state.drift_rad(row, col), state.drift_change_rad(row, col), state.harmonic[0],
                                        state.harmonic[1]);
      state.mean(row, col) += fit[0];
      state.cosine(row, col) = fit[1];
      state.sine(row, col) = fit[2];
      state.mean_drift(row, col) = fit[3];
      state.residual(row, col) = residual;
      size_t entry = 0;
      for (int i = 0; i < 4; ++i) {
        out.right[static_cast<size_t>(i)](row, col) = right[i];
        for (int j = i; j < 4; ++j) out.matrix[entry++](row, col) = matrix(i, j);
      }
      out.residual(row, col) = residual * trust / weight;
      out.freedom(row, col) = freedom * trust / weight;
    }
  });
  return out;
}

// The part of a matrix for (eps, a), regular also if a is not estimated. False if the drift is not determined.
bool drift_matrix(const Eigen::Matrix4d& matrix, bool drift_change, Eigen::Matrix2d& out) {
  out = matrix.topLeftCorner<2, 2>();
  if (!drift_change) out(1, 1) = 1;
  return out(0, 0) > 1e-9 && out.determinant() > 1e-6 * out(0, 0) * out(1, 1);
}

struct Harmonic {
  Eigen::Vector2d value = Eigen::Vector2d::Zero();
  Eigen::Matrix2d covariance = Eigen::Matrix2d::Zero();
};

// (h_c, h_s) with the drifts eliminated block by block. `block_px` is the number of pixels in a block.
Harmonic estimate_harmonic(const RollingImages& in, const SharedNormal& normal, double misfit, double block_px,
                           double prior) {
  if (prior == 0) return {};
  Eigen::Matrix2d information = Eigen::Matrix2d::Zero();
  Eigen::Vector2d right = Eigen::Vector2d::Zero();
  for (int row = 0; row < normal.freedom.rows; ++row) {
    for (int col = 0; col < normal.freedom.cols; ++col) {
      const Eigen::Matrix4d matrix = normal.matrix_at(row, col);
      Eigen::Matrix2d drift;
      if (!drift_matrix(matrix, in.drift_change, drift)) continue;
      const Eigen::Vector4d sums = normal.right_at(row, col);
      const Eigen::Matrix2d mixed = matrix.topRightCorner<2, 2>(), slopes = drift.inverse() * mixed;
      information += matrix.bottomRightCorner<2, 2>() - mixed.transpose() * slopes;
      right += sums.tail<2>() - slopes.transpose() * sums.head<2>();
    }
  }
  const double scale = block_px / misfit;
  Harmonic out;
  out.covariance = (scale * information + Eigen::Matrix2d::Identity() / (prior * prior)).inverse();
  out.value = out.covariance * (scale * right);
  if (const double size = out.value.norm(); size > kMostHarmonic) out.value *= kMostHarmonic / size;
  return out;
}

// Inputs of finish_row() in addition to the state.
struct RollingErrors {
  cv::Mat1d drift, mixed, change;  // covariance of (eps, a), H x W
  cv::Mat1d misfit;                // variance of the residuals relative to the camera's noise, at least 1, H x W
  Harmonic harmonic;
};

// Writes the phase of the window's own images, given drift, A' and h, and its sigma.
void finish_row(const RollingImages& in, const RollingState& state, const RollingErrors& errors,
                const SensorModel& sensor, const RollingPhaseOptions& options, int row, RollingPhase& out) {
  for (int col = 0; col < in.width(); ++col) {
    if (!state.usable(row, col)) continue;
    // The harmonic's phase follows from the phasor: the second pass takes that of the window instead of that of all
    // images.
    Eigen::Vector3d fit(state.mean(row, col), state.cosine(row, col), state.sine(row, col));
    Eigen::Matrix3d inverse;
    bool regular = true;
    for (int pass = 0; pass < 2 && regular; ++pass) {
      const RollingPixel pixel(in, state, row, col, fit[1], fit[2]);
      Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
      Eigen::Vector3d right = Eigen::Vector3d::Zero();
      for (size_t k = in.window; k < in.window + in.steps; ++k) {
        const Eigen::Vector3d columns = pixel.columns[k].head<3>();
        normal += columns * columns.transpose();
        right += columns * (pixel.grey[k] - state.mean_drift(row, col) * in.tau[k]);
      }
      regular = normal.determinant() > 1e-2 * static_cast<double>(in.steps);  // drift can make shifts equal
      inverse = normal.inverse();
      fit = inverse * right;
    }
    const double modulation = std::hypot(fit[1], fit[2]);
    if (!regular || !(modulation >= options.min_modulation_dn) || !(modulation >= options.min_data_modulation * fit[0]))
      continue;

    // d phi / d I_k, directly and through A'; what a change of the shared unknowns does to I_k, it undoes in phi.
    const RollingPixel pixel(in, state, row, col, fit[1], fit[2]);
    const Eigen::Vector3d by_fit = inverse * Eigen::Vector3d(0, -fit[2], fit[1]) / (modulation * modulation);
    std::array<double, kMostRollingImages> by_grey{};
    double by_mean_drift = 0;
    for (size_t k = in.window; k < in.window + in.steps; ++k) {
      by_grey[k] = by_fit.dot(pixel.columns[k].head<3>());
      by_mean_drift -= by_grey[k] * in.tau[k];
    }
    if (in.mean_drift) {
      const Eigen::Vector4d weights = RollingNormal(pixel, 0).columns.llt().solve(Eigen::Vector4d::UnitW());
      for (size_t k = 0; k < pixel.images; ++k) by_grey[k] += by_mean_drift * weights.dot(pixel.columns[k]);
    }
    double noise = 0;
    Eigen::Vector4d by_shared = Eigen::Vector4d::Zero();
    for (size_t k = 0; k < pixel.images; ++k) {
      noise += by_grey[k] * by_grey[k] * sensor.variance_dn2(static_cast<double>(in.images[k](row, col)));
      by_shared -= by_grey[k] * pixel.shared[k];
    }
    const double variance = errors.misfit(row, col) * noise + by_shared[0] * by_shared[0] * errors.drift(row, col) +
                            2 * by_shared[0] * by_shared[1] * errors.mixed(row, col) +
                            by_shared[1] * by_shared[1] * errors.change(row, col) +
                            by_shared.tail<2>().dot(errors.harmonic.covariance * by_shared.tail<2>());
    if (!(variance <= options.max_phase_sigma_rad * options.max_phase_sigma_rad)) continue;
    out.mean(row, col) = static_cast<float>(fit[0]);
    out.modulation(row, col) = static_cast<float>(modulation);
    out.wrapped_phase(row, col) = static_cast<float>(std::atan2(fit[2], fit[1]));
    out.sigma_rad(row, col) = static_cast<float>(std::sqrt(variance));
    out.drift_rad_s(row, col) = static_cast<float>(state.drift_rad(row, col) / in.interval_s);
    out.drift_sigma_rad_s(row, col) = static_cast<float>(std::sqrt(errors.drift(row, col)) / in.interval_s);
  }
}

}  // namespace

RollingPhase decode_rolling_window(const FringeStack& recording, size_t first, int steps, const SensorModel& sensor,
                                   const RollingPhaseOptions& options) {
  RollingPhase out;
  const RollingImages in = rolling_images(recording, first, steps, options.neighbours, out);
  const cv::Size size = in.images.front().size();
  RollingState state = first_state(in, sensor, options);
  RollingErrors errors;
  // The drift is smooth, so its equations are averaged over blocks before they are smoothed and solved.
  const int block = std::max(1, static_cast<int>(options.smoothing_px / 3));
  const cv::Size blocks((size.width + block - 1) / block, (size.height + block - 1) / block);
  const double block_px = static_cast<double>(size.area()) / blocks.area();
  const double smoothing = options.smoothing_px * std::sqrt(1 / block_px);
  // Effective number of pixels of the smoothing window.
  const double window_px = 4 * kPi * options.smoothing_px * options.smoothing_px + block_px;
  cv::Mat1d drift(blocks, 0.0), change(blocks, 0.0), variance(blocks, 0.0), mixed(blocks, 0.0),
      change_variance(blocks, 0.0);
  for (int iteration = 0; iteration < options.iterations; ++iteration) {
    SharedNormal normal = eliminate_pixels(in, state);
    normal.for_each_image([&](cv::Mat1d& image) {
      cv::Mat1d small;
      cv::resize(image, small, blocks, 0, 0, cv::INTER_AREA);
      blur(small, smoothing);
      image = small;
    });
    const double freedom = cv::sum(normal.freedom)[0];
    const double misfit = freedom > 0 ? std::max(1.0, cv::sum(normal.residual)[0] / freedom) : 1;
    errors.harmonic = estimate_harmonic(in, normal, misfit, block_px, options.harmonic_prior);
    state.harmonic = errors.harmonic.value;
    for (int row = 0; row < blocks.height; ++row) {
      for (int col = 0; col < blocks.width; ++col) {
        const Eigen::Matrix4d matrix = normal.matrix_at(row, col);
        Eigen::Matrix2d of_drift;
        if (!drift_matrix(matrix, in.drift_change, of_drift)) {
          variance(row, col) = kUnknownVariance;
          continue;
        }
        const Eigen::Matrix2d inverse = of_drift.inverse();
        const Eigen::Vector2d found =
            inverse * (normal.right_at(row, col).head<2>() - matrix.topRightCorner<2, 2>() * state.harmonic);
        drift(row, col) = std::clamp(found[0], -kMostDriftRad, kMostDriftRad);
        if (in.drift_change) change(row, col) = std::clamp(found[1], -kMostDriftChangeRad, kMostDriftChangeRad);
        const double local =
            normal.freedom(row, col) > 0 ? std::max(1.0, normal.residual(row, col) / normal.freedom(row, col)) : 1;
        variance(row, col) = inverse(0, 0) * local / window_px;
        mixed(row, col) = in.drift_change ? inverse(0, 1) * local / window_px : 0;
        change_variance(row, col) = in.drift_change ? inverse(1, 1) * local / window_px : 0;
      }
    }
    cv::resize(drift, state.drift_rad, size, 0, 0, cv::INTER_LINEAR);
    cv::resize(change, state.drift_change_rad, size, 0, 0, cv::INTER_LINEAR);
    if (iteration + 1 < options.iterations) continue;
    // Smoothing flattens a drift that bends within the window. Smoothing once more shows by how much: by as much inside a
    // surface, by sqrt(2) - 1 times as much at its border, where the windows are one-sided.
    cv::Mat1d again, weight = normal.matrix[0].clone();
    cv::multiply(weight, drift, again);
    blur(again, smoothing);
    blur(weight, smoothing);
    for (int row = 0; row < blocks.height; ++row) {
      for (int col = 0; col < blocks.width; ++col) {
        if (!(weight(row, col) > 0)) continue;
        const double bend = (again(row, col) / weight(row, col) - drift(row, col)) / (std::numbers::sqrt2 - 1);
        variance(row, col) += bend * bend;
      }
    }
  }
  cv::resize(variance, errors.drift, size, 0, 0, cv::INTER_LINEAR);
  cv::resize(mixed, errors.mixed, size, 0, 0, cv::INTER_LINEAR);
  cv::resize(change_variance, errors.change, size, 0, 0, cv::INTER_LINEAR);
  errors.misfit = cv::Mat1d(size, 1.0);
  // A pixel's own residuals, with those of its neighbours, for what the model does not describe: moving texture, edges.
  if (static_cast<int>(in.images.size()) > in.pixel_unknowns()) {
    const double freedom = static_cast<double>(in.images.size()) - in.pixel_unknowns();
    cv::Mat1d residual = state.residual.clone(), known;
    state.usable.convertTo(known, CV_64F, freedom);
    cv::boxFilter(residual, residual, -1, {3, 3});
    cv::boxFilter(known, known, -1, {3, 3});
    for (int row = 0; row < size.height; ++row) {
      for (int col = 0; col < size.width; ++col)
        errors.misfit(row, col) = known(row, col) > 0 ? std::max(1.0, residual(row, col) / known(row, col)) : 1;
    }
  }
  for (int i = 0; i < 2; ++i) {
    out.harmonic[i] = errors.harmonic.value[i];
    out.harmonic_sigma[i] = std::sqrt(errors.harmonic.covariance(i, i));
  }
  for (cv::Mat1f* image :
       {&out.mean, &out.modulation, &out.wrapped_phase, &out.sigma_rad, &out.drift_rad_s, &out.drift_sigma_rad_s})
    *image = cv::Mat1f(size, kNaN);
  for_each_row(size.height, [&](int row) { finish_row(in, state, errors, sensor, options, row, out); });
  return out;
}

}  // namespace fringeslam
