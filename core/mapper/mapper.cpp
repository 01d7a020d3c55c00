// SPDX-License-Identifier: Apache-2.0
#include "core/mapper/mapper.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <utility>

#include "core/base/stage_clock.h"
#include "core/registration/motion_registration.h"
#include "core/types/linear_algebra.h"

namespace fringeslam {

namespace {

// Extrapolates a motion to `share` of its duration at constant velocity.
Pose continued(const Pose& motion, double share) {
  return {rotation_exp(share * rotation_log(motion.rotation)), share * motion.translation};
}

// The first keyframe must show enough surface, by the finest fringes, to register the next views with.
bool can_start_map(const ReconstructedView& view) {
  constexpr double kLeast = 0.01;
  if (view.decoded.omitted_period_px > 0) return false;
  const Frame& frame = view.frame;
  int valid = 0;
  for (int row = 0; row < frame.height(); ++row) {
    for (int col = 0; col < frame.width(); ++col) valid += frame.valid(row, col);
  }
  return valid >= kLeast * frame.height() * frame.width();
}

}  // namespace

std::string to_string(Tracking tracking) {
  switch (tracking) {
    case Tracking::first:
      return "first";
    case Tracking::followed:
      return "followed";
    case Tracking::refined:
      return "refined";
    case Tracking::landmarks:
      return "landmarks";
    case Tracking::ambiguous:
      return "ambiguous";
    case Tracking::lost:
      return "lost";
  }
  return "unknown";
}

Mapper::Mapper(const RigModel& rig, const MapperOptions& options, const Pose& world_from_robot)
    : Mapper(KeyframeMap(rig, options.mapping), options) {
  start_ = world_from_robot;
}

Mapper::Mapper(KeyframeMap map, const MapperOptions& options)
    : rig_(map.rig()),
      options_(options),
      finder_(rig_, options.finder),
      map_(std::move(map)),
      vibration_(rig_.timing.camera_rate_hz) {
  check_options(options.registration.matching, "matching");
  check_options(options.registration.motion, "motion");
  check_options(options.registration.icp, "icp");
  check_options(options.registration.tracking, "tracking");
  check_options(options.registration.ambiguity, "ambiguity");
  check_options(options.registration.motion_prior, "motion_prior");
  check_options(options.mapping, "mapping");
  check_options(options.pose_graph, "pose_graph");
  finder_.add_keyframes(static_cast<int>(map_.keyframes().size()), [&](int i) -> const KnownLandmarks& {
    return map_.keyframes()[static_cast<size_t>(i)].landmarks;
  });
}

FrameResult Mapper::process(MapperInput input) {
  FrameResult result;
  MotionEffect effect;
  vibration_.set_camera_rate(input.image_interval_s > 0 ? 1 / input.image_interval_s : rig_.timing.camera_rate_hz);
  std::optional<Prediction> predicted = predict(input.timestamp_s);
  vibration_.begin_view(track_.empty() ? 0 : input.timestamp_s - track_.back().timestamp_s);
  reconstruct_unless_predicted(result, input, predicted);
  if (moves_on(result, input)) {
    in_motion_ = true;
    predicted = predict(input.timestamp_s);
  }
  track(result, input, predicted, effect);
  if (wants_landmarks(result) && result.keypoints.detected == 0) find_landmarks(result);
  if (lost_ && has_pose(result.tracking)) restart();
  const FrameMotion motion = add_motion_uncertainty(result, input, effect);
  result.images = input.images;
  if (!has_pose(result.tracking)) {
    lost_ = !map_.keyframes().empty();
    hold(std::move(input));
    return result;
  }
  result.relocalized = std::exchange(lost_, false);
  if (result.tracking == Tracking::followed && predicted) note_prediction_error(result, *predicted);
  extend_map(result, motion);
  note_pose(result);
  note_first_keyframe(result, std::move(input));
  improve_first_keyframe();
  recover_held_views(result);
  return result;
}

// After a view without a pose, earlier views do not predict the motion.
void Mapper::restart() {
  continuous_from_ = track_.size();
  evidence_of_motion_ = 0;
  vibration_.restart();
}

// Reconstructs the view, unless that requires the depth predicted by the map. If the stack alone does not determine the
// motion, it is estimated again with the prediction, and without it if the prediction does not lead to a motion.
void Mapper::reconstruct_unless_predicted(FrameResult& result, MapperInput& input,
                                          const std::optional<Prediction>& predicted) const {
  if (input.view)
    static_cast<ReconstructedView&>(result) = std::move(*input.view);
  else if (!input.needs_prior)
    reconstruct(result, input, {});
  result.complete = !input.needs_prior;
  if (result.complete && result.motion_unknown() && input.reconstruct) {
    const ReconstructedView rough = result;  // shares its images
    if (predicted) reconstruct(result, input, {nullptr, predicted->motion, false, &rough});
    result.motion_by_prediction = predicted && !result.motion_unknown();
    if (result.motion_unknown())
      reconstruct(result, input, {nullptr, unknown_motion(options_.registration.motion_prior), false, &rough});
  }
  if (wants_landmarks(result)) find_landmarks(result);
}

bool Mapper::wants_landmarks(const FrameResult& result) const {
  return result.complete && options_.registration.tracking.landmarks == LandmarkViews::every_frame;
}

// Finds the pose: from the prediction if possible, else by landmarks.
void Mapper::track(FrameResult& result, const MapperInput& input, std::optional<Prediction> predicted,
                   MotionEffect& effect) {
  if (predicted && in_motion_) {
    predicted = corrected(std::move(*predicted), result);
    prediction_covariance_ = predicted->covariance;
    prediction_checked_ = true;
  }
  const bool moving = result.in_motion();
  if (result.motion_unknown()) {
    follow_by_finest(result, input, predicted, effect);
    return;
  }
  if (map_.keyframes().empty()) {
    if (result.complete && can_start_map(result)) result.tracking = Tracking::first;
  } else if (input.needs_prior) {
    if (predicted) follow_by_prediction(result, input, *predicted, effect);
  } else if (!moving) {
    if (!predicted || !follow(result, predicted->world_from_camera)) relocalize(result);
  } else {
    const ReconstructedView own = result;  // shares its images
    if (!predicted || !follow_in_motion(result, input, *predicted, effect)) {
      // The motion was estimated for a pose that is wrong.
      static_cast<ReconstructedView&>(result) = own;
      effect = {};
      if (own.motion->residuals == 0 && input.reconstruct) {
        reconstruct(result, input, {nullptr, unknown_motion(options_.registration.motion_prior), false, nullptr});
        result.motion_by_prediction = false;
      }
      if (!result.motion_unknown() && relocalize(result)) confirm_in_motion(result, input);
    }
  }
  if (!has_pose(result.tracking) && result.registration.ambiguous) result.tracking = Tracking::ambiguous;
}

Trajectory Mapper::trajectory() const {
  Trajectory trajectory;
  for (const std::vector<TrackedView>* views : {&track_, &recovered_}) {
    for (const TrackedView& view : *views)
      trajectory.push_back(
          {view.timestamp_s, orthonormalised(world_from_camera(view) * rig_.robot_from_camera.inverse())});
  }
  const auto earlier = [](const TimedPose& a, const TimedPose& b) { return a.timestamp_s < b.timestamp_s; };
  if (!recovered_.empty()) std::stable_sort(trajectory.begin(), trajectory.end(), earlier);
  return trajectory;
}

Pose Mapper::world_from_camera(const TrackedView& view) const {
  return map_.world_from_camera(view.keyframe, view.keyframe_from_camera);
}

// Adds the errors of the poses that the prediction shares with its reference.
Mapper::Prediction Mapper::with_shared_errors(const MotionPrediction& motion) {
  constexpr double kTurn_rad = 0.006 * std::numbers::pi / 180, kShift_m = 0.06e-3;
  Vector6d sigmas;
  sigmas << Eigen::Vector3d::Constant(std::max(kTurn_rad, motion.turn_rad)),
      Eigen::Vector3d::Constant(std::max(kShift_m, motion.shift_m));
  return {motion.world_from_camera, sigmas.cwiseAbs2().asDiagonal(), motion.motion};
}

// Predicts pose and motion of the next view. A robot that moves while it captures has the same motion between its views
// and during them; for one that stops for each capture, the poses between views do not predict the motion during them.
std::optional<Mapper::Prediction> Mapper::predict(double timestamp_s) const {
  if (!options_.registration.tracking.predict || lost_ || track_.empty()) return std::nullopt;
  if (!in_motion_) {
    const std::optional<Pose> camera = camera_at_constant_velocity(timestamp_s);
    if (!camera) return std::nullopt;
    return Prediction{*camera, prediction_covariance_, motion_like_last(timestamp_s)};
  }
  std::optional<MotionPrediction> motion =
      predict_motion(last_samples(), timestamp_s, options_.registration.motion_prior);
  if (!motion) return std::nullopt;
  return with_shared_errors(*motion);
}

std::optional<ExpectedView> Mapper::expected_at(double timestamp_s) const {
  const std::optional<Prediction> predicted = predict(timestamp_s);
  if (!predicted) return std::nullopt;
  return expected_view(predicted->world_from_camera, predicted->covariance, image_keyframe_ >= 0);
}

std::vector<PoseSample> Mapper::last_samples() const {
  const TrackedView& last = track_.back();
  return last_samples(last.registered_with, last.shared);
}

// The last tracked views as samples for one that is registered with this keyframe. Views registered with the same keyframe
// share its errors, which do not make them scatter.
std::vector<PoseSample> Mapper::last_samples(int registered_with, const PoseVariance& shared) const {
  constexpr size_t kMost = 32;
  const size_t first = std::max(continuous_from_, track_.size() - std::min(kMost, track_.size()));
  std::vector<PoseSample> samples;
  for (size_t i = first; i < track_.size(); ++i) {
    const TrackedView& view = track_[i];
    const bool same = view.registered_with == registered_with;
    samples.push_back(
        {view.timestamp_s, world_from_camera(view), same ? view.variance : view.variance + shared, view.motion()});
  }
  return samples;
}

// Constant velocity between the last two tracked views; empty if they are too far in the past, or if views between them had
// no pose.
std::optional<Pose> Mapper::camera_at_constant_velocity(double timestamp_s) const {
  constexpr double kFarthest = 3;  // intervals between those views
  if (track_.size() < continuous_from_ + 2) return std::nullopt;
  const TrackedView &before = track_[track_.size() - 2], &last = track_.back();
  const double share = (timestamp_s - last.timestamp_s) / (last.timestamp_s - before.timestamp_s);
  if (!(share >= 0 && share <= kFarthest)) return std::nullopt;
  const Pose from = world_from_camera(last);
  // Extrapolation would double the rounding error of the rotations each time.
  return orthonormalised(from * continued(orthonormalised(world_from_camera(before).inverse() * from), share));
}

const Frame& Mapper::keyframe_image(int keyframe) {
  if (image_keyframe_ != keyframe) keyframe_image_ = map_.keyframe_image(keyframe);
  image_keyframe_ = keyframe;
  return keyframe_image_;
}

void Mapper::reconstruct(FrameResult& result, const MapperInput& input, const ReconstructionPrior& prior) const {
  static_cast<ReconstructedView&>(result) = input.reconstruct(prior);
  // Those of the frame before.
  result.keypoints = {};
  result.landmarks = {};
  result.recognitions = {};
}

void Mapper::find_landmarks(FrameResult& result, bool longer) const {
  FoundLandmarks found = finder_.find(result.frame, longer);
  result.keypoints = std::move(found.keypoints);
  result.landmarks = std::move(found.landmarks);
  result.recognitions = std::move(found.recognitions);
}

// Registers with the keyframe that shows most of the view; the previous one is kept unless another shows clearly more.
int Mapper::best_reference(const Frame& frame, const Pose& predicted) const {
  constexpr double kClearly = 0.1;
  const std::vector<int> candidates = map_.overlapping(frame, predicted);
  if (candidates.empty()) return -1;
  const int most = candidates.front();
  if (track_.empty()) return most;  // the first view in a map of an earlier run
  const int last = track_.back().keyframe;
  const bool change =
      map_.expected_overlap(frame, predicted, most) > map_.expected_overlap(frame, predicted, last) + kClearly;
  return change ? most : last;
}

// Returns the keyframe that views followed until they came back to a part of the map that is far from it along the links:
// `reference` closes a loop. -1: none.
int Mapper::unlinked_from(int reference) const {
  constexpr int kFewLinks = 3;
  if (track_.empty()) return -1;
  const int left = unlinked_ >= 0 ? unlinked_ : track_.back().keyframe;
  return map_.linked_within(left, reference, kFewLinks) ? -1 : left;
}

bool Mapper::follow(FrameResult& result, const Pose& predicted, const Matrix6d& prior, double max_error_m) {
  enter_stage("follow");
  result.tracking = Tracking::lost;  // an earlier registration of the view does not count if this one fails
  const int reference = best_reference(result.frame, predicted);
  if (reference < 0) return false;
  result.reference = reference;
  result.unlinked = unlinked_from(reference);
  const Pose world_from_reference = map_.keyframes()[static_cast<size_t>(result.reference)].world_from_camera;
  // Covariance of the prediction relative to the reference, which may be far from the last keyframe along the links; zero:
  // unknown.
  Matrix6d predicted_covariance = prediction_checked_ ? prediction_covariance_ : Matrix6d::Zero();
  if (prediction_checked_ && !track_.empty() && track_.back().keyframe != reference) {
    const Matrix6d between = map_.covariance_between(reference, track_.back().keyframe);
    predicted_covariance = between.isZero(0) ? between : Matrix6d(predicted_covariance + between);
  }
  const auto registered = [&](const Pose& expected, int stride) {
    RegistrationOptions options = options_.registration;
    options.icp.stride = std::max(options.icp.stride, stride);
    options.tracking.max_prediction_error_m = std::min(options.tracking.max_prediction_error_m, max_error_m);
    return follow_view(keyframe_image(result.reference), result.frame, expected, rig_.camera, rig_.middle_range_m(),
                       options, prior, predicted_covariance);
  };
  result.registration = registered(world_from_reference.inverse() * predicted, options_.registration.tracking.stride);
  const Pose found = result.registration.earlier_from_current;
  result.leaves_keyframe =
      result.registration.found && leaves_keyframe(result, world_from_reference * found, result.reference);
  // Keyframes are registered with all points.
  if (result.leaves_keyframe) result.registration = registered(found, 1);
  result.covariance = result.registration.covariance;
  if (result.registration.found) result.tracking = Tracking::followed;
  return result.registration.found;
}

// Follows a whole sequence by its finest fringes, unwrapped by the map: they last a third as long as the sequence, during
// which strong vibration is not smooth.
bool Mapper::follow_by_finest(FrameResult& result, const MapperInput& input, const std::optional<Prediction>& predicted,
                              MotionEffect& effect) {
  if (!predicted || !in_motion_ || !input.reconstruct) return false;
  const FrameResult before = result;  // shares its images
  result.complete = false;
  if (follow_by_prediction(result, input, *predicted, effect)) return true;
  result = before;
  effect = {};
  return false;
}

// Unwraps by the depth that the map predicts (docs/method.md, section 3.2, `predicted`). The first registration improves
// the predicted pose, which determines more fringe orders.
bool Mapper::follow_by_prediction(FrameResult& result, const MapperInput& input, const Prediction& predicted,
                                  MotionEffect& effect) {
  // In motion, the prediction is usually so accurate that the first registration improves no fringe orders.
  if (!predicted.motion.motion.is_still()) {
    keyframe_image(track_.back().keyframe);
    return follow_known_motion(result, input, predicted, effect);
  }
  const ExpectedView first = expected_view(predicted.world_from_camera, predicted.covariance, false);
  reconstruct(result, input, {&first, predicted.motion});
  if (result.motion_unknown()) return false;
  const Pose start = estimate_motion(result, input, predicted, &first, predicted.motion, effect);
  // The fringe orders at depth steps are still missing, and the remaining walls may not constrain all directions: the
  // prediction is a prior of the registration.
  if (!follow(result, start, inverse(predicted.covariance))) return false;
  const Pose world_from_reference = map_.keyframes()[static_cast<size_t>(result.reference)].world_from_camera;
  const Pose found = world_from_reference * result.registration.earlier_from_current;
  const ExpectedView second =
      expected_view(found, rotated_covariance(world_from_reference.rotation, result.covariance), true);
  const std::optional<StackMotion> motion = result.motion, undecided = result.undecided_motion;
  reconstruct(result, input, {&second, motion ? MotionPrior{motion->motion, motion->covariance} : predicted.motion});
  if (!result.in_motion()) result.undecided_motion = undecided;
  return follow(result, found);
}

// The same with a motion that is known approximately, and with the keyframe that keyframe_image() was called for last.
bool Mapper::follow_known_motion(FrameResult& result, const MapperInput& input, const Prediction& predicted,
                                 MotionEffect& effect) {
  if (!follow_from(result, input, predicted, predicted.motion, false, Matrix6d::Zero(), effect)) return false;
  follow_again(result, input, predicted.motion, effect);
  return true;
}

// Unwraps the view by the map, decodes it with an approximate motion, and registers it. `prior`: of its motion;
// `information`: of the approximate pose, if it is a prior of the registration.
bool Mapper::follow_from(FrameResult& result, const MapperInput& input, const Prediction& from,
                         const MotionPrior& prior, bool motion_is_known, const Matrix6d& information,
                         MotionEffect& effect) {
  const ExpectedView expected = expected_view(from.world_from_camera, from.covariance, true);
  reconstruct(result, input, {&expected, from.motion, motion_is_known});
  if (result.motion_unknown()) return false;
  const Pose start = estimate_motion(result, input, from, &expected, prior, effect);
  return follow(result, start, information, largest_error_m(from));
}

// Depth expected from the last view, and from its keyframe where the last view shows nothing. `covariance` is that of the
// camera pose relative to them, in the axes of the world.
ExpectedView Mapper::expected_view(const Pose& world_from_current, const Matrix6d& covariance,
                                   bool by_reference) const {
  enter_stage("expected view");
  const Pose current_from_world = world_from_current.inverse();
  const auto known = [&](const Frame& frame, const Pose& world_from_known) {
    const Pose current_from_known = current_from_world * world_from_known;
    const Matrix6d in_known = rotated_covariance(world_from_known.rotation.transpose(), covariance);
    return KnownView{&frame, current_from_known, covariance_of_inverse(current_from_known.inverse(), in_known)};
  };
  std::vector<KnownView> views;
  if (!track_.empty()) views.push_back(known(last_frame_, world_from_camera(track_.back())));
  if (by_reference && last_keyframe_ != image_keyframe_)
    views.push_back(known(keyframe_image_, map_.keyframes()[static_cast<size_t>(image_keyframe_)].world_from_camera));
  return fringeslam::expected_view(views, rig_.camera, map_.rays());
}

// Relocalizes by landmarks, wherever in the map they were seen, or else by all keypoints of the last keyframe.
bool Mapper::relocalize(FrameResult& result) {
  if (result.keypoints.detected == 0)
    find_landmarks(result, true);
  else if (result.recognitions.empty())
    result.recognitions = finder_.search_longer(result.landmarks);
  enter_stage("locate");
  const int last = track_.empty() ? static_cast<int>(map_.keyframes().size()) - 1 : track_.back().keyframe;
  std::shared_ptr<const Landmarks> landmarks;
  const auto known = [&](int keyframe) -> SeenView {
    landmarks = map_.keyframes()[static_cast<size_t>(keyframe)].landmarks.get();
    return {keyframe_image(keyframe), landmarks->keypoints};
  };
  LocatedView located = locate_view(known, last, {result.frame, result.keypoints}, result.recognitions, rig_.camera,
                                    rig_.middle_range_m(), options_.registration);
  // A view that is ambiguous near its prediction is reported as ambiguous even if relocalization fails.
  if (result.registration.ambiguous && !located.registration.found && !located.registration.ambiguous) return false;
  result.reference = located.with.earlier;
  result.unlinked = -1;
  result.matches = std::move(located.with.matches);
  result.registration = std::move(located.registration);
  result.leaves_keyframe = false;
  // Landmarks do not reveal that a view or its keyframe is distorted by a motion that its own stack misjudged.
  const bool doubtful = map_.keyframes()[static_cast<size_t>(result.reference)].motion.doubtful ||
                        (result.in_motion() && result.motion->residuals > 0);
  if (doubtful && !result.registration.refined) result.registration.found = false;
  if (!result.registration.found) return false;
  result.covariance = result.registration.covariance;
  result.tracking = result.registration.refined ? Tracking::refined : Tracking::landmarks;
  const Pose world_from_reference = map_.keyframes()[static_cast<size_t>(result.reference)].world_from_camera;
  result.leaves_keyframe =
      result.registration.refined &&
      leaves_keyframe(result, world_from_reference * result.registration.earlier_from_current, result.reference);
  return true;
}

// Views reconstructed by prediction show nothing new, so they never start a keyframe.
bool Mapper::leaves_keyframe(const FrameResult& result, const Pose& world_from_camera, int keyframe) const {
  if (options_.mapping.every_view) return true;
  return result.complete && (result.unlinked >= 0 || map_.expected_overlap(result.frame, world_from_camera, keyframe) <
                                                         options_.mapping.keyframe_overlap);
}

// Adds the view to the track, and to the map if registration by depth confirmed its pose.
void Mapper::extend_map(FrameResult& result, const FrameMotion& motion) {
  enter_stage("map");
  TrackedView here{result.frame.timestamp_s, result.reference, result.registration.earlier_from_current};
  if (result.tracking == Tracking::first || result.leaves_keyframe)
    add_keyframe(result, here, motion);
  else if (result.registration.refined)
    result.in_map = map_.add_frame(result.frame, here.keyframe, here.keyframe_from_camera);
  result.view = static_cast<int>(track_.size());
  unlinked_ = result.keyframe < 0 ? result.unlinked : -1;
  track_.push_back(here);
}

void Mapper::add_keyframe(FrameResult& result, TrackedView& here, const FrameMotion& motion) {
  const bool first = result.tracking == Tracking::first;
  const Pose current = first ? start_ * rig_.robot_from_camera : world_from_camera(here);
  if (result.keypoints.detected == 0) find_landmarks(result);
  enter_stage("map");
  const bool moved = !motion.covariance.isZero(0);
  corrected_ = (corrected_ || map_.keyframes().empty()) && result.corrected_spread_px2;
  result.keyframe = map_.add_keyframe(result.frame, result.landmarks, current, {motion.spread(), first && moved});
  if (first && moved) first_motion_ = motion;
  result.in_map = true;
  finder_.add_keyframe(result.keyframe, map_.keyframes().back().landmarks);
  here = {here.timestamp_s, result.keyframe, {}};
  if (first) return;
  // Where the robot returns, the reference closes a loop, if the keyframe that views followed so far can be linked as well.
  const size_t to_reference = map_.links().size();
  link(result.reference, result.keyframe, result.registration.earlier_from_current, result.covariance, false);
  result.loops = close_loops(result);
  const bool continues = std::any_of(map_.links().begin() + static_cast<std::ptrdiff_t>(to_reference) + 1,
                                     map_.links().end(), [](const PoseEdge& edge) { return !edge.loop; });
  if (continues) map_.set_loop(to_reference, true);
  if (result.loops > 0) result.corrected = map_.correct(options_.pose_graph, options_.mapping.significant_m);
}

void Mapper::link(int from, int to, const Pose& from_from_to, const Matrix6d& covariance, bool loop) {
  map_.link({from, to, from_from_to, inverse(Matrix6d(kLinkVariance * covariance)), loop});
}

// Links the new keyframe with earlier ones besides its reference: the one that views followed until the robot returned, those
// that overlap it, and those whose landmarks were re-identified. Returns the number of links.
int Mapper::close_loops(const FrameResult& result) {
  enter_stage("loops");
  const Pose current = map_.keyframes().back().world_from_camera;
  std::vector<int> near = map_.overlapping(result.frame, current);
  std::map<int, std::vector<KeypointMatch>> recognised;
  for (auto& [keyframe, matches] : matches_by_view(result.recognitions)) {
    recognised[keyframe] = std::move(matches);
    if (std::find(near.begin(), near.end(), keyframe) == near.end()) near.push_back(keyframe);
  }
  if (result.unlinked >= 0) {
    std::erase(near, result.unlinked);
    near.insert(near.begin(), result.unlinked);
  }
  int links = 0;
  for (const int keyframe : near) {
    if (links >= options_.mapping.max_links) break;
    if (keyframe == result.keyframe || keyframe == result.reference) continue;
    if (link_with(keyframe, result, recognised[keyframe], keyframe != result.unlinked)) ++links;
  }
  return links;
}

// Links the new keyframe with an earlier one, given their matching landmarks, if depth confirms their relative pose.
bool Mapper::link_with(int keyframe, const FrameResult& result, const std::vector<KeypointMatch>& matches, bool loop) {
  const Keyframe &earlier = map_.keyframes()[static_cast<size_t>(keyframe)], &current = map_.keyframes().back();
  const Frame image = map_.keyframe_image(keyframe);
  ViewRegistration registration =
      follow_view(image, result.frame, earlier.world_from_camera.inverse() * current.world_from_camera, rig_.camera,
                  rig_.middle_range_m(), options_.registration, Matrix6d::Zero(),
                  map_.covariance_between(keyframe, result.keyframe));
  if (!registration.refined && !matches.empty())
    registration =
        register_views(image, result.frame, point_pairs(earlier.landmarks.get()->keypoints, result.keypoints, matches),
                       rig_.camera, rig_.middle_range_m(), options_.registration);
  if (!registration.refined) return false;
  const Pose& pose = registration.earlier_from_current;
  // The registration takes the motions during both stacks as known.
  const Matrix6d covariance = registration.covariance + covariance_by_motion(earlier, current, pose);
  link(keyframe, result.keyframe, pose, with_parallax(covariance, result, pose), loop);
  return true;
}

// Accounts for the parallax between the view and an earlier one.
Matrix6d Mapper::with_parallax(const Matrix6d& covariance, const FrameResult& result,
                               const Pose& earlier_from_current) const {
  return fringeslam::with_parallax(covariance, earlier_from_current, rig_.middle_range_m(),
                                   corrected_ ? result.corrected_spread_px2 : std::nullopt);
}

// The next error of constant velocity is assumed to be at most twice the current one, and at least that of a robot that moves
// slowly and unevenly. Called before the view corrects the map.
void Mapper::note_prediction_error(const FrameResult& result, const Prediction& predicted) {
  constexpr double kTurn_rad = 0.03 * std::numbers::pi / 180, kShift_m = 0.3e-3;
  const Pose world_from_reference = map_.keyframes()[static_cast<size_t>(result.reference)].world_from_camera;
  const Vector6d error =
      difference(world_from_reference * result.registration.earlier_from_current, predicted.world_from_camera);
  Vector6d sigmas;
  sigmas << Eigen::Vector3d::Constant(std::max(kTurn_rad, 2 * error.head<3>().norm())),
      Eigen::Vector3d::Constant(std::max(kShift_m, 2 * error.tail<3>().norm()));
  prediction_covariance_ = sigmas.cwiseAbs2().asDiagonal();
}

// Fills in the poses, and stores the state from which the next view is predicted.
void Mapper::note_pose(FrameResult& result) {
  enter_stage("other");
  const Pose world_from_current = world_from_camera(track_.back());
  result.world_from_robot = orthonormalised(world_from_current * rig_.robot_from_camera.inverse());
  if (track_.size() > 1)
    result.previous_from_current = world_from_camera(track_[track_.size() - 2]).inverse() * world_from_current;
  last_frame_ = result.frame;
  last_keyframe_ = result.keyframe;
  last_motion_ = result.motion;
  prediction_checked_ = result.tracking == Tracking::followed;
  if (in_motion_ && !result.in_motion()) evidence_of_motion_ = 0;  // of the motion that has ended
  in_motion_ = result.in_motion();
  track_.back().registered_with = result.reference;
  track_.back().variance = variance_;
  track_.back().shared = shared_variance_;
  if (in_motion_ && result.motion->residuals > 0 && !result.motion_by_prediction)
    track_.back().own_motion = std::make_shared<const StackMotion>(*result.motion);
  vibration_.end_view();
  // Older views predict no motion.
  constexpr size_t kMostPredicting = 64;
  if (track_.size() > kMostPredicting) track_[track_.size() - 1 - kMostPredicting].own_motion.reset();
}

}  // namespace fringeslam
