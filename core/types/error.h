// SPDX-License-Identifier: Apache-2.0
// The project's only exception class. Its message is one actionable line: what is wrong, where (file:line if there is a
// file) and how to fix it.
#pragma once

#include <stdexcept>
#include <string>

namespace fringeslam {

class Error : public std::runtime_error {
 public:
  explicit Error(const std::string& message) : std::runtime_error(one_line(message)) {}

 private:
  // Messages may quote file contents, which can contain line breaks and terminal control characters.
  static std::string one_line(std::string text) {
    for (char& c : text) {
      if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) c = ' ';
    }
    return text;
  }
};

}  // namespace fringeslam
