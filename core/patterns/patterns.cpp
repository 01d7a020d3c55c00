// SPDX-License-Identifier: Apache-2.0
#include "core/patterns/patterns.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/base/constants.h"
#include "core/patterns/long_run_code.h"
#include "core/types/error.h"
#include "core/types/options.h"

namespace fringeslam {

size_t distinct_shifts(const std::vector<double>& shifts_rad) {
  std::vector<double> distinct;
  for (const double shift : shifts_rad) {
    const bool known = std::any_of(distinct.begin(), distinct.end(), [&](double other) {
      return std::abs(std::remainder(shift - other, kTwoPi)) < 1e-6;
    });
    if (!known) distinct.push_back(shift);
  }
  return distinct.size();
}

namespace {

// Floyd-Steinberg error diffusion; the scan direction alternates between rows so that no direction is preferred.
cv::Mat1f diffused(cv::Mat1f wanted, double levels) {
  const int rows = wanted.rows, cols = wanted.cols;
  cv::Mat1f shown(wanted.size());
  const auto pass_on = [&](int row, int col, double error) {
    if (row < rows && col >= 0 && col < cols) wanted(row, col) += static_cast<float>(error);
  };
  for (int row = 0; row < rows; ++row) {
    const int ahead = row % 2 == 0 ? 1 : -1;
    for (int i = 0; i < cols; ++i) {
      const int col = ahead > 0 ? i : cols - 1 - i;
      const double value = std::clamp(std::round(wanted(row, col) * levels) / levels, 0.0, 1.0);
      const double error = wanted(row, col) - value;
      shown(row, col) = static_cast<float>(value);
      pass_on(row, col + ahead, error * 7 / 16);
      pass_on(row + 1, col - ahead, error * 3 / 16);
      pass_on(row + 1, col, error * 5 / 16);
      pass_on(row + 1, col + ahead, error * 1 / 16);
    }
  }
  return shown;
}

}  // namespace

double absolute_phase(double coordinate_px, double period_px) { return kTwoPi * (coordinate_px + 0.5) / period_px; }

double projector_coordinate(double absolute_phase_rad, double period_px) {
  return absolute_phase_rad * period_px / kTwoPi - 0.5;
}

int gray_cell(double coordinate_px, double cell_px) {
  return static_cast<int>(std::floor((coordinate_px + 0.5) / cell_px));
}

PatternSequence phase_shift_sequence(int width, int height, const std::vector<double>& periods_px, int steps, Axis axis,
                                     int bits) {
  PatternSequence sequence{width, height, {}};
  for (const double period : periods_px) {
    for (int step = 0; step < steps; ++step)
      sequence.patterns.push_back({axis, period, kTwoPi * (step - 0.5 * (steps - 1)) / steps, bits});
  }
  return sequence;
}

std::vector<Pattern> gray_patterns(Axis axis, double cell_px, int length_px, int bits, double carrier_px) {
  std::vector<Pattern> patterns;
  bool has_carrier = false;
  // The bit of cell width c is constant over the first c px, so it carries no information if c >= length_px.
  for (double cell = cell_px; cell < length_px; cell *= 2) {
    Pattern pattern{axis, cell, 0, bits};
    pattern.coding = Coding::gray;
    has_carrier |= cell == carrier_px;
    if (carrier_px > 0 && cell > carrier_px) pattern.carrier_px = carrier_px;
    patterns.insert(patterns.begin(), pattern);
  }
  if (carrier_px > 0 && !has_carrier)
    throw Error("patterns: the Gray code has no bit with cells of " + to_text(carrier_px) +
                " px to combine the others with; its cells are " + to_text(cell_px) + " px times powers of two");
  return patterns;
}

std::vector<Pattern> long_run_patterns(Axis axis, double cell_px, int length_px, int bits) {
  int code_bits = 1;
  while (std::exp2(code_bits) * cell_px < length_px * (1 - 1e-9)) ++code_bits;
  if (code_bits > kMostLongRunBits)
    throw Error("patterns: cells of " + to_text(cell_px) + " px over " + std::to_string(length_px) + " px need " +
                std::to_string(code_bits) + " bits; a Gray code with long runs has at most " +
                std::to_string(kMostLongRunBits) + "; use wider cells");
  std::vector<Pattern> patterns;
  for (int bit = 0; bit < code_bits; ++bit) {
    Pattern pattern{axis, cell_px, 0, bits};
    pattern.coding = Coding::gray;
    pattern.code_bits = code_bits;
    pattern.code_bit = bit;
    patterns.push_back(pattern);
  }
  return patterns;
}

std::vector<FringeGroup> fringe_groups(const PatternSequence& sequence, Axis axis) {
  std::vector<FringeGroup> groups;
  for (size_t i = 0; i < sequence.patterns.size(); ++i) {
    const Pattern& pattern = sequence.patterns[i];
    if (pattern.coding != Coding::fringe || pattern.axis != axis) continue;
    auto group = std::find_if(groups.begin(), groups.end(),
                              [&](const FringeGroup& g) { return g.period_px == pattern.period_px; });
    if (group == groups.end()) group = groups.insert(groups.end(), FringeGroup{axis, pattern.period_px, {}, {}});
    group->images.push_back(static_cast<int>(i));
    group->shifts_rad.push_back(pattern.shift_rad);
  }
  for (const FringeGroup& group : groups) {
    if (distinct_shifts(group.shifts_rad) < 3)
      throw Error("patterns: period " + to_text(group.period_px) +
                  " px has fewer than three distinct phase shifts; add steps, or describe its images by `extra`");
  }
  std::stable_sort(groups.begin(), groups.end(),
                   [](const auto& a, const auto& b) { return a.period_px > b.period_px; });
  return groups;
}

PatternSequence finest_patterns(const PatternSequence& sequence, Axis axis) {
  const std::vector<FringeGroup> groups = fringe_groups(sequence, axis);
  PatternSequence finest = sequence;
  finest.patterns.clear();
  if (groups.empty()) return finest;
  for (const int image : groups.back().images) finest.patterns.push_back(sequence.patterns[static_cast<size_t>(image)]);
  return finest;
}

bool has_exposures(const PatternSequence& sequence) {
  return std::any_of(sequence.patterns.begin(), sequence.patterns.end(),
                     [](const Pattern& p) { return p.exposure != 1; });
}

bool codes_axis(const PatternSequence& sequence, Axis axis) {
  return std::any_of(sequence.patterns.begin(), sequence.patterns.end(), [&](const Pattern& p) {
    return p.axis == axis && (p.coding == Coding::fringe || p.coding == Coding::gray || p.coding == Coding::product);
  });
}

void require_decoder(const PatternSequence& sequence, Axis axis) {
  const bool others = std::any_of(sequence.patterns.begin(), sequence.patterns.end(),
                                  [&](const Pattern& p) { return p.axis == axis && p.coding == Coding::extra; });
  if (others && !codes_axis(sequence, axis))
    throw Error(std::string("patterns: ") + to_string(axis) +
                " are coded only by `extra` images, which determine no phase by themselves; add `fringe` images with "
                "three or more phase shifts of a period, or a `gray` code");
}

namespace {

// Adds an image to the bits of a code.
void add_to_code(std::vector<GrayBit>& bits, const Pattern& pattern, int image) {
  auto bit = std::find_if(bits.begin(), bits.end(), [&](const GrayBit& known) {
    return known.cell_px == pattern.period_px && known.code_bit == pattern.code_bit;
  });
  if (bit == bits.end())
    bit = bits.insert(bits.end(), {pattern.period_px, pattern.carrier_px, pattern.code_bits, pattern.code_bit});
  (pattern.inverted ? bit->inverted_image : bit->image) = image;
}

}  // namespace

std::vector<std::vector<GrayBit>> gray_codes(const PatternSequence& sequence, Axis axis) {
  // Each code by its carrier and, with long runs, its cell width and number of bits; in the order of appearance.
  struct Code {
    double carrier_px = 0, cell_px = 0;
    int bits = 0;
    bool operator==(const Code&) const = default;
  };
  std::vector<Code> kinds;
  const auto is_bit = [&](const Pattern& p) { return p.coding == Coding::gray && p.axis == axis; };
  for (const Pattern& pattern : sequence.patterns) {
    if (!is_bit(pattern)) continue;
    const bool long_runs = pattern.code_bits > 0;
    const Code kind{long_runs ? 0 : pattern.carrier_px, long_runs ? pattern.period_px : 0, pattern.code_bits};
    if (std::find(kinds.begin(), kinds.end(), kind) == kinds.end()) kinds.push_back(kind);
  }
  std::vector<std::vector<GrayBit>> codes;
  for (const Code& kind : kinds) {
    std::vector<GrayBit> bits;
    for (size_t i = 0; i < sequence.patterns.size(); ++i) {
      const Pattern& pattern = sequence.patterns[i];
      if (!is_bit(pattern) || pattern.code_bits != kind.bits) continue;
      const bool belongs = kind.bits > 0 ? pattern.period_px == kind.cell_px
                                         : pattern.carrier_px == kind.carrier_px ||
                                               (pattern.carrier_px == 0 && pattern.period_px <= kind.carrier_px);
      if (belongs) add_to_code(bits, pattern, static_cast<int>(i));
    }
    std::stable_sort(bits.begin(), bits.end(), [](const GrayBit& a, const GrayBit& b) {
      return a.cell_px != b.cell_px ? a.cell_px > b.cell_px : a.code_bit < b.code_bit;
    });
    codes.push_back(std::move(bits));
  }
  const auto cells = [](const std::vector<GrayBit>& bits) { return bits.size(); };
  const size_t most = codes.empty() ? 0 : cells(*std::max_element(codes.begin(), codes.end(), [&](auto& a, auto& b) {
    return cells(a) < cells(b);
  }));
  std::stable_partition(codes.begin(), codes.end(),
                        [&](const std::vector<GrayBit>& bits) { return cells(bits) == most || bits[0].code_bits > 0; });
  return codes;
}

std::vector<GrayBit> gray_bits(const PatternSequence& sequence, Axis axis) {
  std::vector<std::vector<GrayBit>> codes = gray_codes(sequence, axis);
  return codes.empty() ? std::vector<GrayBit>() : std::move(codes.front());
}

namespace {

bool gray_bit_at(double coordinate_px, double cell_px) {
  return ((gray_cell(coordinate_px, cell_px) + 1) >> 1) % 2 != 0;
}

double gray_level(const Pattern& pattern, double coordinate_px) {
  if (pattern.code_bits > 0) {
    const std::vector<unsigned>& words = long_run_code(pattern.code_bits);
    const int cell = std::clamp(gray_cell(coordinate_px, pattern.period_px), 0, static_cast<int>(words.size()) - 1);
    const bool set = words[static_cast<size_t>(cell)] >> (pattern.code_bits - 1 - pattern.code_bit) & 1U;
    return set != pattern.inverted ? 1 : 0;
  }
  bool bit = gray_bit_at(coordinate_px, pattern.period_px);
  if (pattern.carrier_px > 0) bit ^= gray_bit_at(coordinate_px, pattern.carrier_px);
  return bit != pattern.inverted ? 1 : 0;
}

}  // namespace

double ideal_intensity(const Pattern& pattern, double coordinate_px) {
  switch (pattern.coding) {
    case Coding::fringe:
    case Coding::extra:
      return 0.5 + 0.5 * std::cos(absolute_phase(coordinate_px, pattern.period_px) + pattern.shift_rad);
    case Coding::product:
      return 0.5 + 0.5 * std::cos(absolute_phase(coordinate_px, pattern.period_px) + pattern.shift_rad) *
                       std::cos(absolute_phase(coordinate_px, pattern.carrier_px) + pattern.carrier_shift_rad);
    case Coding::gray:
      return gray_level(pattern, coordinate_px);
    case Coding::flat:
      break;
  }
  return pattern.level;
}

cv::Mat1f pattern_levels(const Pattern& pattern, const PatternSequence& sequence) {
  const bool columns = pattern.axis == Axis::columns, flat = pattern.coding == Coding::flat;
  const cv::Size size(columns && !flat ? sequence.width : 1, !columns && !flat ? sequence.height : 1);
  cv::Mat1f wanted(size);
  for (int i = 0; i < static_cast<int>(wanted.total()); ++i)
    wanted(i) = static_cast<float>(interpolate_table(sequence.inverse_response, ideal_intensity(pattern, i)));
  if (pattern.bits == 0) return wanted;
  const double levels = (1 << pattern.bits) - 1;
  if (pattern.dithered)
    return diffused(cv::repeat(wanted, sequence.height / size.height, sequence.width / size.width), levels);
  for (float& level : wanted) level = static_cast<float>(std::round(static_cast<double>(level) * levels) / levels);
  return wanted;
}

cv::Mat pattern_image(const Pattern& pattern, const PatternSequence& sequence) {
  const cv::Mat1f levels = pattern_levels(pattern, sequence);
  const bool wide = pattern.bits > 8;
  cv::Mat image;
  levels.convertTo(image, wide ? CV_16U : CV_8U, wide ? 65535 : 255);
  return cv::repeat(image, sequence.height / levels.rows, sequence.width / levels.cols);
}

double interpolate_table(const std::vector<double>& table, double position) {
  if (table.empty()) return position;
  const double at = std::clamp(position, 0.0, 1.0) * static_cast<double>(table.size() - 1);
  const size_t low = std::min(static_cast<size_t>(at), table.size() - 1), high = std::min(low + 1, table.size() - 1);
  return table[low] + (at - static_cast<double>(low)) * (table[high] - table[low]);
}

std::vector<double> invert_table(const std::vector<double>& table, int entries) {
  std::vector<double> inverse;
  for (int i = 0; i < entries; ++i) {
    const double wanted = static_cast<double>(i) / (entries - 1);
    const auto above = std::upper_bound(table.begin(), table.end(), wanted);
    if (above == table.begin() || above == table.end()) {
      inverse.push_back(above == table.begin() ? 0 : 1);
      continue;
    }
    const double part = (wanted - above[-1]) / (above[0] - above[-1]);
    inverse.push_back((static_cast<double>(above - table.begin()) - 1 + part) / static_cast<double>(table.size() - 1));
  }
  return inverse;
}

}  // namespace fringeslam
