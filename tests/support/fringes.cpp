// SPDX-License-Identifier: Apache-2.0
#include "tests/support/fringes.h"

#include <cmath>
#include <numbers>

namespace fringeslam::support {

FringeStack fringe_stack(const cv::Mat1d& coordinate_px, const PatternSequence& sequence, const FringeLight& light,
                         int type, const SensorModel& sensor, Random* noise) {
  std::vector<cv::Mat> images;
  // Rounding itself contributes the 1/12 of the sensor's variance; float images are not rounded.
  const double rounding = type == CV_32FC1 ? 0 : 1.0 / 12;
  for (const Pattern& pattern : sequence.patterns) {
    cv::Mat1d exact(coordinate_px.size());
    for (int row = 0; row < exact.rows; ++row) {
      for (int col = 0; col < exact.cols; ++col) {
        const double phase = 2 * std::numbers::pi * (coordinate_px(row, col) + 0.5) / pattern.period_px;
        const double wave = pattern.coding == Coding::fringe
                                ? std::cos(phase + pattern.shift_rad)
                                : 2 * ideal_intensity(pattern, coordinate_px(row, col)) - 1;
        const double grey = light.mean_dn + light.modulation_dn * wave;
        exact(row, col) = grey + (noise ? std::sqrt(sensor.variance_dn2(grey) - rounding) * noise->normal() : 0);
      }
    }
    cv::Mat image;
    exact.convertTo(image, type);
    images.push_back(image);
  }
  return stack_of(sequence, images);
}

FringeStack stack_of(const PatternSequence& sequence, const std::vector<cv::Mat>& images) {
  FringeStack stack;
  stack.patterns = sequence;
  stack.images = images;
  stack.exposure_s.assign(images.size(), 0.01);
  stack.exposure_time_s = exposure_times_s(0, images.size(), {});
  return stack;
}

cv::Mat1d ramp(double first, double last, int count) {
  cv::Mat1d row(1, count);
  for (int i = 0; i < count; ++i) row(0, i) = first + (last - first) * i / (count - 1);
  return row;
}

}  // namespace fringeslam::support
