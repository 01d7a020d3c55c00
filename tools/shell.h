// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace fringeslam::tools {

// Returns the word quoted for a POSIX shell.
inline std::string quoted(const std::string& word) {
  std::string text = "'";
  for (const char c : word) text += c == '\'' ? "'\\''" : std::string(1, c);
  return text + "'";
}

}  // namespace fringeslam::tools
