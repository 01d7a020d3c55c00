// SPDX-License-Identifier: Apache-2.0
#include "bench/accuracy/percent_chart.h"

#include <cmath>
#include <cstdio>
#include <opencv2/imgproc.hpp>

#include "core/io/files.h"

namespace fringeslam::bench {

void write_percent_chart(const std::string& file, const std::string& title, const std::vector<std::string>& names,
                         const std::vector<BarGroup>& groups) {
  const cv::Scalar ink(40, 40, 40), faint(225, 225, 225);
  const cv::Scalar colours[] = {{170, 110, 30}, {70, 150, 235}, {120, 170, 90}};
  constexpr int kLeft = 290, kTop = 62, kRow = 50, kScale = 6, kBar = 11;  // px; kScale: px per percent
  cv::Mat3b picture(kTop + kRow * static_cast<int>(groups.size()) + 20, kLeft + 100 * kScale + 70,
                    cv::Vec3b(255, 255, 255));
  const auto text = [&](const std::string& words, cv::Point at, double size, const cv::Scalar& colour) {
    cv::putText(picture, words, at, cv::FONT_HERSHEY_SIMPLEX, size, colour, 1, cv::LINE_AA);
  };
  text(title, {12, 24}, 0.55, ink);
  for (size_t i = 0; i < names.size(); ++i) {
    const int x = kLeft + 150 * static_cast<int>(i);
    cv::rectangle(picture, cv::Rect(x, 34, 12, 12), colours[i], cv::FILLED);
    text(names[i], {x + 18, 45}, 0.45, ink);
  }
  for (int percent = 0; percent <= 100; percent += 20) {
    const int x = kLeft + percent * kScale;
    cv::line(picture, {x, kTop - 8}, {x, picture.rows - 20}, faint, 1);
    text(std::to_string(percent), {x - 8, picture.rows - 5}, 0.4, ink);
  }
  for (size_t g = 0; g < groups.size(); ++g) {
    const int y = kTop + kRow * static_cast<int>(g);
    text(groups[g].name, {12, y + 24}, 0.47, ink);
    for (size_t i = 0; i < groups[g].percents.size(); ++i) {
      const double percent = groups[g].percents[i];
      if (std::isnan(percent)) continue;
      const int width = static_cast<int>(std::lround(percent * kScale)), top = y + static_cast<int>(i) * (kBar + 2);
      cv::rectangle(picture, cv::Rect(kLeft, top, width, kBar), colours[i], cv::FILLED);
      char label[16];
      std::snprintf(label, sizeof label, "%.1f", percent);
      text(label, {kLeft + width + 4, top + 10}, 0.38, ink);
    }
  }
  write_png(file, picture);
}

}  // namespace fringeslam::bench
