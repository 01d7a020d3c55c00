// SPDX-License-Identifier: Apache-2.0
// Building blocks of binary PLY files.
#pragma once

#include <bit>
#include <string>

namespace fringeslam {

static_assert(std::endian::native == std::endian::little, "PLY bodies are written as binary_little_endian");

template <class Value>
void append_binary(std::string& bytes, Value value) {
  bytes.append(reinterpret_cast<const char*>(&value), sizeof value);
}

// Properties of a vertex: position, normal, grey value as colour, and sigma.
inline constexpr const char* kPlyPoint =
    "property float x\nproperty float y\nproperty float z\nproperty float nx\nproperty float ny\nproperty float nz\n"
    "property uchar red\nproperty uchar green\nproperty uchar blue\nproperty float sigma\n";

template <class Point>
void append_point(std::string& bytes, const Point& p) {
  for (int i = 0; i < 3; ++i) append_binary(bytes, p.position_m[i]);
  for (int i = 0; i < 3; ++i) append_binary(bytes, p.normal[i]);
  for (int i = 0; i < 3; ++i) append_binary(bytes, p.grey);
  append_binary(bytes, p.sigma_m);
}

}  // namespace fringeslam
