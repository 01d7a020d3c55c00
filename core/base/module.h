// SPDX-License-Identifier: Apache-2.0
// Parts of this library that are loaded when they are first used, because the libraries that they depend on take longer to
// load than the rest of the program.
#pragma once

#include <string>

namespace fringeslam {

// Loads a module and returns its function `name`, or null with the reason in `why`. The module stays loaded. `file` is in
// the folder `fringeslam` beside the library that contains this function.
void* load_from_module(const std::string& file, const std::string& name, std::string& why);

// Determines the folder of the modules, which may be relative to the working folder, without loading any.
void locate_modules();

}  // namespace fringeslam
