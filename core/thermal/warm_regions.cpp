// SPDX-License-Identifier: Apache-2.0
#include "core/thermal/warm_regions.h"

#include <algorithm>
#include <cmath>
#include <cstdarg>
#include <cstdio>
#include <iterator>
#include <limits>
#include <opencv2/imgproc.hpp>

#include "core/base/parallel.h"

namespace fringeslam {

namespace {

constexpr size_t kLeastPixels = 12;  // of a region; smaller ones are dropped
constexpr double kNothing = std::numeric_limits<double>::infinity();

double quantile(std::vector<float>& values, double q) {
  if (values.empty()) return std::numeric_limits<double>::quiet_NaN();
  const auto at = values.begin() + static_cast<std::ptrdiff_t>(q * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return static_cast<double>(*at);
}

double surroundings(const cv::Mat1f& temperature_c, double q) {
  std::vector<float> known;
  std::copy_if(temperature_c.begin(), temperature_c.end(), std::back_inserter(known),
               [](float t) { return !std::isnan(t); });
  return quantile(known, q);
}

// Marks pixels that are warm, and not just due to the blur of something hot next to them.
cv::Mat1b warm_pixels(const RegisteredThermal& thermal, double surroundings_c, const ThermalOptions& options) {
  const auto least = static_cast<float>(surroundings_c + options.min_contrast_k);
  const auto hot = static_cast<float>(options.hottest_c);
  cv::Mat1b warm(thermal.temperature_c.size(), uchar{0});
  for (int row = 0; row < warm.rows; ++row) {
    for (int col = 0; col < warm.cols; ++col) {
      const float t = thermal.temperature_c(row, col), around = thermal.around_c(row, col);
      warm(row, col) = t > least && (t > hot || around < hot);
    }
  }
  return warm;
}

// True if the surface is concave between two points: the normals converge with a curvature above 1 / radius.
bool hollow(const Frame& frame, cv::Point a, cv::Point b, double radius_m) {
  const Eigen::Vector3d apart = vector_of(frame.points_m(b)) - vector_of(frame.points_m(a));
  const Eigen::Vector3d turned = vector_of(frame.normals(b)) - vector_of(frame.normals(a));
  return apart.dot(turned) * radius_m < -apart.squaredNorm();
}

// Separates touching objects: clears pixels where the surface, along a row or a column, is more concave than a face or
// a hand.
void split_at_creases(const Frame& frame, double radius_m, cv::Mat1b& warm) {
  constexpr int kReach = 3;  // px to both sides, since normals are computed over a few pixels
  cv::Mat1b creases(warm.size(), uchar{0});
  for_each_row(warm.rows - 2 * kReach, [&](int r) {
    for (int col = kReach, row = r + kReach; col < warm.cols - kReach; ++col) {
      if (!warm(row, col)) continue;
      creases(row, col) = hollow(frame, {col - kReach, row}, {col + kReach, row}, radius_m) ||
                          hollow(frame, {col, row - kReach}, {col, row + kReach}, radius_m);
    }
  });
  warm.setTo(0, creases);
}

// Grows a region from its first pixel over pixels at most two apart without a depth step between them.
std::vector<cv::Point> grown(const Frame& frame, const cv::Mat1b& warm, cv::Point first, int number, double step_m,
                             cv::Mat1i& regions) {
  constexpr int kReach = 2;  // px; bridges single pixels without depth
  std::vector<cv::Point> pixels = {first};
  regions(first) = number;
  for (size_t i = 0; i < pixels.size(); ++i) {
    const cv::Point at = pixels[i];
    const float z = frame.points_m(at)[2];
    for (int dy = -kReach; dy <= kReach; ++dy) {
      for (int dx = -kReach; dx <= kReach; ++dx) {
        const cv::Point next(at.x + dx, at.y + dy);
        if (!cv::Rect({}, warm.size()).contains(next) || !warm(next) || regions(next) >= 0) continue;
        const double apart = std::max(std::abs(dx), std::abs(dy));
        if (std::abs(static_cast<double>(frame.points_m(next)[2] - z)) > apart * step_m) continue;
        regions(next) = number;
        pixels.push_back(next);
      }
    }
  }
  return pixels;
}

// Area of the surface in a pixel: the pixel's area on a plane perpendicular to z at the point's depth, divided by the
// cosine of the slope relative to the ray. Slopes are limited to 75 degrees.
double area_m2(const Frame& frame, cv::Point pixel, const Pinhole& camera) {
  constexpr double kLeastCosine = 0.26;
  const Eigen::Vector3d point = vector_of(frame.points_m(pixel)), normal = vector_of(frame.normals(pixel));
  const double across = point.z() * point.z() / (camera.fx * camera.fy);
  const double towards = std::abs(normal.dot(point));
  return std::isnan(towards) ? across : across * point.z() / std::max(towards, kLeastCosine * point.norm());
}

__attribute__((format(printf, 1, 2))) std::string words(const char* pattern, ...) {
  char buffer[256];
  va_list arguments;
  va_start(arguments, pattern);
  std::vsnprintf(buffer, sizeof buffer, pattern, arguments);
  va_end(arguments);
  return buffer;
}

void judge(WarmRegion& region, const ThermalOptions& o) {
  const PipeFit& pipe = region.pipe;
  const double cm2 = 1e4 * region.area_m2;
  const std::string what = words("%.1f degrees over %.0f cm2", region.warmest_c, cm2);
  const auto print_result = [&](WarmKind kind, const std::string& why) {
    region.kind = kind;
    region.reason = what + ": " + why;
  };
  if (region.warmest_c > o.hottest_c)
    print_result(WarmKind::too_hot, words("hotter than skin (%.1f)", o.hottest_c));
  else if (region.warmest_c < o.coldest_c)
    print_result(WarmKind::too_cold, words("colder than skin (%.1f)", o.coldest_c));
  else if (region.area_m2 < o.min_area_m2)
    print_result(WarmKind::too_small, words("smaller than %.0f cm2", 1e4 * o.min_area_m2));
  else if (region.area_m2 > o.max_area_m2)
    print_result(WarmKind::too_large, words("larger than %.0f cm2", 1e4 * o.max_area_m2));
  else if (region.planar_share > o.max_planar_share)
    print_result(WarmKind::flat, words("flat, %.0f %% on two planes", 100 * region.planar_share));
  else if (pipe.found && pipe.share > o.pipe_share && pipe.radius_m < o.max_pipe_radius_m &&
           pipe.length_m > o.min_pipe_length * pipe.width_m)
    print_result(WarmKind::pipe, words("a pipe, %.0f %% on a cylinder of %.0f mm diameter, %.0f mm long",
                                       100 * pipe.share, 2e3 * pipe.radius_m, 1e3 * pipe.length_m));
  else
    print_result(WarmKind::skin, words("skin temperature, neither flat (%.0f %% on two planes) nor a pipe (%.0f %%)",
                                       100 * region.planar_share, 100 * pipe.share));
}

// Returns the distance of each pixel of `box` from the nearest marked one.
cv::Mat1f distance_from(const std::vector<cv::Point>& marked, const cv::Rect& box) {
  cv::Mat1b apart(box.size(), uchar{1});
  for (const cv::Point& pixel : marked) apart(pixel - box.tl()) = 0;
  cv::Mat1f distance_px;
  cv::distanceTransform(apart, distance_px, cv::DIST_L2, cv::DIST_MASK_5);
  return distance_px;
}

// Removes a pipe from `pixels` if it makes up a good part of them, and returns it, so that objects touching it are
// classified separately. A pixel without a normal belongs to what is nearest in the image.
std::vector<cv::Point> extract_pipe(const Frame& frame, std::vector<cv::Point>& pixels, const ThermalOptions& options) {
  constexpr double kLeastShare = 0.25;
  std::vector<cv::Point> known, unknown;
  std::vector<SurfacePoint> patch;
  for (const cv::Point& pixel : pixels) {
    const Eigen::Vector3d normal = vector_of(frame.normals(pixel));
    (normal.allFinite() ? known : unknown).push_back(pixel);
    if (normal.allFinite()) patch.push_back({vector_of(frame.points_m(pixel)), normal});
  }
  const std::vector<char> on_pipe = find_long_pipe(patch, kLeastShare, options);
  if (on_pipe.empty()) return {};
  std::vector<cv::Point> pipe, rest;
  for (size_t i = 0; i < known.size(); ++i) (on_pipe[i] ? pipe : rest).push_back(known[i]);
  const cv::Rect box = cv::boundingRect(pixels);
  const cv::Mat1f from_pipe = distance_from(pipe, box), from_rest = distance_from(rest, box);
  for (const cv::Point& pixel : unknown) {
    const cv::Point at = pixel - box.tl();
    (from_pipe(at) < from_rest(at) ? pipe : rest).push_back(pixel);
  }
  pixels = std::move(rest);
  return pipe;
}

// Splits pixels into connected parts.
std::vector<std::vector<cv::Point>> together(const Frame& frame, const std::vector<cv::Point>& pixels, double step_m) {
  cv::Mat1b among(frame.points_m.size(), uchar{0});
  cv::Mat1i parts(among.size(), -1);
  for (const cv::Point& pixel : pixels) among(pixel) = 1;
  std::vector<std::vector<cv::Point>> result;
  for (const cv::Point& pixel : pixels) {
    if (parts(pixel) < 0) result.push_back(grown(frame, among, pixel, static_cast<int>(result.size()), step_m, parts));
  }
  return result;
}

double warmest_fifth(const cv::Mat1f& temperature_c, const std::vector<cv::Point>& pixels) {
  std::vector<float> temperatures;
  for (const cv::Point& pixel : pixels) temperatures.push_back(temperature_c(pixel));
  return quantile(temperatures, 0.8);
}

// Returns the pixels without the rim, which is warm only due to the thermal camera's blur, and without cooler parts.
std::vector<cv::Point> core_of(const cv::Mat1f& temperature_c, std::vector<cv::Point> pixels, double surroundings_c,
                               const ThermalOptions& options) {
  const double contrast_k = warmest_fifth(temperature_c, pixels) - surroundings_c;
  const auto least = static_cast<float>(surroundings_c + options.core_contrast * contrast_k);
  std::erase_if(pixels, [&](const cv::Point& pixel) { return temperature_c(pixel) < least; });
  return pixels;
}

WarmRegion described(const Frame& frame, const cv::Mat1f& temperature_c, const std::vector<cv::Point>& pixels,
                     const Pinhole& camera, const ThermalOptions& options) {
  constexpr size_t kKept = 64;
  WarmRegion region;
  region.pixels = static_cast<int>(pixels.size());
  region.box = cv::boundingRect(pixels);
  const auto n = static_cast<double>(pixels.size());
  std::vector<SurfacePoint> patch;
  double squares = 0;
  region.max_c = -kNothing;
  for (const cv::Point& pixel : pixels) {
    const auto t = static_cast<double>(temperature_c(pixel));
    region.mean_c += t / n;
    squares += t * t / n;
    region.max_c = std::max(region.max_c, t);
    region.area_m2 += area_m2(frame, pixel, camera);
    const Eigen::Vector3d point = vector_of(frame.points_m(pixel)), normal = vector_of(frame.normals(pixel));
    region.centre_m += point / n;
    if (normal.allFinite()) patch.push_back({point, normal});
  }
  for (size_t i = 0; i < pixels.size(); i += std::max<size_t>(1, pixels.size() / kKept))
    region.points_m.push_back(vector_of(frame.points_m(pixels[i])));
  region.spread_c = std::sqrt(std::max(0.0, squares - region.mean_c * region.mean_c));
  region.warmest_c = warmest_fifth(temperature_c, pixels);
  region.planar_share = planar_share(patch, options);
  region.pipe = fit_pipe(patch, options);
  judge(region, options);
  return region;
}

// Returns the pixels too far from the core to belong to its rim.
std::vector<cv::Point> beyond_rim(const std::vector<cv::Point>& pixels, const std::vector<cv::Point>& core, int reach) {
  const cv::Rect box = cv::boundingRect(pixels);
  cv::Mat1b near(box.size(), uchar{0});
  for (const cv::Point& pixel : core) near(pixel - box.tl()) = 1;
  cv::dilate(near, near, cv::getStructuringElement(cv::MORPH_ELLIPSE, {2 * reach + 1, 2 * reach + 1}));
  std::vector<cv::Point> left;
  std::copy_if(pixels.begin(), pixels.end(), std::back_inserter(left),
               [&](const cv::Point& pixel) { return near(pixel - box.tl()) == 0; });
  return left;
}

// Separates connected warm pixels into objects without rims: the warmest first, pipes separately, then cooler objects
// that touch them.
class Separation {
 public:
  Separation(const Frame& frame, const RegisteredThermal& thermal, double surroundings_c, const RigModel& rig,
             const ThermalOptions& options)
      : frame_(frame),
        temperature_c_(thermal.temperature_c),
        surroundings_c_(surroundings_c),
        options_(options),
        rim_(static_cast<int>(std::ceil(options.rim_px * rig.camera.fx / rig.thermal->lens.fx))) {}

  std::vector<std::vector<cv::Point>> of(std::vector<cv::Point> pixels) const {
    std::vector<std::vector<cv::Point>> things, waiting = {std::move(pixels)};
    const auto add = [&](std::vector<cv::Point> thing) {
      if (thing.size() >= kLeastPixels) things.push_back(std::move(thing));
    };
    while (!waiting.empty()) {
      const std::vector<cv::Point> next = std::move(waiting.back());
      waiting.pop_back();
      if (next.size() < kLeastPixels) continue;
      std::vector<cv::Point> core = core_of(temperature_c_, next, surroundings_c_, options_);
      for (auto& part : together(frame_, beyond_rim(next, core, rim_), options_.step_m))
        waiting.push_back(std::move(part));
      add(extract_pipe(frame_, core, options_));
      for (auto& part : together(frame_, core, options_.step_m)) add(std::move(part));
    }
    return things;
  }

 private:
  const Frame& frame_;
  const cv::Mat1f& temperature_c_;
  double surroundings_c_;
  const ThermalOptions& options_;
  int rim_;
};

}  // namespace

std::string to_string(WarmKind kind) {
  switch (kind) {
    case WarmKind::skin:
      return "skin";
    case WarmKind::too_cold:
      return "too_cold";
    case WarmKind::too_hot:
      return "too_hot";
    case WarmKind::too_small:
      return "too_small";
    case WarmKind::too_large:
      return "too_large";
    case WarmKind::flat:
      return "flat";
    case WarmKind::pipe:
      return "pipe";
  }
  return "unknown";
}

WarmView find_warm_regions(const Frame& frame, const RegisteredThermal& thermal, const RigModel& rig,
                           const ThermalOptions& options) {
  WarmView view;
  view.surroundings_c = surroundings(thermal.temperature_c, options.surroundings_quantile);
  view.regions = cv::Mat1i(frame.points_m.size(), -1);
  cv::Mat1b warm = warm_pixels(thermal, view.surroundings_c, options);
  split_at_creases(frame, options.crease_radius_m, warm);
  const Separation separation(frame, thermal, view.surroundings_c, rig, options);
  cv::Mat1i visited = view.regions.clone();
  int number = 0;
  for (int row = 0; row < warm.rows; ++row) {
    for (int col = 0; col < warm.cols; ++col) {
      if (!warm(row, col) || visited(row, col) >= 0) continue;
      for (const auto& pixels : separation.of(grown(frame, warm, {col, row}, number++, options.step_m, visited))) {
        for (const cv::Point& pixel : pixels) view.regions(pixel) = static_cast<int>(view.list.size());
        view.list.push_back(described(frame, thermal.temperature_c, pixels, rig.camera, options));
      }
    }
  }
  return view;
}

std::vector<LandmarkTemperature> landmark_temperatures(const cv::Mat1f& temperature_c, const WarmView& warm,
                                                       const Landmarks& landmarks, const ThermalOptions& options) {
  std::vector<LandmarkTemperature> results;
  const auto least = static_cast<float>(warm.surroundings_c + options.min_contrast_k);
  for (const Landmark& landmark : landmarks.landmarks) {
    LandmarkTemperature& result = results.emplace_back();
    if (landmark.outline.empty()) continue;
    cv::Mat1b inside(temperature_c.size(), uchar{0});
    cv::fillPoly(inside, std::vector<std::vector<cv::Point>>{landmark.outline}, cv::Scalar(1));
    std::vector<float> known;
    std::vector<int> on_it(warm.list.size());
    const cv::Rect box = cv::boundingRect(landmark.outline) & cv::Rect({}, inside.size());
    for (int row = box.y; row < box.br().y; ++row) {
      for (int col = box.x; col < box.br().x; ++col) {
        const float t = temperature_c(row, col);
        if (!inside(row, col) || std::isnan(t)) continue;
        known.push_back(t);
        if (const int region = warm.regions(row, col); region >= 0) ++on_it[static_cast<size_t>(region)];
      }
    }
    if (known.empty()) continue;
    result.pixels = static_cast<int>(known.size());
    double sum = 0, squares = 0;
    for (const float t : known) {
      sum += static_cast<double>(t);
      squares += static_cast<double>(t) * static_cast<double>(t);
    }
    result.mean_c = sum / result.pixels;
    result.spread_c = std::sqrt(std::max(0.0, squares / result.pixels - result.mean_c * result.mean_c));
    result.max_c = static_cast<double>(*std::max_element(known.begin(), known.end()));
    result.warm_share =
        static_cast<double>(std::count_if(known.begin(), known.end(), [&](float t) { return t > least; })) /
        result.pixels;
    result.p95_c = quantile(known, 0.95);
    // A region lies on the landmark if more than half of its pixels do.
    for (size_t i = 0; i < on_it.size(); ++i) {
      if (2 * on_it[i] > warm.list[i].pixels) result.regions.push_back(static_cast<int>(i));
    }
  }
  return results;
}

}  // namespace fringeslam
