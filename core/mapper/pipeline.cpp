// SPDX-License-Identifier: Apache-2.0
#include "core/mapper/pipeline.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <utility>

#include "core/map/expected_view.h"

namespace fringeslam {

namespace {

double middle_m(const RigModel& rig) { return 0.5 * (rig.near_m + rig.far_m); }

// A motion continued for `share` of its duration.
Pose continued(const Pose& motion, double share) {
  return {rotation_exp(share * rotation_log(motion.rotation)), share * motion.translation};
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
    case Tracking::lost:
      return "lost";
  }
  return "unknown";
}

Pipeline::Pipeline(const RigModel& rig, const PatternSequence& sequence, const PipelineOptions& options,
                   const Pose& start)
    : Pipeline(KeyframeMap(rig, options.mapping), sequence, options) {
  start_ = start;
}

Pipeline::Pipeline(KeyframeMap map, const PatternSequence& sequence, const PipelineOptions& options)
    : rig_(map.rig()),
      sequence_(sequence),
      finest_(finest_patterns(sequence, Axis::columns)),
      options_(options),
      rays_(map.rays()),
      triangulation_(rig_, rays_, options.depth.near_m, options.depth.far_m),
      database_(rig_.camera, options.recognition),
      map_(std::move(map)) {
  options_.for_each_stage([](const char* name, auto& stage) { check_options(stage, name); });
  for (size_t i = 0; i < map_.keyframes().size(); ++i)
    database_.add(static_cast<int>(i), map_.keyframes()[i].landmarks);
}

SeenStack Pipeline::see_ahead(FringeStack stack, StageClock* clock) const {
  SeenStack seen;
  if (stack.images.size() == sequence_.patterns.size() && !options_.tracking.moving)
    std::tie(seen.decoded.emplace(), seen.frame) = see(stack, nullptr, clock);
  seen.stack = std::move(stack);
  return seen;
}

FrameResult Pipeline::process(SeenStack seen) {
  const FringeStack& stack = seen.stack;
  FrameResult result;
  const std::optional<Pose> predicted = predicted_camera(stack.timestamp_s);
  const bool by_prediction = stack.images.size() < sequence_.patterns.size();
  result.images = static_cast<int>(stack.images.size());
  if (seen.decoded) {
    result.decoded = std::move(*seen.decoded);
    result.frame = std::move(seen.frame);
  } else if (!by_prediction) {
    see(result, stack, nullptr);
  }
  const bool every_frame = options_.tracking.landmarks == "every_frame";
  if (every_frame) find_landmarks(result);
  if (map_.keyframes().empty()) {
    result.tracking = Tracking::first;
    add_keyframe(result, start_ * rig_.robot_from_camera);
  } else {
    const bool followed =
        predicted && (by_prediction ? see_by_prediction(result, stack, *predicted) : follow(result, *predicted));
    if (!followed && (by_prediction || !locate(result))) {
      lost_ = wants_all_ = true;
      prediction_failed_ |= by_prediction;
      find_warmth(result, stack);
      return result;
    }
    track_.push_back({stack.timestamp_s, result.reference, result.registration.earlier_from_current});
    result.found_again = std::exchange(lost_, false);
    extend_map(result);
  }
  find_warmth(result, stack);
  enter("other");
  // METHOD S21: world_from_robot(i+1) = world_from_robot(i) robot_from_camera motion camera_from_robot
  const Pose world_from_current = world_from_camera(track_.back());
  result.world_from_robot = orthonormalised(world_from_current * rig_.robot_from_camera.inverse());
  if (track_.size() > 1)
    result.previous_from_current = world_from_camera(track_[track_.size() - 2]).inverse() * world_from_current;
  if (result.tracking == Tracking::followed) note_innovation(*predicted, world_from_current);
  plan_next(result);
  last_ = result;
  return result;
}

Trajectory Pipeline::trajectory() const {
  Trajectory trajectory;
  for (const Located& located : track_)
    trajectory.push_back(
        {located.timestamp_s, orthonormalised(world_from_camera(located) * rig_.robot_from_camera.inverse())});
  return trajectory;
}

Pose Pipeline::world_from_camera(const Located& located) const {
  return map_.world_from_camera(located.keyframe, located.keyframe_from_camera);
}

// Where the camera is if it moves on as it did between the last two frames.
std::optional<Pose> Pipeline::predicted_camera(double timestamp_s) const {
  constexpr double kFarthest = 3;  // times as long as between those
  if (!options_.tracking.predict || lost_ || track_.size() < 2) return std::nullopt;
  const Located &before = track_[track_.size() - 2], &last = track_.back();
  const double share = (timestamp_s - last.timestamp_s) / (last.timestamp_s - before.timestamp_s);
  if (!(share >= 0 && share <= kFarthest)) return std::nullopt;
  const Pose from = world_from_camera(last);
  // Extrapolation doubles whatever rounding left of the rotations, each time.
  return orthonormalised(from * continued(orthonormalised(world_from_camera(before).inverse() * from), share));
}

const Frame& Pipeline::reference_image(int keyframe) {
  if (reference_ != keyframe) reference_frame_ = map_.keyframe_image(keyframe);
  reference_ = keyframe;
  return reference_frame_;
}

std::pair<DecodedStack, Frame> Pipeline::see(const FringeStack& stack, const ExpectedCoordinate* expected,
                                             StageClock* clock) const {
  const PatternSequence& sequence = expected ? finest_ : sequence_;
  DecodeOptions options = options_.decode;
  if (options.unwrapping == "predicted" && !expected) options.unwrapping = "auto";
  if (expected) options.unwrapping = "predicted";
  enter("decode", clock);
  DecodedStack decoded = decode(stack, sequence, rig_, options, {Axis::columns, expected});
  enter("depth", clock);
  Frame frame = reconstruct(decoded, rig_, triangulation_, options_.depth);
  if (options_.tracking.moving && !lost_ && track_.size() >= 2) {
    compensate_motion(decoded, sequence, options, coordinate_rate(frame, rig_, rays_, twist()),
                      image_times_s(stack.images.size(), rig_.timing));
    frame = reconstruct(decoded, rig_, triangulation_, options_.depth);
  }
  return {std::move(decoded), std::move(frame)};
}

// METHOD S3, `predicted`: where the map lets expect an order the fringes have it. What is seen so tells the pose, and
// that lets expect more.
bool Pipeline::see_by_prediction(FrameResult& result, const FringeStack& stack, const Pose& predicted) {
  const ExpectedCoordinate first = expected(predicted, prediction_covariance_, false);
  see(result, stack, &first);
  // Where a step may be no order is told yet, and walls may be all that holds the view sideways: the prediction helps.
  if (!follow(result, predicted, prediction_covariance_.inverse())) return false;
  const Keyframe& reference = map_.keyframes()[static_cast<size_t>(result.reference)];
  const ExpectedCoordinate second =
      expected(reference.world_from_camera * result.registration.earlier_from_current, result.covariance, true);
  see(result, stack, &second);
  return follow(result, reference.world_from_camera * result.registration.earlier_from_current);
}

// From the last view, and from its keyframe what that did not show. `covariance`: of the camera's pose against them.
ExpectedCoordinate Pipeline::expected(const Pose& world_from_current, const Matrix6d& covariance, bool by_reference) {
  enter("expected view");
  const Pose current_from_world = world_from_current.inverse();
  const auto known = [&](const Frame& frame, const Pose& world_from_known) {
    const Pose current_from_known = current_from_world * world_from_known;
    return KnownView{&frame, current_from_known, covariance_of_inverse(current_from_known.inverse(), covariance)};
  };
  std::vector<KnownView> views = {known(last_->frame, world_from_camera(track_.back()))};
  if (by_reference && last_->keyframe != reference_)
    views.push_back(known(reference_frame_, map_.keyframes()[static_cast<size_t>(reference_)].world_from_camera));
  const ExpectedView view = expected_view(views, rig_.camera, rays_);
  return expected_coordinate(rig_, rays_, view.depth_m, view.sigma_m);
}

// How far off constant velocity may be next time: twice as far as this time, and not less than a slow robot's jerks.
void Pipeline::note_innovation(const Pose& predicted, const Pose& found) {
  constexpr double kTurn = 0.03 * std::numbers::pi / 180, kShift_m = 0.3e-3;
  const Vector6d error = difference(found, predicted);
  const double turn = std::max(kTurn, 2 * error.head<3>().norm());
  const double shift = std::max(kShift_m, 2 * error.tail<3>().norm());
  Vector6d sigmas;
  sigmas << Eigen::Vector3d::Constant(turn), Eigen::Vector3d::Constant(shift);
  prediction_covariance_ = sigmas.cwiseAbs2().asDiagonal();
}

// All patterns again where the prediction is not to be had, or left too many fringes without an order.
void Pipeline::plan_next(const FrameResult& result) {
  const double fringes = cv::countNonZero(result.decoded.wrapped_phase == result.decoded.wrapped_phase);
  const double orders = cv::countNonZero(result.decoded.coordinate_px == result.decoded.coordinate_px);
  const bool leaves = result.keyframe < 0 && result.registration.icp.overlap < options_.mapping.keyframe_overlap;
  if (result.keyframe >= 0) prediction_failed_ = false;
  wants_all_ = options_.decode.unwrapping != "predicted" || prediction_failed_ ||
               result.tracking != Tracking::followed || leaves || orders < options_.tracking.min_predicted * fringes;
}

// Of the camera between the last two frames.
CameraTwist Pipeline::twist() const {
  const Located &before = track_[track_.size() - 2], &last = track_.back();
  const double duration_s = last.timestamp_s - before.timestamp_s;
  const Pose motion = world_from_camera(before).inverse() * world_from_camera(last);
  return {rotation_log(motion.rotation) / duration_s, motion.translation / duration_s};
}

void Pipeline::find_landmarks(FrameResult& result) const {
  enter("landmarks");
  result.keypoints = detect_keypoints(result.frame, rig_, rays_, options_.keypoints);
  result.landmarks = identify_landmarks(result.frame, result.keypoints, rig_, options_.keypoints, options_.conditioning,
                                        options_.clusters, options_.landmarks, &result.landmark_stages);
  result.recognitions = database_.recognise(result.landmarks);
}

// Of a view without a pose it is told what is warm, but not where.
void Pipeline::find_warmth(FrameResult& result, const FringeStack& stack) {
  if (stack.thermal_c.empty()) return;
  enter("thermal");
  const RegisteredThermal thermal = register_thermal(result.frame.points_m, stack.thermal_c, rig_, options_.thermal);
  result.frame.temperature_c = thermal.temperature_c;
  result.warm = find_warm_regions(result.frame, thermal, rig_, options_.thermal);
  note_temperatures(result.frame, result.warm, result.landmarks, options_.thermal);
  // Of the views that are followed those in the map are enough, and their number does not grow with time.
  const bool keep = result.in_map || (result.tracking != Tracking::followed && result.tracking != Tracking::lost);
  if (keep && !result.warm.list.empty()) warm_[track_.size() - 1] = {stack.index, {}, result.warm.list};
}

std::vector<WarmThing> Pipeline::warm_things() const {
  std::vector<LocatedRegions> views;
  for (const auto& [place, seen] : warm_) {
    views.push_back(seen);
    views.back().world_from_camera = world_from_camera(track_[place]);
  }
  return merge_regions(views, options_.thermal);
}

// From the keyframe that shows most of the view; the one before is kept unless another shows clearly more.
bool Pipeline::follow(FrameResult& result, const Pose& predicted, const Matrix6d& prior) {
  constexpr double kClearly = 0.1;
  enter("follow");
  const std::vector<int> candidates = map_.overlapping(result.frame, predicted);
  if (candidates.empty()) return false;
  const int last = track_.back().keyframe, most = candidates.front();
  const bool change = map_.expected_overlap(result.frame, predicted, most) >
                      map_.expected_overlap(result.frame, predicted, last) + kClearly;
  result.reference = change ? most : last;
  const Pose world_from_reference = map_.keyframes()[static_cast<size_t>(result.reference)].world_from_camera;
  const auto registered = [&](const Pose& expected, int stride) {
    RegistrationOptions options = registration_options();
    options.icp.stride = std::max(options.icp.stride, stride);
    return follow_view(reference_image(result.reference), result.frame, expected, rig_.camera, middle_m(rig_), options,
                       prior);
  };
  result.registration = registered(world_from_reference.inverse() * predicted, options_.tracking.stride);
  const Pose found = result.registration.earlier_from_current;
  if (result.registration.found && becomes_keyframe(result, world_from_reference * found, result.reference))
    result.registration = registered(found, 1);
  result.covariance = result.registration.covariance;
  if (result.registration.found) result.tracking = Tracking::followed;
  return result.registration.found;
}

// By landmarks, wherever in the map they were seen; where those do not tell, by all keypoints of the last keyframe.
bool Pipeline::locate(FrameResult& result) {
  if (result.keypoints.detected == 0) find_landmarks(result);
  enter("locate");
  const int last = track_.empty() ? static_cast<int>(map_.keyframes().size()) - 1 : track_.back().keyframe;
  const auto known = [&](int keyframe) -> SeenView {
    return {reference_image(keyframe), map_.keyframes()[static_cast<size_t>(keyframe)].landmarks.keypoints};
  };
  LocatedView located = locate_view(known, last, {result.frame, result.keypoints}, result.recognitions, rig_.camera,
                                    middle_m(rig_), registration_options());
  result.reference = located.with.earlier;
  result.matches = std::move(located.with.matches);
  result.registration = std::move(located.registration);
  if (!result.registration.found) return false;
  result.covariance = result.registration.covariance;
  result.tracking = result.registration.refined ? Tracking::refined : Tracking::landmarks;
  return true;
}

// Where it leaves its keyframe's view, if all patterns were shown: of the finest alone, what is new has no depth.
bool Pipeline::becomes_keyframe(const FrameResult& result, const Pose& world_from_camera, int keyframe) const {
  if (options_.tracking.landmarks == "every_frame") return true;
  return result.images == static_cast<int>(sequence_.patterns.size()) &&
         map_.expected_overlap(result.frame, world_from_camera, keyframe) < options_.mapping.keyframe_overlap;
}

void Pipeline::extend_map(FrameResult& result) {
  // Where depth did not confirm the landmarks' motion the frame tells where the robot is, but the map stays as it was.
  enter("map");
  if (!result.registration.refined) return;
  const Located here = track_.back();
  const Pose current = world_from_camera(here);
  if (becomes_keyframe(result, current, here.keyframe)) return add_keyframe(result, current);
  result.in_map = map_.add_frame(result.frame, here.keyframe, here.keyframe_from_camera);
}

void Pipeline::add_keyframe(FrameResult& result, const Pose& world_from_camera) {
  if (result.keypoints.detected == 0) find_landmarks(result);
  enter("map");
  const int number = map_.add_keyframe(result.frame, result.landmarks, world_from_camera);
  database_.add(number, result.landmarks);
  result.keyframe = number;
  result.in_map = true;
  if (result.tracking == Tracking::first) {
    track_.push_back({result.frame.timestamp_s, number, {}});
    return;
  }
  track_.back() = {track_.back().timestamp_s, number, {}};
  map_.link({result.reference, number, result.registration.earlier_from_current, result.covariance.inverse(), false});
  result.loops = close_loops(result);
  if (result.loops > 0) result.corrected = map_.correct(options_.pose_graph, options_.mapping.significant_m);
}

// Links the new keyframe with earlier ones beside its reference: those that it overlaps by what is known, and those
// whose landmarks it shows. How many.
int Pipeline::close_loops(const FrameResult& result) {
  enter("loops");
  const Pose current = map_.keyframes().back().world_from_camera;
  std::vector<int> near = map_.overlapping(result.frame, current);
  std::map<int, std::vector<KeypointMatch>> recognised;
  for (auto& [keyframe, matches] : matches_by_view(result.recognitions)) {
    recognised[keyframe] = std::move(matches);
    if (std::find(near.begin(), near.end(), keyframe) == near.end()) near.push_back(keyframe);
  }
  int links = 0;
  for (const int keyframe : near) {
    if (links >= options_.mapping.max_links) break;
    if (keyframe == result.keyframe || keyframe == result.reference) continue;
    const Keyframe& earlier = map_.keyframes()[static_cast<size_t>(keyframe)];
    const Frame image = map_.keyframe_image(keyframe);
    ViewRegistration registration = follow_view(image, result.frame, earlier.world_from_camera.inverse() * current,
                                                rig_.camera, middle_m(rig_), registration_options());
    if (!registration.refined && recognised.contains(keyframe))
      registration = register_views(image, result.frame,
                                    point_pairs(earlier.landmarks.keypoints, result.keypoints, recognised[keyframe]),
                                    rig_.camera, middle_m(rig_), registration_options());
    if (!registration.refined) continue;
    map_.link({keyframe, result.keyframe, registration.earlier_from_current, registration.covariance.inverse(), true});
    ++links;
  }
  return links;
}

}  // namespace fringeslam
