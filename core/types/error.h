// SPDX-License-Identifier: Apache-2.0
// The one exception of the project. Its message is a single line that a person can act on:
// what is wrong, where (file:line when there is a file) and what to do.
#pragma once

#include <stdexcept>
#include <string>

namespace fringeslam {

class Error : public std::runtime_error {
 public:
  explicit Error(const std::string& message) : std::runtime_error(one_line(message)) {}

 private:
  // Messages quote files, whose texts may hold line ends and what moves a terminal's cursor.
  static std::string one_line(std::string text) {
    for (char& c : text) {
      if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) c = ' ';
    }
    return text;
  }
};

}  // namespace fringeslam
