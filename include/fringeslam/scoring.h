// SPDX-License-Identifier: Apache-2.0
// Scores against ground truth: trajectories, depth, motions, maps.
#pragma once

#include "core/score/map_score.h"
#include "core/score/score.h"
#include "core/score/trajectory_file.h"
#include "core/score/trajectory_score.h"
