// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/continuous_path.h"

#include <algorithm>
#include <cmath>

#include "core/base/constants.h"
#include "core/types/error.h"
#include "core/types/linear_algebra.h"
#include "core/types/options.h"
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

namespace {

// A route by its generalized length: a rotation counts as the distance that the robot covers at its speed meanwhile.
struct MeasuredRoute {
  std::vector<double> length_m;   // from the start to each pose
  std::vector<double> speed_m_s;  // highest speed at each pose
};

// The speed along the route is limited by `travel.speed_m_s`, and so that the accelerations along and across the curve
// add up to `travel.acceleration_m_s2` at most, everywhere and in both directions.
MeasuredRoute measured(const std::vector<Pose>& route, const Travel& travel) {
  const double m_per_rad = travel.speed_m_s / travel.max_rad_s;
  MeasuredRoute result;
  result.length_m = {0};
  std::vector<Vector6d> directions;
  for (size_t i = 1; i < route.size(); ++i) {
    Vector6d step;
    step << m_per_rad * rotation_log(route[i].rotation * route[i - 1].rotation.transpose()),
        route[i].translation - route[i - 1].translation;
    // A segment takes as long as the slower of its translation and its rotation.
    const double length_m = std::max(step.head<3>().norm(), step.tail<3>().norm());
    result.length_m.push_back(result.length_m.back() + length_m);
    directions.push_back(length_m > 0         ? Vector6d(step / length_m)
                         : directions.empty() ? Vector6d(Vector6d::Zero())
                                              : directions.back());
  }
  if (!(result.length_m.back() > 0)) throw Error("a route to travel needs at least two different poses");

  // The larger of the accelerations of translation and rotation counts.
  const auto larger = [](const Vector6d& v) { return std::max(v.head<3>().norm(), v.tail<3>().norm()); };
  std::vector<double> curvature_per_m(route.size(), 0);
  for (size_t i = 1; i + 1 < route.size(); ++i) {
    const double span_m = 0.5 * (result.length_m[i + 1] - result.length_m[i - 1]);
    if (span_m > 0) curvature_per_m[i] = larger(directions[i] - directions[i - 1]) / span_m;
  }
  const double most = travel.acceleration_m_s2;
  for (const double curvature : curvature_per_m)
    result.speed_m_s.push_back(std::min(travel.speed_m_s, std::sqrt(most / std::max(curvature, 1e-12))));
  const auto limit = [&](size_t from, size_t to) {
    const double square = result.speed_m_s[from] * result.speed_m_s[from];
    const double across = curvature_per_m[from] * square;
    // Translation and rotation share one speed, so the accelerations need not be perpendicular.
    const double along = std::max(0.0, most - across);
    const double step_m = std::abs(result.length_m[to] - result.length_m[from]);
    result.speed_m_s[to] = std::min(result.speed_m_s[to], std::sqrt(square + 2 * along * step_m));
  };
  for (size_t i = 1; i < route.size(); ++i) limit(i - 1, i);
  for (size_t i = route.size() - 1; i > 0; --i) limit(i, i - 1);
  return result;
}

constexpr long kMostPoses = 1'000'000;  // 14 hours in steps of 0.05 s

Error too_long(double step_s) {
  return Error("the motion takes longer than " + to_text(static_cast<double>(kMostPoses) * step_s) +
               " s; check its speed, its stops, and the unit of timestamps, which is seconds");
}

}  // namespace

std::vector<Pose> travelled(const std::vector<Pose>& route, const Travel& travel, double step_s) {
  if (route.size() < 2) throw Error("a route to travel needs at least two different poses");
  const MeasuredRoute measures = measured(route, travel);
  const std::vector<double>& length_m = measures.length_m;
  const bool stops = travel.stop_s > 0;
  constexpr int kSubSteps = 16;
  const double dt = step_s / kSubSteps;
  double speed = travel.from_rest || stops ? 0 : measures.speed_m_s.front(), at_m = 0;
  std::vector<Pose> poses;
  size_t segment = 1;
  const double end_m = length_m.back();
  for (long tick = 0;; ++tick) {
    while (length_m[segment] < std::min(at_m, end_m)) ++segment;
    const double size = length_m[segment] - length_m[segment - 1];
    const double part = size > 0 ? (at_m - length_m[segment - 1]) / size : 0;
    // The last pose lies beyond the end of the route, where the robot goes straight on.
    if (tick % kSubSteps == 0) {
      poses.push_back(interpolate(route[segment - 1], route[segment], part));
      if (at_m >= end_m) return poses;
    }
    if (tick > kSubSteps * kMostPoses) throw too_long(step_s);
    // Standing comes first: the robot waits, moves, and waits again.
    const double cycle_s = std::fmod(static_cast<double>(tick) * dt, travel.stop_s + travel.move_s);
    const double limit = std::lerp(measures.speed_m_s[segment - 1], measures.speed_m_s[segment], std::min(part, 1.0));
    const double wanted = stops && cycle_s < travel.stop_s ? 0 : limit;
    speed += std::clamp(wanted - speed, -travel.acceleration_m_s2 * dt, travel.acceleration_m_s2 * dt);
    at_m += speed * dt;
  }
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
  if (!((end_s - start_s) / step_s <= kMostPoses)) throw too_long(step_s);
  std::vector<Pose> poses;
  long segment = 0;
  const auto count = static_cast<long>(std::ceil((end_s - start_s) / step_s - 1e-9));
  for (long i = 0; i <= count; ++i) {
    const double time_s = start_s + static_cast<double>(i) * step_s;
    if (time_s > end_s) {
      // Beyond the last timed pose, the robot goes on at the velocity that it has there.
      const TimedPose &inner = timed[timed.size() - 2], &last = timed.back();
      const double part = (time_s - inner.timestamp_s) / (end_s - inner.timestamp_s);
      poses.push_back(interpolate(inner.world_from_robot, last.world_from_robot, part));
      continue;
    }
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
