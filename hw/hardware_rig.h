// SPDX-License-Identifier: Apache-2.0
// A rig of a camera and a projector that are there: implements Rig. Steps through the patterns itself: shows one, waits
// until it has settled, takes an image. Before a sequence it shows white and black, by which check_sequence() tells
// from the images alone whether every pattern was shown when it should have been; a sequence that fails is taken again,
// and refused when that does not help.
#pragma once

#include <functional>
#include <memory>

#include "core/rig/rig.h"
#include "hw/grey_camera.h"
#include "hw/projector.h"
#include "hw/sequence_check.h"

namespace fringeslam {

struct HardwareOptions {
  double settle_s = 0.05;  // from when the projector says that an image is out until the camera may expose
  int attempts = 3;        // to take a sequence
  SequenceCheckOptions check;
};

class HardwareRig : public Rig {
 public:
  // Throws Error when camera and projector have other sizes than the model says.
  HardwareRig(const RigModel& model, std::unique_ptr<GreyCamera> camera, std::unique_ptr<Projector> projector,
              const HardwareOptions& options);
  const RigModel& model() const override { return model_; }
  // Never empty: there is always more to see. Throws Error when devices fail, or the sequence is refused.
  std::optional<FringeStack> capture(const PatternSequence& sequence) override;

  int retaken() const { return retaken_; }  // sequences
  const GreyCamera& camera() const { return *camera_; }

 private:
  GreyImage image_of(const Pattern& pattern, const PatternSequence& sequence);

  RigModel model_;
  std::unique_ptr<GreyCamera> camera_;
  std::unique_ptr<Projector> projector_;
  HardwareOptions options_;
  int next_ = 0, retaken_ = 0;
};

}  // namespace fringeslam
