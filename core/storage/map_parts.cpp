// SPDX-License-Identifier: Apache-2.0
#include "core/storage/map_parts.h"

#include <fcntl.h>
#include <unistd.h>
#include <xxhash.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

#include "core/types/error.h"

namespace fringeslam {

namespace {

template <class Call>
auto uninterrupted(const Call& call) {
  auto result = call();
  while (result < 0 && errno == EINTR) result = call();
  return result;
}

int opened(const std::filesystem::path& file, int flags) {
  const int descriptor = uninterrupted([&] { return ::open(file.c_str(), O_RDWR | O_CLOEXEC | flags, 0666); });
  if (descriptor < 0) throw Error(file.string() + ": cannot be written: " + std::strerror(errno));
  return descriptor;
}

}  // namespace

MapParts::MapParts(std::filesystem::path file) : file_(std::move(file)), descriptor_(opened(file_, O_CREAT | O_TRUNC)) {
  std::string head(kMapMagic);
  head.resize(kMapAlignment, '\0');
  try {
    write(head.data(), head.size(), 0);
  } catch (...) {
    ::close(descriptor_);
    throw;
  }
}

MapParts::MapParts(std::filesystem::path file, uint64_t end)
    : file_(std::move(file)), descriptor_(opened(file_, 0)), end_(end) {}

MapParts::~MapParts() { ::close(descriptor_); }

void MapParts::write(const void* bytes, uint64_t size, uint64_t at) const {
  const char* next = static_cast<const char*>(bytes);
  while (size > 0) {
    const ssize_t written =
        uninterrupted([&] { return ::pwrite(descriptor_, next, static_cast<size_t>(size), static_cast<off_t>(at)); });
    if (written <= 0) throw Error(file_.string() + ": cannot be written: " + std::strerror(written < 0 ? errno : EIO));
    next += written, at += static_cast<uint64_t>(written), size -= static_cast<uint64_t>(written);
  }
}

StoredPart MapParts::add(const StoredFrame& frame, const FrameLayout& layout) {
  const std::pair<const cv::Mat*, uint64_t> images[] = {{&frame.depth_m, 0},
                                                        {&frame.sigma, layout.sigma},
                                                        {&frame.normals, layout.normals},
                                                        {&frame.texture, layout.texture}};
  StoredPart part;
  part.offset = end_;
  part.size = layout.bytes;
  part.checksum = checksum_of(frame);
  if (frame.check && frame.check->checksum() != part.checksum) frame.check->check(frame);
  for (const auto& [image, at] : images) {
    if (image->size() != layout.size || !image->isContinuous())
      throw Error(file_.string() + ": an image of the map has another size than its camera");
    write(image->data, image->total() * image->elemSize(), end_ + at);
  }
  // The last part must reach to its end.
  const uint64_t written = layout.texture + static_cast<uint64_t>(layout.size.area());
  const char zeros[kMapAlignment] = {};
  write(zeros, layout.bytes - written, end_ + written);
  end_ += layout.bytes;
  return part;
}

StoredPart MapParts::add(std::string_view bytes) {
  StoredPart part;
  part.offset = end_;
  part.size = bytes.size();
  part.checksum = XXH64(bytes.data(), bytes.size(), 0);
  write(bytes.data(), bytes.size(), end_);
  const char zeros[kMapAlignment] = {};
  write(zeros, aligned(bytes.size()) - bytes.size(), end_ + bytes.size());
  end_ += aligned(bytes.size());
  return part;
}

StoredPart MapParts::add(const MappedFile& from, const FilePart& part) {
  StoredPart copied;
  copied.offset = end_;
  copied.size = part.size;
  copied.checksum = part.checksum;
  // In the kernel where the file systems can.
  uint64_t done = 0;
  while (done < part.size) {
    auto source = static_cast<off64_t>(part.offset + done), target = static_cast<off64_t>(end_ + done);
    const ssize_t count = uninterrupted([&] {
      return ::copy_file_range(from.descriptor(), &source, descriptor_, &target, static_cast<size_t>(part.size - done),
                               0);
    });
    if (count <= 0) break;
    done += static_cast<uint64_t>(count);
  }
  write(from.bytes().data() + part.offset + done, part.size - done, end_ + done);
  const char zeros[kMapAlignment] = {};
  write(zeros, aligned(part.size) - part.size, end_ + part.size);
  end_ += aligned(part.size);
  return copied;
}

void MapParts::sync() {
  // The kernel reports an error once and may forget the pages: a later success would not mean that they are on the disk.
  if (failed_errno_ == 0 && uninterrupted([&] { return ::fdatasync(descriptor_); }) != 0 && errno != EINVAL &&
      errno != EROFS)
    failed_errno_ = errno;
  if (failed_errno_ != 0)
    throw Error(file_.string() + ": cannot be written to the disk: " + std::strerror(failed_errno_));
}

void MapParts::finish(const MapIndex& index) {
  const std::string bytes = index_bytes(index, end_);
  write(bytes.data(), bytes.size(), end_);
  if (uninterrupted([&] { return ::ftruncate(descriptor_, static_cast<off_t>(end_ + bytes.size())); }) != 0)
    throw Error(file_.string() + ": cannot be written: " + std::strerror(errno));
  sync();
}

}  // namespace fringeslam
