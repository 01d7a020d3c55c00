// SPDX-License-Identifier: Apache-2.0
// Binary data as text to embed in a page.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace fringeslam::tools {

std::string base64(std::string_view bytes);

// Compresses to the zlib format (RFC 1950), which browsers call "deflate".
std::string deflated(std::string_view bytes);

// Differences between successive values, modulo the type's range, as little-endian bytes: they compress better.
template <class Value>
std::string difference_bytes(const std::vector<Value>& values) {
  std::string bytes;
  Value previous = 0;
  for (const Value value : values) {
    const auto difference = static_cast<Value>(value - previous);
    for (size_t i = 0; i < sizeof difference; ++i) bytes += static_cast<char>(difference >> (8 * i) & 0xff);
    previous = value;
  }
  return bytes;
}

template <class Value>
std::string packed(const std::vector<Value>& values) {
  return base64(deflated(difference_bytes(values)));
}

}  // namespace fringeslam::tools
