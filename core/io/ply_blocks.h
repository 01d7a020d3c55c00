// SPDX-License-Identifier: Apache-2.0
// Reads the elements of a PLY file written by PlyWriter block by block, so that it need not fit in memory.
#pragma once

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <vector>

namespace fringeslam {

class PlyBlocks {
 public:
  // Offsets of a vertex's parts: position and normal (three floats each), three equal colours (bytes), sigma (float).
  static constexpr size_t kNormal = 12, kGrey = 24, kSigma = 27, kVertex = 31;
  static constexpr size_t kTriangle = 13;  // a 3 (byte) and three vertices (int32)

  // Throws Error if the file cannot be read or has another layout.
  explicit PlyBlocks(const std::filesystem::path& file);

  uint64_t vertices() const { return vertices_; }
  uint64_t triangles() const { return triangles_; }

  // Calls use(const char* bytes) for each vertex or triangle, until it returns false if it returns a bool. Throws Error if
  // the file is truncated, or a triangle's vertex does not exist.
  template <class Use>
  void for_each_vertex(const Use& use) {
    for_each(0, vertices_, kVertex, use);
  }
  template <class Use>
  void for_each_triangle(const Use& use) {
    for_each(vertices_ * kVertex, triangles_, kTriangle, [&](const char* bytes) {
      check_triangle(bytes);
      return use(bytes);
    });
  }

 private:
  void read(uint64_t offset, std::vector<char>& block, size_t bytes);
  void check_triangle(const char* bytes) const;

  template <class Use>
  void for_each(uint64_t offset, uint64_t count, size_t size, const Use& use) {
    constexpr uint64_t kElements = 1 << 15;
    std::vector<char> block(std::min(kElements, count) * size);
    for (uint64_t first = 0; first < count; first += kElements) {
      const uint64_t number = std::min(kElements, count - first);
      read(offset + first * size, block, number * size);
      for (uint64_t i = 0; i < number; ++i) {
        if constexpr (std::is_same_v<decltype(use(block.data())), bool>) {
          if (!use(block.data() + i * size)) return;
        } else {
          use(block.data() + i * size);
        }
      }
    }
  }

  std::filesystem::path path_;
  std::ifstream stream_;
  std::streamoff start_ = 0;
  uint64_t vertices_ = 0, triangles_ = 0;
};

}  // namespace fringeslam
