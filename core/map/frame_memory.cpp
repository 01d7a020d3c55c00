// SPDX-License-Identifier: Apache-2.0
#include "core/map/frame_memory.h"

#include <utility>

#include "core/types/options.h"

namespace fringeslam {

// OpenCV asks the allocator of an image for its pixels. Each image holds a reference to its allocator.
class FrameMemory::Allocator : public cv::MatAllocator, public std::enable_shared_from_this<Allocator> {
 public:
  cv::UMatData* allocate(int dims, const int* sizes, int type, void* data, size_t* step, cv::AccessFlag,
                         cv::UMatUsageFlags) const override {
    size_t total = CV_ELEM_SIZE(type);
    for (int i = dims - 1; i >= 0; --i) {
      if (step != nullptr) step[i] = total;
      total *= static_cast<size_t>(sizes[i]);
    }
    if (data != nullptr) throw Error("images in a file cannot share the memory of others");
    auto* pixels = new cv::UMatData(this);
    pixels->data = pixels->origdata = reinterpret_cast<uchar*>(memory_.allocate(total));
    pixels->size = total;
    pixels->handle = new std::shared_ptr<const Allocator>(shared_from_this());
    return pixels;
  }
  bool allocate(cv::UMatData* pixels, cv::AccessFlag, cv::UMatUsageFlags) const override { return pixels != nullptr; }
  void deallocate(cv::UMatData* pixels) const override {
    if (pixels == nullptr) return;
    auto* const self = static_cast<std::shared_ptr<const Allocator>*>(pixels->handle);
    delete pixels;
    delete self;  // possibly the last reference to this
  }

  void release() const { memory_.release(); }
  const FileMemory& memory() const { return memory_; }

 private:
  mutable FileMemory memory_;
};

FrameMemory::FrameMemory() : allocator_(std::make_shared<Allocator>()) {}

void FrameMemory::release() const { allocator_->release(); }

const FileMemory& FrameMemory::memory() const { return allocator_->memory(); }

cv::Mat FrameMemory::moved(const cv::Mat& image) {
  cv::Mat result;
  result.allocator = allocator_.get();
  image.copyTo(result);
  result.allocator = nullptr;  // later assignments allocate as usual
  return result;
}

StoredFrame FrameMemory::moved(const StoredFrame& frame) {
  return {frame.index,
          frame.timestamp_s,
          moved(frame.depth_m),
          moved(frame.sigma),
          moved(frame.normals),
          moved(frame.texture),
          {}};
}

}  // namespace fringeslam
