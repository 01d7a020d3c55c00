// SPDX-License-Identifier: Apache-2.0
// Mapper: reconstructed view -> pose, keyframes, loop closure, map. Pipeline joins it with a front end; Driver runs a
// pipeline on a rig.
#pragma once

#include "core/mapper/driver.h"
#include "core/mapper/mapper.h"
#include "core/mapper/pipeline.h"
#include "core/mapper/thermal_observer.h"
