// SPDX-License-Identifier: Apache-2.0
#include "tools/verbs.h"

#include <cstdio>
#include <nlohmann/json.hpp>

#include "core/io/json_text.h"

namespace fringeslam::tools {

void print_result(const Common& common, const nlohmann::ordered_json& document, const std::string& line) {
  if (common.json)
    std::printf("%s\n", json_text(document, 2).c_str());
  else if (!common.quiet)
    std::printf("%s\n", line.c_str());
}

}  // namespace fringeslam::tools
