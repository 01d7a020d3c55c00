// SPDX-License-Identifier: Apache-2.0
#include "tools/report/view_pictures.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <opencv2/imgproc.hpp>

#include "core/base/parallel.h"
#include "core/io/files.h"
#include "core/io/jpeg_file.h"
#include "tools/report/packing.h"

namespace fringeslam::tools {

namespace {

using nlohmann::ordered_json;

constexpr int kQuality = 85;     // JPEG
constexpr int kCompression = 7;  // PNG
constexpr int kMinWidth = 120;   // px; smaller pictures are useless

double quantile(std::vector<float>& values, double q) {
  const auto place = values.begin() + static_cast<std::ptrdiff_t>(q * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), place, values.end());
  return *place;
}

// Returns every 13th value of all views, without NaN.
template <class Select>
std::vector<float> sampled(const std::vector<ViewImages>& views, const Select& select) {
  std::vector<float> values;
  for (const ViewImages& view : views) {
    const auto& image = select(view);
    for (size_t i = 0; i < image.total(); i += 13) {
      const float value = image(static_cast<int>(i / static_cast<size_t>(image.cols)),
                                static_cast<int>(i % static_cast<size_t>(image.cols)));
      if (!std::isnan(value)) values.push_back(value);
    }
  }
  return values;
}

// Converts linear light to display values, with `white` as white.
cv::Mat1b for_screen(const cv::Mat1b& texture, double white) {
  cv::Mat1b table(1, 256);
  for (int i = 0; i < 256; ++i)
    table(i) = static_cast<uchar>(std::lround(255 * std::pow(std::min(1.0, i / white), 1 / 2.2)));
  cv::Mat1b picture;
  cv::LUT(texture, table, picture);
  return picture;
}

std::string data_url(const std::string& type, const std::string& bytes) {
  return "data:image/" + type + ";base64," + base64(bytes);
}

ordered_json encoded(const ViewImages& view, const PictureScales& scales) {
  const double limit = scales.error_limit_m;
  ordered_json pictures = {
      {"width", view.texture.cols},
      {"height", view.texture.rows},
      {"texture", data_url("jpeg", jpeg_bytes(for_screen(view.texture, scales.white), kQuality))},
      {"depth", data_url("png", png_bytes(levels(view.depth_m, scales.near_m, scales.far_m), kCompression))}};
  if (!view.error_m.empty())
    pictures["error"] = data_url("png", png_bytes(levels(view.error_m, -limit, limit), kCompression));
  if (!view.temperature_c.empty())
    pictures["temperature"] =
        data_url("png", png_bytes(levels(view.temperature_c, scales.cold_c, scales.warm_c), kCompression));
  return pictures;
}

size_t characters(const ordered_json& pictures) {
  size_t sum = 0;
  for (const auto& value : pictures) sum += value.is_string() ? value.get_ref<const std::string&>().size() : 0;
  return sum;
}

}  // namespace

ViewImages shrunk(const ViewImages& view, int max_width) {
  if (view.texture.cols <= max_width) return view;
  const cv::Size size(max_width, std::max(1, view.texture.rows * max_width / view.texture.cols));
  ViewImages small{view.index, {}, {}, {}};
  cv::resize(view.texture, small.texture, size, 0, 0, cv::INTER_AREA);
  cv::resize(view.depth_m, small.depth_m, size, 0, 0, cv::INTER_NEAREST);
  if (!view.error_m.empty()) cv::resize(view.error_m, small.error_m, size, 0, 0, cv::INTER_NEAREST);
  if (!view.temperature_c.empty()) cv::resize(view.temperature_c, small.temperature_c, size, 0, 0, cv::INTER_NEAREST);
  return small;
}

PictureScales picture_scales(const std::vector<ViewImages>& views) {
  PictureScales scales;
  auto grey = sampled(views, [](const ViewImages& view) -> const cv::Mat1b& { return view.texture; });
  if (!grey.empty()) scales.white = std::max(1.0, quantile(grey, 0.995));
  auto depths = sampled(views, [](const ViewImages& view) -> const cv::Mat1f& { return view.depth_m; });
  if (!depths.empty()) {
    scales.near_m = std::floor(quantile(depths, 0.005) * 100) / 100;
    scales.far_m = std::max(scales.near_m + 0.01, std::ceil(quantile(depths, 0.995) * 100) / 100);
  }
  const double limit_m =
      error_limit_m(sampled(views, [](const ViewImages& view) -> const cv::Mat1f& { return view.error_m; }));
  if (limit_m > 0) scales.error_limit_m = limit_m;
  auto temperatures = sampled(views, [](const ViewImages& view) -> const cv::Mat1f& { return view.temperature_c; });
  if (!temperatures.empty()) {
    constexpr double kWarmest_c = 40;
    scales.cold_c = std::floor(std::min(quantile(temperatures, 0.01), kWarmest_c - 5));
    scales.warm_c = kWarmest_c;
  }
  return scales;
}

double error_limit_m(const std::vector<float>& errors) {
  std::vector<float> sizes;
  for (const float error : errors) {
    if (!std::isnan(error)) sizes.push_back(std::abs(error));
  }
  if (sizes.empty()) return 0;
  const double wanted = std::max(1e-7, 4 * quantile(sizes, 0.5));
  const double decade = std::pow(10, std::floor(std::log10(wanted)));
  for (const double step : {1.0, 2.0, 5.0}) {
    if (step * decade >= wanted * (1 - 1e-6)) return step * decade;
  }
  return 10 * decade;
}

cv::Mat1b levels(const cv::Mat1f& values, double low, double high) {
  cv::Mat1b result(values.size());
  for (int row = 0; row < values.rows; ++row) {
    for (int col = 0; col < values.cols; ++col) {
      const double share = std::clamp((values(row, col) - low) / (high - low), 0.0, 1.0);
      result(row, col) = std::isnan(values(row, col)) ? uchar{0} : static_cast<uchar>(1 + std::lround(254 * share));
    }
  }
  return result;
}

std::vector<ordered_json> encoded(const std::vector<ViewImages>& views, const PictureScales& scales, size_t max_bytes) {
  std::vector<ordered_json> pictures(views.size());
  if (views.empty()) return pictures;
  // Estimate the total size from a few views.
  double bytes = 0;
  const std::vector<size_t> probes = {0, views.size() / 2, views.size() - 1};
  for (const size_t probe : probes) bytes += static_cast<double>(characters(encoded(views[probe], scales)));
  bytes *= static_cast<double>(views.size()) / static_cast<double>(probes.size());
  const double factor = std::min(1.0, std::sqrt(static_cast<double>(max_bytes) / bytes));
  const int width = std::max(kMinWidth, static_cast<int>(factor * views.front().texture.cols));
  for_each_row(static_cast<int>(views.size()), [&](int row) {
    const auto i = static_cast<size_t>(row);
    pictures[i] = encoded(shrunk(views[i], width), scales);
  });
  return pictures;
}

}  // namespace fringeslam::tools
