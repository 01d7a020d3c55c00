// SPDX-License-Identifier: Apache-2.0
// Texture images of materials, filtered by OpenImageIO. Their files are decoded by the workers of core/io/image_worker.h;
// OpenImageIO only sees pixels.
#pragma once

#include <memory>
#include <string>

namespace fringeslam::sim {

class TextureImages {
 public:
  TextureImages();
  ~TextureImages();
  TextureImages(const TextureImages&) = delete;
  TextureImages& operator=(const TextureImages&) = delete;

  // Decodes a texture unless it is known already, and returns its number. Throws Error if the file is no image.
  size_t add(const std::string& file);

  // Returns the linear luminance (Rec. 709) at texture coordinates that repeat, averaged over a square of this width. Colors
  // of integer formats are sRGB, those of float formats linear; alpha is ignored. Any number of threads may call it.
  float luminance(size_t texture, float s, float t, float width) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace fringeslam::sim
