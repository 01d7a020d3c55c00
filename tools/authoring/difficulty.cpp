// SPDX-License-Identifier: Apache-2.0
#include "tools/authoring/difficulty.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>

#include "core/base/parallel.h"
#include "core/mapper/pipeline.h"
#include "core/motion/observability.h"
#include "core/registration/ambiguity.h"
#include "core/score/score.h"
#include "core/types/linear_algebra.h"

namespace fringeslam::tools {

namespace {

using sim::SensorView;

constexpr double kReduction = SensorView::kReduction;
constexpr double kInfinite = std::numeric_limits<double>::infinity();

std::string words(const char* format, auto... values) {
  char text[256];
  std::snprintf(text, sizeof text, format, values...);
  return text;
}

double percent(double share) { return 100 * share; }

// Settings of the mapper for reduced images.
PipelineOptions reduced_options() {
  PipelineOptions options;
  options.tracking.at_rest = true;
  options.depth.footprint_noise /= kReduction;  // a reduced pixel covers more of a surface
  return options;
}

struct AssessedView {
  TimedPose pose;
  TruthFrame truth;
  cv::Mat1f sigma_m;  // NaN where not measured
  Frame frame;        // depth and normals: ground truth
};

// Poses of the views of a scene.
class Views {
 public:
  explicit Views(const sim::Scene& scene) : scene_(scene) {
    const Timing& timing = scene.rig.timing;
    const size_t images = scene.patterns.patterns.size();
    for (size_t i = 0; i < images; ++i) {
      exposures_s_.push_back((static_cast<double>(i) + 0.5) / timing.camera_rate_hz);
    }
    reference_s_ = reference_time_s(scene.patterns, exposures_s_);
    interval_s_ = scene.view_rate_hz > 0 ? 1 / scene.view_rate_hz : static_cast<double>(images) / timing.camera_rate_hz;
    if (!scene.path) {
      count_ = scene.trajectory.size();
      return;
    }
    const double room_s = scene.path->duration_s() - exposures_s_.back();
    count_ = room_s < 0 ? 0 : static_cast<size_t>(std::floor(room_s / interval_s_ + 1e-9)) + 1;
  }

  size_t count() const { return count_; }
  TimedPose at(size_t view) const {
    if (!scene_.path) return scene_.trajectory[view];
    const double time_s = static_cast<double>(view) * interval_s_ + reference_s_;
    return {time_s, scene_.path->at(time_s)};
  }
  // Poses of the camera at the exposures of a view, relative to its reference.
  std::vector<Pose> reference_from_exposures(size_t view) const {
    const TimedPose reference = at(view);
    const Pose reference_from_world = (reference.world_from_robot * scene_.rig.robot_from_camera).inverse();
    std::vector<Pose> poses;
    for (const double exposure_s : exposures_s_) {
      const double after_s = exposure_s - reference_s_;
      const Pose robot = scene_.path
                             ? scene_.path->at(reference.timestamp_s + after_s)
                             : reference.world_from_robot * Pose{rotation_exp(after_s * scene_.motion.angular_rad_s),
                                                                 after_s * scene_.motion.velocity_m_s};
      poses.push_back(reference_from_world * robot * scene_.rig.robot_from_camera);
    }
    return poses;
  }

 private:
  const sim::Scene& scene_;
  std::vector<double> exposures_s_;  // of a stack, from its beginning
  double reference_s_ = 0, interval_s_ = 0;
  size_t count_ = 0;
};

class Assessment {
 public:
  Assessment(const sim::Scene& scene, SensorView& view)
      : scene_(scene),
        view_(view),
        rig_(view.reduced_rig()),
        options_(reduced_options()),
        rays_(pixel_rays(rig_.camera)),
        front_end_(rig_, scene.patterns, options_.front_end()),
        views_(scene) {}

  const Views& views() const { return views_; }

  // Empty if `stop` returned true meanwhile.
  std::optional<AssessedView> observed(size_t number, const sim::Stop& stop) {
    const TimedPose pose = views_.at(number);
    std::optional<SensorView::Stack> taken = view_.stack(pose, stop);
    // Samples of a texture would be aliased where views are compared.
    const cv::Mat averaged = view_.image(pose.world_from_robot, std::nullopt, true, stop);
    if (!taken || averaged.empty()) return std::nullopt;
    AssessedView result{pose, std::move(taken->truth), {}, front_end_.reconstruct(taken->stack, {}).frame};
    Frame& frame = result.frame;
    averaged.convertTo(frame.texture, CV_8U, 255 / rig_.sensor.max_dn());
    for (int row = 0; row < frame.height(); ++row) {
      for (int col = 0; col < frame.width(); ++col) {
        const int mask = static_cast<int>(result.truth.mask(row, col));
        const bool measured = frame.valid(row, col) && (mask & kTruthSurface);
        const cv::Vec2f& ray = rays_(row, col);
        const float depth = result.truth.depth_m(row, col);
        const float nan = std::numeric_limits<float>::quiet_NaN();
        frame.points_m(row, col) = measured ? cv::Vec3f(depth * ray[0], depth * ray[1], depth) : cv::Vec3f::all(nan);
        frame.normals(row, col) =
            measured && !(mask & kTruthMixed) ? result.truth.normals(row, col) : cv::Vec3f::all(nan);
        if (!measured) frame.sigma_m(row, col) = nan;
      }
    }
    result.sigma_m = frame.sigma_m;
    return result;
  }

  ViewDifficulty judged(size_t number, const AssessedView& current, const AssessedView* before) const {
    ViewDifficulty result;
    result.view = number;
    result.time_s = current.pose.timestamp_s;
    judge_range(current, result);
    judge_depth(current, result);
    judge_speed(number, current, result);
    if (before) judge_motion(*before, current, result);
    return result;
  }

 private:
  // Notes a measure relative to its limit, and the reason from the limit on.
  static void note(ViewDifficulty& view, Hardship which, double strain, const std::function<std::string()>& reason) {
    const auto i = static_cast<size_t>(which);
    view.strain[i] = strain;
    if (!(strain < 1)) view.reason[i] = reason();
  }
  static double strain_of(double value, double least) { return value > 0 ? least / value : kInfinite; }

  void judge_range(const AssessedView& view, ViewDifficulty& result) const {
    const auto pixels = static_cast<double>(view.truth.mask.total());
    int surface = 0, lit = 0, near = 0, far = 0;
    for (int i = 0; i < static_cast<int>(view.truth.mask.total()); ++i) {
      const int mask = static_cast<int>(view.truth.mask(i));
      surface += (mask & kTruthSurface) != 0;
      if (!(mask & kTruthInBeam) || (mask & kTruthInShadow)) continue;
      const auto depth = static_cast<double>(view.truth.depth_m(i));
      ++lit;
      near += depth < rig_.near_m;
      far += depth > rig_.far_m;
    }
    result.lit = lit / pixels, result.near = near / pixels, result.far = far / pixels;
    result.in_range = (lit - near - far) / pixels;
    const double least = limits_.least_in_range;
    note(result, Hardship::range, strain_of(result.in_range, least), [&] {
      std::string why;
      if (result.far >= std::max(least, result.near))
        why = words("%.0f %% see surfaces beyond far_m, %.3g m", percent(result.far), rig_.far_m);
      else if (result.near >= least)
        why = words("%.0f %% see surfaces nearer than near_m, %.3g m", percent(result.near), rig_.near_m);
      else if (surface / pixels < least)
        why = words("only %.0f %% see a surface", percent(surface / pixels));
      else
        why = words("%.0f %% see surfaces in shadow or outside the beam", percent((surface - lit) / pixels));
      return words("only %.0f %% of the pixels are lit and in range: %s", percent(result.in_range), why.c_str());
    });
  }

  void judge_depth(const AssessedView& view, ViewDifficulty& result) const {
    std::vector<double> sigmas;
    for (const float sigma : view.sigma_m) {
      if (!std::isnan(sigma)) sigmas.push_back(static_cast<double>(sigma));
    }
    result.measured = static_cast<double>(sigmas.size()) / static_cast<double>(view.sigma_m.total());
    if (!sigmas.empty()) result.sigma_m = median_of(std::move(sigmas));
    note(result, Hardship::depth, strain_of(result.measured, limits_.least_measured),
         [&] { return words("only %.0f %% of the pixels yield a depth", percent(result.measured)); });
  }

  void judge_speed(size_t number, const AssessedView& view, ViewDifficulty& result) const {
    const Pinhole& camera = scene_.rig.camera;
    const std::vector<Pose> exposures = views_.reference_from_exposures(number);
    std::vector<Pose> inverse;
    for (const Pose& pose : exposures) inverse.push_back(pose.inverse());
    std::vector<double> steps;
    constexpr int kStride = 4;
    for (int row = 0; row < view.truth.depth_m.rows; row += kStride) {
      for (int col = 0; col < view.truth.depth_m.cols; col += kStride) {
        const auto depth = static_cast<double>(view.truth.depth_m(row, col));
        if (std::isnan(depth)) continue;
        const cv::Vec2f& ray = rays_(row, col);
        const Eigen::Vector3d point = depth * Eigen::Vector3d(ray[0], ray[1], 1);
        std::optional<Eigen::Vector2d> last;
        double largest = 0;
        for (const Pose& pose : inverse) {
          const Eigen::Vector3d seen = pose * point;
          if (!(seen.z() > 0)) break;
          const Eigen::Vector2d pixel = camera.project(seen);
          if (last) largest = std::max(largest, (pixel - *last).norm());
          last = pixel;
        }
        steps.push_back(largest);
      }
    }
    if (!steps.empty()) result.step_px = median_of(std::move(steps));
    const Timing& timing = scene_.rig.timing;
    note(result, Hardship::speed, result.step_px / limits_.most_step_px, [&] {
      return words(
          "the image moves by %.1f px from one image to the next at %.3g images/s; up to %.0f px are known to work",
          result.step_px, timing.camera_rate_hz, limits_.most_step_px);
    });
  }

  void judge_motion(const AssessedView& before, const AssessedView& current, ViewDifficulty& result) const {
    const Pose before_from_current = (before.pose.world_from_robot * rig_.robot_from_camera).inverse() *
                                     (current.pose.world_from_robot * rig_.robot_from_camera);
    Eigen::Vector3d centre = Eigen::Vector3d::Zero();
    double squares = 0;
    int points = 0;
    for (const cv::Vec3f& point : current.frame.points_m) {
      if (std::isnan(point[2])) continue;
      const Eigen::Vector3d there = before_from_current * vector_of(point);
      centre += there, squares += there.squaredNorm();
      ++points;
    }
    const double n = std::max(1, points);
    centre /= n;
    const double spread = std::sqrt(std::max(0.0, squares / n - centre.squaredNorm()));

    const cv::Mat1f sigma_before_m = sigma_before(before, current, before_from_current);
    const auto is_known = [](float sigma_m) { return !std::isnan(sigma_m); };
    result.overlap = static_cast<double>(std::count_if(sigma_before_m.begin(), sigma_before_m.end(), is_known)) / n;
    note(result, Hardship::overlap, strain_of(*result.overlap, limits_.least_overlap), [&] {
      return words("only %.0f %% of the points were measured by the view before", percent(*result.overlap));
    });
    judge_bound(information(current, sigma_before_m, before_from_current), before_from_current, centre, spread, result);

    if (*result.overlap < limits_.least_overlap) return;
    const AmbiguityReport report =
        find_alternatives(before.frame, current.frame, rig_.camera, before_from_current, options_.ambiguity);
    for (const AlternativePose& other : report.alternatives) {
      const double moved = (other.target_from_source * (before_from_current.inverse() * centre) - centre).norm();
      result.repeats_m = std::min(result.repeats_m.value_or(kInfinite), moved);
    }
    note(result, Hardship::repetition, result.repeats_m ? 1 : 0, [&] {
      return words("the views look alike elsewhere: a motion that differs by %.3g mm explains them as well",
                   1e3 * *result.repeats_m);
    });
  }

  // Depth sigmas with which the view before has measured the points, NaN where it has not, as seen from the current
  // view: n.d sigma_z is the same along the rays d of both. Pixels are compared with the 3 x 3 of the view before around
  // them, because a sample of pixels misses narrow surfaces.
  cv::Mat1f sigma_before(const AssessedView& before, const AssessedView& current,
                         const Pose& before_from_current) const {
    constexpr double kPixels = 2;  // of depth, the tolerance of occlusion
    const Pinhole& camera = rig_.camera;
    cv::Mat1f sigma_m(current.sigma_m.size(), std::numeric_limits<float>::quiet_NaN());
    const cv::Rect inside(0, 0, sigma_m.cols, sigma_m.rows);
    for_each_row(sigma_m.rows, [&](int row) {
      for (int col = 0; col < sigma_m.cols; ++col) {
        if (std::isnan(current.sigma_m(row, col))) continue;
        const Eigen::Vector3d there = before_from_current * vector_of(current.frame.points_m(row, col));
        if (!(there.z() > 0)) continue;
        const Eigen::Vector2d pixel = camera.project(there);
        if (!camera.contains(pixel)) continue;
        const cv::Point at(static_cast<int>(std::lround(pixel.x())), static_cast<int>(std::lround(pixel.y())));
        const cv::Rect around = cv::Rect(at.x - 1, at.y - 1, 3, 3) & inside;
        float farthest = 0, sum = 0;
        int measured = 0;
        for (int y = around.y; y < around.br().y; ++y) {
          for (int x = around.x; x < around.br().x; ++x) {
            farthest = std::max(farthest, before.truth.depth_m(y, x));  // NaN: no surface
            if (std::isnan(before.sigma_m(y, x))) continue;
            sum += before.sigma_m(y, x);
            ++measured;
          }
        }
        const double tolerance_m = kPixels * there.z() / std::min(camera.fx, camera.fy);
        if (measured == 0 || static_cast<double>(farthest) < there.z() - tolerance_m) continue;
        const cv::Vec2f& ray = rays_(row, col);
        const Eigen::Vector3d normal = vector_of(current.truth.normals(row, col));
        const double here = normal.dot(Eigen::Vector3d(ray[0], ray[1], 1)),
                     from_before = (before_from_current.rotation * normal).dot(there) / there.z();
        // Seen from behind.
        if (!(from_before < 0)) continue;
        sigma_m(row, col) = sum / static_cast<float>(measured) * static_cast<float>(from_before / here);
      }
    });
    return sigma_m;
  }

  // Fisher information of before_from_current for the full images: each point pairs with itself.
  Matrix6d information(const AssessedView& current, const cv::Mat1f& sigma_before_m,
                       const Pose& before_from_current) const {
    const Matrix6d at_identity =
        pose_information(current.truth, sigma_before_m, current.truth, current.sigma_m, rig_.camera, rays_, {});
    return rotated_covariance(before_from_current.rotation, kReduction * kReduction * at_identity);
  }

  void judge_bound(const Matrix6d& information, const Pose& before_from_current, const Eigen::Vector3d& centre,
                   double spread, ViewDifficulty& result) const {
    const ObservabilityOptions options;
    const std::vector<UnobservableDirection> free =
        unobservable_directions(information, before_from_current, centre, spread, options);
    // As in core/motion/observability.h: z = (s omega, u), the displacement of the scene.
    const double s = spread > 0 ? spread : 1;
    Matrix6d tangent_from_z = Matrix6d::Identity();
    tangent_from_z.topLeftCorner<3, 3>() /= s;
    tangent_from_z.bottomLeftCorner<3, 3>() = skew(centre - before_from_current.translation) / s;
    const double least = symmetric_eigen(Matrix6d(tangent_from_z.transpose() * information * tangent_from_z)).values[0];
    result.displacement_m = free.empty() && least > 0 ? 1 / std::sqrt(least) : kInfinite;
    if (free.empty() && least > 0) {
      // The motion of the robot, as in reports: T_robot = X T X^-1 with X = robot_from_camera.
      const Pose& x = rig_.robot_from_camera;
      const Eigen::Vector3d turned = x.rotation * before_from_current.rotation * x.rotation.transpose() * x.translation;
      Matrix6d robot_from_camera = rotated_tangent(x.rotation);
      robot_from_camera.bottomLeftCorner<3, 3>() = skew(turned) * x.rotation;
      const Matrix6d bound = robot_from_camera * inverse(information) * robot_from_camera.transpose();
      result.rotation_rad = bound.diagonal().head<3>().cwiseSqrt();
      result.translation_m = bound.diagonal().tail<3>().cwiseSqrt();
    }
    note(result, Hardship::motion, *result.displacement_m / options.max_displacement_sigma_m, [&] {
      std::string text = "depth does not determine the motion";
      for (size_t i = 0; i < free.size(); ++i) text += (i == 0 ? ": the view " : ", ") + to_string(free[i]);
      return text;
    });
  }

  const sim::Scene& scene_;
  SensorView& view_;
  const RigModel& rig_;
  DifficultyLimits limits_;
  PipelineOptions options_;
  PixelRays rays_;
  FringeFrontEnd front_end_;
  Views views_;
};

// Distance between the views that are assessed.
size_t step_of(size_t count, size_t most) { return std::max<size_t>(1, (count + most - 1) / most); }

}  // namespace

double ViewDifficulty::worst() const { return *std::max_element(strain.begin(), strain.end()); }

size_t view_count(const sim::Scene& scene) { return Views(scene).count(); }

size_t assessed_views(const sim::Scene& scene, size_t most) {
  const size_t count = view_count(scene), step = step_of(count, most);
  return (count + step - 1) / step;
}

void assess_difficulty(const sim::Scene& scene, SensorView& view, size_t most,
                       const std::function<void(ViewDifficulty)>& found, const sim::Stop& stop) {
  Assessment assessment(scene, view);
  const size_t count = assessment.views().count(), step = step_of(count, most);
  std::optional<std::pair<size_t, AssessedView>> last;
  for (size_t i = 0; i < count; i += step) {
    if (i > 0 && (!last || last->first != i - 1)) {
      std::optional<AssessedView> before = assessment.observed(i - 1, stop);
      if (!before) return;
      last.emplace(i - 1, std::move(*before));
    }
    std::optional<AssessedView> current = assessment.observed(i, stop);
    if (!current || (stop && stop())) return;
    found(assessment.judged(i, *current, i > 0 ? &last->second : nullptr));
    last.emplace(i, std::move(*current));
  }
}

}  // namespace fringeslam::tools
