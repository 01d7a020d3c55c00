// SPDX-License-Identifier: Apache-2.0
// The `hardware:` section of a rig file: which camera and projector there are, and how they are set. Its keys are
// documented in hw/README.md.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>

#include "hw/aravis_camera.h"
#include "hw/dlpc350.h"
#include "hw/hardware_rig.h"

namespace fringeslam {

struct HardwareSettings {
  CameraSettings camera;                   // size and exposure are the rig's
  int display = -1;                        // of the projector; -1: the only one there
  std::optional<Dlpc350Settings> dlpc350;  // of a LightCrafter 4500's controller
  HardwareOptions rig;
};

// Of the rig that the file describes. Throws Error, with file and line, when there is no such section or it is wrong.
HardwareSettings read_hardware(const std::filesystem::path& rig_file, const RigModel& rig);

// Throws Error when it is not there, or several are and none was chosen.
std::unique_ptr<Projector> open_projector(const HardwareSettings& settings, const RigModel& rig);

// Opens what a rig file describes.
std::unique_ptr<HardwareRig> open_hardware(const std::filesystem::path& rig_file);

}  // namespace fringeslam
