// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace fringeslam::tools {

// A word that a POSIX shell takes as it is.
inline std::string quoted(const std::string& word) {
  std::string text = "'";
  for (const char c : word) text += c == '\'' ? "'\\''" : std::string(1, c);
  return text + "'";
}

}  // namespace fringeslam::tools
