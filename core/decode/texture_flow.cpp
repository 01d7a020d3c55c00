// SPDX-License-Identifier: Apache-2.0
#include "core/decode/texture_flow.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <opencv2/video/tracking.hpp>

#include "core/base/symmetric_filter.h"
#include "core/decode/steps.h"
#include "core/types/linear_algebra.h"
#include "core/types/selected_instruction_set.h"

namespace fringeslam {

namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

// A piece of texture that was found at two times.
struct Track {
  double before_s = 0, after_s = 0;
  Vector2d before, after;
};

double mean_time_s(const FringeStack& stack, const std::vector<int>& images) {
  double sum = 0;
  for (const int k : images) sum += stack.exposure_time_s[static_cast<size_t>(k)] - stack.timestamp_s;
  return sum / static_cast<double>(images.size());
}

// The mean of a period's images shows hardly any fringes, nor does a single image of wide ones. Its local contrast does
// not depend on the illumination.
cv::Mat1b texture_of(const FringeStack& stack, const std::vector<int>& images) {
  constexpr int kWindow_px = 31;
  constexpr double kGrey = 50;  // grey values per local standard deviation
  cv::Mat1f mean(stack.images[0].size(), 0.f);
  for (const int k : images) cv::accumulate(stack.images[static_cast<size_t>(k)], mean);
  mean /= static_cast<double>(images.size());
  cv::Mat1f slow, squares;
  const cv::Mat1f smooth = filtered(mean, gaussian_half(1), FilterBorder::mirrored, selected_instruction_set());
  cv::blur(smooth, slow, {kWindow_px, kWindow_px});
  cv::blur(smooth.mul(smooth), squares, {kWindow_px, kWindow_px});
  cv::Mat deviation = cv::max(squares - slow.mul(slow), 1.f);
  cv::sqrt(deviation, deviation);
  const cv::Mat texture = (smooth - slow) / deviation;
  cv::Mat1b grey;
  texture.convertTo(grey, CV_8U, kGrey, 128);
  return grey;
}

// Adds the corners of one texture that were tracked to another and back to where they came from.
void add_tracks(const cv::Mat1b& before, double before_s, const cv::Mat1b& after, double after_s,
                std::vector<Track>& tracks) {
  constexpr int kMostCorners = 400, kLevels = 5;
  constexpr double kQuality = 0.02, kLeastDistance_px = 9;
  constexpr float kReturned_px = 1.f;
  const cv::Size window(25, 25);
  std::vector<cv::Point2f> corners, there, back;
  cv::goodFeaturesToTrack(before, corners, kMostCorners, kQuality, kLeastDistance_px);
  if (corners.empty()) return;
  std::vector<uchar> found, returned;
  std::vector<float> errors;
  cv::calcOpticalFlowPyrLK(before, after, corners, there, found, errors, window, kLevels);
  cv::calcOpticalFlowPyrLK(after, before, there, back, returned, errors, window, kLevels);
  const auto vector = [](const cv::Point2f& p) { return Vector2d(static_cast<double>(p.x), static_cast<double>(p.y)); };
  for (size_t i = 0; i < corners.size(); ++i) {
    const cv::Point2f off = back[i] - corners[i];
    if (found[i] && returned[i] && std::hypot(off.x, off.y) <= kReturned_px)
      tracks.push_back({before_s, after_s, vector(corners[i]), vector(there[i])});
  }
}

// Tracks between the means of consecutive periods, which are accurate, and between consecutive images of wide fringes,
// which are found at higher speeds: texture moves less, and is not smeared.
std::vector<Track> tracks_of(const FringeStack& stack, const std::vector<FringeGroup>& periods) {
  constexpr double kWide_px = 100;
  std::vector<Track> tracks;
  const auto add_sequence = [&](const std::vector<std::vector<int>>& sequence) {
    cv::Mat1b before;
    for (size_t i = 0; i < sequence.size(); ++i) {
      const cv::Mat1b here = texture_of(stack, sequence[i]);
      if (i > 0) add_tracks(before, mean_time_s(stack, sequence[i - 1]), here, mean_time_s(stack, sequence[i]), tracks);
      before = here;
    }
  };
  std::vector<std::vector<int>> means, singles;
  for (const FringeGroup& period : periods) {
    means.push_back(period.images);
    if (period.period_px < kWide_px) continue;
    for (const int image : period.images) singles.push_back({image});
  }
  add_sequence(means);
  add_sequence(singles);
  return tracks;
}

class TrackFit {
 public:
  TrackFit(const RigModel& rig, const PixelRays& rays, const cv::Mat1f& depth_m, const MotionPrior& prior)
      : rig_(rig), rays_(rays), depth_m_(depth_m), start_(prior.motion) {
    information_ = inverse_positive_definite(Eigen::MatrixXd(prior.covariance));
  }

  // Motion of the least robust cost. The scale of the robust kernel shrinks from that of any displacement to that of the
  // tracks' errors (graduated non-convexity), so that no start is needed. Accelerations follow once the velocity is
  // roughly known, if `accelerated`.
  Vector12d solve(const std::vector<Track>& tracks, bool accelerated) const {
    constexpr double kWidest_px = 64, kAccelerated_px = 12, kNarrowest_px = 1, kNarrower = 0.7, kSigma_px = 0.3;
    constexpr double kHeld = 1e6;
    Vector12d motion = to_vector(start_);
    const Vector12d prior = motion;
    for (double scale_px = kWidest_px; scale_px > kNarrowest_px; scale_px *= kNarrower) {
      Matrix12d information = information_;
      if (!accelerated || scale_px > kAccelerated_px) information.diagonal().tail<6>() *= kHeld;
      Vector12d gradient = information * (motion - prior);
      for (const Track& track : tracks) {
        Vector2d residual;
        Eigen::Matrix<double, 2, 12> jacobian;
        if (!residual_px(track, motion, residual, &jacobian)) continue;
        // Geman-McClure.
        const double share = 1 / (1 + residual.squaredNorm() / (scale_px * scale_px));
        const double weight = share * share / std::max(kSigma_px * kSigma_px, 0.01 * scale_px * scale_px);
        information += weight * jacobian.transpose() * jacobian;
        gradient += weight * jacobian.transpose() * residual;
      }
      motion -= solve_positive_definite(Eigen::MatrixXd(information), Eigen::VectorXd(gradient));
    }
    return motion;
  }

  // Share of the tracks that a motion explains.
  double explained(const std::vector<Track>& tracks, const Vector12d& motion) const {
    constexpr double kInlier_px = 2;
    int inliers = 0;
    for (const Track& track : tracks) {
      Vector2d residual;
      inliers += residual_px(track, motion, residual) && residual.norm() < kInlier_px;
    }
    return static_cast<double>(inliers) / static_cast<double>(tracks.size());
  }

 private:
  // `derivative`: with respect to the motion, to first order in the turn during the stack and without the lens's
  // distortion.
  bool residual_px(const Track& track, const Vector12d& motion, Vector2d& out,
                   Eigen::Matrix<double, 2, 12>* derivative = nullptr) const {
    const int row = static_cast<int>(track.before.y() + 0.5), col = static_cast<int>(track.before.x() + 0.5);
    if (row < 0 || col < 0 || row >= rays_.rows || col >= rays_.cols) return false;
    const cv::Vec2f& ray = rays_(row, col);
    if (std::isnan(ray[0])) return false;
    const CameraMotion here = to_motion(motion);
    const Pose before = here.at(track.before_s), after = here.at(track.after_s);
    const Vector3d point = static_cast<double>(depth_m_(row, col)) * Vector3d(ray[0], ray[1], 1);
    const Vector3d moved = after.inverse() * (before * point);
    if (!(moved.z() > 0)) return false;
    out = rig_.camera.project(moved) - rig_.camera.project(point) - (track.after - track.before);
    if (derivative == nullptr) return true;
    Eigen::Matrix<double, 2, 3> by_point;
    by_point << rig_.camera.fx, 0, -rig_.camera.fx * moved.x() / moved.z(), 0, rig_.camera.fy,
        -rig_.camera.fy * moved.y() / moved.z();
    by_point /= moved.z();
    Eigen::Matrix<double, 2, 6> by_displacement;
    for (int axis = 0; axis < 3; ++axis) by_displacement.col(axis) = by_point * moved.cross(Vector3d::Unit(axis));
    by_displacement.rightCols<3>() = -by_point;
    const double first = track.after_s - track.before_s,
                 second = 0.5 * (track.after_s * track.after_s - track.before_s * track.before_s);
    *derivative << first * by_displacement, second * by_displacement;
    return true;
  }

  const RigModel& rig_;
  const PixelRays& rays_;
  const cv::Mat1f& depth_m_;
  CameraMotion start_;
  Matrix12d information_;
};

}  // namespace

std::optional<CameraMotion> motion_from_texture(const FringeStack& stack, const RigModel& rig, const PixelRays& rays,
                                                const cv::Mat1f& depth_m, const MotionPrior& prior, Axis axis) {
  constexpr size_t kLeastTracks = 20;
  constexpr double kLeastExplained = 0.4;
  check_stack(stack);
  std::vector<FringeGroup> periods = select_groups(stack.patterns, axis, {});
  if (periods.size() < 2) return std::nullopt;
  // The finest fringes drift so far between images that their mean still shows them.
  if (periods.size() > 2) periods.pop_back();
  const std::vector<Track> tracks = tracks_of(stack, periods);
  if (tracks.size() < kLeastTracks) return std::nullopt;
  const TrackFit fit(rig, rays, depth_m, prior);
  // Accelerations make the velocity less certain, so they must explain tracks that it does not.
  constexpr double kClearly = 0.05;
  const Vector12d steady = fit.solve(tracks, false), accelerated = fit.solve(tracks, true);
  const double by_steady = fit.explained(tracks, steady), by_accelerated = fit.explained(tracks, accelerated);
  const bool accelerates = by_accelerated > by_steady + kClearly;
  const Vector12d& found = accelerates ? accelerated : steady;
  if (!found.allFinite() || std::max(by_steady, by_accelerated) < kLeastExplained) return std::nullopt;
  return to_motion(found);
}

}  // namespace fringeslam
