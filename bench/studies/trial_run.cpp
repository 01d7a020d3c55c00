// SPDX-License-Identifier: Apache-2.0
#include "bench/studies/trial_run.h"

#include <algorithm>
#include <cmath>
#include <exception>
#include <limits>
#include <new>
#include <nlohmann/json.hpp>
#include <numbers>
#include <optional>

#include "bench/studies/trial_settings.h"
#include "core/base/constants.h"
#include "core/io/json_text.h"
#include "core/score/depth_honesty.h"
#include "core/score/pose_honesty.h"
#include "core/score/score.h"

namespace fringeslam::studies {

namespace {

constexpr double kDegPerRad = 180 / std::numbers::pi;

// Thresholds that attribute a failure to a cause; the first that applies counts.
constexpr double kMostSaturated = 0.1, kLeastModulation = 6, kLeastValid = 0.2, kMostWrongOrders = 0.01,
                 kLeastOverlap = 0.2;
constexpr int kLeastMatches = 8;

// Measurements of a trial, in the worst view; NaN: nothing could be compared with the ground truth.
struct SeenView {
  bool tracked = false;
  double valid = 1, wrong_order = kNaN, beyond_4_sigma = kNaN, depth_m = kNaN, nees = kNaN;
  int matches = std::numeric_limits<int>::max();
  bool confidently_wrong = false;
};

struct Seen {
  double valid = 1, wrong_order = kNaN, beyond_4_sigma = kNaN, saturated = 0, modulation = kNaN, depth_m = kNaN;
  int views = 0, tracked = 0, matches = std::numeric_limits<int>::max();
  double translation_m = kNaN, rotation_rad = kNaN, over_bound = kNaN, nees = kNaN, overlap = 1;
  bool confidently_wrong = false;

  void add(const SeenView& view) {
    ++views;
    tracked += view.tracked;
    valid = std::min(valid, view.valid);
    // fmax ignores NaN.
    wrong_order = std::fmax(wrong_order, view.wrong_order);
    beyond_4_sigma = std::fmax(beyond_4_sigma, view.beyond_4_sigma);
    depth_m = std::fmax(depth_m, view.depth_m);
    nees = std::fmax(nees, view.nees);
    matches = std::min(matches, view.matches);
    confidently_wrong |= view.confidently_wrong;
  }
};

double saturated_share(const FringeStack& stack, double full_dn) {
  cv::Mat any;
  for (const cv::Mat& image : stack.images) {
    const cv::Mat full = image >= full_dn;
    any = any.empty() ? full : cv::Mat(any | full);
  }
  return static_cast<double>(cv::countNonZero(any)) / static_cast<double>(any.total());
}

bool is_lit(const TruthFrame& truth, int row, int col) {
  return (static_cast<int>(truth.mask(row, col)) & (kTruthInBeam | kTruthInShadow)) == kTruthInBeam;
}

// Fraction of the current view's lit surface that is lit in the previous view too, from ground truth only.
double true_overlap(const TruthFrame& previous, const TruthFrame& current, const RigModel& rig) {
  const Pose previous_from_current = (previous.world_from_robot * rig.robot_from_camera).inverse() *
                                     (current.world_from_robot * rig.robot_from_camera);
  const PixelRays rays = pixel_rays(rig.camera);
  int seen = 0, both = 0;
  constexpr int kStep = 4;
  for (int row = 0; row < current.depth_m.rows; row += kStep) {
    for (int col = 0; col < current.depth_m.cols; col += kStep) {
      const auto z = static_cast<double>(current.depth_m(row, col));
      if (!(z > 0) || !is_lit(current, row, col)) continue;
      ++seen;
      const cv::Vec2f ray = rays(row, col);
      const Eigen::Vector3d point =
          previous_from_current * (z * Eigen::Vector3d(static_cast<double>(ray[0]), static_cast<double>(ray[1]), 1));
      if (point.z() <= 0) continue;
      const Eigen::Vector2d pixel = rig.camera.project(point);
      const int u = static_cast<int>(std::lround(pixel.x())), v = static_cast<int>(std::lround(pixel.y()));
      if (u < 0 || v < 0 || u >= current.depth_m.cols || v >= current.depth_m.rows) continue;
      both += is_lit(previous, v, u) && std::abs(static_cast<double>(previous.depth_m(v, u)) - point.z()) < 0.01;
    }
  }
  return seen > 0 ? static_cast<double>(both) / seen : 0;
}

// Why the depth fails the rule; empty if it does not.
std::string depth_failure(const Seen& seen, const SuccessRule& rule) {
  if (seen.beyond_4_sigma > rule.max_beyond_4_sigma) return "overconfident_depth";
  if (seen.depth_m > rule.max_depth_m || seen.wrong_order > rule.max_wrong_order) return "inaccurate_depth";
  if (seen.valid < rule.min_valid) return "little_depth";
  return "";
}

std::string cause_of(const Seen& seen, const SuccessRule& rule) {
  if (seen.saturated > kMostSaturated) return "saturated";
  if (seen.modulation < kLeastModulation) return "too_dark";
  if (seen.wrong_order > kMostWrongOrders) return "wrong_fringe_order";
  if (seen.valid < kLeastValid) return "little_depth";
  if (seen.overlap < kLeastOverlap) return "too_little_overlap";
  if (seen.tracked < seen.views) return seen.matches < kLeastMatches ? "too_few_landmarks" : "not_registered";
  const std::string of_depth = depth_failure(seen, rule);
  return of_depth.empty() ? "inaccurate_registration" : of_depth;
}

// Compares the pipeline's views with their ground truth.
class Record {
 public:
  Record(const Study& study, const sim::Scene& scene) : study_(study), scene_(scene) {}

  void add(const FringeStack& stack, const FrameResult& result, const TruthFrame& truth, const KeyframeMap& map,
           const RigModel& calibration) {
    note_images(stack, result);
    views_.push_back(seen_view(result, truth, map));
    if (!truths_.empty()) seen_.overlap = std::min(seen_.overlap, true_overlap(truths_.back(), truth, scene_.rig));
    if (has_pose(result.tracking) && last_tracked_ + 1 == static_cast<int>(truths_.size()) && last_tracked_ >= 0)
      note_bound(result, truth, calibration);
    if (has_pose(result.tracking)) {
      last_tracked_ = static_cast<int>(truths_.size());
      last_sigma_m_ = result.frame.sigma_m.clone();
    }
    truths_.push_back(truth);
    truth_.push_back({stack.timestamp_s, truth.world_from_robot});
    for (const std::shared_ptr<const FrameResult>& late : result.recovered) {
      const auto earlier = truth_of(late->frame.index);
      if (earlier != truths_.end())
        views_[static_cast<size_t>(earlier - truths_.begin())] = seen_view(*late, *earlier, map);
    }
  }

  TrialResult result(const Trajectory& trajectory) {
    std::optional<std::pair<size_t, size_t>> last;
    for (const auto& [e, t] : associate(trajectory, truth_)) {
      if (last && last->first + 1 == e && last->second + 1 == t) note_pair(trajectory, e, t);
      last = {e, t};
    }
    for (const SeenView& view : views_) seen_.add(view);
    TrialResult result;
    const SuccessRule& rule = study_.success;
    const bool inaccurate = seen_.translation_m > rule.max_translation_m ||
                            kDegPerRad * seen_.rotation_rad > rule.max_rotation_deg ||
                            !depth_failure(seen_, rule).empty();
    result.outcome = seen_.confidently_wrong       ? Outcome::confidently_wrong
                     : seen_.tracked < seen_.views ? Outcome::lost
                     : inaccurate                  ? Outcome::inaccurate
                                                   : Outcome::success;
    if (result.outcome != Outcome::success) result.cause = cause_of(seen_, rule);
    result.metrics = {{"translation_mm", 1e3 * seen_.translation_m},
                      {"rotation_deg", kDegPerRad * seen_.rotation_rad},
                      {"error_over_bound", seen_.over_bound},
                      {"nees", seen_.nees},
                      {"depth_median_mm", 1e3 * seen_.depth_m},
                      {"valid", seen_.valid},
                      {"wrong_order", seen_.wrong_order},
                      {"beyond_4_sigma", seen_.beyond_4_sigma},
                      {"saturated", seen_.saturated},
                      {"modulation_dn", seen_.modulation},
                      {"overlap", seen_.overlap},
                      {"views", seen_.views},
                      {"tracked", seen_.tracked}};
    return result;
  }

 private:
  static cv::Mat1f depth_of(const Frame& frame) {
    cv::Mat1f depth;
    cv::extractChannel(frame.points_m, depth, 2);
    return depth;
  }

  void note_images(const FringeStack& stack, const FrameResult& result) {
    seen_.saturated = std::max(seen_.saturated, saturated_share(stack, scene_.rig.sensor.saturation_dn()));
    std::vector<double> modulation;
    for (int i = 0; i < static_cast<int>(result.decoded.modulation.total()); i += 7) {
      const auto value = static_cast<double>(result.decoded.modulation(i));
      if (std::isfinite(value)) modulation.push_back(value);
    }
    const double median = modulation.empty() ? 0 : median_of(modulation);
    seen_.modulation = std::isnan(seen_.modulation) ? median : std::min(seen_.modulation, median);
  }

  std::vector<TruthFrame>::const_iterator truth_of(int index) const {
    return std::find_if(truths_.begin(), truths_.end(), [&](const TruthFrame& frame) { return frame.index == index; });
  }

  SeenView seen_view(const FrameResult& result, const TruthFrame& truth, const KeyframeMap& map) const {
    SeenView view;
    const DepthScore score = score_depth({depth_of(result.frame), result.frame.sigma_m, result.decoded.coordinate_px},
                                         truth, finest_period_px(scene_.patterns));
    view.valid = score.valid_fraction;
    if (score.compared > 0) {
      view.wrong_order = score.wrong_order;
      view.depth_m = score.median_m;
      DepthHonesty honesty;
      honesty.add(result.frame, truth);
      view.beyond_4_sigma = honesty.dishonest_share();
    }
    view.tracked = has_pose(result.tracking);
    if (result.reference >= 0) {
      view.matches = static_cast<int>(result.matches.size());
      if (view.tracked) note_motion(result, truth, map.keyframes()[static_cast<size_t>(result.reference)].index, view);
    }
    return view;
  }

  // Compares the estimated motion's error with its reported covariance.
  void note_motion(const FrameResult& result, const TruthFrame& truth, int reference, SeenView& view) const {
    const auto earlier = truth_of(reference);
    if (earlier == truths_.end()) return;
    const Pose& mount = scene_.rig.robot_from_camera;
    const Pose true_motion = (earlier->world_from_robot * mount).inverse() * (truth.world_from_robot * mount);
    const Pose& measured = result.registration.earlier_from_current;
    const PoseHonesty honesty = pose_honesty(measured, true_motion, result.covariance, scene_.rig);
    view.nees = honesty.squared_sigmas;
    view.confidently_wrong = honesty.confidently_wrong();
  }

  void note_bound(const FrameResult& result, const TruthFrame& truth, const RigModel& calibration) {
    const Pose& mount = scene_.rig.robot_from_camera;
    const TruthFrame& previous = truths_.back();
    const Pose true_motion = (previous.world_from_robot * mount).inverse() * (truth.world_from_robot * mount);
    const Matrix6d information = pose_information(previous, last_sigma_m_, truth, result.frame.sigma_m,
                                                  calibration.camera, pixel_rays(calibration.camera), true_motion);
    const double over = error_over_bound(result.previous_from_current, true_motion, information);
    if (std::isfinite(over)) seen_.over_bound = std::fmax(seen_.over_bound, over);  // fmax ignores NaN
  }

  void note_pair(const Trajectory& estimate, size_t e, size_t t) {
    const Pose true_motion = truth_[t - 1].world_from_robot.inverse() * truth_[t].world_from_robot;
    const Pose motion = estimate[e - 1].world_from_robot.inverse() * estimate[e].world_from_robot;
    const MotionScore score = score_motion(motion, true_motion);
    seen_.translation_m = std::fmax(seen_.translation_m, score.translation_error_m);
    seen_.rotation_rad = std::fmax(seen_.rotation_rad, score.rotation_error_rad);
  }

  const Study& study_;
  const sim::Scene& scene_;
  Seen seen_;
  std::vector<SeenView> views_;
  std::vector<TruthFrame> truths_;
  Trajectory truth_;
  cv::Mat1f last_sigma_m_;
  int last_tracked_ = -1;
};

// An error of a trial: in its setup, when files are read, or later.
struct Refusal {
  std::string message;
  bool in_setup = true;
};

// Runs a trial and returns why it was refused, if it was; otherwise sets `result`. Throws Error if memory does not suffice.
std::optional<Refusal> attempt(const Study& study, const Trial& trial, const ViewWatcher& watch, TrialResult& result) {
  bool in_setup = true;
  try {
    const TrialSettings settings = settings_of(study, trial);
    const sim::Scene scene = scene_of(study, trial);
    sim::VirtualRig rig(scene, settings.render);
    Pipeline pipeline(rig.model(), scene.patterns, settings.pipeline, Pose{});
    Record record(study, scene);
    in_setup = false;
    for (int number = 0; study.views == 0 || number < study.views; ++number) {
      const auto view = rig.simulate(pipeline.next_patterns());
      if (!view) break;
      const FrameResult frame = pipeline.process(view->stack);
      record.add(view->stack, frame, view->truth, pipeline.map(), rig.model());
      if (watch) watch(frame, view->truth);
    }
    result = record.result(pipeline.trajectory());
    return std::nullopt;
  } catch (const Error& e) {
    return Refusal{e.what(), in_setup};
  } catch (const std::bad_alloc&) {
    throw Error("memory does not suffice for it; use fewer --jobs or a computer with more memory");
  } catch (const std::exception& e) {
    result = {};
    result.outcome = Outcome::crashed;
    result.cause = to_string(result.outcome);
    result.message = e.what();
    return std::nullopt;
  }
}

}  // namespace

std::string to_string(Outcome outcome) {
  switch (outcome) {
    case Outcome::success:
      return "success";
    case Outcome::inaccurate:
      return "inaccurate";
    case Outcome::confidently_wrong:
      return "confidently_wrong";
    case Outcome::lost:
      return "lost";
    case Outcome::refused:
      return "refused";
    case Outcome::crashed:
      return "crashed";
    case Outcome::timed_out:
      return "timed_out";
  }
  return "refused";
}

TrialResult run_trial(const Study& study, const Trial& trial, const ViewWatcher& watch) {
  TrialResult result;
  std::optional<Refusal> refusal = attempt(study, trial, watch, result);
  if (refusal && refusal->in_setup) {
    // A refusal is recorded for good, so it must be due to the trial's values. If a file that all trials need has
    // disappeared, the first trial, which was valid at the start of the study, is refused now as well. A temporary failure
    // does not happen again.
    check_study(study);
    refusal = attempt(study, trial, watch, result);
  }
  if (refusal) {
    result = {};
    result.outcome = Outcome::refused;
    result.cause = "refused";
    result.message = refusal->message;
  }
  result.index = trial.index;
  return result;
}

std::string to_line(const Study& study, const Trial& trial, const TrialResult& result) {
  nlohmann::ordered_json line = {
      {"study", hash_text(study)}, {"files", study.files_hash}, {"trial", trial.index}, {"seed", trial.world_seed}};
  for (size_t p = 0; p < study.parameters.size(); ++p) line["values"][study.parameters[p].name] = trial.values[p];
  line["outcome"] = to_string(result.outcome);
  if (!result.cause.empty()) line["cause"] = result.cause;
  if (!result.message.empty()) line["message"] = result.message;
  for (const auto& [name, value] : result.metrics) line["metrics"][name] = value;
  return json_text(line);
}

}  // namespace fringeslam::studies
