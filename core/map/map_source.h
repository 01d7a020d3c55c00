// SPDX-License-Identifier: Apache-2.0
// Where the parts of a map lie in the file from which it was opened (core/storage/map_file.h).
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "core/map/mapped_file.h"

namespace fringeslam {

// A part of a map file, bytes.
struct FilePart {
  uint64_t offset = 0, size = 0, checksum = 0;
};

struct MapSource {
  std::shared_ptr<const MappedFile> file;
  struct OfKeyframe {
    FilePart landmarks, digest;
  };
  std::vector<OfKeyframe> keyframes;
};

}  // namespace fringeslam
