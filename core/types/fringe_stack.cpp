// SPDX-License-Identifier: Apache-2.0
#include "core/types/fringe_stack.h"

#include <string>

#include "core/types/error.h"

namespace fringeslam {

std::vector<double> exposure_times_s(double timestamp_s, size_t images, const Timing& timing) {
  std::vector<double> times_s(images);
  for (size_t i = 0; i < images; ++i)
    times_s[i] =
        timestamp_s + (static_cast<double>(i) - 0.5 * (static_cast<double>(images) - 1)) / timing.camera_rate_hz;
  return times_s;
}

void check_stack(const FringeStack& stack) {
  const std::string name = "stack " + std::to_string(stack.index);
  const size_t images = stack.images.size(), patterns = stack.patterns.patterns.size(),
               exposures = stack.exposure_s.size(), times = stack.exposure_time_s.size();
  if (patterns != images || exposures != images || times != images)
    throw Error(name + " has " + std::to_string(images) + " images, " + std::to_string(patterns) + " patterns, " +
                std::to_string(exposures) + " exposures and " + std::to_string(times) +
                " exposure times; there must be one of each per image");
  for (const cv::Mat& image : stack.images) {
    if (image.size() != stack.images.front().size() || image.type() != stack.images.front().type())
      throw Error(name + ": its images differ in size or type");
    if (image.type() != CV_8UC1 && image.type() != CV_16UC1 && image.type() != CV_32FC1)
      throw Error(name + ": images must be grey, 8 or 16 bit or float");
  }
}

}  // namespace fringeslam
