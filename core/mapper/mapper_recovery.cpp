// SPDX-License-Identifier: Apache-2.0
// Mapper: views in motion that only later views determine, such as the first ones (docs/method.md, section 9.4).
#include <algorithm>
#include <utility>

#include "core/base/stage_clock.h"
#include "core/mapper/mapper.h"
#include "core/registration/motion_registration.h"
#include "core/types/linear_algebra.h"

namespace fringeslam {

// Keeps the first stack if its motion has to be determined better.
void Mapper::note_first_keyframe(const FrameResult& result, MapperInput input) {
  if (result.tracking != Tracking::first || !input.reconstruct) return;
  const std::optional<StackMotion>& own = result.undecided_motion ? result.undecided_motion : result.motion;
  if (result.in_motion() || result.undecided_motion)
    first_keyframe_ = FirstKeyframe{std::move(input), {own->motion, own->covariance}};
}

// Re-decodes the first keyframe as soon as the views after it determine its motion better than its own stack, and
// once more when there are enough of them to determine it as well as that of a predicted view.
void Mapper::improve_first_keyframe() {
  constexpr size_t kMostViews = 8;
  constexpr int kStride = 6;
  if (!first_keyframe_ || track_.size() < first_keyframe_->views) return;
  const FirstKeyframe first = *std::exchange(first_keyframe_, std::nullopt);
  if (continuous_from_ > 0) return;
  const auto try_later = [&] {
    if (first.views < kMostViews) first_keyframe_ = FirstKeyframe{first.input, first.own, 2 * first.views};
  };
  // Slow motion may be recognized later.
  if (!in_motion_) return try_later();
  std::vector<PoseSample> samples = last_samples();
  samples.erase(samples.begin());
  for (PoseSample& sample : samples) sample.motion.reset();
  const std::optional<MotionPrediction> predicted =
      predict_backwards(std::move(samples), first.input.timestamp_s, options_.registration.motion_prior);
  if (!predicted) return try_later();
  MotionPrior motion = predicted->motion;
  vibration_.widen(motion.covariance);
  motion = fused(first.own, motion);
  if (!first.input.depth_slopes) return;
  ReconstructedView view = first.input.reconstruct({nullptr, motion, true});
  if (!view.motion) return;
  enter_stage("motion");
  const Pose last_from_first = world_from_camera(track_.back()).inverse() * map_.keyframes()[0].world_from_camera;
  const MotionRegistration found =
      register_motion(last_frame_, view.frame, rig_.camera, last_from_first, first.input.depth_slopes(view, kStride),
                      view.motion->motion, motion);
  if (!found.valid) return try_later();
  MotionPrior known{changed(view.motion->motion, found.step), found.motion_covariance};
  // The ripples of the last view's depth, which its own motion left, resemble those of the keyframe.
  if (last_motion_) known.covariance += last_motion_->covariance;
  view = first.input.reconstruct({nullptr, known, true});
  if (!view.in_motion()) return;  // its coding needs rest
  const ViewRegistration moved = follow_view(last_frame_, view.frame, found.target_from_source, rig_.camera,
                                             rig_.middle_range_m(), options_.registration);
  if (!moved.refined) return try_later();
  // The views so far stay where they are; their keyframe's frame has moved.
  const Pose new_from_old = moved.earlier_from_current.inverse() * last_from_first;
  for (std::vector<TrackedView>* views : {&track_, &recovered_}) {
    for (TrackedView& tracked : *views) {
      if (tracked.keyframe == 0 && &tracked != &track_.front())
        tracked.keyframe_from_camera = orthonormalised(new_from_old * tracked.keyframe_from_camera);
    }
  }
  map_.replace_frame(0, view.frame, new_from_old);
  first_new_from_old_ = orthonormalised(new_from_old * first_new_from_old_);
  FrameMotion remaining = frame_motion(view, first.input, view.frame, {});
  vibration_.widen_estimate(remaining.covariance);
  map_.set_motion(0, {remaining.spread(), true});  // its landmarks were found in the frame before
  first_motion_.reset();
  image_keyframe_ = -1;
  try_later();
}

Pose Mapper::world_from_frame(int view) const {
  const Pose camera = world_from_camera(view);
  return view == 0 ? camera * first_new_from_old_ : camera;
}

// Keeps a view without a pose, until later views predict it.
void Mapper::hold(MapperInput input) {
  constexpr size_t kMost = 8;
  if (!input.reconstruct) return;
  input.view.reset();
  held_.push_back(std::move(input));
  if (held_.size() > kMost) held_.erase(held_.begin());
}

// Registers held views, the latest first, once enough views after them predict where they were captured from.
void Mapper::recover_held_views(FrameResult& result) {
  constexpr size_t kMany = 8;
  if (held_.empty()) return;
  const size_t since = track_.size() - continuous_from_;
  // The first keyframe is improved before views are registered with it.
  const size_t few = continuous_from_ > 0 ? 2 : 4;
  if (since < few) return;
  if (!in_motion_ || since > kMany) {
    held_.clear();
    return;
  }
  if (since != few && since != kMany / 2 && since != kMany) return;
  while (!held_.empty()) {
    std::shared_ptr<const FrameResult> view = recovered(held_.back());
    if (!view) break;
    result.recovered.insert(result.recovered.begin(), std::move(view));
    held_.pop_back();
  }
}

// Predicts pose and motion from the views after a time and, unless it is before the map, those before it.
std::optional<Mapper::Prediction> Mapper::predict_between(double timestamp_s) const {
  constexpr std::ptrdiff_t kMost = 32;  // samples on each side
  std::vector<const TrackedView*> views;
  for (const std::vector<TrackedView>* some : {&recovered_, &track_}) {
    for (const TrackedView& view : *some) views.push_back(&view);
  }
  std::stable_sort(views.begin(), views.end(),
                   [](const TrackedView* a, const TrackedView* b) { return a->timestamp_s < b->timestamp_s; });
  const auto middle = std::partition_point(views.begin(), views.end(),
                                           [&](const TrackedView* view) { return view->timestamp_s < timestamp_s; });
  const auto samples = [&](auto first, auto end) {
    std::vector<PoseSample> list;
    for (; first != end; ++first) {
      const TrackedView& view = **first;
      list.push_back({view.timestamp_s, world_from_camera(view), view.variance + view.shared, view.motion()});
    }
    return list;
  };
  const auto before = samples(middle - std::min(kMost, middle - views.begin()), middle);
  auto after = samples(middle, middle + std::min(kMost, views.end() - middle));
  const MotionLimits& limits = options_.registration.motion_prior;
  const std::optional<MotionPrediction> earlier = predict_motion(before, timestamp_s, limits),
                                        later = predict_backwards(std::move(after), timestamp_s, limits);
  if (!later) return std::nullopt;
  const Prediction by_later = with_shared_errors(*later);
  if (!earlier) return by_later;
  const Prediction by_earlier = with_shared_errors(*earlier);
  // Both covariances are diagonal.
  const Vector6d ours = by_earlier.covariance.diagonal(), theirs = by_later.covariance.diagonal(), sum = ours + theirs;
  const Vector6d step =
      difference(by_later.world_from_camera, by_earlier.world_from_camera).cwiseProduct(ours).cwiseQuotient(sum);
  return Prediction{orthonormalised(retract(by_earlier.world_from_camera, step)),
                    ours.cwiseProduct(theirs).cwiseQuotient(sum).asDiagonal(),
                    fused(by_later.motion, by_earlier.motion)};
}

// Decodes a whole sequence by itself, for which an accurate motion suffices, and registers it.
bool Mapper::follow_held_sequence(FrameResult& result, const MapperInput& input, const Prediction& predicted,
                                  MotionEffect& effect) {
  if (input.needs_prior) return false;
  reconstruct(result, input, {nullptr, predicted.motion, true});
  return result.in_motion() && follow_in_motion(result, input, predicted, effect);
}

// Unwraps a view by the map. The prediction is so much less accurate than that of the next view that it determines few fringe
// orders, which may not constrain all directions: it is a prior of a first registration.
bool Mapper::follow_held_view(FrameResult& result, const MapperInput& input, const Prediction& predicted,
                              MotionEffect& effect) {
  result = {};
  effect = {};
  return follow_from(result, input, predicted, predicted.motion, false, inverse(predicted.covariance), effect) &&
         follow_from(result, input, registered(result, input), predicted.motion, true, Matrix6d::Zero(), effect);
}

// Returns null if the view cannot be registered.
std::shared_ptr<const FrameResult> Mapper::recovered(const MapperInput& input) {
  const std::optional<Prediction> predicted = predict_between(input.timestamp_s);
  if (!predicted) return nullptr;
  // The state describes the last view, which stays the one from which the next is predicted.
  const Matrix6d prediction_covariance = std::exchange(prediction_covariance_, predicted->covariance);
  const bool prediction_checked = std::exchange(prediction_checked_, true);
  const Vibration vibration = vibration_;
  auto view = std::make_shared<FrameResult>();
  MotionEffect effect;
  keyframe_image(track_[continuous_from_].keyframe);
  bool found = follow_held_sequence(*view, input, *predicted, effect);
  if (!found) found = follow_held_view(*view, input, *predicted, effect);
  prediction_covariance_ = prediction_covariance;
  prediction_checked_ = prediction_checked;
  vibration_ = vibration;
  if (!found) return nullptr;
  view->images = input.images;
  FrameMotion own = own_motion(*view, input, effect);
  const Matrix6d of_reference = by_motion_of_reference(*view);
  TrackedView here{view->frame.timestamp_s, view->reference, view->registration.earlier_from_current};
  here.registered_with = view->reference;
  here.variance = pose_variance(view->covariance + own.spread());
  here.shared = pose_variance(of_reference);
  vibration_.widen_estimate(own.covariance);
  view->covariance =
      with_parallax(view->covariance + own.spread() + of_reference, *view, view->registration.earlier_from_current);
  // A stack that leaves its motion so uncertain was distorted by more than its covariance, a linear model, describes.
  constexpr double kMostSigma_m = 5e-3;
  if (!(displacement_sigma_m(view->registration.earlier_from_current, view->covariance, rig_.middle_range_m()) <
        kMostSigma_m))
    return nullptr;
  view->world_from_robot = orthonormalised(world_from_camera(here) * rig_.robot_from_camera.inverse());
  recovered_.push_back(here);
  return view;
}

}  // namespace fringeslam
