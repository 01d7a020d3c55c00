// SPDX-License-Identifier: Apache-2.0
// A frame as the map keeps it, to be registered against and to be fused once it is known where it was taken: 11 bytes a
// pixel instead of 30. Depth is kept to the last bit, sigma to 0.05 %, normals to 0.003 degrees.
#pragma once

#include "core/types/frame.h"

namespace fringeslam {

// All H x W. Where depth_m is NaN the others say nothing.
struct StoredFrame {
  int index = 0;
  double timestamp_s = 0;
  cv::Mat1f depth_m;
  cv::Mat1s sigma;    // half-precision floats, mm
  cv::Mat2s normals;  // the octahedron's two coordinates / 32767 (Cigolle et al. 2014); (-32768, -32768): no normal
  cv::Mat1b texture;
};

StoredFrame stored(const Frame& frame);

// The frame again, without its 8-bit depth image. `rays`: of the camera that took it.
Frame restored(const StoredFrame& stored, const PixelRays& rays);

size_t bytes_of(const StoredFrame& stored);

}  // namespace fringeslam
