// SPDX-License-Identifier: Apache-2.0
// Checks #include directives against the include rules of docs/architecture.md.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace fringeslam::test {

// Returns one line "core/decode/decode.h:7: core/depth/depth.h (reason)" for each forbidden #include below core, sim,
// hw, bench and tools of `root`, sorted by file name.
std::vector<std::string> violations(const std::filesystem::path& root);

}  // namespace fringeslam::test
