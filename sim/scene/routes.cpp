// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/routes.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "core/types/error.h"
#include "sim/random.h"

namespace fringeslam::sim {

Pose looking_at(const Eigen::Vector3d& eye, const Eigen::Vector3d& target, const Eigen::Vector3d& up) {
  if ((target - eye).norm() < 1e-9) throw Error("the camera position coincides with its target");
  const Eigen::Vector3d forward = (target - eye).normalized();
  Eigen::Vector3d right = forward.cross(up);
  if (right.norm() < 1e-6) right = forward.cross(Eigen::Vector3d::UnitX());
  right.normalize();
  Pose pose{Eigen::Matrix3d::Identity(), eye};
  pose.rotation << right, forward.cross(right), forward;
  return pose;
}

Pose interpolate(const Pose& a, const Pose& b, double share) {
  const Eigen::Vector3d turn = rotation_log(a.rotation.transpose() * b.rotation);
  return {a.rotation * rotation_exp(share * turn), a.translation + share * (b.translation - a.translation)};
}

Pose catmull_rom(const Pose p[4], const double knot[4], double t) {
  const auto between = [&](const Pose& a, const Pose& b, int i, int j) {
    return interpolate(a, b, (t - knot[i]) / (knot[j] - knot[i]));
  };
  const Pose a1 = between(p[0], p[1], 0, 1), a2 = between(p[1], p[2], 1, 2), a3 = between(p[2], p[3], 2, 3);
  const Pose b1 = between(a1, a2, 0, 2), b2 = between(a2, a3, 1, 3);
  return between(b1, b2, 1, 2);
}

namespace {

double length(const Pose& a, const Pose& b, double turn_m_per_rad) {
  const Pose step = a.inverse() * b;
  return translation_m(step) + turn_m_per_rad * rotation_rad(step);
}

// Samples the whole curve densely.
std::vector<Pose> dense_curve(const std::vector<Pose>& waypoints, bool closed, double turn_m_per_rad) {
  constexpr int kPerSegment = 64;
  const int n = static_cast<int>(waypoints.size());
  const auto at = [&](int i) -> Pose {
    if (closed) return waypoints[static_cast<size_t>((i % n + n) % n)];
    const auto w = [&](int k) { return waypoints[static_cast<size_t>(k)]; };
    // Open curves are extrapolated beyond their first and last waypoints.
    if (i < 0) return interpolate(w(0), w(1), -1);
    if (i >= n) return interpolate(w(n - 2), w(n - 1), 2);
    return w(i);
  };
  std::vector<Pose> curve = {at(0)};
  const int segments = closed ? n : n - 1;
  for (int segment = 0; segment < segments; ++segment) {
    const Pose p[4] = {at(segment - 1), at(segment), at(segment + 1), at(segment + 2)};
    double knot[4] = {0, 0, 0, 0};
    for (int i = 1; i < 4; ++i)
      knot[i] = knot[i - 1] + std::sqrt(std::max(1e-9, length(p[i - 1], p[i], turn_m_per_rad)));
    for (int k = 1; k <= kPerSegment; ++k)
      curve.push_back(catmull_rom(p, knot, knot[1] + (knot[2] - knot[1]) * k / kPerSegment));
  }
  return curve;
}

}  // namespace

std::vector<Pose> sample_spline(const std::vector<Pose>& waypoints, int count, bool closed, double turn_m_per_rad) {
  const std::vector<Pose> curve = dense_curve(waypoints, closed, turn_m_per_rad);
  std::vector<double> travelled = {0};
  for (size_t i = 1; i < curve.size(); ++i)
    travelled.push_back(travelled.back() + length(curve[i - 1], curve[i], turn_m_per_rad));
  std::vector<Pose> route;
  size_t next = 1;
  for (int i = 0; i < count; ++i) {
    const double wanted = count == 1 ? 0 : travelled.back() * i / (count - 1);
    while (next + 1 < curve.size() && travelled[next] < wanted) ++next;
    const double step = travelled[next] - travelled[next - 1];
    const double share = step > 0 ? std::clamp((wanted - travelled[next - 1]) / step, 0.0, 1.0) : 0;
    route.push_back(interpolate(curve[next - 1], curve[next], share));
  }
  return route;
}

std::vector<Pose> orbit_route(const Orbit& orbit) {
  std::vector<Pose> route;
  for (int i = 0; i < orbit.count; ++i) {
    const double angle = orbit.from + (orbit.count == 1 ? 0 : (orbit.to - orbit.from) * i / (orbit.count - 1));
    const Eigen::Vector3d arm(orbit.radius * std::cos(angle), orbit.radius * std::sin(angle), orbit.height);
    route.push_back(looking_at(orbit.centre + arm, orbit.centre));
  }
  return route;
}

double reflected(double value, double low, double high) {
  const double width = high - low;
  if (!(width > 0)) return low;
  const double along = std::fmod(std::fmod(value - low, 2 * width) + 2 * width, 2 * width);
  return low + (along <= width ? along : 2 * width - along);
}

std::vector<Pose> random_walk(const RandomWalk& walk, uint64_t seed) {
  const Philox random(seed, Stream::views, 1);
  std::vector<Pose> route = {walk.start};
  Eigen::Vector3d position = walk.start.translation, turned = Eigen::Vector3d::Zero();
  for (int i = 1; i < walk.count; ++i) {
    for (int axis = 0; axis < 3; ++axis) {
      const auto [step, turn] = random.normal_pair(static_cast<uint32_t>(3 * i + axis));
      position[axis] = reflected(position[axis] + step * walk.step[axis], walk.low[axis], walk.high[axis]);
      turned[axis] = reflected(turned[axis] + turn * walk.turn[axis], -walk.max_turn, walk.max_turn);
    }
    route.push_back({walk.start.rotation * rotation_exp(turned), position});
  }
  return route;
}

}  // namespace fringeslam::sim
