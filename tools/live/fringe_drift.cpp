// SPDX-License-Identifier: Apache-2.0
#include "tools/live/fringe_drift.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace fringeslam::tools {

namespace {

constexpr int kStride = 8;

template <class Value>
cv::Mat_<Value> thinned(const cv::Mat_<Value>& image) {
  cv::Mat_<Value> result((image.rows + kStride - 1) / kStride, (image.cols + kStride - 1) / kStride);
  for (int row = 0; row < result.rows; ++row) {
    for (int col = 0; col < result.cols; ++col) result(row, col) = image(kStride * row, kStride * col);
  }
  return result;
}

}  // namespace

std::optional<double> fringe_drift(const Frame& frame, const PixelRays& rays, const RigModel& rig,
                                   const CameraTwist& twist, double finest_period_px) {
  if (finest_period_px <= 0) return std::nullopt;
  Frame few;
  few.points_m = thinned(frame.points_m);
  few.normals = thinned(frame.normals);
  const cv::Mat1f rate_px_s = coordinate_rate(few, rig, thinned(rays), twist);
  std::vector<float> drifts;
  for (const float rate : rate_px_s) {
    if (!std::isnan(rate)) drifts.push_back(std::abs(rate));
  }
  if (drifts.empty()) return std::nullopt;
  const auto middle = drifts.begin() + static_cast<std::ptrdiff_t>(drifts.size() / 2);
  std::nth_element(drifts.begin(), middle, drifts.end());
  return static_cast<double>(*middle) / rig.timing.camera_rate_hz / finest_period_px;
}

CameraTwist mean_twist(const Pose& previous_from_current, double duration_s) {
  if (!(duration_s > 0)) return {};
  return {rotation_log(previous_from_current.rotation) / duration_s, previous_from_current.translation / duration_s};
}

std::vector<std::string> drift_warnings(std::optional<double> drift) {
  if (!drift || *drift <= kFastestDrift) return {};
  const auto percent = [](double share) { return std::to_string(std::max(1l, std::lround(100 * share))) + " %"; };
  return {"Moving too fast: from image to image fringes drift by " + percent(*drift) +
          " of their period. Slow down to " + percent(kFastestDrift / *drift) + " of this speed."};
}

}  // namespace fringeslam::tools
