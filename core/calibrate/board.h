// SPDX-License-Identifier: Apache-2.0
// Planar calibration boards and their detection in images.
#pragma once

#include <Eigen/Core>
#include <array>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "core/types/options.h"

namespace fringeslam {

enum class BoardKind { checkerboard, circles, asymmetric_circles, charuco };

constexpr auto choices(BoardKind) {
  using enum BoardKind;
  return std::to_array<Choice<BoardKind>>({{checkerboard, "checkerboard"},
                                           {circles, "circles"},
                                           {asymmetric_circles, "asymmetric_circles"},
                                           {charuco, "charuco"}});
}

struct Board {
  BoardKind kind = BoardKind::checkerboard;
  int columns = 9, rows = 6;  // number of inner corners or circles
  // Distance between neighbours in a row. Rows are one spacing apart; the rows of asymmetric circles are half a spacing
  // apart, and every other row is shifted by half a spacing.
  double spacing_m = 0.02;
  double diameter_m = 0;  // of circles; 0: unknown, no perspective correction
  // ChArUco: edge of the markers, and their dictionary: N for N x N bits, with 50, 100, 250 or 1000 markers.
  double marker_m = 0;
  int marker_bits = 4, markers = 50;

  int corners() const { return columns * rows; }
  // Board frame: plane z = 0, origin at the centre of the grid, row by row.
  std::vector<Eigen::Vector3d> points_m() const;
};

// Detects the board's corners, px (integers at pixel centres), in the order of points_m(); empty unless the whole board
// is found. A ChArUco board may be partly visible; corners that are not found are NaN. `image`: evenly lit grey values of
// any scale.
std::vector<cv::Point2f> detect_board(const cv::Mat1f& image, const Board& board);

// True if all corners are known.
bool is_complete(const std::vector<cv::Point2f>& corners);

// True if a checkerboard's crossings continue beyond the detected corners, which are then part of a larger board.
bool continues_beyond(const cv::Mat1f& image, const Board& board, const std::vector<cv::Point2f>& corners);

// Reverses `corners` if they run against `reference`. A board that looks the same after a 180-degree rotation may be
// detected starting from either end; the two views must differ by less than 90 degrees of rotation.
void align_corner_order(const std::vector<cv::Point2f>& reference, std::vector<cv::Point2f>& corners);

}  // namespace fringeslam
