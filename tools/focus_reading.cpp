// SPDX-License-Identifier: Apache-2.0
#include "tools/focus_reading.h"

#include <cmath>
#include <limits>

#include "core/base/constants.h"
#include "core/decode/decode.h"
#include "core/patterns/design.h"
#include "core/types/error.h"
#include "tools/live/preview.h"

namespace fringeslam::tools {

namespace {

constexpr double kLeastRange = 0.05;     // white minus black, share of full scale, for a usable pixel
constexpr double kLeastMeasured = 0.02;  // minimum share of usable pixels in a region

cv::Mat1f flat_image(const FringeStack& stack, double level) {
  for (size_t i = 0; i < stack.images.size(); ++i) {
    const Pattern& pattern = stack.patterns.patterns[i];
    if (pattern.coding != Coding::flat || pattern.level != level) continue;
    cv::Mat1f image;
    stack.images[i].convertTo(image, CV_32F);
    return image;
  }
  throw Error(std::string("focus: the patterns have no ") + (level > 0 ? "white" : "black"));
}

double usable_share(const cv::Mat& mask) {
  return static_cast<double>(cv::countNonZero(mask)) / static_cast<double>(mask.total());
}

// Ratio of sums, so that bright pixels, which are less noisy, count more.
double contrast(const cv::Mat1f& modulation, const cv::Mat1f& range, const cv::Mat& usable) {
  if (usable_share(usable) < kLeastMeasured) return kNaN;
  return 2 * cv::mean(modulation, usable)[0] / cv::mean(range, usable)[0];
}

double texture_sharpness(const cv::Mat1f& mean) {
  double sum = 0;
  for (int row = 1; row + 1 < mean.rows; ++row) {
    for (int col = 1; col + 1 < mean.cols; ++col) {
      const double across = 0.5 * (mean(row, col + 1) - mean(row, col - 1)),
                   along = 0.5 * (mean(row + 1, col) - mean(row - 1, col));
      sum += across * across + along * along;
    }
  }
  const double brightness = cv::mean(mean)[0];
  const double pixels = static_cast<double>(mean.rows - 2) * (mean.cols - 2);
  return brightness > 0 && pixels > 0 ? std::sqrt(sum / pixels) / brightness : kNaN;
}

}  // namespace

PatternSequence focus_sequence(const RigModel& rig, double period_px) {
  SequenceDesign design;
  design.width = rig.projector.width;
  design.height = rig.projector.height;
  design.periods_px = {period_px};
  design.steps = 4;
  design.white_black = true;
  return design_sequence(design);
}

FocusReading read_focus(const FringeStack& stack, const RigModel& rig) {
  const DecodedStack decoded = decode_without_orders(stack, rig, Axis::columns);
  const cv::Mat1f white = flat_image(stack, 1);
  cv::Mat1f range;
  cv::subtract(white, flat_image(stack, 0), range);
  const double full = rig.sensor.max_dn();
  const cv::Mat usable = (range >= kLeastRange * full) & (white < DecodeOptions().saturation * full);

  FocusReading reading;
  reading.fringes = contrast(decoded.modulation, range, usable);
  reading.measured = usable_share(usable);
  reading.sharpness = texture_sharpness(decoded.mean);
  const auto cell = [&](int row, int col) {
    const auto third = [](int length, int index) { return length * index / 3; };
    const cv::Rect area(cv::Point(third(usable.cols, col), third(usable.rows, row)),
                        cv::Point(third(usable.cols, col + 1), third(usable.rows, row + 1)));
    return contrast(decoded.modulation(area), range(area), usable(area));
  };
  reading.centre = cell(1, 1);
  double sum = 0;
  int lit = 0;
  for (const double corner : {cell(0, 0), cell(0, 2), cell(2, 0), cell(2, 2)}) {
    if (std::isnan(corner)) continue;
    sum += corner;
    ++lit;
  }
  reading.corners = lit > 0 ? sum / lit : kNaN;
  return reading;
}

}  // namespace fringeslam::tools
