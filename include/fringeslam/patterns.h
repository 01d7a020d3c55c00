// SPDX-License-Identifier: Apache-2.0
// Patterns: phase-shifted fringes, Gray codes, flat images; sequences of them, and their images for a projector.
#pragma once

#include "core/patterns/design.h"
#include "core/patterns/patterns.h"
