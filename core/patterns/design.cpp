// SPDX-License-Identifier: Apache-2.0
#include "core/patterns/design.h"

#include <algorithm>

#include "core/types/error.h"

namespace fringeslam {

namespace {

std::vector<Pattern> axis_patterns(const SequenceDesign& design, Axis axis) {
  const int length = axis == Axis::columns ? design.width : design.height;
  std::vector<Pattern> patterns =
      phase_shift_sequence(design.width, design.height, design.periods_px, design.steps, axis, design.bits).patterns;
  double finest = design.gray_cell_px;
  if (finest == 0) {
    if (design.gray == GrayCode::none) return patterns;
    if (design.periods_px.empty())
      throw Error("patterns: a Gray code numbers fringe periods, but there are none; add periods_px or gray_cell_px");
    const double period = *std::min_element(design.periods_px.begin(), design.periods_px.end());
    finest = design.gray == GrayCode::complementary ? period / 2 : period;
  }
  for (Pattern pattern : gray_patterns(axis, finest, length, design.bits)) {
    patterns.push_back(pattern);
    pattern.inverted = true;
    if (design.gray_inverted) patterns.push_back(pattern);
  }
  return patterns;
}

Pattern flat_pattern(double level, int bits) {
  Pattern pattern;
  pattern.coding = Coding::flat;
  pattern.level = level;
  pattern.bits = bits;
  return pattern;
}

}  // namespace

PatternSequence design_sequence(const SequenceDesign& design) {
  PatternSequence sequence{design.width, design.height, {}};
  std::vector<Pattern>& all = sequence.patterns;
  const auto append = [&](const std::vector<Pattern>& more) { all.insert(all.end(), more.begin(), more.end()); };
  if (design.columns) append(axis_patterns(design, Axis::columns));
  if (design.rows) append(axis_patterns(design, Axis::rows));
  if (design.white_black) append({flat_pattern(1, design.bits), flat_pattern(0, design.bits)});
  for (int i = 0; i < design.ramp_levels; ++i)
    all.push_back(flat_pattern(static_cast<double>(i) / std::max(1, design.ramp_levels - 1), design.bits));
  if (all.empty()) throw Error("patterns: the sequence is empty; specify periods_px, gray_cell_px or ramp_levels");
  for (Pattern& pattern : all) pattern.dithered = design.dithered && pattern.coding == Coding::fringe;
  return sequence;
}

cv::Mat3b packed_image(const std::vector<cv::Mat1b>& images, const std::string& order) {
  std::string sorted = order;
  std::sort(sorted.begin(), sorted.end());
  if (sorted != "BGR") throw Error("packing order '" + order + "' must name each of R, G and B once, such as RGB");
  if (images.size() != 3) throw Error("packing needs exactly three images");
  std::vector<cv::Mat1b> channels(3);
  for (size_t i = 0; i < 3; ++i) channels[std::string("BGR").find(order[i])] = images[i];
  cv::Mat3b packed;
  cv::merge(std::vector<cv::Mat>(channels.begin(), channels.end()), packed);
  return packed;
}

}  // namespace fringeslam
