// SPDX-License-Identifier: Apache-2.0
// Saved maps that the command line names, and those that runs left when they died.
#pragma once

#include <filesystem>
#include <string>

namespace fringeslam::tools {

// Returns the file that `name` means: a map file, or that of a run folder. Throws Error if there is none, which says how to
// recover one that was left.
std::filesystem::path map_file(const std::string& name);

// Prints a line to standard error for each map that a run of this result folder left.
void report_left_maps(const std::filesystem::path& target);

}  // namespace fringeslam::tools
