// SPDX-License-Identifier: Apache-2.0
// Reads board.yaml: kind (checkerboard, circles, asymmetric_circles, charuco), columns, rows (inner corners, or circles),
// spacing_m and, for circles, diameter_m; for ChArUco, marker_m, marker_bits and markers.
#pragma once

#include <filesystem>

#include "core/calibrate/board.h"

namespace fringeslam::tools {

constexpr const char* kBoardFile = "board.yaml";

// Reads a board file. Throws Error with file:line.
Board read_board(const std::filesystem::path& file);

// Returns the dataset's board, read from `given` or, if that is empty, from the dataset's own board.yaml. Throws Error
// if the file is missing or invalid.
Board board_of(const std::filesystem::path& dataset, const std::filesystem::path& given);

}  // namespace fringeslam::tools
