// SPDX-License-Identifier: Apache-2.0
// Includes all public headers. docs/architecture.md in the project's repository describes how the parts fit together.
#pragma once

#include "fringeslam/front_end.h"
#include "fringeslam/map.h"
#include "fringeslam/mapper.h"
#include "fringeslam/patterns.h"
#include "fringeslam/rig.h"
#include "fringeslam/scoring.h"
#include "fringeslam/simulator.h"
#include "fringeslam/stack.h"
