// SPDX-License-Identifier: Apache-2.0
// A map file that is being written: parts are appended, then the index. See map_index.h.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>

#include "core/storage/map_index.h"

namespace fringeslam {

class MapParts {
 public:
  // Creates the file, or empties it. Throws Error if that fails.
  explicit MapParts(std::filesystem::path file);
  // Continues a file whose parts end at `end`; what follows is overwritten.
  MapParts(std::filesystem::path file, uint64_t end);
  ~MapParts();
  MapParts(const MapParts&) = delete;
  MapParts& operator=(const MapParts&) = delete;

  // Append a part. After an Error, the next one takes its place. Throws Error also for a frame of another size than the
  // layout's, or if the frame lies in a file and is damaged.
  StoredPart add(const StoredFrame& frame, const FrameLayout& layout);
  StoredPart add(std::string_view bytes);
  // Appends a part of another file as it is, with the checksum that it should have.
  StoredPart add(const MappedFile& from, const FilePart& part);

  // Where the next part begins; going back discards later ones.
  uint64_t end() const { return end_; }
  void go_back(uint64_t end) { end_ = end; }

  // Waits until the parts are on the disk. Throws Error if they cannot be written.
  void sync();
  // Writes the index after the parts and cuts off what follows, and waits until all is on the disk.
  void finish(const MapIndex& index);

 private:
  void write(const void* bytes, uint64_t size, uint64_t at) const;

  std::filesystem::path file_;
  int descriptor_ = -1;
  uint64_t end_ = kMapAlignment;
  int failed_errno_ = 0;  // of the first sync() that failed
};

}  // namespace fringeslam
