// SPDX-License-Identifier: Apache-2.0
#include "core/map/mapped_file.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <new>

#include "core/types/error.h"

namespace fringeslam {

namespace {

// OpenCV asks it to free the pixels of an image; each image holds a reference to its file instead.
class MappedPixels : public cv::MatAllocator {
 public:
  cv::UMatData* allocate(int, const int*, int, void*, size_t*, cv::AccessFlag, cv::UMatUsageFlags) const override {
    throw Error("images cannot be created in a file that is read");
  }
  bool allocate(cv::UMatData* pixels, cv::AccessFlag, cv::UMatUsageFlags) const override { return pixels != nullptr; }
  void deallocate(cv::UMatData* pixels) const override {
    if (pixels == nullptr) return;
    delete static_cast<std::shared_ptr<const MappedFile>*>(pixels->handle);
    delete pixels;
  }
};

// Never destroyed: images may outlive static objects.
const MappedPixels& mapped_pixels() {
  static const auto* const allocator = new MappedPixels;
  return *allocator;
}

}  // namespace

MappedFile::MappedFile(int descriptor, uint64_t size)
    : descriptor_(::fcntl(descriptor, F_DUPFD_CLOEXEC, 0)), size_(static_cast<size_t>(size)) {
  if (size_ == 0) return;
  void* const data = ::mmap(nullptr, size_, PROT_READ, MAP_SHARED, descriptor_, 0);
  if (data == MAP_FAILED) {
    if (descriptor_ >= 0) ::close(descriptor_);
    throw std::bad_alloc();
  }
  data_ = static_cast<char*>(data);
}

MappedFile::~MappedFile() {
  if (data_ != nullptr) ::munmap(data_, size_);
  if (descriptor_ >= 0) ::close(descriptor_);
}

std::optional<uint64_t> MappedFile::offset_of(const void* address) const {
  const auto at = reinterpret_cast<uintptr_t>(address), begin = reinterpret_cast<uintptr_t>(data_);
  if (data_ == nullptr || at < begin || at >= begin + size_) return std::nullopt;
  return at - begin;
}

cv::Mat MappedFile::image(uint64_t offset, cv::Size size, int type) const {
  cv::Mat image(size, type, data_ + offset);
  auto* const pixels = new cv::UMatData(&mapped_pixels());
  pixels->data = pixels->origdata = image.data;
  pixels->size = image.total() * image.elemSize();
  pixels->handle = new std::shared_ptr<const MappedFile>(shared_from_this());
  pixels->refcount = 1;
  image.u = pixels;
  return image;
}

void MappedFile::prefetch(uint64_t offset, uint64_t bytes) const {
  constexpr uint64_t kPage = 4096;
  const uint64_t first = offset / kPage * kPage;
  ::madvise(data_ + first, static_cast<size_t>(offset - first + bytes), MADV_WILLNEED);
}

void MappedFile::release() const {
  if (data_ != nullptr) ::madvise(data_, size_, MADV_DONTNEED);
}

}  // namespace fringeslam
