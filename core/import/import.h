// SPDX-License-Identifier: Apache-2.0
// Third-party structured-light images as a Rig: import.yaml (core/import/import_file.h) describes a folder of images as
// fringe stacks, which RecordingRig can turn into a dataset.
#pragma once

#include "core/import/import_file.h"
#include "core/rig/rig.h"

namespace fringeslam {

// Completes the rig model with the size and bit depth of the first image. Throws Error if the images do not match the
// calibration or if the resulting rig is invalid.
class ImportedRig : public Rig {
 public:
  explicit ImportedRig(ImportPlan plan);
  // Replaces lenses and relative pose by those of a calibration; see with_calibration().
  void recalibrate(const RigModel& calibration);
  const RigModel& model() const override { return model_; }
  const PatternSequence& sequence() const { return plan_.sequence; }
  // Returns the next stack. Throws Error naming the image if it is damaged, differs from the first in size or type, or
  // has grey values above its bit depth.
  std::optional<FringeStack> capture(const PatternSequence& sequence) override;
  bool can_change_patterns() const override { return false; }
  std::vector<std::filesystem::path> inputs() const override { return inputs_of(plan_); }
  // Replaces the noise parameters. Throws Error if the bit depth differs.
  void set_sensor(const SensorModel& sensor);

 private:
  cv::Mat read(const std::filesystem::path& file) const;

  ImportPlan plan_;
  RigModel model_;
  std::filesystem::path first_;  // first image; all others must have its size and type
  int type_ = 0;
  size_t next_ = 0;
};

}  // namespace fringeslam
