// SPDX-License-Identifier: Apache-2.0
// Memory for data that is written once and rarely read again, such as the frames of a map. It is mapped from a file without
// a name, so that the kernel can keep it on disk instead of in memory.
#pragma once

#include <cstddef>
#include <filesystem>
#include <memory>
#include <mutex>
#include <vector>

namespace fringeslam {

class FileMemory {
 public:
  // The file is in `folder`; by default in $TMPDIR, else in /var/tmp, which unlike /tmp is always on disk. If no file can
  // be created or the disk is full, ordinary memory is used instead. At most about `resident_bytes` of what has been
  // allocated stay in memory until they are used again.
  explicit FileMemory(std::filesystem::path folder = {}, size_t resident_bytes = size_t{128} << 20);
  ~FileMemory();
  FileMemory(const FileMemory&) = delete;
  FileMemory& operator=(const FileMemory&) = delete;

  // Returns zeroed memory, aligned to 64 bytes, that lives as long as this object. Threads may allocate at the same time.
  // Throws std::bad_alloc if there is neither disk space nor memory.
  std::byte* allocate(size_t bytes);

  // Lets the kernel keep everything on disk until it is used again.
  void release();

  // Number of bytes that have been allocated, and whether all of them are in the file.
  size_t allocated_bytes() const;
  bool on_disk() const;

 private:
  struct Segment {
    std::byte* data = nullptr;
    size_t size = 0, used = 0;
    bool in_file = false;
  };
  Segment& segment_for(size_t bytes);
  void release_segments();

  mutable std::mutex mutex_;
  size_t resident_bytes_;
  int file_ = -1;
  size_t file_size_ = 0, allocated_ = 0, since_release_ = 0;
  std::vector<Segment> segments_;
};

}  // namespace fringeslam
