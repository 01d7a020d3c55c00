// SPDX-License-Identifier: Apache-2.0
// A rig that returns given images, and a dataset recorded from it.
#pragma once

#include <filesystem>
#include <opencv2/core.hpp>
#include <utility>
#include <vector>

#include "core/rig/dataset.h"
#include "core/rig/rig_file.h"

namespace fringeslam::test {

class FakeRig : public Rig {
 public:
  FakeRig(RigModel model, std::vector<FringeStack> stacks) : model_(std::move(model)), stacks_(std::move(stacks)) {}
  const RigModel& model() const override { return model_; }
  std::optional<FringeStack> capture(const PatternSequence&) override {
    if (next_ == stacks_.size()) return std::nullopt;
    return stacks_[next_++];
  }

 private:
  RigModel model_;
  std::vector<FringeStack> stacks_;
  size_t next_ = 0;
};

inline RigModel thesis_rig() {
  return read_rig(std::filesystem::path(FRINGESLAM_SOURCE_DIR) / "scenes/rigs/thesis.yaml");
}

// Returns the thesis rig with 1 / `factor` of the camera pixels along each side and the same field of view.
inline RigModel thesis_rig_reduced(int factor) {
  RigModel rig = thesis_rig();
  Pinhole& camera = rig.camera;
  camera.width /= factor, camera.height /= factor;
  camera.fx /= factor, camera.fy /= factor;
  camera.cx = (camera.cx + 0.5) / factor - 0.5, camera.cy = (camera.cy + 0.5) / factor - 0.5;
  return rig;
}

inline RigModel tiny_rig() { return thesis_rig_reduced(10); }

inline PatternSequence short_sequence() { return phase_shift_sequence(1024, 768, {1040, 131}, 3, Axis::columns, 8); }

// Returns two stacks of noise over the pixel type's range, at timestamps without a short decimal form.
inline std::vector<FringeStack> noise_stacks(int type) {
  cv::RNG random(7);
  std::vector<FringeStack> stacks(2);
  for (int index = 0; index < 2; ++index) {
    FringeStack& stack = stacks[static_cast<size_t>(index)];
    stack.index = index;
    stack.timestamp_s = 0.1 + 0.2 + index / 3.0;
    stack.patterns = short_sequence();
    for (size_t i = 0; i < short_sequence().patterns.size(); ++i) {
      cv::Mat image(tiny_rig().camera.height, tiny_rig().camera.width, type);
      const double high = type == CV_8UC1 ? 256 : type == CV_16UC1 ? 65536 : 1e4;
      random.fill(image, cv::RNG::UNIFORM, type == CV_32FC1 ? -high : 0, high);
      stack.images.push_back(image);
      stack.exposure_s.push_back(1.0 / 360 + 1e-7 * static_cast<double>(i));
      stack.exposure_time_s.push_back(stack.timestamp_s + static_cast<double>(i) / 7 - 0.4);
    }
  }
  return stacks;
}

// The rig whose camera has as many bits as the stacks' images.
inline RigModel rig_of(const std::vector<FringeStack>& stacks) {
  RigModel model = tiny_rig();
  if (stacks.front().images.front().depth() == CV_16U) model.sensor.bits = 16;
  return model;
}

inline void record(const std::filesystem::path& folder, const std::vector<FringeStack>& stacks,
                   const std::string& name = "noise", uint64_t seed = 1) {
  std::filesystem::create_directories(folder);
  FakeRig rig(rig_of(stacks), stacks);
  RecordingRig recording(rig, folder);
  while (recording.capture(short_sequence())) continue;
  recording.finish(name, seed, false);
}

}  // namespace fringeslam::test
