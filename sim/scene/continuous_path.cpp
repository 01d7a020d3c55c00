// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/continuous_path.h"

#include <algorithm>
#include <cmath>

#include "core/base/constants.h"
#include "core/types/error.h"
#include "sim/random.h"
#include "sim/scene/routes.h"

namespace fringeslam::sim {

ContinuousPath::ContinuousPath(std::vector<Pose> controls, double knot_s, const Vibration& vibration, uint64_t seed)
    : controls_(std::move(controls)), knot_s_(knot_s) {
  if (controls_.size() < 2) throw Error("a continuous path needs at least two control poses");
  if (vibration.amplitude_m == 0 && vibration.amplitude_rad == 0) return;
  constexpr uint32_t kHarmonics = 8;
  const Philox random(seed, Stream::vibration, 0);
  // A harmonic of random direction and amplitude a has a mean square of a^2 / 2.
  const double share = std::sqrt(2.0 / kHarmonics);
  for (uint32_t i = 0; i < kHarmonics; ++i) {
    const auto unit = [&](uint32_t address) -> Eigen::Vector3d {
      const auto [x, y] = random.normal_pair(address);
      const auto [z, unused] = random.normal_pair(address + 1);
      return Eigen::Vector3d(x, y, z).normalized();
    };
    const std::array<double, 4> drawn = random.uniforms(8 * i);
    Harmonic harmonic;
    const double band = (i + drawn[0]) / kHarmonics;
    harmonic.rad_s = kTwoPi * (vibration.low_hz + band * (vibration.high_hz - vibration.low_hz));
    harmonic.phase_rad = kTwoPi * drawn[1];
    harmonic.shift_m = share * vibration.amplitude_m * unit(8 * i + 1);
    harmonic.turn_rad = share * vibration.amplitude_rad * unit(8 * i + 3);
    harmonics_.push_back(harmonic);
  }
}

double ContinuousPath::duration_s() const { return knot_s_ * static_cast<double>(controls_.size() - 1); }

Pose ContinuousPath::control(long index) const {
  const long last = static_cast<long>(controls_.size()) - 1;
  if (index < 0) {
    return interpolate(controls_[0], controls_[1], static_cast<double>(index));
  }
  if (index > last) {
    const auto end = static_cast<size_t>(last);
    return interpolate(controls_[end - 1], controls_[end], static_cast<double>(index - last + 1));
  }
  return controls_[static_cast<size_t>(index)];
}

Pose ContinuousPath::at(double time_s) const {
  const double knots = time_s / knot_s_;
  const double whole = std::floor(knots), u = knots - whole;
  const auto first = static_cast<long>(whole) - 1;
  // Cumulative basis functions of the uniform cubic B-spline.
  const double b1 = (5 + 3 * u - 3 * u * u + u * u * u) / 6;
  const double b2 = (1 + 3 * u + 3 * u * u - 2 * u * u * u) / 6;
  const double b3 = u * u * u / 6;
  const Pose p[4] = {control(first), control(first + 1), control(first + 2), control(first + 3)};
  Pose pose = p[0];
  const double weights[3] = {b1, b2, b3};
  for (int i = 0; i < 3; ++i) {
    pose.translation += weights[i] * (p[i + 1].translation - p[i].translation);
    pose.rotation *= rotation_exp(weights[i] * rotation_log(p[i].rotation.transpose() * p[i + 1].rotation));
  }
  Eigen::Vector3d shift = Eigen::Vector3d::Zero(), turn = Eigen::Vector3d::Zero();
  for (const Harmonic& harmonic : harmonics_) {
    const double wave = std::sin(harmonic.rad_s * time_s + harmonic.phase_rad);
    shift += wave * harmonic.shift_m;
    turn += wave * harmonic.turn_rad;
  }
  return orthonormalised(pose * Pose{rotation_exp(turn), shift});
}

std::vector<Pose> travelled(const std::vector<Pose>& route, const Travel& travel, double step_s) {
  if (route.size() < 2) throw Error("a route to travel needs at least two different poses");
  // Generalised length: a segment takes as long as the slower of its translation and its rotation.
  std::vector<double> length_m = {0};
  for (size_t i = 1; i < route.size(); ++i) {
    const Pose step = route[i - 1].inverse() * route[i];
    length_m.push_back(length_m.back() +
                       std::max(translation_m(step), rotation_rad(step) * travel.speed_m_s / travel.max_rad_s));
  }
  if (!(length_m.back() > 0)) throw Error("a route to travel needs at least two different poses");
  const bool stops = travel.stop_s > 0;
  constexpr int kSubSteps = 16;
  const double dt = step_s / kSubSteps;
  double speed = travel.from_rest || stops ? 0 : travel.speed_m_s, at_m = 0;
  std::vector<Pose> poses;
  size_t segment = 1;
  for (long tick = 0; at_m < length_m.back(); ++tick) {
    if (tick % kSubSteps == 0) {
      while (segment + 1 < route.size() && length_m[segment] < at_m) ++segment;
      const double size = length_m[segment] - length_m[segment - 1];
      poses.push_back(
          interpolate(route[segment - 1], route[segment], size > 0 ? (at_m - length_m[segment - 1]) / size : 0));
    }
    // Standing comes first: the robot waits, moves, and waits again.
    const double cycle_s = std::fmod(static_cast<double>(tick) * dt, travel.stop_s + travel.move_s);
    const double wanted = stops && cycle_s < travel.stop_s ? 0 : travel.speed_m_s;
    speed += std::clamp(wanted - speed, -travel.acceleration_m_s2 * dt, travel.acceleration_m_s2 * dt);
    at_m += speed * dt;
  }
  poses.push_back(route.back());
  return poses;
}

std::vector<Pose> resampled(const Trajectory& timed, double step_s) {
  if (timed.size() < 2) throw Error("a trajectory to follow needs at least two poses");
  const double start_s = timed.front().timestamp_s, end_s = timed.back().timestamp_s;
  const auto at = [&](long i) {
    const long last = static_cast<long>(timed.size()) - 1;
    if (i >= 0 && i <= last) return timed[static_cast<size_t>(i)];
    const TimedPose &end = i < 0 ? timed.front() : timed.back(),
                    &inner = i < 0 ? timed[1] : timed[static_cast<size_t>(last - 1)];
    return TimedPose{2 * end.timestamp_s - inner.timestamp_s,
                     interpolate(inner.world_from_robot, end.world_from_robot, 2)};
  };
  std::vector<Pose> poses;
  long segment = 0;
  const auto count = static_cast<long>(std::ceil((end_s - start_s) / step_s - 1e-9));
  for (long i = 0; i <= count; ++i) {
    const double time_s = std::min(end_s, start_s + static_cast<double>(i) * step_s);
    while (segment + 2 < static_cast<long>(timed.size()) && at(segment + 1).timestamp_s < time_s) ++segment;
    Pose p[4];
    double knot[4];
    for (int k = 0; k < 4; ++k) {
      p[k] = at(segment - 1 + k).world_from_robot;
      knot[k] = at(segment - 1 + k).timestamp_s;
    }
    poses.push_back(catmull_rom(p, knot, time_s));
  }
  return poses;
}

}  // namespace fringeslam::sim
