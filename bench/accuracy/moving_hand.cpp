// SPDX-License-Identifier: Apache-2.0
#include "bench/accuracy/moving_hand.h"

#include <cmath>
#include <cstdlib>
#include <numbers>
#include <string>
#include <vector>

#include "bench/accuracy/fringe_ripple.h"
#include "core/decode/rolling_phase.h"
#include "core/io/files.h"

namespace fringeslam::bench {

namespace {

constexpr int kImages = 60;

FringeStack read_hand(const std::filesystem::path& folder) {
  FringeStack out;
  out.patterns = {1280, 800};
  for (int k = 0; k < kImages; ++k) {
    Pattern pattern;
    pattern.period_px = 1280 / 28.5;
    pattern.shift_rad = (k % 4) * std::numbers::pi / 2;
    out.patterns.patterns.push_back(pattern);
    out.images.push_back(read_grey(folder / ((k < 10 ? "0" : "") + std::to_string(k) + ".png")));
    out.exposure_s.push_back(1.0 / 90);
    out.exposure_time_s.push_back(k / 90.0);
  }
  return out;
}

class RippleSum {
 public:
  void add(const std::vector<cv::Vec2d>& tiles) {
    cv::Vec2d sum;
    int known = 0;
    for (const cv::Vec2d& tile : tiles) {
      if (std::isnan(tile[0])) continue;
      sum += tile;
      tile_squares_ += tile.dot(tile);
      ++known;
    }
    if (known == 0) return;
    window_squares_ += sum.dot(sum) / (known * known);
    tiles_ += known;
    ++windows_;
  }
  Ripple ripple() const { return {std::sqrt(window_squares_ / windows_), std::sqrt(tile_squares_ / tiles_)}; }
  int tiles() const { return tiles_; }

 private:
  double window_squares_ = 0, tile_squares_ = 0;
  int windows_ = 0, tiles_ = 0;
};

}  // namespace

std::optional<HandRipples> measure_hand_ripples(const std::filesystem::path& folder) {
  if (!std::filesystem::is_directory(folder)) return std::nullopt;
  const FringeStack stack = read_hand(folder);
  std::vector<cv::Mat1f> images;
  for (const cv::Mat& image : stack.images) {
    images.emplace_back();
    image.convertTo(images.back(), CV_32F);
  }
  HandRipples out;
  RippleSum plain[2], binomial[2], rolling[2];
  for (size_t first = 2; first + 6 <= kImages; first += 3) {
    const RollingPhase phase = decode_rolling_window(stack, first, 4, {});
    cv::Mat1b mask;
    cv::compare(phase.modulation, 15, mask, cv::CMP_GT);
    for (const int i : {0, 1}) {
      const auto ripple = [&](const cv::Mat1f& of) { return tile_ripple(of, mask, {80, 40}, 2 * (i + 1)); };
      plain[i].add(ripple(four_step_phase(images, first)));
      binomial[i].add(ripple(binomial_phase(images, first - 2, 4)));
      rolling[i].add(ripple(phase.wrapped_phase));
    }
    ++out.windows;
  }
  out.tiles = rolling[0].tiles();
  out.plain = {plain[0].ripple(), plain[1].ripple()};
  out.binomial = {binomial[0].ripple(), binomial[1].ripple()};
  out.rolling = {rolling[0].ripple(), rolling[1].ripple()};
  return out;
}

std::filesystem::path moving_hand_folder(const std::filesystem::path& source_folder) {
  const char* captures = std::getenv("FRINGESLAM_CAPTURES");
  return (captures ? std::filesystem::path(captures) : source_folder / ".." / "shared" / "captures") / "moving_hand";
}

}  // namespace fringeslam::bench
