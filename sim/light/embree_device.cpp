// SPDX-License-Identifier: Apache-2.0
#include "sim/light/embree_device.h"

#include <embree3/rtcore.h>

#include <string>

#include "core/types/error.h"

namespace fringeslam::sim {

namespace {

void throw_embree_error(void*, RTCError code, const char* message) {
  throw Error("Embree: error " + std::to_string(code) + ": " + (message ? message : "no message"));
}

}  // namespace

RTCDeviceTy* new_embree_device() {
  RTCDevice device = rtcNewDevice(nullptr);
  if (!device) throw Error("Embree: cannot create a device; the processor must support SSE2");
  rtcSetDeviceErrorFunction(device, throw_embree_error, nullptr);
  return device;
}

}  // namespace fringeslam::sim
