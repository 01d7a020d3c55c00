// SPDX-License-Identifier: Apache-2.0
// The manual page of a command line, generated from the same descriptions as --help.
#pragma once

#include <string>

#include "tools/command_line.h"

namespace fringeslam::tools {

// Returns the page of section 1 in the macros of man(7): every command with its options and the settings of its footer.
// Hidden commands are left out. `version` is program and version, such as "fringeslam 0.1.0".
std::string man_page(Command root, const std::string& version);

}  // namespace fringeslam::tools
