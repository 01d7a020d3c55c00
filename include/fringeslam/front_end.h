// SPDX-License-Identifier: Apache-2.0
// FrontEnd: fringe stack -> reconstructed view. Derive from it to plug in your decoder; FringeFrontEnd is ours.
// decode() and reconstruct() are its two stages, for decoders that replace only one of them.
// decode_rolling_window() decodes consecutive images of a moving scene without a rig model.
#pragma once

#include "core/decode/rolling_phase.h"
#include "core/mapper/front_end.h"
