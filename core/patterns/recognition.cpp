// SPDX-License-Identifier: Apache-2.0
#include "core/patterns/recognition.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <cstdio>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>

#include "core/base/constants.h"
#include "core/patterns/cosine_fit.h"
#include "core/patterns/patterns.h"
#include "core/types/error.h"

namespace fringeslam {

namespace {

constexpr double kPeriodAgreement = 1e-3;  // of fringes of one group
constexpr double kShiftAgreement_rad = 0.02;
constexpr double kLeastRange = 0.02;  // of full scale, for a pattern that is not flat

// Levels of an image in parts of full scale.
struct PatternLevels {
  cv::Mat1d image;
  double step = 0;  // between neighbouring levels of the file; 0: continuous
};

PatternLevels levels_of_image(const cv::Mat& image) {
  PatternLevels levels;
  if (image.depth() == CV_8U) levels.step = 1 / 255.0;
  if (image.depth() == CV_16U) levels.step = 1 / 65535.0;
  image.convertTo(levels.image, CV_64F, levels.step > 0 ? levels.step : 1);
  return levels;
}

// Levels along one axis.
struct Profile {
  Axis axis = Axis::columns;
  std::vector<double> levels;
  double low = 0, high = 0;
  double step = 0;
  double deviation = 0;  // greatest deviation of a pixel from its column or row
  double range() const { return high - low; }
};

Profile profile_of(const PatternLevels& levels, Axis axis) {
  const bool columns = axis == Axis::columns;
  cv::Mat1d mean;
  cv::reduce(levels.image, mean, columns ? 0 : 1, cv::REDUCE_AVG, CV_64F);
  Profile profile{axis, {mean.begin(), mean.end()}, 0, 0, levels.step, 0};
  for (int row = 0; row < levels.image.rows; ++row) {
    for (int col = 0; col < levels.image.cols; ++col)
      profile.deviation =
          std::max(profile.deviation, std::abs(levels.image(row, col) - (columns ? mean(0, col) : mean(row, 0))));
  }
  const auto [low, high] = std::minmax_element(profile.levels.begin(), profile.levels.end());
  profile.low = *low, profile.high = *high;
  return profile;
}

// Numbers near a value, the simplest first: whole ones, a whole number of periods over the length, and few decimals.
std::vector<double> simple_numbers(double value, double length) {
  std::vector<double> numbers = {std::round(value)};
  if (const double count = std::round(length / value); count >= 1) numbers.push_back(length / count);
  for (const double scale : {10.0, 100.0, 1e3, 1e4}) numbers.push_back(std::round(value * scale) / scale);
  std::erase_if(numbers, [](double number) { return !(number > 0); });
  return numbers;
}

std::string rounded_text(double value, int digits = 4) {
  char text[32];
  std::snprintf(text, sizeof text, "%.*g", digits, value);
  return text;
}

std::string percent_text(double part) { return rounded_text(100 * part, 2) + " %"; }

// --- Gray code ---

// Positions of the first pixels after the edges of a profile of two levels; empty if it has other levels.
std::optional<std::vector<size_t>> edges_of(const Profile& profile) {
  const double tolerance = std::max(0.03 * profile.range(), profile.step);
  std::vector<size_t> edges;
  bool was_bright = false;
  for (size_t i = 0; i < profile.levels.size(); ++i) {
    const double level = profile.levels[i];
    const bool bright = level > 0.5 * (profile.low + profile.high);
    if (std::abs(level - (bright ? profile.high : profile.low)) > tolerance) return std::nullopt;
    if (i > 0 && bright != was_bright) edges.push_back(i);
    was_bright = bright;
  }
  return edges;
}

std::vector<size_t> edges_of(const Pattern& bit, size_t length) {
  std::vector<size_t> edges;
  for (size_t i = 1; i < length; ++i) {
    const auto u = static_cast<double>(i);
    if (ideal_intensity(bit, u) != ideal_intensity(bit, u - 1)) edges.push_back(i);
  }
  return edges;
}

// Cell widths c with low < c <= high.
struct CellRange {
  double low, high;
  bool empty() const { return !(low < high); }
  bool contains(double cell_px) const { return low < cell_px && cell_px <= high; }
  double middle() const { return 0.5 * (low + high); }
};

// Edges of a Gray bit with cells of c: at x = c, 3 c, 5 c, ... Combined by XOR with a bit that has cells of a power of two
// times c, the `multiple`, it also has the other one's edges (multiple 1: not combined). Returns the first `count` and the next one, as
// multiples of c.
std::vector<double> edges_in_cells(size_t count, double multiple) {
  std::vector<double> edges;
  double own = 1, other = multiple;
  while (edges.size() <= count) {
    const bool is_own = multiple == 1 || own < other;
    edges.push_back(is_own ? own : other);
    if (is_own)
      own += 2;
    else
      other += 2 * multiple;
  }
  return edges;
}

// The cells whose bit, combined by XOR with that of `multiple` times their width, has these edges, the next one beyond
// the last pixel.
CellRange cells_with(const std::vector<size_t>& edges, size_t length, double multiple = 1) {
  const auto last = static_cast<double>(length);
  const std::vector<double> in_cells = edges_in_cells(edges.size(), multiple);
  CellRange range{(last - 0.5) / in_cells.back(), last};
  for (size_t k = 0; k < edges.size(); ++k) {
    const double at = static_cast<double>(edges[k]);
    range.low = std::max(range.low, (at - 0.5) / in_cells[k]);
    range.high = std::min(range.high, (at + 0.5) / in_cells[k]);
  }
  return range;
}

double simplest_cell_px(const CellRange& range, size_t length) {
  for (const double cell_px : simple_numbers(range.middle(), static_cast<double>(length))) {
    if (range.contains(cell_px)) return cell_px;
  }
  return range.middle();
}

std::optional<Pattern> gray_bit_of(const Profile& profile, const std::vector<size_t>& edges) {
  const size_t length = profile.levels.size();
  Pattern pattern;
  pattern.axis = profile.axis;
  pattern.coding = Coding::gray;
  pattern.inverted = profile.levels.front() > 0.5 * (profile.low + profile.high);
  // Pixels do not resolve narrower cells. A bit with cells as wide as the image has no edges of its own.
  constexpr double kNarrowest_px = 1;
  for (double multiple = 1; multiple < static_cast<double>(length); multiple *= 2) {
    const CellRange range = cells_with(edges, length, multiple);
    if (range.empty() || range.high < kNarrowest_px || multiple * range.low >= static_cast<double>(length)) continue;
    const double cell_px = simplest_cell_px(range, length);
    pattern.period_px = multiple * cell_px;
    pattern.carrier_px = multiple == 1 ? 0 : cell_px;
    return pattern;
  }
  return std::nullopt;
}

// --- cosines ---

CosineFit with_simple_period(const CosineFit& best, const Profile& profile) {
  constexpr double kSigmas = 3;
  const double tolerance_px = kSigmas * best.period_sigma_px + 1e-8 * best.period_px;
  for (const double period_px : simple_numbers(best.period_px, static_cast<double>(profile.levels.size()))) {
    if (period_px >= 2 && std::abs(period_px - best.period_px) < tolerance_px)
      return fit_cosine(profile.levels, period_px);
  }
  return best;
}

// Whole degrees at the edge of the image or in the middle of the first pixel, where other rigs have their origins, if
// the largest residual then is hardly more than half a level, as rounding leaves. Rounding errors that repeat with the
// period shift the phase of the fit by more than independent ones would.
double simple_shift_rad(const CosineFit& fit, const Profile& profile) {
  constexpr double kLargest_rad = 1e-3;
  double simple_rad = fit.shift_rad, least_rad = kLargest_rad;
  for (const double origin_deg : {0.0, -180 / fit.period_px}) {
    const double degrees = std::round(fit.shift_rad * 180 / kPi - origin_deg);
    // In this order, import.yaml's descriptions give the same bits.
    const double shift_rad = std::remainder(origin_deg * kPi / 180 + degrees * kPi / 180, kTwoPi);
    const double change_rad = std::abs(std::remainder(shift_rad - fit.shift_rad, kTwoPi));
    if (change_rad >= least_rad) continue;
    const double largest = fit_cosine(profile.levels, fit.period_px, shift_rad).largest;
    if (largest > std::max(0.6 * profile.step, 1.2 * fit.largest) + 1e-9) continue;
    simple_rad = shift_rad;
    least_rad = change_rad;
  }
  return simple_rad;
}

bool is_cosine(const CosineFit& fit, const Profile& profile) {
  constexpr double kMostRms = 0.004;  // of the range; rounding to 8 bits leaves 0.0011 of the full range
  const double outside = 2 * profile.step + 0.01 * profile.range();
  return fit.rms <= std::max(kMostRms * profile.range(), 0.4 * profile.step) && fit.mean - fit.modulation >= -outside &&
         fit.mean + fit.modulation <= 1 + outside;
}

RecognizedPattern cosine_pattern(const CosineFit& best, const Profile& profile) {
  const CosineFit fit = with_simple_period(best, profile);
  RecognizedPattern result;
  result.pattern.axis = profile.axis;
  result.pattern.period_px = fit.period_px;
  result.pattern.shift_rad = simple_shift_rad(fit, profile);
  result.dark = std::max(0.0, fit.mean - fit.modulation);
  result.bright = std::min(1.0, fit.mean + fit.modulation);
  return result;
}

// --- errors ---

std::string cosine_text(Axis axis, double period_px, double shift_rad) {
  // As import.yaml's phase_offset_deg, whose default origin is the middle of the first pixel.
  const double offset_deg = std::remainder(shift_rad * 180 / kPi + 180 / period_px, 360);
  return std::string("along ") + to_string(axis) + ", of period " + rounded_text(period_px, 6) +
         " px and phase_offset_deg " + rounded_text(offset_deg);
}

Error not_recognized(const CosineFit& best, const Profile& profile) {
  constexpr double kMostRms = 0.006;  // of the range
  const DistortedCosineFit distorted = fit_distorted_cosine(profile.levels, best);
  const std::string left = percent_text(best.rms / profile.range()) + " of the range (rms)";
  if (distorted.period_px > 0 && distorted.rms <= std::max(kMostRms * profile.range(), 0.6 * profile.step))
    return Error("is not a cosine (the best one leaves " + left + ") but a monotone function of one " +
                 cosine_text(profile.axis, distorted.period_px, distorted.shift_rad) +
                 (distorted.gamma > 0 ? ", with a gamma of " + rounded_text(distorted.gamma, 3) : "") +
                 "; describe it by `fringe` or `extra` instead of `projected`, and state the pre-distortion");
  return Error("is neither flat nor a Gray code bit nor a cosine; the best cosine, " +
               cosine_text(profile.axis, best.period_px, best.shift_rad) + ", leaves " + left +
               "; describe it by `fringe`, `extra`, `product`, `gray` or `flat` instead of `projected`");
}

Error no_gray_bit(const std::vector<size_t>& edges) {
  constexpr size_t kShown = 4;
  std::string list;
  for (size_t i = 0; i < std::min(kShown, edges.size()); ++i) list += (i ? ", " : "") + std::to_string(edges[i]);
  return Error(
      "has two levels with edges at " + list + (edges.size() > kShown ? ", ..." : "") +
      " px, but is no bit of a reflected Gray code, whose edges lie at c, 3c, 5c, ... for cells of c px, nor two "
      "of them combined by XOR; "
      "project Gray codes, or fringes of more than 1 bit");
}

Profile coded_profile(const PatternLevels& levels) {
  const Profile columns = profile_of(levels, Axis::columns), rows = profile_of(levels, Axis::rows);
  const Profile& coded = columns.deviation <= rows.deviation ? columns : rows;
  double low = 0, high = 0;
  cv::minMaxLoc(levels.image, &low, &high);
  if (coded.deviation > std::max(1.5 * levels.step, 0.015 * (high - low)))
    throw Error(
        "varies along columns and along rows, by up to " + percent_text(rows.deviation) + " and " +
        percent_text(columns.deviation) +
        " of full scale; patterns that vary along one axis are recognized: describe others by hand instead of by "
        "`projected`");
  return coded;
}

RecognizedPattern flat_level(const Profile& profile) {
  const double level = std::clamp(0.5 * (profile.low + profile.high), 0.0, 1.0);
  RecognizedPattern result{{}, level, level};
  result.pattern.coding = Coding::flat;
  result.pattern.level = level;
  return result;
}

// --- sequences ---

void set_period(Pattern& pattern, double period_px, int length) {
  // The phase in the middle hardly depends on the period.
  pattern.shift_rad =
      std::remainder(pattern.shift_rad + kPi * length * (1 / pattern.period_px - 1 / period_px), kTwoPi);
  pattern.period_px = period_px;
}

bool have_equal_periods(const Pattern& a, const Pattern& b) {
  return a.coding == Coding::fringe && b.coding == Coding::fringe && a.axis == b.axis &&
         std::abs(a.period_px / b.period_px - 1) < kPeriodAgreement;
}

// A described period, else the one with the fewest digits.
double common_period_px(const Pattern& pattern, const std::vector<RecognizedPattern>& recognized,
                        const std::vector<Pattern>& described) {
  for (const Pattern& other : described) {
    if (have_equal_periods(pattern, other)) return other.period_px;
  }
  double simplest = pattern.period_px;
  for (const RecognizedPattern& other : recognized) {
    if (have_equal_periods(pattern, other.pattern) &&
        to_text(other.pattern.period_px).size() < to_text(simplest).size())
      simplest = other.pattern.period_px;
  }
  return simplest;
}

int length_along(Axis axis, const cv::Size& projector) {
  return axis == Axis::columns ? projector.width : projector.height;
}

void unite_periods(std::vector<RecognizedPattern>& recognized, const std::vector<Pattern>& described,
                   const cv::Size& projector) {
  for (size_t i = 0; i < recognized.size(); ++i) {
    const Pattern first = recognized[i].pattern;
    if (first.coding != Coding::fringe) continue;
    const double period_px = common_period_px(first, recognized, described);
    for (size_t k = i; k < recognized.size(); ++k) {
      if (have_equal_periods(first, recognized[k].pattern))
        set_period(recognized[k].pattern, period_px, length_along(first.axis, projector));
    }
  }
}

// Offset of shifts k step + offset in any order, near the first of them.
double common_offset_rad(const std::vector<Pattern*>& fringes, double step_rad) {
  std::complex<double> sum = 0;
  for (const Pattern* fringe : fringes) sum += std::polar(1.0, kTwoPi / step_rad * fringe->shift_rad);
  const double offset_rad = std::arg(sum) / kTwoPi * step_rad;
  return offset_rad + step_rad * std::round((fringes.front()->shift_rad - offset_rad) / step_rad);
}

// The usual offset near a measured one: steps centred on 0, or from 0 at the edge or in the middle of the first pixel;
// otherwise whole degrees there.
double usual_offset_rad(double measured_rad, double step_rad, double period_px) {
  constexpr double kUsual_rad = 2e-3, kWhole_rad = 1e-3, kDegree_rad = kPi / 180;
  const double middle_rad = -kPi / period_px;
  double offset_rad = measured_rad, least_rad = kUsual_rad;
  const auto consider = [&](double simple_rad) {
    const double off_rad = std::remainder(simple_rad - measured_rad, step_rad);
    if (std::abs(off_rad) >= least_rad) return;
    offset_rad = simple_rad;
    least_rad = std::abs(off_rad);
  };
  for (const double simple_rad : {0.0, 0.5 * step_rad, middle_rad}) consider(simple_rad);
  if (least_rad < kUsual_rad) return offset_rad;
  least_rad = kWhole_rad;
  for (const double origin_rad : {0.0, middle_rad})
    consider(origin_rad + kDegree_rad * std::round((measured_rad - origin_rad) / kDegree_rad));
  return offset_rad;
}

// Gives shifts that are equal steps of a turn, up to rounding, exactly these values.
void space_equally(std::vector<Pattern*>& fringes) {
  constexpr double kLargest_rad = 0.01, kNegligible_rad = 1e-9;
  const auto count = static_cast<long>(fringes.size());
  const double step_rad = kTwoPi / static_cast<double>(count);
  const double offset_rad =
      usual_offset_rad(common_offset_rad(fringes, step_rad), step_rad, fringes.front()->period_px);
  std::set<long> places;
  std::vector<double> shifts_rad;
  double largest_rad = 0;
  for (const Pattern* fringe : fringes) {
    const long place = std::lround((fringe->shift_rad - offset_rad) / step_rad);
    places.insert((place % count + count) % count);
    shifts_rad.push_back(std::remainder(offset_rad + static_cast<double>(place) * step_rad, kTwoPi));
    largest_rad = std::max(largest_rad, std::abs(std::remainder(shifts_rad.back() - fringe->shift_rad, kTwoPi)));
  }
  if (places.size() != fringes.size() || largest_rad > kLargest_rad || largest_rad < kNegligible_rad) return;
  for (size_t k = 0; k < fringes.size(); ++k) fringes[k]->shift_rad = shifts_rad[k];
}

void space_equally(std::vector<RecognizedPattern>& recognized) {
  std::map<std::pair<Axis, double>, std::vector<Pattern*>> groups;
  for (RecognizedPattern& each : recognized) {
    if (each.pattern.coding == Coding::fringe)
      groups[{each.pattern.axis, each.pattern.period_px}].push_back(&each.pattern);
  }
  for (auto& [period, fringes] : groups) {
    if (fringes.size() >= 3) space_equally(fringes);
  }
}

size_t shifts_of_period(const Pattern& pattern, const std::vector<Pattern>& patterns) {
  std::vector<double> shifts_rad;
  for (const Pattern& other : patterns) {
    if (other.coding != Coding::fringe || other.axis != pattern.axis || other.period_px != pattern.period_px) continue;
    const bool known = std::any_of(shifts_rad.begin(), shifts_rad.end(), [&](double shift) {
      return std::abs(std::remainder(shift - other.shift_rad, kTwoPi)) < kShiftAgreement_rad;
    });
    if (!known) shifts_rad.push_back(other.shift_rad);
  }
  return shifts_rad.size();
}

void mark_extra_periods(std::vector<RecognizedPattern>& recognized, std::vector<Pattern> all) {
  for (const RecognizedPattern& each : recognized) all.push_back(each.pattern);
  for (RecognizedPattern& each : recognized) {
    if (each.pattern.coding == Coding::fringe && shifts_of_period(each.pattern, all) < 3)
      each.pattern.coding = Coding::extra;
  }
}

// Widths whose multiples by powers of two may be cells of an axis: of described cells, then of fringes, finest first.
std::vector<double> cell_widths_px(const std::vector<RecognizedPattern>& recognized,
                                   const std::vector<Pattern>& described, Axis axis) {
  std::vector<double> cells_px, periods_px;
  const auto add = [&](const Pattern& pattern, bool with_cells) {
    if (pattern.axis != axis) return;
    if (pattern.coding == Coding::gray && with_cells) cells_px.push_back(pattern.period_px);
    if (pattern.coding == Coding::fringe) periods_px.push_back(pattern.period_px);
  };
  for (const Pattern& pattern : described) add(pattern, true);
  for (const RecognizedPattern& each : recognized) add(each.pattern, false);
  std::sort(periods_px.begin(), periods_px.end());
  cells_px.insert(cells_px.end(), periods_px.begin(), periods_px.end());
  return cells_px;
}

double nearest_power_of_two(double ratio) { return std::exp2(std::round(std::log2(ratio))); }

void unite_cells(std::vector<RecognizedPattern>& recognized, const std::vector<Pattern>& described,
                 const cv::Size& projector, Axis axis) {
  std::vector<Pattern*> bits;
  for (RecognizedPattern& each : recognized) {
    if (each.pattern.axis == axis && each.pattern.coding == Coding::gray) bits.push_back(&each.pattern);
  }
  if (bits.empty()) return;
  const auto length = static_cast<size_t>(length_along(axis, projector));
  const double finest_px = (*std::min_element(bits.begin(), bits.end(), [](const Pattern* a, const Pattern* b) {
                             return a->period_px < b->period_px;
                           }))->period_px;
  // Cell widths of the finest bit that agree with all bits.
  CellRange common{0, static_cast<double>(length)};
  for (const Pattern* bit : bits) {
    const double multiple = bit->carrier_px > 0 ? nearest_power_of_two(bit->period_px / bit->carrier_px) : 1;
    const CellRange own = cells_with(edges_of(*bit, length), length, multiple);
    const double factor = nearest_power_of_two(bit->period_px / multiple / finest_px);
    common = {std::max(common.low, own.low / factor), std::min(common.high, own.high / factor)};
  }
  if (common.empty()) return;
  double cell_px = simplest_cell_px(common, length);
  for (const double width_px : cell_widths_px(recognized, described, axis)) {
    const double multiple_px = width_px * nearest_power_of_two(finest_px / width_px);
    if (!common.contains(multiple_px)) continue;
    cell_px = multiple_px;
    break;
  }
  for (Pattern* bit : bits) {
    bit->period_px = cell_px * nearest_power_of_two(bit->period_px / finest_px);
    if (bit->carrier_px > 0) bit->carrier_px = cell_px * nearest_power_of_two(bit->carrier_px / finest_px);
  }
}

void scale_levels(std::vector<RecognizedPattern>& recognized) {
  constexpr double kRounding = 0.004;
  const auto is_flat = [](const RecognizedPattern& each) { return each.pattern.coding == Coding::flat; };
  if (std::all_of(recognized.begin(), recognized.end(), is_flat)) return;
  double dark = 1, bright = 0;
  for (const RecognizedPattern& each : recognized) {
    dark = std::min(dark, each.dark);
    bright = std::max(bright, each.bright);
  }
  for (RecognizedPattern& each : recognized) {
    if (!is_flat(each)) continue;
    const double level = (each.pattern.level - dark) / (bright - dark);
    each.pattern.level = level < kRounding ? 0 : level > 1 - kRounding ? 1 : level;
  }
}

}  // namespace

RecognizedPattern recognize_pattern(const cv::Mat& image, const cv::Size& projector) {
  constexpr size_t kLeastLength = 8;
  const auto in_px = [](const cv::Size& size) {
    return std::to_string(size.width) + "x" + std::to_string(size.height) + " px";
  };
  if (image.size() != projector)
    throw Error("is " + in_px(image.size()) + " but the projector has " + in_px(projector) +
                "; list the images that the projector showed pixel by pixel, or correct the projector's size");
  const Profile profile = coded_profile(levels_of_image(image));
  if (profile.range() <= std::max(0.01, 2.5 * profile.step)) return flat_level(profile);
  if (profile.range() < kLeastRange || profile.levels.size() < kLeastLength)
    throw Error("varies by only " + percent_text(profile.range()) + " of full scale over " +
                std::to_string(profile.levels.size()) +
                " px, too little to recognize its pattern; describe it by hand instead of by `projected`");
  const auto edges = edges_of(profile);
  if (edges) {
    if (const auto bit = gray_bit_of(profile, *edges)) return {*bit, profile.low, profile.high};
  }
  const CosineFit best = fit_cosine(profile.levels);
  if (is_cosine(best, profile)) return cosine_pattern(best, profile);
  throw edges ? no_gray_bit(*edges) : not_recognized(best, profile);
}

void reconcile_patterns(std::vector<RecognizedPattern>& recognized, const std::vector<Pattern>& described,
                        const cv::Size& projector) {
  unite_periods(recognized, described, projector);
  mark_extra_periods(recognized, described);
  space_equally(recognized);
  for (const Axis axis : {Axis::columns, Axis::rows}) unite_cells(recognized, described, projector, axis);
  scale_levels(recognized);
}

}  // namespace fringeslam
