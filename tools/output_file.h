// SPDX-License-Identifier: Apache-2.0
// Checks of `--out`: a command must not replace its own input.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace fringeslam::tools {

// Throws Error if `out` exists and is one of the inputs, under whatever name.
void require_not_an_input(const std::filesystem::path& out, const std::vector<std::filesystem::path>& inputs);

// Throws Error unless the file's name ends in `extension` (".png"), in upper or lower case.
void require_extension(const std::filesystem::path& out, const std::string& extension);

}  // namespace fringeslam::tools
