// SPDX-License-Identifier: Apache-2.0
#include "core/io/tum_file.h"

#include "core/io/input_file.h"

namespace fringeslam {

Trajectory read_tum(const std::filesystem::path& file) { return tum_from_text(read_input(file), file.string()); }

}  // namespace fringeslam
