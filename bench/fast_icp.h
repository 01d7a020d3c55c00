// SPDX-License-Identifier: Apache-2.0
// A peer of frame registration.
#pragma once

#include <optional>

#include "bench/frame_pairs.h"

namespace fringeslam::bench {

// OpenCV's FastICPOdometry, on the depth of both frames and from no motion; not found: nothing.
std::optional<Pose> opencv_fast_icp(const FramePair& pair);

}  // namespace fringeslam::bench
