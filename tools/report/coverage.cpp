// SPDX-License-Identifier: Apache-2.0
#include "tools/report/coverage.h"

#include <cmath>
#include <opencv2/imgproc.hpp>

#include "tools/report/pictures.h"

namespace fringeslam::tools {

namespace {

constexpr double kEnlarged = 100;  // magnification of the residuals

cv::Mat3b device_picture(const RigCalibration& calibration, const Pinhole& lens, double rms_px,
                         const std::vector<Eigen::Vector2d> ViewResult::*corners,
                         const std::vector<Eigen::Vector2d> ViewResult::*residuals) {
  constexpr int kHeight = 720, kShift = 4;
  const double scale = static_cast<double>(kHeight) / lens.height;
  cv::Mat3b picture(kHeight, static_cast<int>(std::lround(lens.width * scale)), cv::Vec3b(30, 30, 30));
  const auto place = [&](const Eigen::Vector2d& p) {
    const Eigen::Vector2d q = ((p.array() + 0.5) * scale - 0.5) * (1 << kShift);
    return cv::Point(static_cast<int>(std::lround(q.x())), static_cast<int>(std::lround(q.y())));
  };
  for (const ViewResult& view : calibration.views) {
    for (size_t j = 0; j < (view.*corners).size(); ++j) {
      const Eigen::Vector2d &corner = (view.*corners)[j], &residual = (view.*residuals)[j];
      if (!corner.allFinite()) continue;
      const double size = std::min(1.0, residual.norm() / (3 * std::max(rms_px, 1e-6)));
      const cv::Scalar colour =
          view.used ? cv::Scalar(60, 220 * (1 - size) + 30, 60 + 190 * size) : cv::Scalar::all(110);
      cv::line(picture, place(corner), place(corner + kEnlarged * residual), colour, 1, cv::LINE_AA, kShift);
      cv::circle(picture, place(corner), 2 << kShift, colour, cv::FILLED, cv::LINE_AA, kShift);
    }
  }
  return picture;
}

}  // namespace

cv::Mat3b coverage_picture(const RigCalibration& calibration) {
  char camera[96], projector[96];
  std::snprintf(camera, sizeof camera, "camera: RMS %.3f px, residuals x%.0f", calibration.camera_rms_px, kEnlarged);
  std::snprintf(projector, sizeof projector, "projector: RMS %.3f px, residuals x%.0f", calibration.projector_rms_px,
                kEnlarged);
  return sheet({{{camera, device_picture(calibration, calibration.rig.camera, calibration.camera_rms_px,
                                         &ViewResult::camera_px, &ViewResult::camera_residual_px)},
                 {projector, device_picture(calibration, calibration.rig.projector, calibration.projector_rms_px,
                                            &ViewResult::projector_px, &ViewResult::projector_residual_px)}}},
               {960, 720});
}

}  // namespace fringeslam::tools
