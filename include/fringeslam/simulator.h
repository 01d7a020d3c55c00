// SPDX-License-Identifier: Apache-2.0
// VirtualRig: renders fringe stacks of a scene at known poses, with ground truth as a separate value.
#pragma once

#include "sim/scene/scene.h"
#include "sim/virtual_rig.h"
