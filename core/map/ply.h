// SPDX-License-Identifier: Apache-2.0
// The parts of binary PLY files.
#pragma once

#include <bit>
#include <string>

namespace fringeslam {

static_assert(std::endian::native == std::endian::little, "PLY bodies are written as binary_little_endian");

template <class Value>
void append_binary(std::string& bytes, Value value) {
  bytes.append(reinterpret_cast<const char*>(&value), sizeof value);
}

}  // namespace fringeslam
