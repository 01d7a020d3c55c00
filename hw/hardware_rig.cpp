// SPDX-License-Identifier: Apache-2.0
#include "hw/hardware_rig.h"

#include <algorithm>
#include <chrono>
#include <thread>
#include <utility>

#include "core/patterns/design.h"
#include "core/types/error.h"
#include "hw/words.h"

namespace fringeslam {

namespace {

const Pattern kWhite{.coding = Coding::flat, .level = 1}, kBlack{.coding = Coding::flat, .level = 0};
// For gammas of 0.4 to 4 of the projector, its light contradicts both values of a bit (SequenceCheckOptions::tolerance).
const Pattern kBetween{.coding = Coding::flat, .level = 0.7};

// Expands a pattern to the projector's full image, 8 bits.
cv::Mat1b screen_of(const Pattern& pattern, const PatternSequence& sequence) {
  const cv::Mat line = pattern_image(pattern, sequence);
  if (line.type() != CV_8UC1) throw Error("projector: patterns of more than 8 bits are not supported");
  cv::Mat1b screen;
  cv::repeat(line, sequence.height / line.rows, sequence.width / line.cols, screen);
  return screen;
}

bool begins_with_bits(const PatternSequence& sequence, size_t count) {
  const auto end = sequence.patterns.begin() + static_cast<std::ptrdiff_t>(std::min(count, sequence.patterns.size()));
  return std::any_of(sequence.patterns.begin(), end, [](const Pattern& of) { return of.coding == Coding::gray; });
}

}  // namespace

HardwareRig::HardwareRig(const RigModel& model, std::unique_ptr<GreyCamera> camera,
                         std::unique_ptr<Projector> projector, const HardwareOptions& options)
    : model_(model),
      camera_(std::move(camera)),
      projector_(std::move(projector)),
      options_(options),
      exposure_s_(camera_->exposure_s()) {
  options_.check.full_scale_dn = model.sensor.max_dn();
  options_.check.saturation *= model.sensor.saturation_dn() / model.sensor.max_dn();
  const cv::Size camera_size(model.camera.width, model.camera.height);
  const cv::Size projector_size(model.projector.width, model.projector.height);
  if (camera_->size() != camera_size)
    throw Error("rig: the camera delivers " + to_words(camera_->size()) + ", but the rig's calibration is for " +
                to_words(camera_size));
  if (projector_->size() != projector_size)
    throw Error("rig: the projector shows " + to_words(projector_->size()) + ", but the rig's calibration is for " +
                to_words(projector_size));
}

// Shows a pattern and takes it at its exposure.
GreyImage HardwareRig::image_of(const Pattern& pattern, const PatternSequence& sequence) {
  if (const double exposure_s = pattern.exposure * exposure_s_; camera_->exposure_s() != exposure_s)
    camera_->set_exposure_s(exposure_s);
  projector_->show(screen_of(pattern, sequence));
  std::this_thread::sleep_for(std::chrono::duration<double>(options_.settle_s));
  return camera_->take();
}

HardwareRig::Taken HardwareRig::capture_sequential(const PatternSequence& sequence) {
  Taken taken;
  for (const Pattern& pattern : sequence.patterns) {
    if (std::any_of(taken.references.begin(), taken.references.end(),
                    [&](const Reference& known) { return known.exposure == pattern.exposure; }))
      continue;
    Pattern white = kWhite, black = kBlack;
    white.exposure = black.exposure = pattern.exposure;
    taken.references.push_back({pattern.exposure, image_of(white, sequence).image, image_of(black, sequence).image});
  }
  if (begins_with_bits(sequence, 1)) {
    Pattern between = kBetween;
    between.exposure = sequence.patterns.front().exposure;
    image_of(between, sequence);
  }
  for (const Pattern& pattern : sequence.patterns) taken.images.push_back(image_of(pattern, sequence));
  return taken;
}

// Checks the images of each exposure by themselves. An exposure at which hardly any pixel is neither dark nor saturated is
// left out, unless it is the only one.
SequenceVerdict HardwareRig::check(const PatternSequence& sequence, const Taken& taken) const {
  SequenceVerdict verdict;
  for (const Reference& reference : taken.references) {
    PatternSequence part = sequence;
    part.patterns.clear();
    std::vector<cv::Mat> images;
    for (size_t i = 0; i < sequence.patterns.size(); ++i) {
      if (sequence.patterns[i].exposure != reference.exposure) continue;
      part.patterns.push_back(sequence.patterns[i]);
      part.patterns.back().exposure = 1;
      images.push_back(taken.images[i].image);
    }
    const SequenceVerdict found = check_sequence(part, images, reference.white, reference.black, options_.check);
    if (!found.good && !found.too_few_pixels) {
      const std::string at = taken.references.size() > 1
                                 ? " (of those at " + to_text(reference.exposure) + " times the rig's exposure)"
                                 : "";
      return {false, found.reason + at, found.gamma};
    }
    if (found.good || !verdict.good) verdict = found;
  }
  return verdict;
}

// Shows packed patterns and returns one exposure of each channel, indexed by the exposure number modulo 3.
std::array<GreyImage, 3> HardwareRig::images_of(const std::vector<cv::Mat1b>& screens) {
  constexpr int kMostExposures = 60;  // limit; some may be lost
  projector_->show(packed_image(screens, options_.packing));
  std::this_thread::sleep_for(std::chrono::duration<double>(options_.settle_s));
  std::array<GreyImage, 3> images;
  GreyImage image = camera_->take();
  for (int i = 0; i < kMostExposures; ++i) {
    images[image.number % 3] = image;
    if (std::none_of(images.begin(), images.end(), [](const GreyImage& of) { return of.image.empty(); })) return images;
    image = camera_->next();
  }
  throw Error("camera: the exposures are not consecutive: in " + std::to_string(kMostExposures) +
              " images, one of the three channels never occurred; is the camera triggered by the projector?");
}

// A longer exposure would mix a packed pattern with the next one.
void HardwareRig::check_packed_exposure() const {
  constexpr double kSlack = 1.002;  // rates of 59.94 Hz are reported as 60 Hz
  const double shown_s = projector_->refresh_s() / 3;
  if (exposure_s_ <= kSlack * shown_s) return;
  throw Error(
      "rig: the exposure of " + to_text(1e3 * exposure_s_) + " ms is longer than the " + to_text(1e3 * shown_s) +
      " ms for which each packed pattern is shown; shorten `camera.exposure_s`, or remove `packing` from the rig file");
}

HardwareRig::Taken HardwareRig::capture_packed(const PatternSequence& sequence) {
  const cv::Mat1b white = screen_of(kWhite, sequence), black = screen_of(kBlack, sequence);
  const auto brightest = [](const std::array<GreyImage, 3>& images) {
    const auto light = [](const GreyImage& image) { return cv::mean(image.image)[0]; };
    return static_cast<size_t>(std::max_element(images.begin(), images.end(),
                                                [&](const auto& a, const auto& b) { return light(a) < light(b); }) -
                               images.begin());
  };
  const uint64_t reopened = camera_->statistics().reopened;
  const std::array<GreyImage, 3> reference = images_of({white, black, black});
  const size_t first = brightest(reference);

  Taken taken;
  taken.references = {{1, reference[first].image, reference[(first + 1) % 3].image}};
  if (begins_with_bits(sequence, 3)) {
    const cv::Mat1b between = screen_of(kBetween, sequence);
    images_of({between, between, between});
  }
  for (size_t i = 0; i < sequence.patterns.size(); i += 3) {
    std::vector<cv::Mat1b> screens;
    for (size_t k = i; k < i + 3; ++k)
      screens.push_back(k < sequence.patterns.size() ? screen_of(sequence.patterns[k], sequence) : black);
    const std::array<GreyImage, 3> images = images_of(screens);
    for (size_t k = 0; k < 3 && i + k < sequence.patterns.size(); ++k) taken.images.push_back(images[(first + k) % 3]);
  }
  // White in another channel than at the start reveals a camera that sees the channels in another order.
  if (camera_->statistics().reopened != reopened || brightest(images_of({black, white, black})) != (first + 1) % 3)
    taken.fault = "the camera missed an exposure or took an extra one";
  return taken;
}

void HardwareRig::scale_exposure(double factor) {
  camera_->set_exposure_s(factor * exposure_s_);
  exposure_s_ = camera_->exposure_s();
}

std::optional<FringeStack> HardwareRig::capture(const PatternSequence& sequence) {
  if (sequence.width != model_.projector.width || sequence.height != model_.projector.height)
    throw Error("rig: patterns of " + to_words({sequence.width, sequence.height}) + " do not match the projector's " +
                to_words(projector_->size()));
  if (has_exposures(sequence) && !takes_exposures())
    throw Error(
        "rig: packed patterns are taken at one exposure; remove `exposures` from the patterns, or `packing` from "
        "the rig file");
  if (!takes_exposures()) check_packed_exposure();
  std::string reason;
  bool saturated = false;
  for (int attempt = 0; attempt < options_.attempts; ++attempt) {
    retaken_ += attempt > 0;
    const Taken taken = options_.packing.empty() ? capture_sequential(sequence) : capture_packed(sequence);
    FringeStack stack;
    stack.patterns = sequence;
    for (const GreyImage& image : taken.images) {
      stack.images.push_back(image.image);
      stack.exposure_s.push_back(image.exposure_s);
      // The camera sends an image when its exposure ends.
      stack.exposure_time_s.push_back(image.timestamp_s - 0.5 * image.exposure_s);
    }
    reason = taken.fault;
    saturated = false;
    if (!reason.empty()) continue;
    const SequenceVerdict verdict = check(sequence, taken);
    if (verdict.good) {
      gamma_ = verdict.gamma;
      stack.timestamp_s = reference_time_s(sequence, stack.exposure_time_s);
      stack.index = next_++;
      return stack;
    }
    reason = verdict.reason;
    saturated = verdict.saturated;
  }
  reason = "rig: no valid sequence in " + std::to_string(options_.attempts) + " attempts: " + reason;
  if (saturated) throw Overexposed(reason);
  throw SequenceRejected(reason);
}

}  // namespace fringeslam
