// SPDX-License-Identifier: Apache-2.0
// A camera as a rig uses it: one whole grey image, exposed after it was asked for.
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>

namespace fringeslam {

struct GreyImage {
  cv::Mat image;           // H x W, CV_8UC1 or CV_16UC1, grey values in DN
  double timestamp_s = 0;  // when it arrived, by the system's clock since 1970
  double exposure_s = 0;
  uint64_t number = 0;  // of the exposure, counted by the camera, whether its image arrived or not
};

struct CameraStatistics {
  uint64_t images = 0;   // whole ones
  uint64_t refused = 0;  // arrived incomplete or not at all, and were taken again
  uint64_t resent_packets = 0, missing_packets = 0;
  uint64_t reopened = 0;  // times that the connection was lost and found again
};

class GreyCamera {
 public:
  virtual ~GreyCamera() = default;
  virtual cv::Size size() const = 0;
  // Exposed entirely after the call. Never an incomplete image: throws Error when none can be had.
  virtual GreyImage take() = 0;
  // Of a camera that exposes by itself: the next whole image after the one that was taken last. Throws Error likewise.
  virtual GreyImage next() = 0;
  virtual CameraStatistics statistics() const = 0;
};

}  // namespace fringeslam
