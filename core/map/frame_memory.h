// SPDX-License-Identifier: Apache-2.0
// Images of a map's frames, and descriptors of its keypoints, in memory that the kernel can keep on disk (core/map/file_memory.h).
#pragma once

#include <memory>
#include <opencv2/core.hpp>

#include "core/map/file_memory.h"
#include "core/map/stored_frame.h"

namespace fringeslam {

// Moves frames to such memory. The images may outlive this object: they keep the memory.
class FrameMemory {
 public:
  FrameMemory();
  // Returns the frame with its images moved. Images share their pixels as usual when copied.
  StoredFrame moved(const StoredFrame& frame);
  // Returns a copy of one image in such memory.
  cv::Mat moved(const cv::Mat& image);

  // Lets the kernel keep all frames on disk until they are used again.
  void release() const;

  const FileMemory& memory() const;

 private:
  class Allocator;
  std::shared_ptr<Allocator> allocator_;
};

}  // namespace fringeslam
