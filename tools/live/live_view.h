// SPDX-License-Identifier: Apache-2.0
// One view as shown by the live page. Its pictures and figures are computed when the first viewer asks for them.
#pragma once

#include <functional>
#include <map>
#include <mutex>
#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <vector>

#include "tools/live/preview.h"

namespace fringeslam::tools {

struct LandmarkOutline {
  std::vector<cv::Point> corners_px;
  bool recognised = false;  // seen in an earlier view
};

class LiveView {
 public:
  // `number` counts all views of a run from 1. `prepare` is called once, in a viewer's thread.
  LiveView(int number, int index, std::function<Preview()> prepare)
      : number_(number), index_(index), prepare_(std::move(prepare)) {}

  int number() const { return number_; }
  int index() const { return index_; }  // the stack's index

  // Set before others access the view.
  std::vector<LandmarkOutline> landmarks;
  std::vector<std::string> warnings;  // in addition to those of its figures

  const PreviewFigures& figures() const;
  // Returns texture.jpg, modulation.jpg, saturation.png or depth.png; empty for another name.
  std::string picture(const std::string& name) const;

 private:
  const Preview& prepared() const;  // with the lock held

  int number_, index_;
  mutable std::mutex mutex_;  // guards all members below
  mutable std::function<Preview()> prepare_;
  mutable std::optional<Preview> preview_;
  mutable std::map<std::string, std::string> encoded_;
};

}  // namespace fringeslam::tools
