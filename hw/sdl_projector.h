// SPDX-License-Identifier: Apache-2.0
// A projector that is a display of the computer: a window that fills one display at its native size.
//
// That a window was drawn does not say that it was shown: drivers queue images, and whether they wait for the display
// they do not reliably tell. So an image is presented three times, and until two refresh periods have passed by the
// clock; the intervals of these presents tell whether the driver waits.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "hw/projector.h"

namespace fringeslam {

struct FoundDisplay {
  int number = 0;
  std::string name;
  cv::Rect area;  // of the desktop, px
  double refresh_hz = 0;
};

// Throws Error when there is no desktop to ask.
std::vector<FoundDisplay> find_displays();

class SdlProjector : public Projector {
 public:
  // `display`: number as `fringeslam rig list` prints it. Throws Error when there is none such, and when its native
  // mode has not `size`: an image that the display scales has no fringes of the right period.
  SdlProjector(int display, cv::Size size);
  ~SdlProjector() override;

  cv::Size size() const override;
  void show(const cv::Mat& image) override;
  double refresh_s() const override;
  // Below half a refresh period the driver does not wait for the display.
  double present_interval_s() const override;

 private:
  class Window;
  std::unique_ptr<Window> window_;
};

}  // namespace fringeslam
