// SPDX-License-Identifier: Apache-2.0
#include "core/calibrate/saddle.h"

#include <ceres/ceres.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "core/base/parallel.h"

namespace fringeslam {

namespace {

// Parameters: centre (2), directions of the two edges (angles), m, g (2), k, log s.
constexpr int kParameters = 9;

struct Pixel {
  double x, y, grey;
};

// erf(x / s), an edge blurred by the lens, averaged over a pixel of half width h. For an edge parallel to the pixel
// rows this average is nearly all of the blur.
template <class T>
T pixel_edge(const T& x, const T& s, const T& h) {
  using std::erf;
  using std::exp;
  const auto integral = [&](const T& at) {
    const T q = at / s;
    return at * erf(q) + s * (1 / std::sqrt(std::numbers::pi)) * exp(-q * q);
  };
  return (integral(x + h) - integral(x - h)) / (2.0 * h);
}

struct SaddleResidual {
  const std::vector<Pixel>& pixels;

  template <class T>
  bool operator()(const T* p, T* residuals) const {
    using std::abs;
    using std::cos;
    using std::exp;
    using std::sin;
    const T c1 = cos(p[2]), s1 = sin(p[2]), c2 = cos(p[3]), s2 = sin(p[3]);
    const T blur = exp(p[8]) * std::sqrt(2.0);
    const T half1 = 0.5 * (abs(c1) + abs(s1)), half2 = 0.5 * (abs(c2) + abs(s2));
    for (size_t i = 0; i < pixels.size(); ++i) {
      const T x = pixels[i].x - p[0], y = pixels[i].y - p[1];
      const T edge1 = pixel_edge(T(c1 * y - s1 * x), blur, half1), edge2 = pixel_edge(T(c2 * y - s2 * x), blur, half2);
      residuals[i] = p[4] + p[5] * x + p[6] * y + p[7] * edge1 * edge2 - pixels[i].grey;
    }
    return true;
  }
};

std::vector<Pixel> pixels_around(const cv::Mat1f& image, const cv::Point2f& corner, double radius) {
  std::vector<Pixel> pixels;
  const int reach = static_cast<int>(std::ceil(radius));
  const int x0 = static_cast<int>(std::lround(corner.x)), y0 = static_cast<int>(std::lround(corner.y));
  for (int y = std::max(0, y0 - reach); y <= std::min(image.rows - 1, y0 + reach); ++y) {
    for (int x = std::max(0, x0 - reach); x <= std::min(image.cols - 1, x0 + reach); ++x) {
      const double dx = x - static_cast<double>(corner.x), dy = y - static_cast<double>(corner.y);
      if (std::hypot(dx, dy) <= radius) pixels.push_back({dx, dy, image(y, x)});
    }
  }
  return pixels;
}

double angle_of(const cv::Point2f& direction) {
  return std::atan2(static_cast<double>(direction.y), static_cast<double>(direction.x));
}

// Fits the saddle to the pixels around a corner; `along_row` and `along_column` are the directions of the two edges.
cv::Point2f fitted(const cv::Mat1f& image, const cv::Point2f& corner, const cv::Point2f& along_row,
                   const cv::Point2f& along_column) {
  const double radius = std::clamp(0.42 * std::min(cv::norm(along_row), cv::norm(along_column)), 3.0, 16.0);
  const std::vector<Pixel> pixels = pixels_around(image, corner, radius);
  if (pixels.size() < 20) return corner;
  double mean = 0, low = pixels[0].grey, high = low;
  for (const Pixel& p : pixels) {
    mean += p.grey / static_cast<double>(pixels.size());
    low = std::min(low, p.grey);
    high = std::max(high, p.grey);
  }
  std::array<double, kParameters> start{
      0, 0, angle_of(along_row), angle_of(along_column), mean, 0, 0, 0.4 * (high - low), -0.7};
  // Determines which pair of opposite squares is bright.
  double sign = 0;
  for (const Pixel& p : pixels) {
    const double a = std::cos(start[2]) * p.y - std::sin(start[2]) * p.x;
    const double b = std::cos(start[3]) * p.y - std::sin(start[3]) * p.x;
    sign += (p.grey - mean) * (a * b > 0 ? 1 : -1);
  }
  if (sign < 0) start[7] = -start[7];

  std::array<double, kParameters> p = start;
  ceres::Problem problem;
  problem.AddResidualBlock(new ceres::AutoDiffCostFunction<SaddleResidual, ceres::DYNAMIC, kParameters>(
                               new SaddleResidual{pixels}, static_cast<int>(pixels.size())),
                           nullptr, p.data());
  problem.SetParameterLowerBound(p.data(), 8, std::log(0.05));
  problem.SetParameterUpperBound(p.data(), 8, std::log(0.5 * radius));
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_NORMAL_CHOLESKY;
  options.max_num_iterations = 25;
  options.function_tolerance = 1e-8;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  const bool strayed = std::hypot(p[0], p[1]) > std::min(1.5, 0.4 * radius);
  if (!summary.IsSolutionUsable() || strayed) return corner;
  return corner + cv::Point2f(static_cast<float>(p[0]), static_cast<float>(p[1]));
}

}  // namespace

void refine_saddle_points(const cv::Mat1f& image, int columns, std::vector<cv::Point2f>& corners) {
  const std::vector<cv::Point2f> before = corners;
  const auto width = static_cast<size_t>(columns), total = before.size();
  for_each_row(static_cast<int>(total), [&](int corner) {
    const auto i = static_cast<size_t>(corner);
    const size_t beside = i % width + 1 < width ? i + 1 : i - 1, below = i + width < total ? i + width : i - width;
    corners[i] = fitted(image, before[i], before[beside] - before[i], before[below] - before[i]);
  });
}

}  // namespace fringeslam
