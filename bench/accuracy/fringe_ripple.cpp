// SPDX-License-Identifier: Apache-2.0
#include "bench/accuracy/fringe_ripple.h"

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <cmath>
#include <complex>
#include <limits>
#include <numbers>
#include <optional>

namespace fringeslam::bench {

namespace {

constexpr double kTurn = 2 * std::numbers::pi;

using Terms = Eigen::Matrix<double, 12, 1>;

std::complex<double> phasor(double phase_rad) { return std::polar(1.0, phase_rad); }

// The phase of one tile relative to a plane that follows it, so that it needs no unwrapping.
class Tile {
 public:
  Tile(const cv::Mat1f& phase, const cv::Mat1b& mask, const cv::Rect& area, int harmonic)
      : phase_(phase), mask_(mask), area_(area), harmonic_(harmonic) {
    std::complex<double> across, down, level;
    each([&](int row, int col) {
      if (col + 1 < area_.br().x && mask_(row, col + 1)) across += phasor(phase_(row, col + 1) - phase_(row, col));
      if (row + 1 < area_.br().y && mask_(row + 1, col)) down += phasor(phase_(row + 1, col) - phase_(row, col));
    });
    across_ = std::arg(across);
    down_ = std::arg(down);
    each([&](int row, int col) { level += phasor(above_plane(row, col)); });
    level_ = std::arg(level);
  }

  // Least squares over the pixels whose residual from `previous` is at most `cut`; `rms` receives their residual.
  Terms fit(const std::optional<Terms>& previous, double cut, double& rms) const {
    Eigen::Matrix<double, 12, 12> normal = Eigen::Matrix<double, 12, 12>::Zero();
    Terms right = Terms::Zero();
    double squares = 0;
    int count = 0;
    each([&](int row, int col) {
      const double value = std::remainder(above_plane(row, col), kTurn);
      const double x = 2.0 * (col - area_.x) / area_.width - 1, y = 2.0 * (row - area_.y) / area_.height - 1;
      const double angle = harmonic_ * static_cast<double>(phase_(row, col));
      Terms terms;
      terms << 1, x, y, x * x, x * y, y * y, x * x * x, x * x * y, x * y * y, y * y * y, std::cos(angle),
          std::sin(angle);
      const double residual = previous ? value - terms.dot(*previous) : 0;
      if (std::abs(residual) > cut) return;
      squares += residual * residual;
      ++count;
      normal += terms * terms.transpose();
      right += terms * value;
    });
    rms = std::sqrt(squares / std::max(1, count));
    return normal.ldlt().solve(right);
  }

 private:
  double above_plane(int row, int col) const {
    return static_cast<double>(phase_(row, col)) - across_ * (col - area_.x) - down_ * (row - area_.y) - level_;
  }
  template <class Body>
  void each(const Body& body) const {
    for (int row = area_.y; row < area_.br().y; ++row) {
      for (int col = area_.x; col < area_.br().x; ++col) {
        if (mask_(row, col)) body(row, col);
      }
    }
  }

  const cv::Mat1f& phase_;
  const cv::Mat1b& mask_;
  cv::Rect area_;
  int harmonic_;
  double across_ = 0, down_ = 0, level_ = 0;
};

}  // namespace

cv::Mat1f four_step_phase(const std::vector<cv::Mat1f>& images, size_t first) {
  cv::Mat1f phase(images[first].size());
  const cv::Mat1f* by_shift[4] = {};
  for (size_t k = first; k < first + 4; ++k) by_shift[k % 4] = &images[k];
  for (int row = 0; row < phase.rows; ++row) {
    for (int col = 0; col < phase.cols; ++col) {
      const auto grey = [&](int shift) { return (*by_shift[shift])(row, col); };
      phase(row, col) = std::atan2(grey(3) - grey(1), grey(0) - grey(2));
    }
  }
  return phase;
}

cv::Mat1f binomial_phase(const std::vector<cv::Mat1f>& images, size_t first, int order) {
  const cv::Mat1f middle = four_step_phase(images, first + static_cast<size_t>(order / 2));
  cv::Mat1d sum(middle.size(), 0.0);
  double weight = std::exp2(-order);
  for (int k = 0; k <= order; ++k) {
    const cv::Mat1f phase = four_step_phase(images, first + static_cast<size_t>(k));
    for (int row = 0; row < sum.rows; ++row) {
      for (int col = 0; col < sum.cols; ++col)
        sum(row, col) += weight * std::remainder(static_cast<double>(phase(row, col) - middle(row, col)), kTurn);
    }
    weight = weight * (order - k) / (k + 1);
  }
  cv::Mat1f out(middle.size());
  for (int row = 0; row < sum.rows; ++row) {
    for (int col = 0; col < sum.cols; ++col)
      out(row, col) = static_cast<float>(std::remainder(static_cast<double>(middle(row, col)) + sum(row, col), kTurn));
  }
  return out;
}

std::vector<cv::Vec2d> tile_ripple(const cv::Mat1f& wrapped_phase, const cv::Mat1b& mask, cv::Size tile, int harmonic) {
  constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();
  std::vector<cv::Vec2d> out;
  for (int top = 0; top + tile.height <= mask.rows; top += tile.height) {
    for (int left = 0; left + tile.width <= mask.cols; left += tile.width) {
      const cv::Rect area({left, top}, tile);
      out.emplace_back(kUnknown, kUnknown);
      if (cv::countNonZero(mask(area)) < 0.9 * tile.area()) continue;
      const Tile pixels(wrapped_phase, mask, area, harmonic);
      double rms = 0;
      std::optional<Terms> fit = pixels.fit({}, 1, rms);
      for (const double cut : {1.0, 0.3, 0.3}) fit = pixels.fit(fit, std::min(cut, 1.0), rms);
      if (rms <= 0.15) out.back() = {(*fit)[10], (*fit)[11]};
    }
  }
  return out;
}

}  // namespace fringeslam::bench
