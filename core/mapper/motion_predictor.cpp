// SPDX-License-Identifier: Apache-2.0
#include "core/mapper/motion_predictor.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "core/types/linear_algebra.h"

namespace fringeslam {

namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

// Spectral densities of the jerk, (m/s^3)^2 s or (rad/s^3)^2 s: from a sensor on a rail to a robot that is pushed.
constexpr std::array kJerks = {1e-3, 1e-2, 1e-1, 1e0, 1e1, 1e2, 1e3, 1e4};

// One component of the pose as measured at a time, for three axes at once: rotation or translation.
struct Measurement {
  double time_s = 0, variance = 0;
  Vector3d value;
  bool has_rate = false;
  double rate_variance = 0;
  Vector3d rate;
};

// Value, rate and acceleration of three axes with a common covariance.
struct State {
  Matrix3d mean = Matrix3d::Zero();  // a row each
  Matrix3d covariance = Matrix3d::Zero();
};

void advance(State& state, double dt, double jerk) {
  Matrix3d f;
  f << 1, dt, dt * dt / 2, 0, 1, dt, 0, 0, 1;
  const double d2 = dt * dt, d3 = d2 * dt, d4 = d3 * dt, d5 = d4 * dt;
  Matrix3d noise;
  noise << d5 / 20, d4 / 8, d3 / 6, d4 / 8, d3 / 3, d2 / 2, d3 / 6, d2 / 2, dt;
  state.mean = f * state.mean;
  state.covariance = f * state.covariance * f.transpose() + jerk * noise;
}

// Updates the state by a measurement of its row `row`; returns the log-likelihood of the measurement.
double update(State& state, int row, const Vector3d& value, double variance) {
  const double total = state.covariance(row, row) + variance;
  const Vector3d innovation = value - state.mean.row(row).transpose(), gain = state.covariance.col(row) / total;
  state.mean += gain * innovation.transpose();
  state.covariance -= gain * state.covariance.row(row).eval();
  return -0.5 * (3 * std::log(total) + innovation.squaredNorm() / total);
}

// Initial standard deviations of rate and acceleration.
struct Start {
  double rate_sigma = 0, acceleration_sigma = 0;
};

// How a component of the pose changes: smoothly, with white-noise jerk, and by displacements of single views that are
// independent of each other.
struct Model {
  double jerk = 0, jitter = 0, jitter_rate = 0;
  double memory = 1;  // factor of earlier log-likelihoods at each measurement
};

struct Filtered {
  State state;
  double time_s = 0;
  double log_likelihood = 0;
};

// The state at the last measurement.
Filtered filtered(const std::vector<Measurement>& measured, const Model& model, const Start& start) {
  const double jitter = model.jitter * model.jitter, jitter_rate = model.jitter_rate * model.jitter_rate;
  Filtered result{{}, measured.front().time_s, 0};
  State& state = result.state;
  state.mean.row(0) = measured.front().value.transpose();
  state.covariance.diagonal() << measured.front().variance + jitter, start.rate_sigma * start.rate_sigma,
      start.acceleration_sigma * start.acceleration_sigma;
  for (size_t k = 0; k < measured.size(); ++k) {
    const Measurement& m = measured[k];
    advance(state, m.time_s - result.time_s, model.jerk);
    result.time_s = m.time_s;
    result.log_likelihood *= model.memory;
    if (k > 0) result.log_likelihood += update(state, 0, m.value, m.variance + jitter);
    if (m.has_rate) result.log_likelihood += update(state, 1, m.rate, m.rate_variance + jitter_rate);
  }
  return result;
}

// Prior of the jerk's intensities.
double log_prior_of_jerk(double jerk) { return -0.5 * std::log(jerk); }

// Turns log-likelihoods into weights with a sum of 1.
template <class Weights>
void normalise(Weights& weights) {
  const double best = *std::max_element(weights.begin(), weights.end());
  double sum = 0;
  for (double& weight : weights) sum += weight = std::exp(weight - best);
  for (double& weight : weights) weight /= sum;
}

// Mixture of all intensities of the jerk at `time_s`, by its first two moments.
State predicted(const std::vector<Measurement>& measured, double time_s, const Start& start) {
  std::array<State, kJerks.size()> states;
  std::array<double, kJerks.size()> weights;
  for (size_t i = 0; i < kJerks.size(); ++i) {
    Filtered last = filtered(measured, {kJerks[i]}, start);
    advance(last.state, time_s - last.time_s, kJerks[i]);
    states[i] = last.state;
    weights[i] = last.log_likelihood + log_prior_of_jerk(kJerks[i]);
  }
  normalise(weights);
  State mixture;
  for (size_t i = 0; i < kJerks.size(); ++i) mixture.mean += weights[i] * states[i].mean;
  for (size_t i = 0; i < kJerks.size(); ++i) {
    const Matrix3d off = states[i].mean - mixture.mean;
    mixture.covariance += weights[i] * (states[i].covariance + off * off.transpose() / 3);
  }
  return mixture;
}

// Root mean square and 5 % quantile of the jitter's posterior. Before, no jitter is as likely as any, and all orders of
// magnitude of the jitter are equally likely.
std::pair<double, double> jitter_of(const std::vector<Measurement>& measured, const Start& start,
                                    double rate_per_jitter) {
  constexpr std::array kJitters = {0.0, 1e-5, 2e-5, 4e-5, 8e-5, 1.6e-4, 3.2e-4, 5.6e-4, 1e-3};  // m or rad
  constexpr double kUnlikely = 0.05;
  // Share of an image's displacement that remains in the mean of three: 0.58 if they are independent, 0.54 for vibration
  // of a fifth of the image rate.
  constexpr double kMeanOfThree = 0.55;
  constexpr double kMemory = 0.95;  // vibration begins and ends
  std::array<double, kJitters.size() * kJerks.size()> weights;
  size_t n = 0;
  for (const double jitter : kJitters) {
    const double log_prior = jitter == 0 ? std::log(kJitters.size() - 1.0) : 0;
    for (const double jerk : kJerks)
      weights[n++] =
          filtered(measured, {jerk, kMeanOfThree * jitter, rate_per_jitter * jitter, kMemory}, start).log_likelihood +
          log_prior_of_jerk(jerk) + log_prior;
  }
  normalise(weights);
  double square = 0, below = 0, least = 0;
  n = 0;
  for (const double jitter : kJitters) {
    double weight = 0;
    for (size_t i = 0; i < kJerks.size(); ++i) weight += weights[n++];
    square += weight * jitter * jitter;
    if (below < kUnlikely) least = jitter;
    below += weight;
  }
  return {std::sqrt(square), least};
}

// Rotations and translations of the last `most` samples relative to the last one.
struct Measurements {
  std::vector<Measurement> turns, shifts;
};

Measurements measurements_of(const std::vector<PoseSample>& samples, size_t most) {
  Measurements all;
  const Pose last_from_world = samples.back().world_from_camera.inverse();
  for (size_t i = samples.size() - std::min(most, samples.size()); i < samples.size(); ++i) {
    const PoseSample& sample = samples[i];
    const Pose last_from_this = last_from_world * sample.world_from_camera;
    Measurement turn{
        sample.timestamp_s, sample.variance.turn_rad2, rotation_log(last_from_this.rotation), false, 0, {}};
    Measurement shift{sample.timestamp_s, sample.variance.shift_m2, last_from_this.translation, false, 0, {}};
    if (sample.motion) {
      const auto variances = sample.motion->covariance.diagonal();
      turn.has_rate = shift.has_rate = true;
      turn.rate_variance = variances.segment<3>(0).mean();
      shift.rate_variance = variances.segment<3>(3).mean();
      turn.rate = last_from_this.rotation * sample.motion->motion.angular_rad_s;
      shift.rate = last_from_this.rotation * sample.motion->motion.velocity_m_s;
    }
    all.turns.push_back(turn);
    all.shifts.push_back(shift);
  }
  return all;
}

Start start_of_turns(const MotionLimits& limits) { return {limits.max_turn_rad_s, limits.turn_rad_s2}; }
Start start_of_shifts(const MotionLimits& limits) { return {limits.max_speed_m_s, limits.acceleration_m_s2}; }

}  // namespace

PoseVariance pose_variance(const Matrix6d& covariance) {
  return {covariance.topLeftCorner<3, 3>().trace() / 3, covariance.bottomRightCorner<3, 3>().trace() / 3};
}

std::optional<MotionPrediction> predict_motion(const std::vector<PoseSample>& samples, double timestamp_s,
                                               const MotionLimits& limits) {
  constexpr double kOldest_s = 0.5;
  if (samples.empty() || (samples.size() == 1 && !samples.back().motion)) return std::nullopt;
  const PoseSample& last = samples.back();
  if (!(timestamp_s >= last.timestamp_s && timestamp_s - last.timestamp_s <= kOldest_s)) return std::nullopt;
  constexpr size_t kMost = 8;
  const Measurements measured = measurements_of(samples, kMost);
  const State turn = predicted(measured.turns, timestamp_s, start_of_turns(limits));
  const State shift = predicted(measured.shifts, timestamp_s, start_of_shifts(limits));
  MotionPrediction result;
  const Pose last_from_predicted{rotation_exp(turn.mean.row(0).transpose()), shift.mean.row(0).transpose()};
  // Extrapolation would double the rounding error of the rotations each time.
  result.world_from_camera = orthonormalised(last.world_from_camera * last_from_predicted);
  result.turn_rad = std::sqrt(turn.covariance(0, 0));
  result.shift_m = std::sqrt(shift.covariance(0, 0));
  const Matrix3d predicted_from_last = last_from_predicted.rotation.transpose();
  result.motion.motion.angular_rad_s = predicted_from_last * turn.mean.row(1).transpose();
  result.motion.motion.angular_rad_s2 = predicted_from_last * turn.mean.row(2).transpose();
  result.motion.motion.velocity_m_s = predicted_from_last * shift.mean.row(1).transpose();
  result.motion.motion.acceleration_m_s2 = predicted_from_last * shift.mean.row(2).transpose();
  result.motion.covariance.setZero();
  const auto set = [&](int of_rate, int of_acceleration, const State& state) {
    for (int axis = 0; axis < 3; ++axis) {
      const int r = of_rate + axis, a = of_acceleration + axis;
      result.motion.covariance(r, r) = state.covariance(1, 1);
      result.motion.covariance(a, a) = state.covariance(2, 2);
      result.motion.covariance(r, a) = result.motion.covariance(a, r) = state.covariance(1, 2);
    }
  };
  set(0, 6, turn);
  set(3, 9, shift);
  return result;
}

std::optional<MotionPrediction> predict_backwards(std::vector<PoseSample> samples, double timestamp_s,
                                                  const MotionLimits& limits) {
  std::reverse(samples.begin(), samples.end());
  // Reverses a motion: the derivatives of odd order change their signs.
  const auto reverse = [](CameraMotion& motion, Matrix12d& covariance) {
    motion.angular_rad_s *= -1;
    motion.velocity_m_s *= -1;
    motion.angular_rad_s3 *= -1;
    motion.jerk_m_s3 *= -1;
    covariance.topRightCorner<6, 6>() *= -1;
    covariance.bottomLeftCorner<6, 6>() *= -1;
  };
  for (PoseSample& sample : samples) {
    sample.timestamp_s *= -1;
    if (sample.motion) reverse(sample.motion->motion, sample.motion->covariance);
  }
  std::optional<MotionPrediction> predicted = predict_motion(samples, -timestamp_s, limits);
  if (predicted) reverse(predicted->motion.motion, predicted->motion.covariance);
  return predicted;
}

MotionPrior fused(const MotionPrior& one, const MotionPrior& other) {
  const Matrix12d information = inverse_positive_definite(Eigen::MatrixXd(one.covariance)),
                  added = inverse_positive_definite(Eigen::MatrixXd(other.covariance));
  MotionPrior both = one;
  both.covariance = inverse_positive_definite(Eigen::MatrixXd(information + added));
  const Vector12d change = both.covariance * (added * (to_vector(other.motion) - to_vector(one.motion)));
  both.motion = changed(one.motion, change);
  return both;
}

double velocity_of_jitter(double camera_rate_hz) {
  // Independent displacements of consecutive images cause 0.71 of them per interval, vibration of a fifth of the image
  // rate 1.26.
  return 1.25 * camera_rate_hz;
}

VibrationEstimate estimate_vibration(const std::vector<PoseSample>& samples, const MotionLimits& limits,
                                     double camera_rate_hz) {
  if (samples.empty()) return {};
  const Measurements measured = measurements_of(samples, samples.size());
  // Share of that velocity which remains in a motion fitted to nine images: 0.1 at constant velocity, 0.3 at the end of a
  // constant acceleration.
  constexpr double kFitted = 0.2;
  const double rate = kFitted * velocity_of_jitter(camera_rate_hz);
  const auto [turn, least_turn] = jitter_of(measured.turns, start_of_turns(limits), rate);
  const auto [shift, least_shift] = jitter_of(measured.shifts, start_of_shifts(limits), rate);
  return {{turn, shift}, {least_turn, least_shift}};
}

}  // namespace fringeslam
