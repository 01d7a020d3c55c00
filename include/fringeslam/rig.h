// SPDX-License-Identifier: Apache-2.0
// Rig: the interface between where images come from and what is done with them. Derive from it to connect your sensor.
// Also rig files (rig.yaml), recorded datasets (ReplayRig, RecordingRig) and BackgroundRig for slow consumers.
#pragma once

#include "core/rig/background_rig.h"
#include "core/rig/dataset.h"
#include "core/rig/rig.h"
#include "core/rig/rig_file.h"
