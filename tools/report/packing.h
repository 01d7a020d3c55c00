// SPDX-License-Identifier: Apache-2.0
// Binary data as text that a page can hold.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace fringeslam::tools {

std::string base64(std::string_view bytes);

// zlib's format (RFC 1950), which browsers know as "deflate".
std::string deflated(std::string_view bytes);

// Differences from the value before, modulo the type's range, in little-endian bytes: they deflate better.
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
