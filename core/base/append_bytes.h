// SPDX-License-Identifier: Apache-2.0
// Building block of binary files, all of which are little-endian.
#pragma once

#include <bit>
#include <string>
#include <type_traits>

namespace fringeslam {

static_assert(std::endian::native == std::endian::little, "binary files are written in little-endian byte order");

template <class Value>
void append_bytes(std::string& bytes, const Value& value) {
  static_assert(std::is_trivially_copyable_v<Value>);
  bytes.append(reinterpret_cast<const char*>(&value), sizeof value);
}

}  // namespace fringeslam
