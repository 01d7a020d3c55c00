// SPDX-License-Identifier: Apache-2.0
#include "core/map/file_memory.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <new>
#include <utility>

namespace fringeslam {

namespace {

constexpr size_t kSegment = size_t{64} << 20, kAlignment = 64, kPage = 4096;

size_t rounded_up(size_t bytes, size_t to) { return (bytes + to - 1) / to * to; }

std::filesystem::path default_folder() {
  const char* folder = std::getenv("TMPDIR");
  return folder != nullptr && *folder != '\0' ? folder : "/var/tmp";
}

// Opens a file that disappears with its descriptor; -1: not possible.
int open_unnamed(const std::filesystem::path& folder) {
  const int file = ::open(folder.c_str(), O_TMPFILE | O_RDWR | O_CLOEXEC, 0600);
  if (file >= 0) return file;
  // Some file systems cannot create files without a name.
  std::string path = folder / "fringeslam-XXXXXX";
  const int named = ::mkostemp(path.data(), O_CLOEXEC);
  if (named >= 0) ::unlink(path.c_str());
  return named;
}

}  // namespace

FileMemory::FileMemory(std::filesystem::path folder, size_t resident_bytes)
    : resident_bytes_(resident_bytes), file_(open_unnamed(folder.empty() ? default_folder() : std::move(folder))) {}

FileMemory::~FileMemory() {
  for (const Segment& segment : segments_) ::munmap(segment.data, segment.size);
  if (file_ >= 0) ::close(file_);
}

FileMemory::Segment& FileMemory::segment_for(size_t bytes) {
  if (!segments_.empty() && segments_.back().size - segments_.back().used >= bytes) return segments_.back();
  Segment segment;
  segment.size = std::max(kSegment, rounded_up(bytes, kPage));
  void* data = MAP_FAILED;
  // Reserves the space: writing to a mapped page without it would end the process.
  if (file_ >= 0 && ::posix_fallocate(file_, static_cast<off_t>(file_size_), static_cast<off_t>(segment.size)) == 0) {
    data = ::mmap(nullptr, segment.size, PROT_READ | PROT_WRITE, MAP_SHARED, file_, static_cast<off_t>(file_size_));
    segment.in_file = data != MAP_FAILED;
    file_size_ += segment.size;
  }
  if (data == MAP_FAILED)
    data = ::mmap(nullptr, segment.size, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  if (data == MAP_FAILED) throw std::bad_alloc();
  segment.data = static_cast<std::byte*>(data);
  segments_.push_back(segment);
  return segments_.back();
}

std::byte* FileMemory::allocate(size_t bytes) {
  const std::lock_guard lock(mutex_);
  const size_t size = rounded_up(std::max<size_t>(bytes, 1), kAlignment);
  if (since_release_ + size > resident_bytes_) release_segments();
  Segment& segment = segment_for(size);
  std::byte* const data = segment.data + segment.used;
  segment.used += size;
  allocated_ += size;
  since_release_ += size;
  return data;
}

void FileMemory::release() {
  const std::lock_guard lock(mutex_);
  release_segments();
}

// Pages of a shared mapping remain in the file; they return on access.
void FileMemory::release_segments() {
  for (const Segment& segment : segments_) {
    if (segment.in_file) ::madvise(segment.data, segment.size, MADV_DONTNEED);
  }
  since_release_ = 0;
}

size_t FileMemory::allocated_bytes() const {
  const std::lock_guard lock(mutex_);
  return allocated_;
}

bool FileMemory::on_disk() const {
  const std::lock_guard lock(mutex_);
  return std::all_of(segments_.begin(), segments_.end(), [](const Segment& segment) { return segment.in_file; });
}

}  // namespace fringeslam
