// SPDX-License-Identifier: Apache-2.0
// Embree with its errors as exceptions.
#pragma once

struct RTCDeviceTy;

namespace fringeslam::sim {

// To be released by rtcReleaseDevice. Throws Error when this processor lacks what Embree needs; so do Embree's
// functions from then on when they fail.
RTCDeviceTy* new_embree_device();

}  // namespace fringeslam::sim
