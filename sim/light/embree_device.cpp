// SPDX-License-Identifier: Apache-2.0
#include "sim/light/embree_device.h"

#include <embree3/rtcore.h>

#include <string>

#include "core/types/error.h"
#include "core/types/selected_instruction_set.h"

namespace fringeslam::sim {

namespace {

void throw_embree_error(void*, RTCError code, const char* message) {
  throw Error("Embree: error " + std::to_string(code) + ": " + (message ? message : "no message"));
}

// Returns Embree's configuration for the selected instruction set; Embree selects the widest one by itself.
const char* embree_configuration() {
  switch (selected_instruction_set()) {
    case InstructionSet::portable:
      return "max_isa=sse2";
    case InstructionSet::avx2:
      return "max_isa=avx2";
    case InstructionSet::avx512:
      break;
  }
  return nullptr;
}

}  // namespace

RTCDeviceTy* new_embree_device() {
  RTCDevice device = rtcNewDevice(embree_configuration());
  if (!device) throw Error("Embree: cannot create a device; is there enough memory?");
  rtcSetDeviceErrorFunction(device, throw_embree_error, nullptr);
  return device;
}

}  // namespace fringeslam::sim
