// SPDX-License-Identifier: Apache-2.0
// FringeStack: the camera images of one pattern sequence, with the pattern and the time of every exposure. Also the plain
// values that stages exchange: Frame (reconstructed view), Pose, Trajectory, Pinhole, RigModel.
#pragma once

#include "core/types/frame.h"
#include "core/types/fringe_stack.h"
#include "core/types/pose.h"
#include "core/types/rig_model.h"
#include "core/types/trajectory.h"
