// SPDX-License-Identifier: Apache-2.0
#include "core/decode/motion_compensation.h"

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cmath>
#include <limits>
#include <numbers>

#include "core/base/parallel.h"
#include "core/decode/coordinate_of_depth.h"
#include "core/decode/steps.h"
#include "core/types/error.h"

namespace fringeslam {

namespace {

constexpr double kTurn = 2 * std::numbers::pi;
constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();

// Effect of a drift on the phase measured from one group of images.
class DriftedPhase {
 public:
  DriftedPhase(const FringeGroup& group, const std::vector<double>& times_s) : estimator_(least_squares(group)) {
    for (const int image : group.images)
      mean_s_ += times_s[static_cast<size_t>(image)] / static_cast<double>(group.images.size());
    for (size_t k = 0; k < group.images.size(); ++k) {
      times_s_.push_back(times_s[static_cast<size_t>(group.images[k])] - mean_s_);
      shifts_.push_back(group.shifts_rad[k]);
    }
  }

  // Returns the phase error (measured minus true) for a drift of `rate` rad/s. The contribution of the mean time is
  // treated separately because it may exceed half a turn.
  double offset(double measured, double rate) const {
    double cc = 0, cs = 0, sc = 0, ss = 0;
    for (size_t k = 0; k < times_s_.size(); ++k) {
      const double at = shifts_[k] + rate * times_s_[k], cosine = std::cos(at), sine = std::sin(at);
      const auto c = static_cast<double>(estimator_.cosine[k]), s = static_cast<double>(estimator_.sine[k]);
      cc += c * cosine, cs -= c * sine, sc += s * cosine, ss -= s * sine;
    }
    // The adjugate replaces the inverse: only the ratio matters, and the determinant is positive for small drifts.
    const double x = std::cos(measured), y = std::sin(measured);
    const double phase = std::atan2(cc * y - sc * x, ss * x - cs * y);
    return std::remainder(measured - phase, kTurn) + rate * mean_s_;
  }

 private:
  StepEstimator estimator_;
  std::vector<double> times_s_, shifts_;
  double mean_s_ = 0;
};

}  // namespace

cv::Mat1f coordinate_rate(const Frame& frame, const RigModel& rig, const PixelRays& rays, const CameraTwist& twist,
                          Axis axis) {
  if (frame.points_m.size() != rays.size()) throw Error("motion: the frame and the camera differ in size");
  cv::Mat1f depth;
  cv::extractChannel(frame.points_m, depth, 2);
  cv::Mat1f rate = coordinate_of_depth(rig, rays, depth, axis).per_m;
  for_each_row(rate.rows, [&](int row) {
    for (int col = 0; col < rate.cols; ++col) {
      if (!frame.valid(row, col)) continue;
      const cv::Vec3f& p = frame.points_m(row, col);
      cv::Vec3f normal = frame.normals(row, col);
      if (std::isnan(normal[2])) normal = neighbour_normal(frame.points_m, row, col);
      const Eigen::Vector3d point(p[0], p[1], p[2]), n(normal[0], normal[1], normal[2]);
      const Eigen::Vector3d velocity = -(twist.angular_rad_s.cross(point) + twist.velocity_m_s);
      rate(row, col) *= static_cast<float>(n.dot(velocity) * point.z() / n.dot(point));
    }
  });
  return rate;
}

void compensate_motion(DecodedStack& decoded, const FringeStack& stack, const DecodeOptions& options,
                       const cv::Mat1f& rate_px_s, Axis axis) {
  check_stack(stack);
  if (rate_px_s.size() != decoded.coordinate_px.size()) throw Error("motion: rates and coordinates differ in size");
  const std::vector<FringeGroup> groups = select_groups(stack.patterns, axis, options);
  if (groups.empty()) return;  // no fringes: the coordinate is from the Gray code
  const double period = groups.back().period_px;
  std::vector<double> times_s = stack.exposure_time_s;
  for (double& time_s : times_s) time_s -= stack.timestamp_s;
  const DriftedPhase drifted(groups.back(), times_s);
  for_each_row(rate_px_s.rows, [&](int row) {
    for (int col = 0; col < rate_px_s.cols; ++col) {
      const double rate = static_cast<double>(rate_px_s(row, col)) * kTurn / period;
      const double measured = decoded.wrapped_phase(row, col);
      if (rate == 0 || std::isnan(rate) || std::isnan(measured)) continue;
      const double offset = drifted.offset(measured, rate);
      const double wrapped = std::remainder(measured - offset, kTurn);
      // Change of the order, so that coordinate = (phase / 2 pi + order) period - 1/2 still holds.
      const auto turned = static_cast<int>(std::lround((measured - offset - wrapped) / kTurn));
      decoded.wrapped_phase(row, col) = static_cast<float>(wrapped);
      decoded.coordinate_px(row, col) -= static_cast<float>(offset / kTurn * period);  // NaN stays
      if (!decoded.relative_phase.empty()) decoded.relative_phase(row, col) -= static_cast<float>(offset);
      int& order = decoded.fringe_order(row, col);
      if (order < 0) continue;
      order += turned;
      if (order < 0) decoded.coordinate_px(row, col) = decoded.confidence(row, col) = kNaN;  // outside the projector
    }
  });
}

}  // namespace fringeslam
