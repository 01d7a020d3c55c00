// SPDX-License-Identifier: Apache-2.0
// The one exception of the project. Its message is a single line that a person can act on:
// what is wrong, where (file:line when there is a file) and what to do.
#pragma once

#include <stdexcept>
#include <string>

namespace fringeslam {

class Error : public std::runtime_error {
 public:
  explicit Error(const std::string& message) : std::runtime_error(message) {}
};

}  // namespace fringeslam
