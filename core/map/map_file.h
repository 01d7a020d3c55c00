// SPDX-License-Identifier: Apache-2.0
// Map files: a header line, size and checksum, then a zstd frame with the content of a KeyframeMap, little-endian. A
// map can only be loaded with the camera it was made with.
#pragma once

#include <string>
#include <string_view>

#include "core/map/keyframe_map.h"

namespace fringeslam {

constexpr const char* kMapFile = "saved.map";  // in a run folder

std::string to_bytes(const KeyframeMap& map);

// Throws Error, beginning with `where`, if the bytes are not a map, are damaged, have another format version, or were
// made with another camera.
KeyframeMap map_from_bytes(std::string_view bytes, const std::string& where, const RigModel& rig,
                           const MappingOptions& options);

}  // namespace fringeslam
