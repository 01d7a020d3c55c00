// SPDX-License-Identifier: Apache-2.0
#include "core/landmarks/scale_space.h"

#include <algorithm>
#include <opencv2/imgproc.hpp>

#include "core/base/parallel.h"
#include "core/base/symmetric_filter.h"
#include "core/types/selected_instruction_set.h"

namespace fringeslam {

namespace {

constexpr double kSigmaOfImages = 0.5;  // of the camera's own blur, px (Lowe)

cv::Mat1f every_second_pixel(const cv::Mat1f& image) {
  cv::Mat1f result((image.rows + 1) / 2, (image.cols + 1) / 2);
  for_each_row(result.rows, [&](int row) {
    const float* const from = image[2 * row];
    float* const to = result[row];
    for (int col = 0; col < result.cols; ++col) to[col] = from[2 * col];
  });
  return result;
}

}  // namespace

cv::Mat1f blurred(const cv::Mat1f& image, double sigma) {
  return filtered(image, gaussian_half(sigma, 3.5), FilterBorder::mirrored, selected_instruction_set());
}

std::vector<Octave> scale_space(const cv::Mat1b& image) {
  constexpr int kSmallest = 8;  // pixels across
  std::vector<Octave> octaves;
  if (std::min(image.rows, image.cols) < kSmallest / 2) return octaves;
  cv::Mat1f grey, first;
  image.convertTo(grey, CV_32F);
  cv::resize(grey, first, {}, 2, 2, cv::INTER_LINEAR);
  first = blurred(first, std::sqrt(kFinestSigma * kFinestSigma - 4 * kSigmaOfImages * kSigmaOfImages));
  while (std::min(first.rows, first.cols) >= kSmallest) {
    Octave& octave = octaves.emplace_back();
    octave[0] = first;
    for (size_t level = 1; level < kLevels; ++level) {
      const double before = level_sigma(static_cast<double>(level) - 1), now = level_sigma(static_cast<double>(level));
      octave[level] = blurred(octave[level - 1], std::sqrt(now * now - before * before));
    }
    first = every_second_pixel(octave[kScalesPerOctave]);
  }
  return octaves;
}

}  // namespace fringeslam
