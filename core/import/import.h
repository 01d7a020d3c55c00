// SPDX-License-Identifier: Apache-2.0
// Images of any structured-light rig as a Rig: what import.yaml (core/import/import_file.h) says about a folder of images
// makes them fringe stacks, which RecordingRig turns into a dataset.
#pragma once

#include "core/import/import_file.h"
#include "core/rig/rig.h"

namespace fringeslam {

// Completes the rig by the size and the bit depth of the first image. Throws Error when the images are not those of
// the calibration, or when the rig that results can measure nothing.
class ImportedRig : public Rig {
 public:
  explicit ImportedRig(ImportPlan plan);
  const RigModel& model() const override { return model_; }
  const PatternSequence& sequence() const { return plan_.sequence; }
  // Throws Error naming the image that is damaged, of another size or type than the first, or brighter than its bits.
  std::optional<FringeStack> capture(const PatternSequence& sequence) override;

 private:
  cv::Mat read(const std::filesystem::path& file) const;

  ImportPlan plan_;
  RigModel model_;
  std::filesystem::path first_;  // image, whose size and type all others have
  int type_ = 0;
  size_t next_ = 0;
};

}  // namespace fringeslam
