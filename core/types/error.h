// SPDX-License-Identifier: Apache-2.0
// The project's only exception class. Its message is one actionable line: what is wrong, where (file:line if there is a
// file) and how to fix it.
#pragma once

#include <stdexcept>
#include <string>

namespace fringeslam {

// Returns text from outside, such as a name in a file, with a space in place of each byte of a line break or another control
// character: it could otherwise imitate lines of the program, or send commands to a terminal.
inline std::string single_line(std::string text) {
  for (size_t i = 0; i < text.size(); ++i) {
    const auto byte = static_cast<unsigned char>(text[i]);
    if (byte < 0x20 || byte == 0x7f) text[i] = ' ';
    // The control characters U+0080 to U+009F in UTF-8.
    if (byte == 0xc2 && i + 1 < text.size() && (static_cast<unsigned char>(text[i + 1]) & 0xe0) == 0x80)
      text[i] = text[i + 1] = ' ';
  }
  return text;
}

class Error : public std::runtime_error {
 public:
  explicit Error(const std::string& message) : std::runtime_error(single_line(message)) {}
};

}  // namespace fringeslam
