// SPDX-License-Identifier: Apache-2.0
// Compact storage of a frame in the map, for registration and later fusion: 11 bytes per pixel instead of 30. Depth is
// stored exactly, sigma to 0.05 %, normals to 0.003 degrees.
#pragma once

#include <cstdint>
#include <memory>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include "core/types/frame.h"
#include "core/types/pose.h"

namespace fringeslam {

struct StoredFrame;

// Returns the checksum of a frame's images, which must have no gaps between their rows.
uint64_t checksum_of(const StoredFrame& frame);

// Checks the images of a frame that lie in a file, when they are first restored: reading all frames of a large map when it
// is opened would take minutes.
class FrameCheck {
 public:
  // `where` begins the message: the file.
  FrameCheck(uint64_t checksum, std::string where) : checksum_(checksum), where_(std::move(where)) {}
  uint64_t checksum() const { return checksum_; }
  // Throws Error if the images do not have the checksum. Threads may call it at the same time.
  void check(const StoredFrame& frame) const;

 private:
  uint64_t checksum_;
  std::string where_;
  mutable std::once_flag once_;
};

// All images are H x W; where depth_m is NaN the others are meaningless.
struct StoredFrame {
  int index = 0;
  double timestamp_s = 0;
  cv::Mat1f depth_m;
  cv::Mat1s sigma;    // half-precision floats, mm
  cv::Mat2s normals;  // octahedral coordinates * 32767 (Cigolle et al. 2014); (-32768, -32768): none
  cv::Mat1b texture;
  std::shared_ptr<const FrameCheck> check = {};  // of images that lie in a file
};

// Compresses a frame.
StoredFrame stored(const Frame& frame);

// Restores the frame, without its 8-bit depth image. `rays` are those of the camera that took it. Throws Error if the images
// lie in a file and are damaged.
Frame restored(const StoredFrame& stored, const PixelRays& rays);

// An axis-aligned box in the world frame.
struct WorldBox {
  Eigen::Vector3d low_m, high_m;
};

// Returns boxes that together contain all points of the frame, one per block of pixels that has a point.
// Throws Error if the images lie in a file and are damaged.
std::vector<WorldBox> boxes_of(const StoredFrame& stored, const PixelRays& rays, const Pose& world_from_camera);

// Returns the memory of the stored images, bytes.
size_t bytes_of(const StoredFrame& stored);

}  // namespace fringeslam
