// SPDX-License-Identifier: Apache-2.0
// Mapping while the robot moves: depth, poses and their covariances from stacks that are exposed in continuous motion.
// The pipeline is given images and exposure times only; it estimates the motion during each stack itself.
#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <numeric>
#include <random>

#include "bench/moving_run.h"
#include "bench/row.h"
#include "core/score/score.h"

namespace fringeslam::bench {

namespace {

using Eigen::Vector3d;
using Changes = std::vector<std::pair<std::string, std::string>>;

constexpr double kRadPerDeg = std::numbers::pi / 180;
constexpr double kViewRate_hz = 0;  // without pause: 90 images per second, 30 views of three images

std::vector<double> depths_of(const MovingRun& run, int images) {
  std::vector<double> depths;
  for (const MovingView& view : run.views) {
    if (view.images == images && has_pose(view.tracking)) depths.push_back(view.depth_m);
  }
  return depths;
}

double median_depth_sigmas(const MovingRun& run) {
  std::vector<double> ratios;
  for (const MovingView& view : run.views) {
    if (view.images == 3 && has_pose(view.tracking)) ratios.push_back(view.depth_sigmas);
  }
  return median_of(std::move(ratios));
}

// --- moving.depth ---

struct Direction {
  const char* name;
  Vector3d velocity, axis;  // of the camera, at 1 m/s or 1 rad/s
};

std::vector<Row> depth_rows(const Context& context) {
  const double third = 1 / std::sqrt(3.0);
  const Direction directions[] = {{"x", {1, 0, 0}, {0, 0, 0}},
                                  {"-x", {-1, 0, 0}, {0, 0, 0}},
                                  {"y", {0, 1, 0}, {0, 0, 0}},
                                  {"z", {0, 0, 1}, {0, 0, 0}},
                                  {"xyz", {third, third, third}, {0, 0, 0}},
                                  {"about x", {0, 0, 0}, {1, 0, 0}},
                                  {"about y", {0, 0, 0}, {0, 1, 0}},
                                  {"about z", {0, 0, 0}, {0, 0, 1}}};
  constexpr double kSpeed_m_s = 0.3, kTurn_rad_s = 20 * kRadPerDeg;
  const double duration_s = context.quick ? 0.4 : 0.6;
  std::vector<double> ratios;
  for (const char* name : {"loop", "rubble_pile"}) {
    const auto measured = [&](const Vector3d& velocity, const Vector3d& axis) {
      return moving_run(
          scene_with_constant_motion(name, 1, kSpeed_m_s * velocity, kTurn_rad_s * axis, duration_s, kViewRate_hz), {});
    };
    const std::vector<double> at_rest = depths_of(measured(Vector3d::Zero(), Vector3d::Zero()), 3);
    if (at_rest.empty()) throw Error(std::string("bench: no view of three images is tracked at rest in ") + name);
    const double rest_m = median_of(at_rest);
    for (const Direction& direction : directions) {
      const MovingRun run = measured(direction.velocity, direction.axis);
      const std::vector<double> depths = depths_of(run, 3);
      const double ratio = depths.empty() ? INFINITY : median_of(depths) / rest_m;
      std::vector<double> off;
      for (const MovingView* view : run.tracked()) off.push_back(view->off_m);
      std::fprintf(stderr,
                   "  %-11s %-7s: %zu views, %d lost, %zu of three images; depth %.3f mm, %.2f of that at rest, "
                   "|error|/sigma %.2f; pose %.4f mm\n",
                   name, direction.name, run.views.size(), run.lost(), depths.size(),
                   depths.empty() ? NAN : 1e3 * median_of(depths), ratio, median_depth_sigmas(run),
                   off.empty() ? NAN : 1e3 * median_of(off));
      ratios.push_back(ratio);
    }
  }
  return {bound_row("moving.depth", greatest_of(ratios), static_cast<int>(ratios.size()), "x", 1.3, Limit::most)};
}

// --- poses along the loop ---

Changes along_the_loop(double speed_m_s, const Changes& more = {}) {
  Changes changes = {{"trajectory.continuous.speed_m_s", std::to_string(speed_m_s)}};
  changes.insert(changes.end(), more.begin(), more.end());
  return changes;
}

void print(const std::string& what, const MovingRun& run) {
  std::vector<double> nees, off, bound, depth, speed;
  int three = 0;
  for (const MovingView* view : run.tracked()) {
    nees.push_back(view->sigmas * view->sigmas);
    off.push_back(view->off_m);
    bound.push_back(view->over_bound);
    depth.push_back(view->depth_m);
    if (!std::isnan(view->velocity_m_s)) speed.push_back(view->velocity_m_s);
    three += view->images == 3;
  }
  const auto keyframes = std::count_if(run.views.begin(), run.views.end(), [](const auto& v) { return v.keyframe; });
  if (off.empty()) return;
  std::fprintf(stderr,
               "  %s: %zu views, %d lost, %td keyframes, %d of three images; ATE %.3f mm; pose error median %.4f mm, "
               "worst %.4f; NEES mean %.2f, median %.2f; over bound %.2f; depth %.3f mm; velocity error %.1f mm/s\n",
               what.c_str(), run.views.size(), run.lost(), keyframes, three, 1e3 * run.ate_m, 1e3 * median_of(off),
               1e3 * *std::max_element(off.begin(), off.end()),
               std::accumulate(nees.begin(), nees.end(), 0.0) / static_cast<double>(nees.size()), median_of(nees),
               median_of(bound), 1e3 * median_of(depth), speed.empty() ? NAN : 1e3 * median_of(speed));
}

// Mean NEES of the poses of complete paths. All views of a keyframe share its errors, and those far from it also have the
// errors that depend on the viewing direction, so a path needs many keyframes and views at all distances from them.
class PathNees {
 public:
  void add(const MovingRun& run) {
    for (const MovingView* view : run.tracked()) {
      const auto band =
          static_cast<size_t>(std::upper_bound(kBands_m.begin(), kBands_m.end(), view->baseline_m) - kBands_m.begin());
      sums_[band] += view->sigmas * view->sigmas;
      ++counts_[band];
    }
    // New keyframes are registered with all points, from where their surfaces overlap least.
    for (const MovingView& view : run.views) {
      if (!view.has_pose || !view.keyframe || view.tracking == Tracking::first) continue;
      keyframe_sum_ += view.sigmas * view.sigmas;
      ++keyframes_;
    }
  }

  std::vector<Row> rows(const std::string& id) const {
    for (size_t i = 0; i < counts_.size(); ++i)
      std::fprintf(stderr, "  from %.1f m to the keyframe: %d views, NEES %.2f\n", i == 0 ? 0.0 : kBands_m[i - 1],
                   counts_[i], sums_[i] / std::max(1, counts_[i]));
    std::fprintf(stderr, "  not counted: %d new keyframes, NEES %.2f\n", keyframes_,
                 keyframe_sum_ / std::max(1, keyframes_));
    const int n = std::accumulate(counts_.begin(), counts_.end(), 0);
    const double mean = std::accumulate(sums_.begin(), sums_.end(), 0.0) / n;
    return {bound_row(id + ".least", mean, n, "", 5.3, Limit::least),
            bound_row(id + ".most", mean, n, "", 6.7, Limit::most)};
  }

 private:
  static constexpr std::array kBands_m = {0.1, 0.2, 0.3, 0.4};
  std::array<double, kBands_m.size() + 1> sums_{};
  std::array<int, kBands_m.size() + 1> counts_{};
  double keyframe_sum_ = 0;
  int keyframes_ = 0;
};

std::vector<Row> lap_rows(const Context& context) {
  std::vector<double> ates;
  PathNees nees;
  for (int seed = 3; seed < (context.quick ? 4 : 6); ++seed) {
    MovingRunOptions options;
    if (context.quick) options.most_views = 120;
    const MovingRun run = moving_run(scene_with("loop", static_cast<uint64_t>(seed), along_the_loop(0.3)), options);
    print("seed " + std::to_string(seed), run);
    ates.push_back(run.lost() > 0 ? INFINITY : 1e3 * run.ate_m);
    nees.add(run);
  }
  std::vector<Row> rows = nees.rows("moving.nees");
  rows.push_back(median_row("moving.ate", ates, "mm", 0.3));
  return rows;
}

std::vector<Row> bound_rows(const Context& context) {
  std::vector<double> bounds;
  for (int seed = 1; seed <= (context.quick ? 1 : 8); ++seed) {
    MovingRunOptions options;
    options.most_views = 100;  // so many that the first ones, whose motion is less certain, hardly matter
    options.bound = true;
    const MovingRun run = moving_run(scene_with("loop", static_cast<uint64_t>(seed), along_the_loop(0.3)), options);
    print("moving, seed " + std::to_string(seed), run);
    for (const MovingView* view : run.tracked()) bounds.push_back(view->over_bound);
  }
  return {median_row("moving.pose_bound", bounds, "x", 1.4)};
}

// A robot that stands still for each of the views of the loop.
std::vector<Row> still_rows(const Context& context) {
  PathNees nees;
  for (int seed = 3; seed < (context.quick ? 4 : 7); ++seed) {
    MovingRunOptions options;
    options.predicted = false;
    options.bound = true;
    const MovingRun run = moving_run(scene_with("loop", static_cast<uint64_t>(seed), {}), options);
    print("still, seed " + std::to_string(seed), run);
    nees.add(run);
  }
  return nees.rows("still.nees");
}

std::vector<Row> lost_rows(const Context& context) {
  int lost = 0, views = 0;
  for (const double speed_m_s : {0.1, 0.3, 0.5, 1.0}) {
    for (int seed = 1; seed <= (context.quick ? 1 : 3); ++seed) {
      MovingRunOptions options;
      options.most_views = context.quick ? 30 : 90;
      const MovingRun run =
          moving_run(scene_with("loop", static_cast<uint64_t>(seed), along_the_loop(speed_m_s)), options);
      char name[64];
      std::snprintf(name, sizeof name, "%.1f m/s, seed %d", speed_m_s, seed);
      print(name, run);
      if (speed_m_s > 0.3) continue;
      lost += run.lost();
      views += static_cast<int>(run.views.size());
    }
  }
  return {bound_row("moving.lost", lost, views, "views", 0, Limit::most)};
}

// --- moving.blur ---

// The light of each exposure is the same, so that only the blur differs.
std::vector<Row> blur_rows(const Context&) {
  constexpr double kReference_s = 1e-3;
  std::vector<double> ratios;
  double first_m = NAN;
  for (const double exposure_s : {1e-3, 2e-3, 4e-3, 7e-3, 10e-3}) {
    sim::Scene scene = scene_with_constant_motion("loop", 1, {0.2, 0.2, 0.1}, {0, 0, 0}, 0.4, kViewRate_hz);
    scene.rig.timing.exposure_s = exposure_s;
    scene.rig.projector_lens.flux_lm *= 2.78e-3 / exposure_s;
    const MovingRun run = moving_run(scene, {});
    const std::vector<double> depths = depths_of(run, 3);
    const double depth_m = depths.empty() ? INFINITY : median_of(depths);
    if (exposure_s == kReference_s) first_m = depth_m;
    char name[64];
    std::snprintf(name, sizeof name, "exposure %.0f ms", 1e3 * exposure_s);
    print(name, run);
    ratios.push_back(depth_m / first_m);
  }
  return {bound_row("moving.blur", greatest_of(ratios), static_cast<int>(ratios.size()), "x", 1.5, Limit::most)};
}

// --- moving.vibration ---

// Robots that vibrate as they move at different speeds and view rates: the share of poses that are off by more than six
// sigmas, from the second view on.
std::vector<Row> vibration_rows(const Context& context) {
  constexpr double kSigmas = 6;
  constexpr double kSpeeds_m_s[] = {0.05, 0.2, 0.3, 0.5, 0.8}, kAmplitudes_mm[] = {0.05, 0.1, 0.2, 0.4};
  constexpr const char* kRates_hz[] = {"0", "10", "5"};
  const int runs = context.quick ? 6 : 40;
  int off = 0, posed = 0, lost = 0;
  std::vector<double> nees;
  for (int i = 0; i < runs; ++i) {
    const auto n = static_cast<size_t>(i);
    const double amplitude_mm = kAmplitudes_mm[n % std::size(kAmplitudes_mm)];
    const Changes vibrating = {{"trajectory.continuous.view_rate_hz", kRates_hz[n % std::size(kRates_hz)]},
                               {"trajectory.continuous.vibration", "{amplitude_mm: " + std::to_string(amplitude_mm) +
                                                                       ", amplitude_deg: 0, band_hz: [5, 40]}"}};
    MovingRunOptions options;
    options.most_views = 12;
    const double speed_m_s = kSpeeds_m_s[n % std::size(kSpeeds_m_s)];
    const MovingRun run =
        moving_run(scene_with("loop", static_cast<uint64_t>(i) + 1, along_the_loop(speed_m_s, vibrating)), options);
    lost += run.lost();
    for (const MovingView& view : run.views) {
      if (!view.has_pose) continue;
      ++posed;
      off += !(view.sigmas <= kSigmas);
      nees.push_back(view.sigmas * view.sigmas);
    }
  }
  std::fprintf(stderr, "  %d poses, %d views without one; NEES: median %.1f, 90 %% quantile %.1f, largest %.1f\n",
               posed, lost, median_of(nees), quantile_of(nees, 0.9), *std::max_element(nees.begin(), nees.end()));
  return {bound_row("moving.vibration", static_cast<double>(off) / posed, posed, "", 0.01, Limit::most)};
}

// --- moving.wrong ---

// Shows the camera's images one pattern late from `image` on, as after a frame that the camera dropped.
void drop_image(FringeStack& stack, size_t image) {
  for (size_t k = image; k + 1 < stack.images.size(); ++k) stack.images[k] = stack.images[k + 1];
  stack.images.back() = stack.images.front();
}

std::vector<Row> wrong_rows(const Context& context) {
  const int motions = std::min(context.quick ? 20 : 1000, context.last_case);
  int wrong = 0, posed = 0, views = 0, lost = 0;
  std::array<int, 4> wrong_of{}, lost_of{}, views_of{};
  int done = 0;
  const auto began = std::chrono::steady_clock::now();
  const auto in_time = [&] {
    const std::chrono::duration<double> passed = std::chrono::steady_clock::now() - began;
    return context.minutes == 0 || passed.count() < 60 * context.minutes;
  };
  for (int number = context.first_case; number <= motions && in_time(); ++number, ++done) {
    std::mt19937_64 random(static_cast<uint64_t>(number));
    const auto uniform = [&](double low, double high) {
      return low + (high - low) * static_cast<double>(random() >> 11) / 9007199254740992.0;
    };
    const char* name = number % 2 ? "loop" : "rubble_pile";
    const int kind = number % 4;  // constant motion, jerks, vibration, dropped images
    const auto direction = [&] {
      Vector3d d;
      do {
        d = {uniform(-1, 1), uniform(-1, 1), uniform(-1, 1)};
      } while (d.norm() > 1 || d.norm() < 0.1);
      return Vector3d(d.normalized());
    };
    const Vector3d velocity = uniform(0, 1) * direction(), turn = uniform(0, 90) * kRadPerDeg * direction();
    constexpr double kDuration_s = 0.4, kKnot_s = 0.05;
    const auto seed = static_cast<uint64_t>(1 + number / 8);
    sim::Scene scene = scene_with_constant_motion(name, seed, velocity, turn, kDuration_s, kViewRate_hz);
    sim::Vibration vibration;
    if (kind == 2) vibration = {uniform(0, 2e-3), uniform(0, 0.3) * kRadPerDeg, uniform(3, 15), uniform(15, 60)};
    if (kind == 1 || kind == 2) {
      const Pose& mount = scene.rig.robot_from_camera;
      const Pose start = scene.path->at(kDuration_s / 2) * mount;
      const double jerk = kind == 1 ? uniform(0, 1) : 0;
      std::vector<Pose> controls;
      Vector3d v = velocity, w = turn;
      Pose at = start * Pose{rotation_exp(-0.5 * kDuration_s * turn), -0.5 * kDuration_s * velocity};
      for (double t = 0; t < kDuration_s + 3 * kKnot_s; t += kKnot_s) {
        controls.push_back(orthonormalised(at * mount.inverse()));
        at = at * Pose{rotation_exp(kKnot_s * w), kKnot_s * v};
        v += 0.3 * jerk * direction();
        w += 30 * kRadPerDeg * jerk * direction();
      }
      scene.path.emplace(std::move(controls), kKnot_s, vibration, seed);
    }
    MovingRunOptions options;
    int view = 0;
    const int hit = static_cast<int>(uniform(0, 6));
    const size_t image = static_cast<size_t>(uniform(0, 3));
    if (kind == 3) {
      options.disturb = [&view, hit, image](FringeStack& stack) {
        if (view++ == hit) drop_image(stack, image);
        return true;
      };
    }
    const MovingRun run = moving_run(scene, options);
    for (const MovingView& v : run.views) {
      posed += v.has_pose;
      if (v.confidently_wrong) {
        ++wrong;
        ++wrong_of[static_cast<size_t>(kind)];
        std::fprintf(
            stderr,
            "  WRONG: motion %d (%s, kind %d, %.2f m/s, %.0f deg/s) at %.3f s: %.2f mm, %.1f sigmas, %s, %d images\n",
            number, name, kind, velocity.norm(), turn.norm() / kRadPerDeg, v.time_s, 1e3 * v.off_m, v.sigmas,
            to_string(v.tracking).c_str(), v.images);
      }
    }
    views += static_cast<int>(run.views.size());
    lost += run.lost();
    lost_of[static_cast<size_t>(kind)] += run.lost();
    views_of[static_cast<size_t>(kind)] += static_cast<int>(run.views.size());
    constexpr int kReport = 50;  // what is known if the measurement is stopped
    if (number % kReport == 0)
      std::fprintf(stderr, "  to motion %d: %d views, %d lost, %d confidently wrong\n", number, views, lost, wrong);
  }
  const char* const kinds[] = {"constant", "jerks", "vibration", "dropped image"};
  for (size_t i = 0; i < wrong_of.size(); ++i)
    std::fprintf(stderr, "  %-13s: %d views, %d lost, %d confidently wrong\n", kinds[i], views_of[i], lost_of[i],
                 wrong_of[i]);
  std::fprintf(stderr, "  %d poses of %d motions judged\n", posed, done);
  return {wrong_row("moving.wrong", wrong, posed, "poses")};
}

}  // namespace

std::vector<Item> motion_items() {
  return {{{"moving.depth"},
           "median depth error of three images at 0.3 m/s and 20 deg/s, relative to that at rest: worst direction",
           depth_rows},
          {{"moving.pose_bound"},
           "errors of poses relative to their keyframes at 0.3 m/s, relative to the Cramer-Rao bound",
           bound_rows},
          {{"still.nees.least", "still.nees.most"},
           "poses along the loop relative to their keyframes, at rest: NEES",
           still_rows},
          {{"moving.lost"}, "views without a pose at 0.1 and 0.3 m/s", lost_rows},
          {{"moving.blur"}, "depth error with long exposures at 0.3 m/s, relative to 1 ms", blur_rows},
          {{"moving.vibration"},
           "robots that vibrate by 0.05 to 0.4 mm: share of poses off by more than six sigmas",
           vibration_rows},
          {{"moving.nees.least", "moving.nees.most", "moving.ate"},
           "one lap at 0.3 m/s, 30 views per second: NEES relative to the keyframes, and absolute error",
           lap_rows},
          {{"moving.wrong"}, "random motions up to 1 m/s and 90 deg/s: confidently wrong poses", wrong_rows}};
}

}  // namespace fringeslam::bench
