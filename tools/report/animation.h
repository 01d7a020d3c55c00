// SPDX-License-Identifier: Apache-2.0
// Animation of a run: the growing map beside fringes and depth, as a GIF.
#pragma once

#include <filesystem>
#include <vector>

#include "core/map/cloud.h"
#include "core/mapper/mapper.h"
#include "core/types/fringe_stack.h"

namespace fringeslam::tools {

class Animation {
 public:
  // Takes every `every`-th view.
  Animation(const RigModel& rig, int every) : rig_(rig), every_(every) {}
  // Call for each view after it was mapped.
  void add(const FringeStack& stack, const FrameResult& result, const KeyframeMap& map);
  // Draws the map as it grew, with the final poses, and writes the file. Throws Error if it cannot be written.
  void write(const std::filesystem::path& file, const Mapper& mapper, const CloudOptions& cloud) const;

 private:
  struct Sample {
    cv::Mat3b fringes, depth;
    size_t frames = 0;  // of the map so far
    int views = 0;      // tracked so far
  };
  RigModel rig_;
  int every_, seen_ = 0, tracked_ = 0;
  std::vector<Sample> samples_;
};

}  // namespace fringeslam::tools
