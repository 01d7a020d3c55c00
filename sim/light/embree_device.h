// SPDX-License-Identifier: Apache-2.0
// Embree device that reports errors as exceptions.
#pragma once

struct RTCDeviceTy;

namespace fringeslam::sim {

// Returns a new Embree device, to be released with rtcReleaseDevice. Throws Error if Embree does not support this
// processor. Embree calls on the device throw Error on failure.
RTCDeviceTy* new_embree_device();

}  // namespace fringeslam::sim
