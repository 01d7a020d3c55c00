// SPDX-License-Identifier: Apache-2.0
// OpenCV's FastICPOdometry as a peer of frame registration.
#pragma once

#include <optional>

#include "bench/frame_pairs.h"

namespace fringeslam::bench {

// Registers the depth of both frames by OpenCV's FastICPOdometry, starting from no motion; empty on failure.
std::optional<Pose> opencv_fast_icp(const FramePair& pair);

}  // namespace fringeslam::bench
