// SPDX-License-Identifier: Apache-2.0
// board.yaml: kind (checkerboard, circles, asymmetric_circles), columns, rows (inner corners, or circles), spacing_m,
// and of circles diameter_m.
#pragma once

#include <filesystem>

#include "core/calibrate/board.h"

namespace fringeslam::tools {

constexpr const char* kBoardFile = "board.yaml";

// Throws Error with file:line.
Board read_board(const std::filesystem::path& file);

// The board of a dataset: `given` when that is not empty, else its own board.yaml.
Board board_of(const std::filesystem::path& dataset, const std::filesystem::path& given);

}  // namespace fringeslam::tools
