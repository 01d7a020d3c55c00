// SPDX-License-Identifier: Apache-2.0
// Saved maps (map_index.h describes the file). A map can only be opened with the camera it was made with.
#pragma once

#include <filesystem>
#include <string>

#include "core/map/keyframe_map.h"
#include "core/storage/map_index.h"

namespace fringeslam {

constexpr const char* kMapFile = "saved.map";  // in a run folder

// Writes a map, part by part. Not atomic: write it to a StagedFile or StagedFolder. Throws Error if it cannot be written.
void write_map(const std::filesystem::path& file, const KeyframeMap& map);

// Opens a map. Its images stay in the file, which is mapped: they are read and checked when they are used, and the file must
// not be changed in place meanwhile (replacing it is harmless). Throws Error, beginning with the file's name, if it is not
// a map, is damaged, has another format version, or was made with another camera.
KeyframeMap open_map(const std::filesystem::path& file, const RigModel& rig, const MappingOptions& options);

// Contents of a map file.
struct MapFileInfo {
  IndexOfFile content;
  uint64_t bytes = 0;
};
MapFileInfo read_map_info(const std::filesystem::path& file);
// Compares all parts with their checksums. Throws Error if one is damaged.
void verify_map(const std::filesystem::path& file);

// A map file, mapped.
std::shared_ptr<const MappedFile> map_into_memory(const std::filesystem::path& file);
// A frame whose images lie in the file.
StoredFrame frame_in_file(const MappedFile& file, const FilePart& part, const FrameLayout& layout,
                          const std::string& where);

}  // namespace fringeslam
