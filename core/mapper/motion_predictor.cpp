// SPDX-License-Identifier: Apache-2.0
#include "core/mapper/motion_predictor.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>

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

// Mixture of all intensities of the jerk at `time_s`, by its first two moments.
State predicted(const std::vector<Measurement>& measured, double time_s, double rate_sigma, double acceleration_sigma) {
  std::array<State, kJerks.size()> states;
  std::array<double, kJerks.size()> weights;
  for (size_t i = 0; i < kJerks.size(); ++i) {
    State& state = states[i];
    state.mean.row(0) = measured.front().value.transpose();
    state.covariance.diagonal() << measured.front().variance, rate_sigma * rate_sigma,
        acceleration_sigma * acceleration_sigma;
    double likelihood = -0.5 * std::log(kJerks[i]), now = measured.front().time_s;
    for (size_t k = 0; k < measured.size(); ++k) {
      const Measurement& m = measured[k];
      advance(state, m.time_s - now, kJerks[i]);
      now = m.time_s;
      if (k > 0) likelihood += update(state, 0, m.value, m.variance);
      if (m.has_rate) likelihood += update(state, 1, m.rate, m.rate_variance);
    }
    advance(state, time_s - now, kJerks[i]);
    weights[i] = likelihood;
  }
  const double best = *std::max_element(weights.begin(), weights.end());
  double sum = 0;
  for (double& weight : weights) sum += weight = std::exp(weight - best);
  State mixture;
  for (size_t i = 0; i < kJerks.size(); ++i) mixture.mean += weights[i] / sum * states[i].mean;
  for (size_t i = 0; i < kJerks.size(); ++i) {
    const Matrix3d off = states[i].mean - mixture.mean;
    mixture.covariance += weights[i] / sum * (states[i].covariance + off * off.transpose() / 3);
  }
  return mixture;
}

}  // namespace

std::optional<MotionPrediction> predict_motion(const std::vector<PoseSample>& samples, double timestamp_s,
                                               const MotionLimits& limits) {
  constexpr size_t kMost = 8;
  constexpr double kOldest_s = 0.5;
  if (samples.empty() || (samples.size() == 1 && !samples.back().motion)) return std::nullopt;
  const PoseSample& last = samples.back();
  if (!(timestamp_s >= last.timestamp_s && timestamp_s - last.timestamp_s <= kOldest_s)) return std::nullopt;
  std::vector<Measurement> turns, shifts;
  for (size_t i = samples.size() - std::min(kMost, samples.size()); i < samples.size(); ++i) {
    const PoseSample& sample = samples[i];
    const Pose last_from_this = last.world_from_camera.inverse() * sample.world_from_camera;
    Measurement turn{sample.timestamp_s, sample.turn_rad2, rotation_log(last_from_this.rotation), false, 0, {}};
    Measurement shift{sample.timestamp_s, sample.shift_m2, last_from_this.translation, false, 0, {}};
    if (sample.motion) {
      const auto variances = sample.motion->covariance.diagonal();
      turn.has_rate = shift.has_rate = true;
      turn.rate_variance = variances.segment<3>(0).mean();
      shift.rate_variance = variances.segment<3>(3).mean();
      turn.rate = last_from_this.rotation * sample.motion->motion.angular_rad_s;
      shift.rate = last_from_this.rotation * sample.motion->motion.velocity_m_s;
    }
    turns.push_back(turn);
    shifts.push_back(shift);
  }
  const State turn = predicted(turns, timestamp_s, limits.max_turn_rad_s, limits.turn_rad_s2);
  const State shift = predicted(shifts, timestamp_s, limits.max_speed_m_s, limits.acceleration_m_s2);
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

}  // namespace fringeslam
