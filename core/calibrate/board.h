// SPDX-License-Identifier: Apache-2.0
// Flat boards of known corners, and finding them in images.
#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

namespace fringeslam {

enum class BoardKind { checkerboard, circles, asymmetric_circles };

struct Board {
  BoardKind kind = BoardKind::checkerboard;
  int columns = 9, rows = 6;  // inner corners, or circles
  // Checkerboard and circles: between neighbours. Asymmetric circles, of which every other row is shifted by half a
  // spacing: between neighbours of a row; rows are half a spacing apart.
  double spacing_m = 0.02;
  double diameter_m = 0;  // of circles; 0: unknown

  int corners() const { return columns * rows; }
  // On the plane z = 0, row by row, from the middle of the board.
  std::vector<Eigen::Vector3d> points_m() const;
};

// "checkerboard", "circles", "asymmetric_circles".
BoardKind board_kind(const std::string& name);

// The board's corners, in the order of points_m(), integer pixel coordinates at pixel centres; empty when the board is
// not found whole. `image`: evenly lit grey values of any scale.
std::vector<cv::Point2f> detect_board(const cv::Mat1f& image, const Board& board);

// A board that looks the same turned by 180 degrees may be found from either end: puts the corners into the order of
// another view, between which it turned by less than 90 degrees.
void orient_like(const std::vector<cv::Point2f>& reference, std::vector<cv::Point2f>& corners);

}  // namespace fringeslam
