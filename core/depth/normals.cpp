// SPDX-License-Identifier: Apache-2.0
#include "core/depth/normals.h"

#include <limits>

#include "core/base/constants.h"
#include "core/base/parallel.h"
#include "core/depth/normal_propagation.h"

namespace fringeslam {

namespace {

// Copies the normals of a row that `some` provides into `all` and clears their `wanted` flags.
void take(const NormalImages& some, int row, int width, NormalImages& all, int32_t* wanted) {
  constexpr int kTogether = 16;  // blocks, most of which have no wanted pixel left; rows are padded to a multiple
  float *const x = all.x[row], *const y = all.y[row], *const z = all.z[row];
  const float *const from_x = some.x[row], *const from_y = some.y[row], *const from_z = some.z[row];
  for (int first = 0; first < width; first += kTogether) {
    int32_t any = 0;
    for (int col = first; col < first + kTogether; ++col) any |= wanted[col];
    if (any == 0) continue;
    for (int col = first; col < first + kTogether; ++col) {
      const bool given = from_z[col] != 0;
      x[col] = given ? from_x[col] : x[col];
      y[col] = given ? from_y[col] : y[col];
      z[col] = given ? from_z[col] : z[col];
      wanted[col] = given ? 0 : wanted[col];
    }
  }
}

cv::Mat3f interleaved(const NormalImages& normals, const cv::Size& size) {
  cv::Mat3f result(size);
  for_each_row(size.height, [&](int row) {
    const float *const x = normals.x[row], *const y = normals.y[row], *const z = normals.z[row];
    float* const to = result[row]->val;
    for (int col = 0; col < size.width; ++col) {
      const bool given = z[col] != 0;
      to[3 * col] = given ? x[col] : kNaN;
      to[3 * col + 1] = given ? y[col] : kNaN;
      to[3 * col + 2] = given ? z[col] : kNaN;
    }
  });
  return result;
}

}  // namespace

cv::Mat3f estimate_normals(const FitImage& image, const PlaneFit& widest) {
  const int width = image.size.width, height = image.size.height;
  NormalImages normals(image), fitted = NormalImages::framed(image);
  PaddedImage<int32_t> wanted(image.size, image.margin);
  for_each_row(height, [&](int row) {
    for (int col = 0; col < width; ++col) wanted[row][col] = image.z[row][col] < FitImage::kNowhere ? -1 : 0;
  });
  for (PlaneFit fit = widest; fit.radius >= 1; fit.radius /= 2) {
    for_each_row(height, [&](int row) {
      fit_planes(image, row, fit, wanted[row], fitted);
      take(fitted, row, width, normals, wanted[row]);
    });
    for_each_row(height, [&](int row) { propagate_normals(image, fitted, row, fit.radius, wanted[row], normals); });
  }
  return interleaved(normals, image.size);
}

}  // namespace fringeslam
