// SPDX-License-Identifier: Apache-2.0
#include "core/check/conventions.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <limits>
#include <numbers>
#include <optional>
#include <set>

#include "core/base/constants.h"
#include "core/decode/decode.h"
#include "core/decode/exposures.h"
#include "core/patterns/patterns.h"
#include "core/types/error.h"
#include "core/types/grey_value.h"

namespace fringeslam {

namespace {

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
constexpr int kStride = 4, kStep = 3;         // px: of the examined pixels, and to the neighbours that give the slope
constexpr int kBand = 4, kBandDistance = 12;  // rows: of the bands that are examined

// --- lit pixels ---

// Pixels whose grey values vary with the patterns, whatever those are.
cv::Mat1b lit_pixels(const FringeStack& stack, const SensorModel& sensor) {
  cv::Mat low, high;
  for (const cv::Mat& image : stack.images) {
    if (low.empty()) {
      low = image.clone();
      high = image.clone();
    } else {
      low = cv::min(low, image);
      high = cv::max(high, image);
    }
  }
  cv::Mat1f contrast;
  cv::Mat(high - low).convertTo(contrast, CV_32F);
  const double saturated = 0.98 * sensor.saturation_dn();
  cv::Mat1b lit;
  cv::compare(contrast, 0.05 * sensor.max_dn(), lit, cv::CMP_GT);
  lit.setTo(0, high > saturated);
  return lit;
}

// --- triangulation, exact but slow ---

struct LitPoint {
  Eigen::Vector3d point = {kNone, kNone, kNone};  // camera frame, m
  Eigen::Vector2d projector = {kNone, kNone};     // its projection, px
  bool valid() const { return point.z() == point.z(); }
};

// Intersects the ray of a pixel with the surface of constant projector coordinate.
LitPoint triangulated(const RigModel& rig, const Eigen::Vector3d& ray, double coordinate_px, Axis axis) {
  const int i = axis == Axis::columns ? 0 : 1;
  const Pinhole& projector = rig.projector;
  const double focal = i == 0 ? projector.fx : projector.fy, center = i == 0 ? projector.cx : projector.cy;
  const Eigen::Vector3d direction = rig.projector_from_camera.rotation * ray;
  const Eigen::Vector3d& t = rig.projector_from_camera.translation;
  double normalised = (coordinate_px - center) / focal;
  LitPoint result;
  // The projector's lens distorts by a few pixels; each iteration corrects by the remaining error.
  for (int iteration = 0; iteration < 4; ++iteration) {
    const double z = (normalised * t.z() - t[i]) / (direction[i] - normalised * direction.z());
    if (!std::isfinite(z)) return {};
    result.point = z * ray;
    const Eigen::Vector3d seen = z * direction + t;
    result.projector = {kNone, kNone};
    if (seen.z() == 0) return {};
    result.projector = projector.project(seen.z() > 0 ? seen : Eigen::Vector3d(-seen));
    const double error = coordinate_px - result.projector[i];
    if (std::abs(error) < 1e-3 || !std::isfinite(error)) break;
    normalised += error / focal;
  }
  return result;
}

bool in_working_range(const RigModel& rig, const LitPoint& p) {
  const bool behind = (rig.projector_from_camera * p.point).z() <= 0;
  return p.valid() && !behind && p.point.z() > rig.near_m && p.point.z() < rig.far_m &&
         rig.projector.contains(p.projector);
}

// --- agreement of phases ---

double agreement_factor(const Agreement& agreement) {
  // Descriptions without the test do not gain from its absence.
  constexpr double kUntested = 0.8;
  if (std::isnan(agreement.concentration)) return kUntested;
  // An offset of 30 degrees, which moves depths by a twelfth of a period, must matter.
  const double angle = std::min(1.5 * std::abs(agreement.offset_deg), 90.0) * std::numbers::pi / 180;
  return std::max(0.05, agreement.concentration * std::cos(angle));
}

// The one of two agreements that is worse; those without a test are left out.
Agreement worse(const Agreement& a, const Agreement& b) {
  if (std::isnan(a.concentration)) return b;
  if (std::isnan(b.concentration)) return a;
  return agreement_factor(a) < agreement_factor(b) ? a : b;
}

// Mean of unit phasors.
class MeanPhasor {
 public:
  void add(double angle_rad) {
    sum_ += std::polar(1.0, angle_rad);
    ++count_;
  }
  int count() const { return count_; }
  Agreement agreement() const {
    if (count_ == 0) return {};
    return {std::abs(sum_) / count_, std::arg(sum_) * 180 / std::numbers::pi};
  }

 private:
  std::complex<double> sum_ = 0;
  int count_ = 0;
};

double wrapped_phase_at(const FringeStack& stack, const FringeGroup& group, int row, int col) {
  std::complex<double> sum = 0, ones = 0;
  double grey = 0;
  for (size_t k = 0; k < group.images.size(); ++k) {
    const cv::Mat& image = stack.images[static_cast<size_t>(group.images[k])];
    const double y = static_cast<double>(grey_value(image, row, col));
    const std::complex<double> basis = std::polar(1.0, -group.shifts_rad[k]);
    sum += y * basis;
    ones += basis;
    grey += y;
  }
  return std::arg(sum - ones * grey / static_cast<double>(group.images.size()));
}

// Phase differences between the decoded coordinate and every other period, in units of the finer period's phase.
Agreement agreement_of_periods(const FringeStack& stack, const PatternSequence& sequence, const cv::Mat1b& lit,
                               Axis axis) {
  const std::vector<FringeGroup> groups = fringe_groups(sequence, axis);
  Agreement least;
  for (size_t g = 1; g < groups.size(); ++g) {
    const FringeGroup &coarse = groups[g - 1], &fine = groups[g];
    const double ratio = coarse.period_px / fine.period_px;
    if (ratio < 1.5 || coarse.period_px < (axis == Axis::columns ? sequence.width : sequence.height) * (1 - 1e-9))
      continue;
    MeanPhasor mean;
    for (int row = 0; row < lit.rows; row += kStride) {
      for (int col = 0; col < lit.cols; col += kStride) {
        if (!lit(row, col)) continue;
        const double turn = wrapped_phase_at(stack, coarse, row, col);
        const double absolute = turn < 0 ? turn + kTwoPi : turn;
        mean.add(ratio * absolute - wrapped_phase_at(stack, fine, row, col));
      }
    }
    if (mean.count() > 0) least = worse(least, mean.agreement());
  }
  return least;
}

// Coordinates at the edges of the finest Gray code cells, which are multiples of the cell width.
Agreement agreement_with_gray(const FringeStack& stack, const PatternSequence& sequence, const DecodedStack& decoded,
                              const cv::Mat1b& lit, Axis axis) {
  const std::vector<FringeGroup> groups = fringe_groups(sequence, axis);
  const std::vector<GrayBit> bits = gray_bits(sequence, axis);
  if (groups.empty() || bits.empty() || bits.back().image < 0) return {};
  const GrayBit& finest = bits.back();
  const double period_px = groups.back().period_px;
  if (period_px < 0.99 * finest.cell_px) return {};
  const auto is_bright = [&](int row, int col) {
    const cv::Mat& image = stack.images[static_cast<size_t>(finest.image)];
    const double y = static_cast<double>(grey_value(image, row, col));
    return y > static_cast<double>(decoded.mean(row, col));
  };
  MeanPhasor mean;
  for (int row = 0; row < lit.rows; row += kStride) {
    for (int col = 1; col < lit.cols; ++col) {
      if (!lit(row, col) || !lit(row, col - 1) || is_bright(row, col) == is_bright(row, col - 1)) continue;
      const float coordinate = decoded.coordinate_px(row, col), phase = decoded.wrapped_phase(row, col);
      const double from_edge_px = coordinate == coordinate ? static_cast<double>(coordinate) + 0.5
                                                           : static_cast<double>(phase) / kTwoPi * period_px;
      if (phase == phase) mean.add(kTwoPi * from_edge_px / finest.cell_px);
    }
  }
  return mean.count() >= 50 ? mean.agreement() : Agreement{};
}

// --- fit ---

struct DecodedAxis {
  Axis axis = Axis::columns;
  DecodedStack decoded;
};

// Rows of an image in bands of kBand, one every kBandDistance.
cv::Mat bands_of(const cv::Mat& image) {
  std::vector<cv::Mat> bands;
  for (int row = 0; row + kBand <= image.rows; row += kBandDistance) bands.push_back(image.rowRange(row, row + kBand));
  cv::Mat joined;
  cv::vconcat(bands, joined);
  return joined;
}

// Decoding needs complete images where it depends on neighbours or on the geometry.
bool decodes_each_pixel_alone(const PatternSequence& sequence, const RigModel& rig) {
  for (const Axis axis : {Axis::columns, Axis::rows}) {
    if (!codes_axis(sequence, axis)) continue;
    DecodeContext context;
    context.axis = axis;
    try {
      const Unwrapping method = resolve_unwrapping(sequence, rig, DecodeOptions(), context);
      if (method == Unwrapping::geometric || method == Unwrapping::spatial) return false;
    } catch (const Error&) {
      return false;
    }
  }
  return true;
}

// Fits of one stack to several descriptions.
class Examiner {
 public:
  Examiner(const FringeStack& stack, const RigModel& rig) : stack_(stack) {
    banded_ = decodes_each_pixel_alone(stack.patterns, rig) && stack.images[0].rows >= 20 * kBandDistance;
    if (banded_) {
      for (cv::Mat& image : stack_.images) image = bands_of(image);
    }
    lit_ = lit_pixels(stack_, rig.sensor);
  }

  // Number of pixels of the image that each examined one stands for.
  int pixels_each() const { return kStride * (banded_ ? kBandDistance : kStride); }

  DescriptionFit fit(const RigDescription& description) {
    decode_as(description);
    find_rays(description.rig.camera);
    return evaluate(description.rig);
  }

 private:
  // Decodes unless the previous description has the same result: that of the same patterns, unless the geometry bounds
  // the fringe orders.
  void decode_as(const RigDescription& description) {
    if (!axes_.empty() && stack_.patterns == description.sequence && !geometric_) return;
    axes_.clear();
    stack_.patterns = description.sequence;
    agreement_ = {};
    geometric_ = false;
    for (const Axis axis : {Axis::columns, Axis::rows}) {
      if (!codes_axis(description.sequence, axis)) continue;
      DecodeContext context;
      context.axis = axis;
      axes_.push_back({axis, decode(stack_, description.rig, DecodeOptions(), context)});
      const DecodedStack& decoded = axes_.back().decoded;
      geometric_ = geometric_ || decoded.unwrapping == Unwrapping::geometric;
      agreement_ = worse(agreement_, agreement_of_periods(stack_, description.sequence, lit_, axis));
      agreement_ = worse(agreement_, agreement_with_gray(stack_, description.sequence, decoded, lit_, axis));
    }
    if (axes_.empty()) {
      for (const Axis axis : {Axis::columns, Axis::rows}) require_decoder(description.sequence, axis);
      throw Error("the patterns code neither columns nor rows");
    }
  }

  DescriptionFit evaluate(const RigModel& rig) const;

  int image_row(int row) const { return banded_ ? row / kBand * kBandDistance + row % kBand : row; }

  // Undistorts the examined pixels and their neighbours.
  void find_rays(const Pinhole& camera) {
    if (!rays_.empty() && camera == camera_) return;
    camera_ = camera;
    rays_.create(lit_.size());
    for (int row = 0; row < lit_.rows; ++row) {
      for (int col = 0; col < lit_.cols; ++col) {
        const bool examined = (row % kStride == 0 && (col % kStride == 0 || col % kStride == kStep)) ||
                              (row % kStride == kStep && col % kStride == 0);
        if (!examined || !lit_(row, col)) continue;
        const Eigen::Vector2d ray = camera.undistort({col, image_row(row)});
        rays_(row, col) = {ray.x(), ray.y()};
      }
    }
  }

  FringeStack stack_;
  cv::Mat1b lit_;
  std::vector<DecodedAxis> axes_;
  bool banded_ = false;  // the stack's images are bands of the camera's
  cv::Mat2d rays_;
  Pinhole camera_;  // of the rays
  Agreement agreement_;
  bool geometric_ = false;
};

DescriptionFit Examiner::evaluate(const RigModel& rig) const {
  DescriptionFit fit;
  fit.agreement = agreement_;
  const auto coordinate = [&](size_t a, int row, int col) {
    return static_cast<double>(axes_[a].decoded.coordinate_px(row, col));
  };
  const Eigen::Vector3d projector_center = rig.projector_from_camera.inverse().translation;
  int ordered = 0, in_range = 0, with_depth = 0, facing = 0, plausible = 0;
  std::vector<double> depths, distances;
  for (int row = 0; row + kStep < lit_.rows; row += kStride) {
    for (int col = 0; col + kStep < lit_.cols; col += kStride) {
      if (!lit_(row, col) || !lit_(row, col + kStep) || !lit_(row + kStep, col)) continue;
      ++fit.lit;
      // Coordinates here, to the right and below.
      const int rows[3] = {row, row, row + kStep}, cols[3] = {col, col + kStep, col};
      bool all = true;
      for (size_t a = 0; a < axes_.size(); ++a) {
        for (int i = 0; i < 3; ++i) all = all && std::isfinite(coordinate(a, rows[i], cols[i]));
      }
      if (!all) continue;
      ++ordered;
      if (!rig.calibrated) {
        if (axes_.size() < 2) continue;
        const double ux = coordinate(0, row, col + kStep) - coordinate(0, row, col),
                     uy = coordinate(0, row + kStep, col) - coordinate(0, row, col),
                     vx = coordinate(1, row, col + kStep) - coordinate(1, row, col),
                     vy = coordinate(1, row + kStep, col) - coordinate(1, row, col);
        ++with_depth;
        const bool preserved = ux * vy - uy * vx > 0;
        facing += preserved;
        plausible += preserved;
        continue;
      }
      LitPoint points[3];
      bool inside = true;
      for (int i = 0; i < 3; ++i) {
        const cv::Vec2d& ray = rays_(rows[i], cols[i]);
        points[i] = triangulated(rig, {ray[0], ray[1], 1}, coordinate(0, rows[i], cols[i]), axes_[0].axis);
        inside = inside && in_working_range(rig, points[i]);
      }
      if (points[0].valid()) depths.push_back(points[0].point.z());
      in_range += inside;
      double distance = 0;
      if (axes_.size() == 2 && points[0].valid()) {
        distance = std::abs(coordinate(1, row, col) - points[0].projector[1]);
        if (std::isfinite(distance)) distances.push_back(distance);
      }
      ++with_depth;
      Eigen::Vector3d normal = (points[1].point - points[0].point).cross(points[2].point - points[0].point);
      if (normal.dot(points[0].point) > 0) normal = -normal;
      const bool lit_side = normal.dot(projector_center - points[0].point) > 0;
      facing += lit_side;
      constexpr double kEpipolar = 0.005;  // of the projector's width
      plausible += inside && lit_side && distance < kEpipolar * rig.projector.width;
    }
  }
  const auto fraction = [](int part, int whole) { return whole > 0 ? static_cast<double>(part) / whole : 0.0; };
  const auto median = [](std::vector<double>& values) {
    if (values.empty()) return kNone;
    const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
    std::nth_element(values.begin(), middle, values.end());
    return *middle;
  };
  fit.ordered = fraction(ordered, fit.lit);
  fit.in_range = rig.calibrated ? fraction(in_range, fit.lit) : kNone;
  fit.facing = with_depth > 0 ? fraction(facing, with_depth) : kNone;
  fit.plausible = rig.calibrated || axes_.size() == 2 ? fraction(plausible, fit.lit) : fit.ordered;
  fit.median_depth_m = median(depths);
  fit.camera_center = rig.calibrated ? (rig.camera.cx + 0.5) / rig.camera.width : kNone;
  fit.projector_center = rig.calibrated ? (rig.projector.cx + 0.5) / rig.projector.width : kNone;
  fit.epipolar_px = median(distances);
  return fit;
}

}  // namespace

DescriptionFit fit_of(const FringeStack& stack, const RigDescription& description) {
  return Examiner(stack, description.rig).fit(description);
}

// --- alternatives ---

namespace {

std::string number(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.6g", value);
  return text;
}

class Alternatives {
 public:
  Alternatives(const PatternSequence& sequence, const RigModel& rig, const std::vector<double>& offset_rad)
      : stated_{"", sequence, rig}, offset_rad_(offset_rad) {}

  std::vector<RigDescription> all() {
    for (const Axis axis : {Axis::columns, Axis::rows}) {
      if (!codes_axis(stated_.sequence, axis)) continue;
      fringes(axis);
      gray(axis);
    }
    if (codes_axis(stated_.sequence, Axis::columns) && codes_axis(stated_.sequence, Axis::rows))
      offsets({Axis::columns, Axis::rows});
    sizes();
    axes();
    if (stated_.rig.calibrated) geometry();
    return std::move(found_);
  }

 private:
  RigDescription& add(const std::string& change) {
    found_.push_back(stated_);
    found_.back().change = change;
    return found_.back();
  }

  // Calls change(pattern, index) for the patterns of one axis and coding.
  template <class Change>
  static void for_patterns(PatternSequence& sequence, Coding coding, Axis axis, Change&& change) {
    for (size_t i = 0; i < sequence.patterns.size(); ++i) {
      Pattern& pattern = sequence.patterns[i];
      if (pattern.coding == coding && pattern.axis == axis) change(pattern, i);
    }
  }

  std::string on(Axis axis) const {
    const bool both = codes_axis(stated_.sequence, Axis::columns) && codes_axis(stated_.sequence, Axis::rows);
    return !both ? "" : axis == Axis::columns ? " (columns)" : " (rows)";
  }

  void fringes(Axis axis) {
    const std::vector<FringeGroup> groups = fringe_groups(stated_.sequence, axis);
    if (groups.empty()) return;
    const std::vector<double>& shifts = groups.back().shifts_rad;
    const bool rising = std::remainder(shifts[1] - shifts[0], kTwoPi) > 0;
    for_patterns(add(std::string("shift_sign: ") + (rising ? "-1" : "1") + on(axis)).sequence, Coding::fringe, axis,
                 [&](Pattern& p, size_t i) { p.shift_rad = std::remainder(2 * offset_rad_[i] - p.shift_rad, kTwoPi); });
    offsets({axis});
    exchanged_periods(axis, groups);
    const double length_px = axis == Axis::columns ? stated_.sequence.width : stated_.sequence.height;
    for (const FringeGroup& group : groups) {
      const double count = length_px / group.period_px;
      for (const double other :
           std::set<double>{count - 1, count + 1, count - 0.5, count + 0.5, 2 * count, count / 2}) {
        if (other < 0.5) continue;
        const std::string what =
            std::abs(count - std::round(count)) < 1e-9
                ? "number_of_periods: " + number(other) + " instead of " + number(count)
                : "period_px: " + number(length_px / other) + " instead of " + number(group.period_px);
        for_patterns(add(what + on(axis)).sequence, Coding::fringe, axis, [&](Pattern& p, size_t) {
          if (std::abs(p.period_px - group.period_px) < 1e-9) p.period_px = length_px / other;
        });
      }
    }
  }

  // Other offsets of all periods, and of the finest only: sine for cosine, the papers' centred steps for steps from 0,
  // and inverted images, among others.
  void offsets(const std::vector<Axis>& axes) {
    const std::string where = axes.size() > 1 ? " (both axes)" : on(axes[0]);
    for (const bool finest_only : {false, true}) {
      for (const int degrees : {30, 45, 60, 90, 120, 135, 150, 180, -150, -135, -120, -90, -60, -45, -30}) {
        if (finest_only && (std::abs(degrees) % 30 != 0 || std::abs(degrees) == 150)) continue;
        RigDescription shifted = stated_;
        bool several = false;
        for (const Axis axis : axes) {
          const std::vector<FringeGroup> groups = fringe_groups(stated_.sequence, axis);
          if (groups.empty()) return;
          several = several || groups.size() > 1;
          for_patterns(shifted.sequence, Coding::fringe, axis, [&](Pattern& p, size_t) {
            if (!finest_only || std::abs(p.period_px - groups.back().period_px) < 1e-9)
              p.shift_rad = std::remainder(p.shift_rad + degrees * std::numbers::pi / 180, kTwoPi);
          });
        }
        if (finest_only && !several) return;
        shifted.change = "phase_offset_deg " + std::string(degrees > 0 ? "+" : "") + std::to_string(degrees) +
                         (finest_only ? " for the finest period" : "") + where;
        found_.push_back(std::move(shifted));
      }
    }
  }

  // Images of two periods in the wrong places.
  void exchanged_periods(Axis axis, const std::vector<FringeGroup>& groups) {
    for (size_t a = 0; a < groups.size(); ++a) {
      for (size_t b = a + 1; b < groups.size(); ++b) {
        const double first = groups[a].period_px, second = groups[b].period_px;
        for_patterns(
            add("the images of " + number(first) + " px and " + number(second) + " px periods exchanged" + on(axis))
                .sequence,
            Coding::fringe, axis, [&](Pattern& p, size_t) {
              if (std::abs(p.period_px - first) < 1e-9)
                p.period_px = second;
              else if (std::abs(p.period_px - second) < 1e-9)
                p.period_px = first;
            });
      }
    }
  }

  void gray(Axis axis) {
    std::vector<double> cells;
    for (const GrayBit& bit : gray_bits(stated_.sequence, axis)) cells.push_back(bit.cell_px);
    if (cells.empty()) return;
    const auto reverse = [&](PatternSequence& sequence) {
      for_patterns(sequence, Coding::gray, axis, [&](Pattern& p, size_t) {
        const auto at =
            std::find_if(cells.begin(), cells.end(), [&](double c) { return std::abs(c - p.period_px) < 1e-9; });
        if (at != cells.end()) p.period_px = cells[cells.size() - 1 - static_cast<size_t>(at - cells.begin())];
      });
    };
    const auto invert = [&](PatternSequence& sequence) {
      for_patterns(sequence, Coding::gray, axis, [](Pattern& p, size_t) { p.inverted = !p.inverted; });
    };
    const auto scale = [&](PatternSequence& sequence, double factor) {
      for_patterns(sequence, Coding::gray, axis, [&](Pattern& p, size_t) { scale_periods(p, factor); });
    };
    reverse(add("the opposite order of the Gray code bits" + on(axis)).sequence);
    invert(add("the opposite bright_is_one" + on(axis)).sequence);
    {
      PatternSequence& both = add("the opposite order and bright_is_one of the Gray code" + on(axis)).sequence;
      reverse(both);
      invert(both);
    }
    scale(add("Gray code cells twice as wide" + on(axis)).sequence, 2);
    scale(add("Gray code cells half as wide" + on(axis)).sequence, 0.5);
  }

  static void scale_periods(Pattern& pattern, double factor) {
    pattern.period_px *= factor;
    pattern.carrier_px *= factor;
  }

  // The same patterns on a projector of another size.
  void scale_projector(RigDescription& description, double columns, double rows) {
    description.rig.projector.width = static_cast<int>(std::lround(description.rig.projector.width * columns));
    description.rig.projector.height = static_cast<int>(std::lround(description.rig.projector.height * rows));
    description.sequence.width = description.rig.projector.width;
    description.sequence.height = description.rig.projector.height;
    for (Pattern& p : description.sequence.patterns) scale_periods(p, p.axis == Axis::columns ? columns : rows);
  }

  void sizes() {
    const Pinhole& projector = stated_.rig.projector;
    for (const double factor : {0.5, 2.0}) {
      if (codes_axis(stated_.sequence, Axis::columns))
        scale_projector(add("projector width_px: " + number(factor * projector.width) + " with periods in proportion"),
                        factor, 1);
      if (codes_axis(stated_.sequence, Axis::rows))
        scale_projector(
            add("projector height_px: " + number(factor * projector.height) + " with periods in proportion"), 1,
            factor);
    }
  }

  // Columns for rows; periods in px, or in proportion to the projector's size.
  void axes() {
    const bool columns = codes_axis(stated_.sequence, Axis::columns), rows = codes_axis(stated_.sequence, Axis::rows);
    const auto swap = [](Axis axis) { return axis == Axis::columns ? Axis::rows : Axis::columns; };
    const std::string change =
        columns && rows ? "columns and rows exchanged" : std::string("axis: ") + (columns ? "rows" : "columns");
    const double aspect = static_cast<double>(stated_.sequence.height) / stated_.sequence.width;
    for (const bool in_proportion : {false, true}) {
      for (Pattern& p : add(change + (in_proportion ? " with periods in proportion" : "")).sequence.patterns) {
        if (in_proportion) scale_periods(p, p.axis == Axis::columns ? aspect : 1 / aspect);
        p.axis = swap(p.axis);
      }
    }
  }

  void geometry() {
    const Pose& pose = stated_.rig.projector_from_camera;
    add("the opposite calibration direction").rig.projector_from_camera = pose.inverse();
    add("translation of the opposite sign").rig.projector_from_camera.translation = -pose.translation;
    add("translation as the projector's position (T = -R C)").rig.projector_from_camera.translation =
        -(pose.rotation * pose.translation);
    add("rotation transposed").rig.projector_from_camera.rotation = Eigen::Matrix3d(pose.rotation.transpose());
    for (const double factor : {0.001, 0.01, 0.0254, 0.1, 10.0, 39.37, 100.0, 1000.0})
      add("unit_m " + number(factor) + " times as large").rig.projector_from_camera.translation *= factor;
    RigModel& swapped = add("camera and projector matrices exchanged").rig;
    const auto take_lens = [](Pinhole& to, const Pinhole& from) {
      to.fx = from.fx, to.fy = from.fy, to.cx = from.cx, to.cy = from.cy, to.distortion = from.distortion;
    };
    take_lens(swapped.camera, stated_.rig.projector);
    take_lens(swapped.projector, stated_.rig.camera);
  }

  RigDescription stated_;
  std::vector<double> offset_rad_;
  std::vector<RigDescription> found_;
};

}  // namespace

std::vector<RigDescription> alternative_descriptions(const PatternSequence& sequence, const RigModel& rig,
                                                     const std::vector<double>& offset_rad) {
  return Alternatives(sequence, rig, offset_rad).all();
}

// --- verdict ---

namespace {

// Images of cameras are often cropped; projectors shift their image vertically at most.
bool camera_fits(const DescriptionFit& fit) { return !(std::abs(fit.camera_center - 0.5) > 0.3); }
bool projector_fits(const DescriptionFit& fit) { return !(std::abs(fit.projector_center - 0.5) > 0.2); }

// One number to compare descriptions by.
double merit(const DescriptionFit& fit) {
  const double centers = (camera_fits(fit) ? 1 : 0.5) * (projector_fits(fit) ? 1 : 0.5);
  return centers * fit.plausible * agreement_factor(fit.agreement);
}

std::string percent_of(double fraction) { return number(std::round(100 * fraction)) + " %"; }

// The property by which a fit differs most from the stated one.
std::string comparison(const DescriptionFit& best, const DescriptionFit& stated) {
  struct Property {
    double best, stated;
    std::string name;
  };
  const std::vector<Property> properties = {
      {best.in_range, stated.in_range, "of the lit pixels in range"},
      {best.facing, stated.facing, "of the pixels on surfaces that face the projector"},
      {best.ordered, stated.ordered, "of the lit pixels with a consistent fringe order"},
      {best.plausible, stated.plausible, "of the lit pixels on plausible surfaces"}};
  if (projector_fits(best) && !projector_fits(stated))
    return "the projector's principal point at " + percent_of(best.projector_center) + " of the width instead of " +
           percent_of(stated.projector_center);
  const Property* greatest = &properties.back();
  for (const Property& p : properties) {
    if (p.best - p.stated > greatest->best - greatest->stated + 0.05) greatest = &p;
  }
  if (std::isfinite(best.epipolar_px) && best.epipolar_px < 0.2 * stated.epipolar_px)
    return "a median distance of " + number(std::round(10 * best.epipolar_px) / 10) +
           " px between pixels and their epipolar lines instead of " + number(std::round(10 * stated.epipolar_px) / 10);
  if (agreement_factor(best.agreement) - agreement_factor(stated.agreement) > 0.2 &&
      greatest->best - greatest->stated < 0.3)
    return "the phases of different periods, or of fringes and Gray code, differ by " +
           number(std::round(best.agreement.offset_deg)) + " instead of " +
           number(std::round(stated.agreement.offset_deg)) + " degrees and agree to " +
           percent_of(best.agreement.concentration) + " instead of " + percent_of(stated.agreement.concentration);
  return percent_of(greatest->best) + " " + greatest->name + " instead of " + percent_of(greatest->stated);
}

constexpr double kHardly = 0.2;  // merit of a description that hardly fits

struct Candidate {
  RigDescription description;
  DescriptionFit fit;
};

void sort_by_merit(std::vector<Candidate>& candidates) {
  std::stable_sort(candidates.begin(), candidates.end(),
                   [](const Candidate& a, const Candidate& b) { return merit(a.fit) > merit(b.fit); });
}

// Examines the alternatives of a description; those that cannot be decoded are left out.
std::vector<Candidate> examined(Examiner& examiner, const RigDescription& stated,
                                const std::vector<double>& offset_rad) {
  std::vector<Candidate> candidates;
  for (RigDescription& alternative : alternative_descriptions(stated.sequence, stated.rig, offset_rad)) {
    try {
      const DescriptionFit fit = examiner.fit(alternative);
      if (!stated.change.empty()) alternative.change = stated.change + " and " + alternative.change;
      candidates.push_back({std::move(alternative), fit});
    } catch (const Error&) {
    }
  }
  sort_by_merit(candidates);
  return candidates;
}

// Adds a working range around the depths that the stated description yields, if they lie outside of the stated one.
void add_range(Examiner& examiner, const RigDescription& stated, const DescriptionFit& fit,
               std::vector<Candidate>& candidates) {
  if (!stated.rig.calibrated || !(fit.in_range < 0.5 * fit.ordered) || !(fit.median_depth_m > 0)) return;
  RigDescription ranged = stated;
  const auto rounded = [](double length_m) { return std::round(100 * length_m) / 100; };
  ranged.rig.near_m = std::max(0.01, rounded(0.5 * fit.median_depth_m));
  ranged.rig.far_m = std::max(0.02, rounded(2 * fit.median_depth_m));
  ranged.change = "near_m: " + number(ranged.rig.near_m) + ", far_m: " + number(ranged.rig.far_m);
  const DescriptionFit ranged_fit = examiner.fit(ranged);
  candidates.insert(candidates.begin(), {std::move(ranged), ranged_fit});
  sort_by_merit(candidates);
}

// Adds alternatives to the best candidates and to those with the opposite shift sign.
void add_combinations(Examiner& examiner, const std::vector<double>& offset_rad, std::vector<Candidate>& candidates) {
  constexpr size_t kBest = 2;
  std::vector<Candidate> combined;
  for (size_t i = 0; i < candidates.size(); ++i) {
    const bool sign = candidates[i].description.change.starts_with("shift_sign");
    if (i >= kBest && !sign) continue;
    std::vector<Candidate> more = examined(examiner, candidates[i].description, offset_rad);
    std::move(more.begin(), more.end(), std::back_inserter(combined));
  }
  std::move(combined.begin(), combined.end(), std::back_inserter(candidates));
  sort_by_merit(candidates);
}

// Explains that a darker flat pattern is brighter in the images; empty if none is.
std::string reversed_flats(const FringeStack& stack) {
  const std::vector<Pattern>& patterns = stack.patterns.patterns;
  for (size_t i = 0; i < patterns.size(); ++i) {
    for (size_t k = 0; k < patterns.size(); ++k) {
      if (patterns[i].coding != Coding::flat || patterns[k].coding != Coding::flat) continue;
      if (patterns[i].level > patterns[k].level && cv::mean(stack.images[i])[0] < cv::mean(stack.images[k])[0])
        return "the image of level " + number(patterns[i].level) + " is darker than that of level " +
               number(patterns[k].level) + "; exchange white and black";
    }
  }
  return "";
}

}  // namespace

ConventionReport check_conventions(const FringeStack& stack, const RigModel& rig,
                                   const std::vector<double>& offset_rad) {
  constexpr double kDoubtful = 0.85, kWrong = 0.6;  // of the best alternative's merit
  constexpr int kLeastLit = 100;
  Examiner examiner(stack, rig);
  const RigDescription stated{"", stack.patterns, rig};
  ConventionReport report;
  using enum ConventionReport::Verdict;
  if (const std::string reversed = reversed_flats(stack); !reversed.empty()) {
    report.verdict = wrong;
    report.message = reversed;
    return report;
  }
  std::string undecodable;
  try {
    report.stated = examiner.fit(stated);
  } catch (const Error& e) {
    undecodable = e.what();
  }
  if (undecodable.empty() && report.stated.lit < kLeastLit) {
    report.verdict = doubtful;
    report.message = "the patterns are visible in only " + std::to_string(report.stated.lit * examiner.pixels_each()) +
                     " pixels, too few to check the described conventions; check the files and the exposure";
    return report;
  }
  if (merit(report.stated) >= kDoubtful) return report;  // no alternative can be better by enough

  std::vector<Candidate> candidates = examined(examiner, stated, offset_rad);
  if (undecodable.empty()) add_range(examiner, stated, report.stated, candidates);
  if (!candidates.empty() && merit(report.stated) < kHardly && merit(candidates[0].fit) < 2 * kHardly)
    add_combinations(examiner, offset_rad, candidates);
  if (!candidates.empty() && merit(report.stated) < kDoubtful * merit(candidates[0].fit) &&
      candidates[0].fit.plausible > 0.1) {
    const Candidate& best = candidates[0];
    report.better = best.description.change;
    report.best = best.fit;
    // Sequences that need a map or relative phases cannot be decoded alone; they are not wrong.
    const bool overwhelming = undecodable.empty() && merit(report.stated) < kWrong * merit(best.fit);
    report.verdict = overwhelming ? wrong : doubtful;
    report.message = "`" + best.description.change + "`";
    constexpr double kEqual = 0.97;
    constexpr size_t kShown = 3;
    size_t equal = 1;
    while (equal < std::min(kShown, candidates.size()) && merit(candidates[equal].fit) > kEqual * merit(best.fit))
      report.message += " or `" + candidates[equal++].description.change + "`";
    report.message += undecodable.empty()
                          ? " fits better: " + comparison(best.fit, report.stated)
                          : " fits better: " + percent_of(best.fit.plausible) +
                                " of the lit pixels on plausible surfaces, whereas as described, " + undecodable;
    return report;
  }
  if (!undecodable.empty()) throw Error(undecodable);
  if (!projector_fits(report.stated) || !camera_fits(report.stated)) {
    const bool camera = !camera_fits(report.stated);
    report.verdict = doubtful;
    report.message = std::string("the ") + (camera ? "camera" : "projector") + "'s principal point lies at " +
                     percent_of(camera ? report.stated.camera_center : report.stated.projector_center) +
                     " of the image width; the calibration may be for another image size";
  } else if (rig.calibrated && report.stated.in_range < 0.05 && report.stated.ordered > 0.2) {
    report.verdict = wrong;
    report.message = percent_of(report.stated.in_range) +
                     " of the lit pixels have a depth between near_m = " + number(rig.near_m) +
                     " and far_m = " + number(rig.far_m) + " within the projector's image; the median is " +
                     number(std::round(1e4 * report.stated.median_depth_m) / 1e4) +
                     " m: correct near_m and far_m, the calibration or the patterns";
  } else if (report.stated.plausible < 0.1) {
    report.verdict = doubtful;
    report.message =
        "only " + percent_of(report.stated.plausible) +
        " of the lit pixels form plausible surfaces, and no common mistake explains it; check the order of "
        "the images, the periods and the calibration";
  }
  return report;
}

namespace {

// Fits the description of a stack. Of several exposures, the clearest is examined alone: the others saturate or show noise.
DescriptionFit fit_as_described(const FringeStack& stack, const RigModel& rig) {
  if (!has_exposures(stack.patterns)) return fit_of(stack, {"", stack.patterns, rig});
  const FringeStack one =
      as_one_exposure(best_exposure(stack, DecodeOptions().saturation * rig.sensor.saturation_dn()));
  return fit_of(one, {"", one.patterns, rig});
}

}  // namespace

std::string reason_for_turned_images(const FringeStack& stack, const RigModel& rig) {
  // Nearly all surfaces face camera and projector, or nearly none: with edges, at most 1 % differ.
  constexpr double kFacing = 0.1, kLeastPixels = 200;
  if (!rig.calibrated) return "";
  try {
    const DescriptionFit fit = fit_as_described(stack, rig);
    if (!(fit.lit * fit.ordered >= kLeastPixels && fit.facing < kFacing)) return "";
    return percent_of(1 - fit.facing) +
           " of the surfaces face away from the projector: the images are mirrored left to right or rotated by half a "
           "turn; find the right description with `fringeslam import`";
  } catch (const Error&) {
    return "";  // the patterns do not determine fringe orders without a map
  }
}

std::string reason_for_no_depth(const FringeStack& stack, const RigModel& rig) {
  DescriptionFit fit;
  try {
    fit = fit_as_described(stack, rig);
  } catch (const Error& e) {
    return std::string("the patterns do not determine fringe orders without a map (") + e.what() + ")";
  }
  constexpr int kLeastLit = 100;
  if (fit.lit < kLeastLit)
    return "the patterns are hardly visible in the images of the first view; check the files, the exposure and the "
           "saturation";
  if (fit.ordered < 0.01)
    return percent_of(fit.ordered) +
           " of the lit pixels have a consistent fringe order; check the order of the images, shift_sign, the periods, "
           "the bits of the Gray code and, with `fringeslam calibrate response`, the projector's response";
  if (fit.in_range < 0.01)
    return "depths are about " + number(std::round(1e4 * fit.median_depth_m) / 1e4) +
           " m, outside the range from near_m = " + number(rig.near_m) + " to far_m = " + number(rig.far_m) +
           " or the projector's image; check `direction` and `unit_m` of the calibration, near_m and far_m";
  return "depths are in range but rejected; check the depth sigmas (depth.max_sigma_m) and the exposure";
}

}  // namespace fringeslam
