// SPDX-License-Identifier: Apache-2.0
// What casts patterns, as a rig uses it that steps through them itself.
#pragma once

#include <opencv2/core.hpp>

namespace fringeslam {

class Projector {
 public:
  virtual ~Projector() = default;
  virtual cv::Size size() const = 0;
  // Shows an image of that size, CV_8UC1 or (blue, green, red) CV_8UC3; when this returns it is out to the projector
  // for certain. What the projector itself still takes, and the camera, is the rig's settle time. Throws Error when the
  // image cannot be shown.
  virtual void show(const cv::Mat& image) = 0;
  // For how long a frame is shown, and how long the last presents took, median.
  virtual double refresh_s() const = 0;
  virtual double present_interval_s() const = 0;
};

}  // namespace fringeslam
