// SPDX-License-Identifier: Apache-2.0
// A projector connected as a display: a window that fills one display at its native size.
//
// A drawn window has not necessarily been displayed: drivers queue images, and they do not reliably report whether they
// wait for the vertical sync. Therefore an image is presented at least three times and until two refresh periods have
// elapsed; the intervals between the presents show whether the driver waits.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "hw/projector.h"

namespace fringeslam {

struct FoundDisplay {
  int number = 0;
  std::string name;
  cv::Rect area;  // in desktop coordinates, px
  double refresh_hz = 0;
};

// Lists the displays. Throws Error if there is no desktop session.
std::vector<FoundDisplay> find_displays();

class SdlProjector : public Projector {
 public:
  // `display`: number printed by `fringeslam rig list`. Throws Error if it does not exist or its native mode differs
  // from `size`: a scaled image would have the wrong fringe period.
  SdlProjector(int display, cv::Size size);
  ~SdlProjector() override;

  cv::Size size() const override;
  void show(const cv::Mat& image) override;
  double refresh_s() const override;
  // Values below half a refresh period mean that the driver does not wait for the display.
  double present_interval_s() const override;

 private:
  class Window;
  std::unique_ptr<Window> window_;
};

}  // namespace fringeslam
