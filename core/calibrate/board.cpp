// SPDX-License-Identifier: Apache-2.0
#include "core/calibrate/board.h"

#include <algorithm>
#include <cmath>
#include <opencv2/aruco/charuco.hpp>
#include <opencv2/calib3d.hpp>
#include <opencv2/features2d.hpp>
#include <opencv2/imgproc.hpp>

#include "core/calibrate/saddle.h"
#include "core/types/error.h"

namespace fringeslam {

namespace {

// Stretches the grey values between the 0.5 % and 99.5 % quantiles to 8 bits.
cv::Mat1b stretched(const cv::Mat1f& image) {
  std::vector<float> values(image.begin(), image.end());
  values.erase(std::remove_if(values.begin(), values.end(), [](float x) { return std::isnan(x); }), values.end());
  if (values.empty()) return cv::Mat1b(image.size(), uchar{0});
  const auto quantile = [&](double q) {
    const auto nth = values.begin() + static_cast<std::ptrdiff_t>(q * static_cast<double>(values.size() - 1));
    std::nth_element(values.begin(), nth, values.end());
    return static_cast<double>(*nth);
  };
  const double low = quantile(0.005), high = quantile(0.995);
  cv::Mat1b result;
  const double scale = 255 / std::max(1e-6, high - low);
  image.convertTo(result, CV_8U, scale, -low * scale);
  return result;
}

// Images to try in turn: the original, one with equalised contrast, and an enlarged one, in which small squares are
// detected more reliably.
struct Attempt {
  cv::Mat1b image;
  double scale = 1;
};
std::vector<Attempt> attempts(const cv::Mat1f& image) {
  std::vector<Attempt> result = {{stretched(image)}};
  cv::Mat1b even;
  cv::createCLAHE(4.0, {8, 8})->apply(result[0].image, even);
  result.push_back({even});
  if (image.total() < 1'000'000) {
    cv::Mat1b large;
    cv::resize(result[0].image, large, {}, 2, 2, cv::INTER_CUBIC);
    result.push_back({large, 2});
  }
  return result;
}

// Smallest distance between neighbours in a row or column, px.
double least_spacing(const std::vector<cv::Point2f>& corners, cv::Size size) {
  double least = 1e9;
  for (int row = 0; row < size.height; ++row) {
    for (int col = 0; col < size.width; ++col) {
      const auto i = static_cast<size_t>(row * size.width + col);
      if (col + 1 < size.width) least = std::min(least, cv::norm(corners[i + 1] - corners[i]));
      if (row + 1 < size.height)
        least = std::min(least, cv::norm(corners[i + static_cast<size_t>(size.width)] - corners[i]));
    }
  }
  return least;
}

std::vector<cv::Point2f> find_checkerboard(const Attempt& attempt, cv::Size size) {
  std::vector<cv::Point2f> corners;
  if (!cv::findChessboardCornersSB(attempt.image, size, corners,
                                   cv::CALIB_CB_NORMALIZE_IMAGE | cv::CALIB_CB_EXHAUSTIVE) &&
      !cv::findChessboardCorners(attempt.image, size, corners,
                                 cv::CALIB_CB_ADAPTIVE_THRESH | cv::CALIB_CB_NORMALIZE_IMAGE))
    return {};
  return corners;
}

std::vector<cv::Point2f> find_circles(const Attempt& attempt, cv::Size size, bool asymmetric) {
  cv::SimpleBlobDetector::Params params;
  params.minThreshold = 10;
  params.maxThreshold = 245;
  params.thresholdStep = 5;
  params.minDistBetweenBlobs = 4;
  params.minArea = 12;
  params.maxArea = static_cast<float>(attempt.image.total()) / 50;
  params.filterByConvexity = true;
  params.minConvexity = 0.85f;
  params.filterByInertia = true;
  params.minInertiaRatio = 0.2f;
  params.filterByColor = true;
  const int flags = asymmetric ? cv::CALIB_CB_ASYMMETRIC_GRID : cv::CALIB_CB_SYMMETRIC_GRID;
  for (const uchar colour : {uchar{0}, uchar{255}}) {
    params.blobColor = colour;
    const auto detector = cv::SimpleBlobDetector::create(params);
    std::vector<cv::Point2f> centres;
    if (cv::findCirclesGrid(attempt.image, size, centres, flags, detector)) return centres;
    if (cv::findCirclesGrid(attempt.image, size, centres, flags | cv::CALIB_CB_CLUSTERING, detector)) return centres;
  }
  return {};
}

// Refines circle centres to the centroid of darkness (or brightness) over the background, which is sampled half-way to
// the neighbouring circles; more accurate than outlines at a few thresholds.
void refine_circles(const cv::Mat1f& image, double radius_px, std::vector<cv::Point2f>& centres) {
  for (cv::Point2f& centre : centres) {
    for (int iteration = 0; iteration < 3; ++iteration) {
      const int reach = static_cast<int>(std::ceil(radius_px));
      const int x0 = static_cast<int>(std::lround(centre.x)), y0 = static_cast<int>(std::lround(centre.y));
      if (x0 < reach || y0 < reach || x0 + reach >= image.cols || y0 + reach >= image.rows) break;
      std::vector<float> rim;
      double inner = 0;
      int inner_count = 0;
      const auto distance = [&](int x, int y) {
        return std::hypot(x - static_cast<double>(centre.x), y - static_cast<double>(centre.y));
      };
      for (int y = y0 - reach; y <= y0 + reach; ++y) {
        for (int x = x0 - reach; x <= x0 + reach; ++x) {
          const double d = distance(x, y);
          if (d > radius_px - 1.5 && d <= radius_px) rim.push_back(image(y, x));
          if (d <= 1.5) inner += image(y, x), ++inner_count;
        }
      }
      if (rim.size() < 6 || inner_count == 0) break;
      std::nth_element(rim.begin(), rim.begin() + static_cast<std::ptrdiff_t>(rim.size() / 2), rim.end());
      const double background = rim[rim.size() / 2], depth = inner / inner_count - background;
      double sum = 0, sum_x = 0, sum_y = 0;
      for (int y = y0 - reach; y <= y0 + reach; ++y) {
        for (int x = x0 - reach; x <= x0 + reach; ++x) {
          const double weight = (image(y, x) - background) / depth;
          if (distance(x, y) > radius_px || !(weight > 0.05)) continue;
          sum += weight, sum_x += weight * x, sum_y += weight * y;
        }
      }
      if (!(sum > 3)) break;
      centre = {static_cast<float>(sum_x / sum), static_cast<float>(sum_y / sum)};
    }
  }
}

}  // namespace

std::vector<Eigen::Vector3d> Board::points_m() const {
  std::vector<Eigen::Vector3d> points;
  const bool asymmetric = kind == BoardKind::asymmetric_circles;
  const double middle_x = 0.5 * (columns - 1) * spacing_m + (asymmetric ? 0.25 * spacing_m : 0);
  const double row_m = asymmetric ? 0.5 * spacing_m : spacing_m;
  for (int row = 0; row < rows; ++row) {
    const double shift = asymmetric && row % 2 == 1 ? 0.5 * spacing_m : 0;
    for (int col = 0; col < columns; ++col)
      points.emplace_back(col * spacing_m + shift - middle_x, (row - 0.5 * (rows - 1)) * row_m, 0);
  }
  return points;
}

namespace {

int dictionary_of(const Board& board) {
  // The dictionaries of a size follow one another with 50, 100, 250 and 1000 markers.
  const int first[] = {cv::aruco::DICT_4X4_50, cv::aruco::DICT_5X5_50, cv::aruco::DICT_6X6_50, cv::aruco::DICT_7X7_50};
  const int sizes[] = {50, 100, 250, 1000};
  const auto* const size = std::find(std::begin(sizes), std::end(sizes), board.markers);
  if (board.marker_bits < 4 || board.marker_bits > 7 || size == std::end(sizes))
    throw Error("ChArUco markers have 4 to 7 bits and dictionaries of 50, 100, 250 or 1000");
  return first[board.marker_bits - 4] + static_cast<int>(size - std::begin(sizes));
}

// Corners that are not found are NaN; empty if there are fewer than 6.
std::vector<cv::Point2f> find_charuco(const cv::Mat1b& image, const Board& board) {
  constexpr size_t kLeast = 6;
  const auto plan = cv::aruco::CharucoBoard::create(
      board.columns + 1, board.rows + 1, static_cast<float>(board.spacing_m), static_cast<float>(board.marker_m),
      cv::aruco::getPredefinedDictionary(dictionary_of(board)));
  std::vector<int> markers, ids;
  std::vector<std::vector<cv::Point2f>> outlines;
  cv::aruco::detectMarkers(image, plan->dictionary, outlines, markers);
  if (markers.empty()) return {};
  std::vector<cv::Point2f> found;
  cv::aruco::interpolateCornersCharuco(outlines, markers, image, plan, found, ids);
  if (found.size() < kLeast) return {};
  std::vector<cv::Point2f> corners(static_cast<size_t>(board.corners()), cv::Point2f(std::nanf(""), std::nanf("")));
  double spacing = 1e9;
  for (size_t a = 0; a < found.size(); ++a) {
    for (size_t b = a + 1; b < found.size(); ++b) spacing = std::min(spacing, cv::norm(found[a] - found[b]));
  }
  // The markers end at a distance from the crossings that the window must not exceed.
  const double free = 0.5 * (board.spacing_m - board.marker_m) / board.spacing_m;
  const int window = std::clamp(static_cast<int>(free * spacing), 2, 15);
  cv::cornerSubPix(image, found, {window, window}, {-1, -1},
                   {cv::TermCriteria::EPS | cv::TermCriteria::COUNT, 60, 1e-4});
  for (size_t i = 0; i < found.size(); ++i) corners[static_cast<size_t>(ids[i])] = found[i];
  return corners;
}

}  // namespace

bool is_complete(const std::vector<cv::Point2f>& corners) {
  return std::none_of(corners.begin(), corners.end(), [](const cv::Point2f& c) { return std::isnan(c.x); });
}

std::vector<cv::Point2f> detect_board(const cv::Mat1f& image, const Board& board) {
  const cv::Size size(board.columns, board.rows);
  cv::Mat1f finite = image.clone();
  cv::patchNaNs(finite, 0);
  if (board.kind == BoardKind::charuco) return find_charuco(stretched(finite), board);
  for (const Attempt& attempt : attempts(finite)) {
    std::vector<cv::Point2f> corners = board.kind == BoardKind::checkerboard
                                           ? find_checkerboard(attempt, size)
                                           : find_circles(attempt, size, board.kind == BoardKind::asymmetric_circles);
    if (corners.size() != static_cast<size_t>(board.corners())) continue;
    for (cv::Point2f& corner : corners)
      corner = (corner + cv::Point2f(0.5f, 0.5f)) / attempt.scale - cv::Point2f(0.5f, 0.5f);
    const double spacing = least_spacing(corners, size);
    if (board.kind == BoardKind::checkerboard) {
      const int window = std::clamp(static_cast<int>(0.42 * spacing), 2, 15);
      cv::cornerSubPix(stretched(finite), corners, {window, window}, {-1, -1},
                       {cv::TermCriteria::EPS | cv::TermCriteria::COUNT, 60, 1e-4});
      refine_saddle_points(finite, board.columns, corners);
    } else {
      refine_circles(finite, 0.5 * spacing, corners);
    }
    return corners;
  }
  return {};
}

namespace {

// Contrast of the four fields around a crossing: the difference between its diagonal pairs. `along` and `across` lead to
// the neighbouring crossings. NaN outside the image.
double crossing_contrast(const cv::Mat1f& image, const cv::Point2f& at, const cv::Point2f& along,
                         const cv::Point2f& across) {
  const auto field = [&](float a, float b) {
    const cv::Point2f p = at + 0.3f * (a * along + b * across);
    const cv::Point pixel(cvRound(p.x), cvRound(p.y));
    return cv::Rect(0, 0, image.cols, image.rows).contains(pixel) ? static_cast<double>(image(pixel)) : std::nan("");
  };
  return std::abs(field(1, 1) + field(-1, -1) - field(1, -1) - field(-1, 1));
}

}  // namespace

bool continues_beyond(const cv::Mat1f& image, const Board& board, const std::vector<cv::Point2f>& corners) {
  if (board.kind != BoardKind::checkerboard || corners.size() != static_cast<size_t>(board.corners())) return false;
  constexpr int kLeast = 3;  // corners in either direction for the extrapolation
  if (board.columns < kLeast || board.rows < kLeast) return false;
  const auto corner = [&](int row, int col) { return corners[static_cast<size_t>(row * board.columns + col)]; };
  // On each side, compares the contrast of the extrapolated next crossings with that of the outermost ones. At the edge
  // of a complete board only two of the four fields differ, which halves it.
  for (int side = 0; side < 4; ++side) {
    const bool vertical = side < 2;  // a column of crossings
    const int count = vertical ? board.rows : board.columns, depth = vertical ? board.columns : board.rows;
    const auto at = [&](int along, int inward) {
      const int across = side % 2 == 0 ? inward : depth - 1 - inward;
      return vertical ? corner(along, across) : corner(across, along);
    };
    int crossings = 0, examined = 0;
    for (int i = 0; i < count; ++i) {
      const cv::Point2f next = 3.0f * at(i, 0) - 3.0f * at(i, 1) + at(i, 2);
      const cv::Point2f along = i + 1 < count ? at(i + 1, 0) - at(i, 0) : at(i, 0) - at(i - 1, 0);
      const cv::Point2f across = at(i, 0) - at(i, 1);
      const double inside = crossing_contrast(image, at(i, 0), along, across);
      const double outside = crossing_contrast(image, next, along, across);
      if (std::isnan(outside) || std::isnan(inside)) continue;
      ++examined;
      crossings += outside > 0.75 * inside;
    }
    if (2 * examined >= count && 4 * crossings >= 3 * examined) return true;
  }
  return false;
}

void align_corner_order(const std::vector<cv::Point2f>& reference, std::vector<cv::Point2f>& corners) {
  if (reference.empty() || corners.empty()) return;
  const cv::Point2f a = reference.back() - reference.front(), b = corners.back() - corners.front();
  if (a.dot(b) < 0) std::reverse(corners.begin(), corners.end());
}

}  // namespace fringeslam
