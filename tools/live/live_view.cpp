// SPDX-License-Identifier: Apache-2.0
#include "tools/live/live_view.h"

#include "core/io/files.h"
#include "core/io/jpeg_file.h"

namespace fringeslam::tools {

namespace {

constexpr int kJpegQuality = 85;

std::string encoded(const Preview& preview, const std::string& name) {
  if (name == "texture.jpg") return jpeg_bytes(preview.texture, kJpegQuality);
  if (name == "modulation.jpg") return jpeg_bytes(preview.modulation, kJpegQuality);
  if (name == "saturation.png") return png_bytes(preview.saturation, 1);
  if (name == "depth.png") return png_bytes(preview.depth, 1);
  return {};
}

}  // namespace

const PreviewFigures& LiveView::figures() const {
  const std::lock_guard lock(mutex_);
  return prepared().figures;
}

std::string LiveView::picture(const std::string& name) const {
  const std::lock_guard lock(mutex_);
  const auto known = encoded_.find(name);
  if (known != encoded_.end()) return known->second;
  const std::string bytes = encoded(prepared(), name);
  if (!bytes.empty()) encoded_[name] = bytes;
  return bytes;
}

const Preview& LiveView::prepared() const {
  if (!preview_) preview_ = prepare_();
  prepare_ = nullptr;  // also releases the stack's images
  return *preview_;
}

}  // namespace fringeslam::tools
