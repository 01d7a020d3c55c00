// SPDX-License-Identifier: Apache-2.0
#include "hw/hardware_rig.h"

#include <chrono>
#include <thread>
#include <utility>

#include "core/types/error.h"
#include "hw/words.h"

namespace fringeslam {

namespace {

// The whole of the projector's image, 8 bits.
cv::Mat1b screen_of(const Pattern& pattern, const PatternSequence& sequence) {
  const cv::Mat line = pattern_image(pattern, sequence);
  if (line.type() != CV_8UC1) throw Error("projector: it shows 8 bits; patterns of more cannot be shown");
  cv::Mat1b screen;
  cv::repeat(line, sequence.height / line.rows, sequence.width / line.cols, screen);
  return screen;
}

}  // namespace

HardwareRig::HardwareRig(const RigModel& model, std::unique_ptr<GreyCamera> camera,
                         std::unique_ptr<Projector> projector, const HardwareOptions& options)
    : model_(model), camera_(std::move(camera)), projector_(std::move(projector)), options_(options) {
  const cv::Size camera_size(model.camera.width, model.camera.height);
  const cv::Size projector_size(model.projector.width, model.projector.height);
  if (camera_->size() != camera_size)
    throw Error("rig: the camera gives " + to_words(camera_->size()) + ", the rig's calibration is of " +
                to_words(camera_size));
  if (projector_->size() != projector_size)
    throw Error("rig: the projector shows " + to_words(projector_->size()) + ", the rig's calibration is of " +
                to_words(projector_size));
}

GreyImage HardwareRig::image_of(const Pattern& pattern, const PatternSequence& sequence) {
  projector_->show(screen_of(pattern, sequence));
  std::this_thread::sleep_for(std::chrono::duration<double>(options_.settle_s));
  return camera_->take();
}

std::optional<FringeStack> HardwareRig::capture(const PatternSequence& sequence) {
  if (sequence.width != model_.projector.width || sequence.height != model_.projector.height)
    throw Error("rig: patterns of " + to_words({sequence.width, sequence.height}) + " do not fill the projector's " +
                to_words(projector_->size()));
  std::string reason;
  for (int attempt = 0; attempt < options_.attempts; ++attempt) {
    retaken_ += attempt > 0;
    const cv::Mat white = image_of({.coding = Coding::flat, .level = 1}, sequence).image;
    const cv::Mat black = image_of({.coding = Coding::flat, .level = 0}, sequence).image;
    FringeStack stack;
    for (const Pattern& pattern : sequence.patterns) {
      const GreyImage taken = image_of(pattern, sequence);
      stack.images.push_back(taken.image);
      stack.exposure_s.push_back(taken.exposure_s);
      stack.timestamp_s += taken.timestamp_s / static_cast<double>(sequence.patterns.size());
    }
    const SequenceVerdict verdict = check_sequence(sequence, stack.images, white, black, options_.check);
    if (verdict.good) {
      stack.index = next_++;
      return stack;
    }
    reason = verdict.reason;
  }
  throw Error("rig: no good sequence in " + std::to_string(options_.attempts) + " attempts: " + reason);
}

}  // namespace fringeslam
