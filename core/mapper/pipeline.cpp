// SPDX-License-Identifier: Apache-2.0
#include "core/mapper/pipeline.h"

#include <utility>

namespace fringeslam {

namespace {

FinestAlone finest_alone(const PipelineOptions& options) {
  if (options.decode.unwrapping == Unwrapping::predicted) return FinestAlone::always;
  return options.tracking.predict && options.tracking.finest_in_motion ? FinestAlone::in_motion : FinestAlone::never;
}

}  // namespace

Pipeline::Pipeline(const RigModel& rig, const PatternSequence& sequence, const PipelineOptions& options,
                   const Pose& world_from_robot)
    : Pipeline(std::make_shared<FringeFrontEnd>(rig, sequence, options.front_end()),
               Mapper(rig, options.mapper(), world_from_robot), sequence, options) {}

Pipeline::Pipeline(KeyframeMap map, const PatternSequence& sequence, const PipelineOptions& options)
    : Pipeline(std::make_shared<FringeFrontEnd>(map.rig(), sequence, options.front_end()),
               Mapper(std::move(map), options.mapper()), sequence, options) {}

Pipeline::Pipeline(std::shared_ptr<const FrontEnd> front_end, Mapper mapper, const PatternSequence& sequence,
                   const PipelineOptions& options)
    : front_end_(std::move(front_end)),
      mapper_(std::move(mapper)),
      schedule_(sequence, finest_alone(options), options.mapping.keyframe_overlap, options.tracking.min_predicted),
      next_(schedule_.next()),
      surface_(options.surface) {
  PipelineOptions checked = options;
  checked.for_each_stage([](const char* name, auto& stage) { check_options(stage, name); });
}

void Pipeline::keep_all_patterns() {
  schedule_.keep_all();
  next_ = schedule_.next();
}

PreprocessedStack Pipeline::preprocess(FringeStack stack) const {
  PreprocessedStack result{std::move(stack), {}};
  if (!front_end_->needs_prior(result.stack)) result.view = front_end_->reconstruct(result.stack, {});
  return result;
}

FrameResult Pipeline::process(PreprocessedStack preprocessed) {
  const FringeStack& stack = preprocessed.stack;
  // The mapper may keep the input to reconstruct the view again.
  FrameResult result =
      mapper_.process({stack.timestamp_s, std::move(preprocessed.view), front_end_->needs_prior(stack),
                       static_cast<int>(stack.images.size()), image_interval_s(stack, mapper_.map().rig().timing),
                       [front_end = front_end_, stack](const ReconstructionPrior& prior) {
                         return front_end->reconstruct(stack, prior);
                       },
                       [front_end = front_end_, stack](const ReconstructedView& view, int stride) {
                         return front_end->depth_slopes(stack, view, stride);
                       }});
  if (result.complete && result.in_motion() && has_pose(result.tracking) && !schedule_.keeps_all())
    result.predictable = predictable_orders(stack);
  last_timestamp_s_ = stack.timestamp_s;
  schedule_.update(result);
  next_ = schedule_.is_fixed() ? schedule_.next() : front_end_->anticipated(schedule_.next(), result);
  return result;
}

// A camera that waits between its views might as well take whole sequences. If it does not wait, an attempt with the finest
// fringes costs a third of a sequence, and more views predict better.
double Pipeline::predictable_orders(const FringeStack& stack) const {
  const double image_s = image_interval_s(stack, mapper_.map().rig().timing);
  const double interval_s = stack.timestamp_s - last_timestamp_s_,
               sequence_s = image_s * static_cast<double>(stack.images.size());
  if (interval_s <= sequence_s + image_s) return 1;
  const std::optional<ExpectedView> expected = mapper_.expected_at(stack.timestamp_s + interval_s);
  return expected ? front_end_->determined_orders(*expected) : 0;
}

}  // namespace fringeslam
