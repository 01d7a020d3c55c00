// SPDX-License-Identifier: Apache-2.0
#include "tools/report/curve.h"

#include <cmath>
#include <opencv2/imgproc.hpp>

namespace fringeslam::tools {

cv::Mat3b curve_picture(const Response& response) {
  constexpr int kSize = 640, kMargin = 50, kShift = 4;
  cv::Mat3b picture(kSize + 2 * kMargin, kSize + 2 * kMargin, cv::Vec3b(30, 30, 30));
  const auto place = [](double x, double y) {
    return cv::Point(static_cast<int>(std::lround((kMargin + kSize * x) * (1 << kShift))),
                     static_cast<int>(std::lround((kMargin + kSize * (1 - y)) * (1 << kShift))));
  };
  const cv::Scalar faint = cv::Scalar::all(90), bright(80, 220, 250);
  for (int i = 0; i <= 10; ++i) {
    cv::line(picture, place(0.1 * i, 0), place(0.1 * i, 1), cv::Scalar::all(50), 1, cv::LINE_AA, kShift);
    cv::line(picture, place(0, 0.1 * i), place(1, 0.1 * i), cv::Scalar::all(50), 1, cv::LINE_AA, kShift);
  }
  cv::line(picture, place(0, 0), place(1, 1), faint, 1, cv::LINE_AA, kShift);
  const double last = static_cast<double>(response.table.size() - 1);
  for (size_t i = 1; i < response.table.size(); ++i) {
    const double x = static_cast<double>(i);
    cv::line(picture, place((x - 1) / last, response.table[i - 1]), place(x / last, response.table[i]), bright, 2,
             cv::LINE_AA, kShift);
  }
  for (size_t i = 0; i < response.level.size(); ++i)
    cv::circle(picture, place(response.level[i], response.light[i]), 4 << kShift, bright, cv::FILLED, cv::LINE_AA,
               kShift);
  cv::putText(picture, "projector input", {kMargin + 230, kSize + kMargin + 35}, cv::FONT_HERSHEY_SIMPLEX, 0.6,
              cv::Scalar::all(200), 1, cv::LINE_AA);
  cv::putText(picture, "light", {kMargin, kMargin - 15}, cv::FONT_HERSHEY_SIMPLEX, 0.6, cv::Scalar::all(200), 1,
              cv::LINE_AA);
  return picture;
}

}  // namespace fringeslam::tools
