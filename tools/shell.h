// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "core/base/shell.h"

namespace fringeslam::tools {

using fringeslam::quoted;
using fringeslam::shell_word;

}  // namespace fringeslam::tools
