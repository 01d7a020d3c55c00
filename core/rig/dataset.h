// SPDX-License-Identifier: Apache-2.0
// Recorded fringe stacks: a folder that is both what RecordingRig writes and what ReplayRig reads.
//
//   dataset.yaml                  format, name, seed, number of stacks, truth and thermal: true|false
//   rig.yaml  patterns.yaml       core/rig/rig_file.h
//   stacks/000000/stack.yaml      timestamp_s, exposure_s: one for each image
//   stacks/000000/thermal.png     16 bit, hundredths of a kelvin (.exr in degrees C when unquantised); only where
//                                 dataset.yaml says thermal: true
//   stacks/000000/00.png …        grey, 8 or 16 bit (.exr when unquantised), in the order of patterns.yaml
//   truth/                        only of simulated data: truth.tum, truth/000000.exr (core/types/truth.h)
#pragma once

#include <cstdint>
#include <filesystem>

#include "core/rig/rig.h"

namespace fringeslam {

struct DatasetInfo {
  std::string name;
  uint64_t seed = 0;
  int stacks = 0;
  bool has_truth = false;
  bool has_thermal = false;
};

constexpr const char* kDatasetFile = "dataset.yaml";

// Throws Error when the folder is not a dataset.
DatasetInfo read_dataset_info(const std::filesystem::path& folder);

// "000042", the name of the files of one stack or frame.
std::string stack_name(int index);

// Plays a dataset. The constructor checks that every image file exists; a damaged one is found when
// it is reached.
class ReplayRig : public Rig {
 public:
  explicit ReplayRig(std::filesystem::path folder);
  const RigModel& model() const override { return model_; }
  const PatternSequence& sequence() const { return sequence_; }
  const DatasetInfo& info() const { return info_; }
  // Throws Error when `sequence` is neither the recorded one nor part of it, in its order.
  std::optional<FringeStack> capture(const PatternSequence& sequence) override;

 private:
  std::vector<size_t> images_of(const PatternSequence& sequence) const;
  cv::Mat1f thermal_of(const std::filesystem::path& stack) const;

  std::filesystem::path folder_;
  DatasetInfo info_;
  RigModel model_;
  PatternSequence sequence_;
  int next_ = 0;
};

// Passes on what another rig captures and writes it into `folder`, which must exist. finish() writes
// dataset.yaml: without it the folder is not a dataset.
class RecordingRig : public Rig {
 public:
  RecordingRig(Rig& inner, std::filesystem::path folder);
  const RigModel& model() const override { return inner_.model(); }
  std::optional<FringeStack> capture(const PatternSequence& sequence) override;
  void finish(const std::string& name, uint64_t seed, bool has_truth);

 private:
  Rig& inner_;
  std::filesystem::path folder_;
  std::optional<PatternSequence> sequence_;
  int stacks_ = 0;
  bool has_thermal_ = false;
};

}  // namespace fringeslam
