// SPDX-License-Identifier: Apache-2.0
// A rig of a camera and a projector that are there: implements Rig. Before a sequence it shows white and black, by
// which check_sequence() tells from the images alone whether every pattern was shown when it should have been; a
// sequence that fails is taken again, and refused when that does not help. Patterns are shown in one of two ways:
//
//   one by one  shows a pattern, waits until it has settled, takes an image;
//   packed      three patterns are the channels of one colour image, which the projector shows one after the other,
//   again
//               and again, each for one exposure of a camera that follows its trigger [C III.A]. Exposure n sees
//               channel (n - n0) mod 3. A frame of white, black, black before the sequence tells n0, and another one
//               after it that no exposure was missed.
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
  double settle_s = 0.05;    // from when the projector says that an image is out until the camera may expose
  int attempts = 3;          // to take a sequence
  std::string packing = {};  // empty: one by one; such as "RGB": packed, the channels as the projector shows them
  SequenceCheckOptions check;
};

// The devices work, but what the camera saw is not what was to be shown.
class SequenceRefused : public Error {
 public:
  using Error::Error;
};

class HardwareRig : public Rig {
 public:
  // Throws Error when camera and projector have other sizes than the model says.
  HardwareRig(const RigModel& model, std::unique_ptr<GreyCamera> camera, std::unique_ptr<Projector> projector,
              const HardwareOptions& options);
  const RigModel& model() const override { return model_; }
  // Never empty: there is always more to see. Throws Error when devices fail, SequenceRefused when every
  // attempt shows other patterns.
  std::optional<FringeStack> capture(const PatternSequence& sequence) override;

  int retaken() const { return retaken_; }  // sequences
  // Of the projector's response and the patterns' correction together, as the last good sequence told.
  double gamma() const { return gamma_; }
  const GreyCamera& camera() const { return *camera_; }

 private:
  struct Taken {
    cv::Mat white, black;
    std::vector<GreyImage> images;  // of the sequence
    std::string fault;              // empty: none
  };
  Taken take_one_by_one(const PatternSequence& sequence);
  Taken take_packed(const PatternSequence& sequence);
  GreyImage image_of(const cv::Mat1b& screen);
  std::array<GreyImage, 3> images_of(const std::vector<cv::Mat1b>& screens);

  RigModel model_;
  std::unique_ptr<GreyCamera> camera_;
  std::unique_ptr<Projector> projector_;
  HardwareOptions options_;
  int next_ = 0, retaken_ = 0;
  double gamma_ = 1;
};

}  // namespace fringeslam
