// SPDX-License-Identifier: Apache-2.0
#include "bench/accuracy/method_chart.h"

#include <cmath>
#include <cstdio>
#include <opencv2/imgproc.hpp>

#include "core/rig/files.h"

namespace fringeslam::bench {

void write_method_chart(const std::string& file, const std::vector<MethodBar>& bars, int pairs) {
  const cv::Scalar ink(40, 40, 40), faint(225, 225, 225);
  const cv::Scalar colours[] = {{170, 110, 30}, {70, 150, 235}, {120, 170, 90}};
  const char* const names[] = {"recognised", "repeated", "right matches"};
  constexpr int kLeft = 290, kTop = 62, kRow = 50, kScale = 6, kBar = 11;  // px, a percent
  cv::Mat3b picture(kTop + kRow * static_cast<int>(bars.size()) + 20, kLeft + 100 * kScale + 70,
                    cv::Vec3b(255, 255, 255));
  const auto text = [&](const std::string& words, cv::Point at, double size, const cv::Scalar& colour) {
    cv::putText(picture, words, at, cv::FONT_HERSHEY_SIMPLEX, size, colour, 1, cv::LINE_AA);
  };
  text("landmarks of " + std::to_string(pairs) + " generated pairs of views, %", {12, 24}, 0.55, ink);
  for (int i = 0; i < 3; ++i) {
    cv::rectangle(picture, cv::Rect(kLeft + 150 * i, 34, 12, 12), colours[i], cv::FILLED);
    text(names[i], {kLeft + 150 * i + 18, 45}, 0.45, ink);
  }
  for (int percent = 0; percent <= 100; percent += 20) {
    const int x = kLeft + percent * kScale;
    cv::line(picture, {x, kTop - 8}, {x, picture.rows - 20}, faint, 1);
    text(std::to_string(percent), {x - 8, picture.rows - 5}, 0.4, ink);
  }
  for (size_t b = 0; b < bars.size(); ++b) {
    const int y = kTop + kRow * static_cast<int>(b);
    text(bars[b].name, {12, y + 24}, 0.47, ink);
    const double values[] = {bars[b].recognised, bars[b].repeated, bars[b].right};
    for (int i = 0; i < 3; ++i) {
      if (std::isnan(values[i])) continue;
      const int width = static_cast<int>(std::lround(values[i] * kScale));
      cv::rectangle(picture, cv::Rect(kLeft, y + i * (kBar + 2), width, kBar), colours[i], cv::FILLED);
      char label[16];
      std::snprintf(label, sizeof label, "%.1f", values[i]);
      text(label, {kLeft + width + 4, y + i * (kBar + 2) + 10}, 0.38, ink);
    }
  }
  write_png(file, picture);
}

}  // namespace fringeslam::bench
