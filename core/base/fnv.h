// SPDX-License-Identifier: Apache-2.0
// 64-bit FNV-1a hash, identical on all platforms. Not collision-resistant against deliberately constructed inputs.
#pragma once

#include <cstdint>
#include <string_view>

namespace fringeslam {

// `hash` is that of the bytes before, for data that is read in parts.
constexpr uint64_t fnv1a(std::string_view bytes, uint64_t hash = 14695981039346656037ull) {
  for (const char c : bytes) hash = (hash ^ static_cast<unsigned char>(c)) * 1099511628211ull;
  return hash;
}

}  // namespace fringeslam
