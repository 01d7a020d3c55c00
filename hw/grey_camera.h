// SPDX-License-Identifier: Apache-2.0
// Interface of a camera for a rig: delivers complete grey images that were exposed after the request.
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>

#include "core/types/error.h"

namespace fringeslam {

struct GreyImage {
  cv::Mat image;           // H x W, CV_8UC1 or CV_16UC1, grey values in DN
  double timestamp_s = 0;  // arrival time since 1970: system clock at the first image, then even
  double exposure_s = 0;
  uint64_t number = 0;  // exposure counter of the camera; also counts images that were lost
};

struct UnsupportedExposure : Error {
  using Error::Error;
};

struct CameraStatistics {
  uint64_t images = 0;   // complete ones
  uint64_t refused = 0;  // incomplete or missing, taken again
  uint64_t resent_packets = 0, missing_packets = 0;
  uint64_t reopened = 0;  // number of reconnections
};

class GreyCamera {
 public:
  virtual ~GreyCamera() = default;
  virtual cv::Size size() const = 0;
  virtual double exposure_s() const = 0;
  // Sets the exposure time of the images that begin after the call. Throws UnsupportedExposure, and keeps the earlier one, if it is
  // outside the camera's limits; Error if the camera is lost.
  virtual void set_exposure_s(double exposure_s) = 0;
  // Returns a complete image whose exposure started after the call. Throws Error if none is received.
  virtual GreyImage take() = 0;
  // Returns the next complete image after the last one, for a camera that is not triggered by take(). Throws likewise.
  virtual GreyImage next() = 0;
  virtual CameraStatistics statistics() const = 0;
};

}  // namespace fringeslam
