// SPDX-License-Identifier: Apache-2.0
// A map as a file, to go on in later. One header line, sizes and a checksum, then a zstd frame with what KeyframeMap
// holds, little-endian. It fits the camera it was made with and no other.
#pragma once

#include <string>
#include <string_view>

#include "core/map/keyframe_map.h"

namespace fringeslam {

std::string to_bytes(const KeyframeMap& map);

// Throws Error, beginning with `where`, when the bytes are no map, are damaged, are of a later format, or were made
// with another camera.
KeyframeMap map_from_bytes(std::string_view bytes, const std::string& where, const RigModel& rig,
                           const MappingOptions& options);

}  // namespace fringeslam
