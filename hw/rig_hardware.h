// SPDX-License-Identifier: Apache-2.0
// The `hardware:` section of a rig file, which selects and configures camera and projector. Keys: see hw/README.md.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>

#include "hw/aravis_camera.h"
#include "hw/dlpc350.h"
#include "hw/hardware_rig.h"

namespace fringeslam {

struct HardwareSettings {
  CameraSettings camera;                   // size and default exposure are the rig's
  int display = -1;                        // of the projector; -1: the only display
  std::optional<Dlpc350Settings> dlpc350;  // set for a LightCrafter 4500
  HardwareOptions rig;
};

// Reads the section from a rig file that describes `rig`. Throws Error with file and line if it is missing or invalid.
HardwareSettings read_hardware(const std::filesystem::path& rig_file, const RigModel& rig);

// Opens the projector. Throws Error if it does not exist, or if there are several displays and none is chosen.
std::unique_ptr<Projector> open_projector(const HardwareSettings& settings, const RigModel& rig);

// Opens the rig that the file describes.
std::unique_ptr<HardwareRig> open_hardware(const std::filesystem::path& rig_file);

}  // namespace fringeslam
