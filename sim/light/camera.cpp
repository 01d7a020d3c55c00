// SPDX-License-Identifier: Apache-2.0
#include "sim/light/camera.h"

#include <algorithm>
#include <cmath>

#include "core/base/parallel.h"
#include "core/base/symmetric_filter.h"
#include "core/types/selected_instruction_set.h"
#include "sim/light/photometry.h"
#include "sim/light/sample_rays.h"
#include "sim/random.h"

namespace fringeslam::sim {

Camera::Camera(const RigModel& rig, const Effects& effects, uint64_t seed, double sampled_blur_px)
    : sensor_(rig.sensor),
      blur_px_(effects.lens_blur ? remaining_blur_px(rig.camera_lens.blur_px, sampled_blur_px) : 0),
      response_(rig.camera.height, rig.camera.width) {
  if (!effects.fixed_pattern) sensor_.prnu = sensor_.dsnu_electrons = sensor_.dark_current_electrons_s = 0;
  const double on_axis = photons_per_lux_s(rig) * sensor_.quantum_efficiency;
  const double exponent = effects.vignetting ? rig.camera_lens.vignetting : 0;
  // Light passes the lens before it is blurred.
  if (blur_px_ > 0 && exponent != 0) vignetting_ = cv::Mat1f(response_.size(), 1.0f);
  cv::Mat1f& vignetted = vignetting_.empty() ? response_ : vignetting_;
  for_each_row(response_.rows, [&](int row) {
    for (int col = 0; col < response_.cols; ++col) {
      response_(row, col) = static_cast<float>(on_axis);
      if (exponent == 0) continue;
      // A pixel without a ray sees nothing.
      const double transmission = lens_transmission(rig.camera.undistort({col, row}), exponent);
      if (!std::isnan(transmission)) vignetted(row, col) *= static_cast<float>(transmission);
    }
  });
  if (sensor_.prnu == 0 && sensor_.dsnu_electrons == 0) return;
  dark_electrons_.create(response_.size());
  const Philox random(seed, Stream::fixed_pattern, 0);
  for_each_row(response_.rows, [&](int row) {
    for (int col = 0; col < response_.cols; ++col) {
      const auto [response, dark] = random.normal_pair(static_cast<uint32_t>(row * response_.cols + col));
      response_(row, col) *= static_cast<float>(std::max(0.0, 1 + sensor_.prnu * response));
      dark_electrons_(row, col) = static_cast<float>(sensor_.dsnu_electrons * dark);
    }
  });
}

cv::Mat1f Camera::electrons_per_s(const cv::Mat1f& lux) const {
  cv::Mat1f image = lux;
  if (!vignetting_.empty()) image = cv::Mat1f(image.mul(vignetting_));
  if (blur_px_ > 0)
    image = filtered(image, point_spread_half(blur_px_), FilterBorder::replicated, selected_instruction_set());
  return cv::Mat1f(image.mul(response_));
}

cv::Mat Camera::expose(const cv::Mat1f& electrons_per_s, double exposure_s, const Exposure& exposure) const {
  const NormalField random(exposure.seed, Stream::sensor_noise, static_cast<uint32_t>(exposure.stack),
                           static_cast<uint32_t>(exposure.image));
  const auto dark_variance = static_cast<float>(sensor_.dark_noise_electrons * sensor_.dark_noise_electrons);
  const auto dark_current = static_cast<float>(sensor_.dark_current_electrons_s * exposure_s);
  const auto seconds = static_cast<float>(exposure_s), gain = static_cast<float>(sensor_.gain_dn_per_electron);
  const auto offset = static_cast<float>(sensor_.offset_dn);
  const float full = exposure.quantise ? static_cast<float>(sensor_.full_well_electrons) : 1e30f;
  const int cols = electrons_per_s.cols;
  cv::Mat1f grey(electrons_per_s.size());
  for_each_row(grey.rows, [&](int row) {
    const float* rate = electrons_per_s[row];
    const float* dsnu = dark_electrons_.empty() ? nullptr : dark_electrons_[row];
    float* out = grey[row];
    for (int col = 0; col < cols; ++col) out[col] = seconds * rate[col] + dark_current;
    if (exposure.noise) {
      std::vector<float> normal(static_cast<size_t>(cols));
      random.row(static_cast<uint32_t>(row), normal);
      const float* deviate = normal.data();
      for (int col = 0; col < cols; ++col) out[col] += std::sqrt(out[col] + dark_variance) * deviate[col];
    }
    if (dsnu) {
      for (int col = 0; col < cols; ++col) out[col] += dsnu[col];
    }
    for (int col = 0; col < cols; ++col) out[col] = offset + gain * std::min(out[col], full);
  });
  if (!exposure.quantise) return grey;
  cv::Mat quantised;
  cv::Mat clipped = cv::min(grey, sensor_.max_dn());
  clipped.convertTo(quantised, sensor_.bits <= 8 ? CV_8U : CV_16U);  // rounds, and clips at 0
  return quantised;
}

double Camera::auto_exposure_s(const cv::Mat1f& brightest_electrons_per_s, double longest_s) const {
  constexpr double kTarget = 0.8, kShare = 0.999;
  std::vector<float> values(brightest_electrons_per_s.begin(), brightest_electrons_per_s.end());
  const auto nth = values.begin() + static_cast<std::ptrdiff_t>(kShare * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), nth, values.end());
  const double saturation =
      std::min(sensor_.full_well_electrons, (sensor_.max_dn() - sensor_.offset_dn) / sensor_.gain_dn_per_electron);
  const auto rate = static_cast<double>(*nth);
  return rate > 0 ? std::min(longest_s, kTarget * saturation / rate) : longest_s;
}

}  // namespace fringeslam::sim
