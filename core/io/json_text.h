// SPDX-License-Identifier: Apache-2.0
// JSON documents as text.
#pragma once

#include <string>

namespace fringeslam {

// Formats a JSON document on one line, or indented. Strings come from file names and files, so they need not be UTF-8;
// invalid bytes become U+FFFD, because JSON cannot represent them.
template <class Json>
std::string json_text(const Json& document, int indent = -1) {
  return document.dump(indent, ' ', false, Json::error_handler_t::replace);
}

}  // namespace fringeslam
