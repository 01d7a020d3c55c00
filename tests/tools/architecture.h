// SPDX-License-Identifier: Apache-2.0
// Who may include whom, as DESIGN.md says ("The house").
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace fringeslam::test {

// One line "core/decode/decode.h:7: core/depth/depth.h (reason)" for each forbidden #include below
// core, sim, hw, bench and tools of `root`, in the order of the file names.
std::vector<std::string> violations(const std::filesystem::path& root);

}  // namespace fringeslam::test
