// SPDX-License-Identifier: Apache-2.0
// Interface of a projector whose patterns the rig shows one after another.
#pragma once

#include <opencv2/core.hpp>

namespace fringeslam {

class Projector {
 public:
  virtual ~Projector() = default;
  virtual cv::Size size() const = 0;
  // Shows an image of that size, CV_8UC1 or (blue, green, red) CV_8UC3; returns once it has been output to the
  // projector. The latency of projector and camera is covered by the rig's settle time. Throws Error if the image
  // cannot be shown.
  virtual void show(const cv::Mat& image) = 0;
  // Refresh period, and median duration of the last presents.
  virtual double refresh_s() const = 0;
  virtual double present_interval_s() const = 0;
};

}  // namespace fringeslam
