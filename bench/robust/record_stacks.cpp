// SPDX-License-Identifier: Apache-2.0
// record_stacks RIG FOLDER N: records N stacks of random images as `fringeslam capture` does, but without a camera. After
// each stack it prints the number of stacks that the dataset has.
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <filesystem>
#include <opencv2/core.hpp>

#include "core/patterns/design.h"
#include "core/rig/dataset.h"
#include "core/rig/rig_file.h"

namespace fringeslam {
namespace {

class RandomRig : public Rig {
 public:
  explicit RandomRig(RigModel model) : model_(std::move(model)) {}
  const RigModel& model() const override { return model_; }
  std::optional<FringeStack> capture(const PatternSequence& sequence) override {
    FringeStack stack;
    stack.index = next_++;
    stack.timestamp_s = 0.5 * stack.index;
    stack.patterns = sequence;
    for (size_t i = 0; i < sequence.patterns.size(); ++i) {
      cv::Mat1b image(model_.camera.height, model_.camera.width);
      random_.fill(image, cv::RNG::UNIFORM, 0, 256);
      stack.images.push_back(image);
      stack.exposure_s.push_back(0.002);
      stack.exposure_time_s.push_back(stack.timestamp_s + 0.01 * static_cast<double>(i));
    }
    return stack;
  }

 private:
  RigModel model_;
  cv::RNG random_{7};
  int next_ = 0;
};

int record(const std::filesystem::path& rig_file, const std::filesystem::path& folder, int stacks) {
  RandomRig rig(read_rig(rig_file));
  std::filesystem::create_directories(folder);
  RecordingRig recording(rig, folder);
  const PatternSequence sequence = phase_shift_sequence(1024, 768, {1040, 131}, 3, Axis::columns, 8);
  for (int i = 0; i < stacks; ++i) {
    recording.capture(sequence);
    recording.finish("random", 1, false);
    std::printf("%d\n", i + 1);
    std::fflush(stdout);
  }
  return 0;
}

}  // namespace
}  // namespace fringeslam

int main(int argc, char** argv) {
  if (argc != 4) return 2;
  try {
    return fringeslam::record(argv[1], argv[2], std::atoi(argv[3]));
  } catch (const std::exception& e) {
    std::fprintf(stderr, "fringeslam: %s\n", e.what());
    return 2;
  }
}
