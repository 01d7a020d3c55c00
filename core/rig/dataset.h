// SPDX-License-Identifier: Apache-2.0
// Recorded fringe stacks: the folder format that RecordingRig writes and ReplayRig reads.
//
//   dataset.yaml                  format, name, seed, number of stacks, truth, thermal, imported and
//                                 image_times: true|false
//   rig.yaml  patterns.yaml       core/rig/rig_file.h
//   stacks/000000/stack.yaml      timestamp_s; exposure_s and exposure_time_s (middle): one per image
//   stacks/000000/thermal.png     16 bit, hundredths of a kelvin (.exr in degrees C if unquantised); only with
//                                 thermal: true in dataset.yaml
//   stacks/000000/00.png …        grey, 8 or 16 bit (.exr if unquantised), in the order of patterns.yaml
//   truth/                        simulated data only: truth.tum, truth/000000.exr (core/types/truth.h)
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
  bool imported = false;     // images of another rig, with the working range that their importer stated
  bool image_times = false;  // imported: the times of the images within a stack are known
};

constexpr const char* kDatasetFile = "dataset.yaml";

// Reads dataset.yaml. Throws Error if the folder is not a dataset.
DatasetInfo read_dataset_info(const std::filesystem::path& folder);

class YamlMap;

// Content of stack.yaml: the times of a stack.
std::string stack_yaml(const FringeStack& stack);
// Sets the times of a stack of `images` images from its stack.yaml; `timing` replaces exposure times that it lacks.
void read_stack_times(const YamlMap& map, size_t images, const Timing& timing, FringeStack& stack);

// Temperatures in hundredths of a kelvin; empty if that would round any of them.
std::optional<cv::Mat1w> centikelvin_image(const cv::Mat1f& temperature_c);
// Temperatures of a recorded image: CV_16UC1 in hundredths of a kelvin, or CV_32FC1 in degrees C. Throws Error, which
// `where` begins, if it has another type.
cv::Mat1f celsius_image(const cv::Mat& image, const std::string& where);

// File name stem of a stack or frame, such as "000042".
std::string stack_name(int index);

// Replays a dataset. The constructor checks that all image files exist; damaged images are detected when they are read.
class ReplayRig : public Rig {
 public:
  explicit ReplayRig(std::filesystem::path folder);
  const RigModel& model() const override { return model_; }
  const PatternSequence& sequence() const { return sequence_; }
  const DatasetInfo& info() const { return info_; }
  bool can_change_patterns() const override { return false; }
  std::vector<std::filesystem::path> inputs() const override { return {folder_}; }
  // Replaces lenses and relative pose by those of a calibration; see with_calibration().
  void recalibrate(const RigModel& calibration);
  // Returns the next stack. Throws Error unless `sequence` is the recorded sequence or a subsequence of it.
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

enum class Durable { no, yes };

// Forwards the captures of another rig and records them in `folder`, which must exist. finish() writes dataset.yaml,
// which makes the folder a dataset. If durable, each capture is on the disk before it returns, and dataset.yaml before finish()
// returns, so that a loss of power leaves a dataset of complete stacks.
class RecordingRig : public Rig {
 public:
  // Throws Error, and writes nothing, if `folder` is one that the inner rig reads.
  RecordingRig(Rig& inner, std::filesystem::path folder, Durable durable = Durable::no);
  const RigModel& model() const override { return inner_.model(); }
  std::optional<FringeStack> capture(const PatternSequence& sequence) override;
  bool can_change_patterns() const override { return false; }
  std::vector<std::filesystem::path> inputs() const override { return inner_.inputs(); }
  void finish(const std::string& name, uint64_t seed, bool has_truth, bool imported = false, bool image_times = false);

 private:
  Rig& inner_;
  std::filesystem::path folder_;
  Durable durable_;
  std::optional<PatternSequence> sequence_;
  int stacks_ = 0;
  bool has_thermal_ = false;
};

}  // namespace fringeslam
