// SPDX-License-Identifier: Apache-2.0
#include "tools/board_file.h"

#include <algorithm>
#include <iterator>

#include "core/io/yaml.h"

namespace fringeslam::tools {

Board read_board(const std::filesystem::path& file) {
  const YamlMap map = YamlMap::load(file);
  Board board;
  board.kind = map.choice<BoardKind>("kind");
  board.columns = map.integer("columns", {3, 1000});
  board.rows = map.integer("rows", {3, 1000});
  board.spacing_m = map.number("spacing_m", {1e-5, 100});
  if (board.kind == BoardKind::charuco) {
    board.marker_m = map.number("marker_m", {1e-5, 100});
    if (board.marker_m >= board.spacing_m)
      throw map.error("marker_m", "marker_m must be less than spacing_m, the edge of the squares");
    board.marker_bits = map.integer_or("marker_bits", board.marker_bits, {4, 7});
    board.markers = map.integer_or("markers", board.markers, {50, 1000});
    constexpr int kSizes[] = {50, 100, 250, 1000};
    if (std::find(std::begin(kSizes), std::end(kSizes), board.markers) == std::end(kSizes))
      throw map.error("markers", "'markers' is the size of the dictionary: 50, 100, 250 or 1000");
  } else if (board.kind != BoardKind::checkerboard)
    board.diameter_m = map.number_or("diameter_m", 0, {0, 100});
  if (board.diameter_m >= board.spacing_m)
    throw map.error("diameter_m", "diameter_m must be less than spacing_m, otherwise the circles touch");
  map.finish();
  return board;
}

Board board_of(const std::filesystem::path& dataset, const std::filesystem::path& given) {
  if (!given.empty()) return read_board(given);
  const std::filesystem::path own = dataset / kBoardFile;
  if (!std::filesystem::exists(own))
    throw Error(own.string() +
                ": is missing; describe the board there, or give --board FILE (keys: kind, columns, rows, spacing_m)");
  return read_board(own);
}

}  // namespace fringeslam::tools
