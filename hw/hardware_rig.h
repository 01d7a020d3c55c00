// SPDX-License-Identifier: Apache-2.0
// Hardware rig: implements Rig with a physical camera and projector. White and black are captured with every sequence;
// from them, check_sequence() verifies using only the images that each pattern was shown at the right time. A sequence
// that fails the check is captured again, and refused after the given number of attempts. Two display modes:
//
//   one by one  shows a pattern, waits until it has settled, captures an image;
//   packed      three patterns form the channels of one colour image, which the projector shows cyclically, each for
//               one exposure of the externally triggered camera [C III.A]. Exposure n sees channel (n - n0) mod 3. A
//               white, black, black frame before the sequence determines n0; another one after the sequence verifies
//               that no exposure was missed.
//
// A projector that does not show the first pattern leaves what it showed before. Black there would pass for a Gray-code bit,
// so that a level between black and white precedes a sequence that begins with one.
#pragma once

#include <array>
#include <memory>
#include <string>
#include <vector>

#include "core/rig/rig.h"
#include "core/types/error.h"
#include "hw/grey_camera.h"
#include "hw/projector.h"
#include "hw/sequence_check.h"

namespace fringeslam {

struct HardwareOptions {
  double settle_s = 0.05;    // from the end of Projector::show() until the camera may expose
  int attempts = 3;          // attempts per sequence
  std::string packing = {};  // empty: one by one; "RGB" etc.: packed, channels in order of display
  SequenceCheckOptions check;
};

// The devices work, but the captured images do not show the requested patterns.
class SequenceRejected : public Error {
 public:
  using Error::Error;
};

// Thrown if no attempt shows the patterns because the last images are saturated.
class Overexposed : public SequenceRejected {
 public:
  using SequenceRejected::SequenceRejected;
};

class HardwareRig : public Rig {
 public:
  // Throws Error if the camera's or the projector's size differs from the model's.
  HardwareRig(const RigModel& model, std::unique_ptr<GreyCamera> camera, std::unique_ptr<Projector> projector,
              const HardwareOptions& options);
  const RigModel& model() const override { return model_; }
  // Captures one stack, never empty. Throws Error if a device fails, or if the patterns are packed and have several exposures
  // or an exposure longer than the projector shows each of them; SequenceRejected if all attempts fail the check, of which
  // Overexposed if the last one is saturated.
  std::optional<FringeStack> capture(const PatternSequence& sequence) override;

  // False if patterns are packed: all are taken at the rig's exposure then.
  bool takes_exposures() const { return options_.packing.empty(); }

  // Multiplies the exposure of the rig, to which the patterns' exposures are relative. Throws UnsupportedExposure if it is
  // outside the camera's limits.
  void scale_exposure(double factor);

  int retaken() const { return retaken_; }  // number of sequences captured again
  // Combined gamma of the projector's response and the patterns' correction, from the last valid sequence.
  double gamma() const { return gamma_; }
  const GreyCamera& camera() const { return *camera_; }

 private:
  // White and black images at an exposure relative to the rig's.
  struct Reference {
    double exposure = 1;
    cv::Mat white, black;
  };
  struct Taken {
    std::vector<Reference> references;  // one per exposure
    std::vector<GreyImage> images;      // one per pattern
    std::string fault;                  // empty if none
  };
  Taken capture_sequential(const PatternSequence& sequence);
  Taken capture_packed(const PatternSequence& sequence);
  GreyImage image_of(const Pattern& pattern, const PatternSequence& sequence);
  void check_packed_exposure() const;
  SequenceVerdict check(const PatternSequence& sequence, const Taken& taken) const;
  std::array<GreyImage, 3> images_of(const std::vector<cv::Mat1b>& screens);

  RigModel model_;
  std::unique_ptr<GreyCamera> camera_;
  std::unique_ptr<Projector> projector_;
  HardwareOptions options_;
  double exposure_s_ = 0;  // of the rig
  int next_ = 0, retaken_ = 0;
  double gamma_ = 1;
};

}  // namespace fringeslam
