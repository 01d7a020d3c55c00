// SPDX-License-Identifier: Apache-2.0
// Checks of `--out`: a command must not replace its own input.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace fringeslam::tools {

// Throws Error if `out` exists and is one of the inputs, under whatever name, or if it is a result folder that contains one
// which would be removed with it: a file that the program wrote, but for those that are `preserved`, or a folder with such
// files. Each verb that replaces files or folders calls this with all files and folders that it reads.
void require_not_an_input(const std::filesystem::path& out, const std::vector<std::filesystem::path>& inputs,
                          const std::vector<std::string>& preserved = {});

// Throws Error unless the file's name ends in `extension` (".png"), in upper or lower case.
void require_extension(const std::filesystem::path& out, const std::string& extension);

}  // namespace fringeslam::tools
