// SPDX-License-Identifier: Apache-2.0
#include "tools/verbs.h"

#include <cstdio>
#include <nlohmann/json.hpp>

#include "core/io/json_text.h"
#include "core/types/error.h"

namespace fringeslam::tools {

void print_text(const std::string& lines) {
  std::string text = single_line(lines);  // of the same length
  for (size_t i = 0; i < text.size(); ++i) {
    if (lines[i] == '\n') text[i] = '\n';
  }
  std::printf("%s\n", text.c_str());
}

void print_result(const Common& common, const nlohmann::ordered_json& document, const std::string& line) {
  if (common.json)
    std::printf("%s\n", json_text(document, 2).c_str());
  else if (!common.quiet)
    print_text(line);
}

}  // namespace fringeslam::tools
