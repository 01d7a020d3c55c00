// SPDX-License-Identifier: Apache-2.0
// Words of commands that are printed for a user, or passed to a shell.
#pragma once

#include <string>

namespace fringeslam {

// Returns the word quoted for a POSIX shell.
inline std::string quoted(const std::string& word) {
  std::string text = "'";
  for (const char c : word) text += c == '\'' ? "'\\''" : std::string(1, c);
  return text + "'";
}

// Returns the word, quoted if a shell would not take it literally.
inline std::string shell_word(const std::string& word) {
  constexpr const char* kLiteral = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-./=,:+@%";
  return !word.empty() && word.find_first_not_of(kLiteral) == std::string::npos ? word : quoted(word);
}

}  // namespace fringeslam
