// SPDX-License-Identifier: Apache-2.0
// Relative URIs, by which glTF names files (RFC 3986).
#pragma once

#include <charconv>
#include <string>

namespace fringeslam::sim {

// Decodes %XX; other text stays as it is.
inline std::string percent_decoded(const std::string& uri) {
  std::string text;
  for (size_t i = 0; i < uri.size(); ++i) {
    unsigned code = 0;
    const char* const digits = uri.data() + i + 1;
    const bool is_code = uri[i] == '%' && i + 2 < uri.size() &&
                         std::from_chars(digits, digits + 2, code, 16).ptr == digits + 2 && code != 0;
    text += is_code ? static_cast<char>(code) : uri[i];
    if (is_code) i += 2;
  }
  return text;
}

}  // namespace fringeslam::sim
