// SPDX-License-Identifier: Apache-2.0
// FrontEnd: fringe stack -> reconstructed view. Derive from it to plug in your decoder; FringeFrontEnd is ours.
// decode() and reconstruct() are its two stages, for decoders that replace only one of them.
#pragma once

#include "core/mapper/front_end.h"
