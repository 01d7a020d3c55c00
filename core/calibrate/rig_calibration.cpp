// SPDX-License-Identifier: Apache-2.0
#include "core/calibrate/rig_calibration.h"

#include <ceres/ceres.h>
#include <ceres/rotation.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

#include "core/calibrate/initial_rig.h"
#include "core/calibrate/median.h"
#include "core/types/error.h"
#include "core/types/linear_algebra.h"

namespace fringeslam {

namespace {

constexpr const char* kNotFound = "the board was not found";
constexpr int kLens = 9;                      // fx fy cx cy k1 k2 p1 p2 k3
constexpr double kFirstCornerSigmaPx = 0.05;  // initial value, re-estimated from the residuals
constexpr double kLeastCornerSigmaPx = 0.003;
constexpr double kLeastProjectorSigmaPx = 0.01;  // lens distortion within a window, quantised pattern
constexpr double kRobustSigmas = 3;
const Eigen::Vector2d kNone = Eigen::Vector2d::Constant(std::numeric_limits<double>::quiet_NaN());

// Pinhole::project() of core/types/pinhole.h for automatic differentiation.
template <class T>
void project(const T* lens, const T* point, T* pixel) {
  const T x = point[0] / point[2], y = point[1] / point[2], r2 = x * x + y * y;
  const T radial = 1.0 + r2 * (lens[4] + r2 * (lens[5] + r2 * lens[8]));
  pixel[0] = lens[0] * (x * radial + 2.0 * lens[6] * x * y + lens[7] * (r2 + 2.0 * x * x)) + lens[2];
  pixel[1] = lens[1] * (y * radial + lens[6] * (r2 + 2.0 * y * y) + 2.0 * lens[7] * x * y) + lens[3];
}

// Transforms a point by a pose given as angle-axis and translation.
template <class T>
void transform(const T* pose, const T* point, T* result) {
  ceres::AngleAxisRotatePoint(pose, point, result);
  for (int i = 0; i < 3; ++i) result[i] += pose[3 + i];
}

// Whitened residual of a corner in the camera image.
struct CameraResidual {
  Eigen::Vector3d board;
  Eigen::Vector2d pixel;
  double sigma;

  template <class T>
  bool operator()(const T* lens, const T* camera_from_board, T* residual) const {
    const T corner[3] = {T(board.x()), T(board.y()), T(board.z())};
    T point[3], p[2];
    transform(camera_from_board, corner, point);
    project(lens, point, p);
    for (int i = 0; i < 2; ++i) residual[i] = (p[i] - pixel[i]) / sigma;
    return true;
  }
};

// Whitened residual of a corner in the projector image. The projector corner was transferred from the camera corner and
// inherits its error; subtracting the camera residual mapped by the local homography's Jacobian leaves only the error
// of the decoded coordinates. The two residuals together whiten the joint covariance of both errors.
struct ProjectorResidual {
  Eigen::Vector3d board;
  Eigen::Vector2d camera_pixel, projector_pixel, sigma;
  Eigen::Matrix2d projector_per_camera;

  template <class T>
  bool operator()(const T* camera, const T* projector, const T* projector_from_camera, const T* camera_from_board,
                  T* residual) const {
    const T corner[3] = {T(board.x()), T(board.y()), T(board.z())};
    T in_camera[3], in_projector[3], c[2], p[2];
    transform(camera_from_board, corner, in_camera);
    transform(projector_from_camera, in_camera, in_projector);
    project(camera, in_camera, c);
    project(projector, in_projector, p);
    const T off[2] = {c[0] - camera_pixel[0], c[1] - camera_pixel[1]};
    for (int i = 0; i < 2; ++i) {
      const T carried = projector_per_camera(i, 0) * off[0] + projector_per_camera(i, 1) * off[1];
      residual[i] = (p[i] - projector_pixel[i] - carried) / sigma[i];
    }
    return true;
  }
};

using Lens = std::array<double, kLens>;
using PoseVector = std::array<double, 6>;

Lens to_lens(const Pinhole& p) {
  const Distortion& d = p.distortion;
  return {p.fx, p.fy, p.cx, p.cy, d.k1, d.k2, d.p1, d.p2, d.k3};
}

Pinhole to_pinhole(const Lens& l, int width, int height) {
  return {width, height, l[0], l[1], l[2], l[3], {l[4], l[5], l[6], l[7], l[8]}};
}

PoseVector to_vector(const Pose& pose) {
  const Eigen::Vector3d r = rotation_log(pose.rotation), &t = pose.translation;
  return {r.x(), r.y(), r.z(), t.x(), t.y(), t.z()};
}

Pose to_pose(const PoseVector& v) { return {rotation_exp({v[0], v[1], v[2]}), {v[3], v[4], v[5]}}; }

// Bundle adjustment of both lenses, their relative pose and all board poses.
class Bundle {
 public:
  Bundle(const std::vector<BoardView>& views, const Board& board, const RigModel& rig,
         const RigCalibrationOptions& options)
      : views_(views), points_(board.points_m()), diameter_m_(board.diameter_m), rig_(rig), options_(options) {
    offsets_.assign(views.size(), std::vector<Eigen::Vector2d>(points_.size(), Eigen::Vector2d::Zero()));
    poses_.resize(views.size());
  }

  void start(const std::vector<size_t>& used) {
    std::vector<std::vector<cv::Point2f>> corners;
    for (const size_t v : used) corners.push_back(views_[v].corners_px);
    std::vector<Pose> poses;
    const Pinhole camera = initial_camera(corners, points_, {rig_.camera.width, rig_.camera.height}, poses);
    std::vector<Eigen::Vector3d> points;
    std::vector<Eigen::Vector2d> pixels;
    for (size_t i = 0; i < used.size(); ++i) {
      poses_[used[i]] = to_vector(poses[i]);
      for (size_t j = 0; j < points_.size(); ++j) {
        if (!views_[used[i]].homographies[j]) continue;  // nor is there one without a camera corner
        points.push_back(poses[i] * points_[j]);
        pixels.push_back(projector_corner(used[i], j));
      }
    }
    Pose relative;
    const Pinhole projector =
        initial_projector(points, pixels, {rig_.projector.width, rig_.projector.height}, relative);
    camera_ = to_lens(camera);
    projector_ = to_lens(projector);
    relative_ = to_vector(relative);
  }

  // Minimises over the used views; returns the covariance of lenses and relative pose, empty if it is singular.
  Eigen::MatrixXd refine(const std::vector<size_t>& used, bool with_covariance = true) {
    ceres::Problem problem;
    for (const size_t v : used) {
      for (size_t j = 0; j < points_.size(); ++j) {
        if (!is_seen(v, j)) continue;
        auto* seen = new CameraResidual{points_[j], camera_corner(v, j), corner_sigma_px_};
        problem.AddResidualBlock(new ceres::AutoDiffCostFunction<CameraResidual, 2, kLens, 6>(seen),
                                 new ceres::CauchyLoss(kRobustSigmas), camera_.data(), poses_[v].data());
        const auto& local = views_[v].homographies[j];
        if (!local) continue;
        auto* lit = new ProjectorResidual{points_[j], camera_corner(v, j), projector_corner(v, j),
                                          projector_sigma(*local), local->jacobian(camera_corner(v, j))};
        problem.AddResidualBlock(new ceres::AutoDiffCostFunction<ProjectorResidual, 2, kLens, kLens, 6, 6>(lit),
                                 new ceres::CauchyLoss(kRobustSigmas), camera_.data(), projector_.data(),
                                 relative_.data(), poses_[v].data());
      }
    }
    std::vector<int> fixed;
    for (int term = options_.radial_terms; term < 3; ++term) fixed.push_back(term == 0 ? 4 : term == 1 ? 5 : 8);
    if (!options_.tangential) fixed.insert(fixed.end(), {6, 7});
    for (Lens* lens : {&camera_, &projector_}) {
      for (const int index : fixed) (*lens)[static_cast<size_t>(index)] = 0;
      if (!fixed.empty()) problem.SetManifold(lens->data(), new ceres::SubsetManifold(kLens, fixed));
    }
    ceres::Solver::Options solver;
    solver.linear_solver_type = ceres::SPARSE_SCHUR;
    solver.max_num_iterations = 200;
    solver.function_tolerance = 1e-12;
    solver.logging_type = ceres::SILENT;
    ceres::Solver::Summary summary;
    ceres::Solve(solver, &problem, &summary);

    if (!with_covariance) return {};
    ceres::Covariance::Options covariance_options;
    covariance_options.algorithm_type = ceres::SPARSE_QR;
    ceres::Covariance covariance(covariance_options);
    const std::vector<const double*> blocks = {camera_.data(), projector_.data(), relative_.data()};
    if (!summary.IsSolutionUsable() || !covariance.Compute(blocks, &problem)) return {};
    Eigen::Matrix<double, 2 * kLens + 6, 2 * kLens + 6, Eigen::RowMajor> matrix;
    if (!covariance.GetCovarianceMatrix(blocks, matrix.data())) return {};
    return matrix;  // scaled by the sigmas of the last rescale()
  }

  // Re-estimates from the medians of the residuals the sigma of the camera corners and the factor on the sigmas of the
  // local homographies.
  void rescale(const std::vector<size_t>& used) {
    constexpr double kMedianOfTwo = 1.1774;  // of the norm of two standard normal numbers
    const Pinhole camera = camera_lens(), projector = projector_lens();
    std::vector<double> in_camera, in_projector;
    for (const size_t v : used) {
      const Pose camera_from_board = to_pose(poses_[v]);
      for (size_t j = 0; j < points_.size(); ++j) {
        if (!is_seen(v, j)) continue;
        const Eigen::Vector2d off = camera.project(camera_from_board * points_[j]) - camera_corner(v, j);
        in_camera.push_back(off.norm());
        const auto& local = views_[v].homographies[j];
        if (!local) continue;
        const Eigen::Vector2d lit =
            projector.project(relative() * (camera_from_board * points_[j])) - projector_corner(v, j);
        const Eigen::Vector2d rest = lit - local->jacobian(camera_corner(v, j)) * off;
        in_projector.push_back(rest.cwiseQuotient(projector_sigma(*local)).norm());
      }
    }
    corner_sigma_px_ = std::max(kLeastCornerSigmaPx, median(in_camera) / kMedianOfTwo);
    // Lower bound for the systematic errors within the windows.
    projector_factor_ = std::max(0.5, projector_factor_ * median(in_projector) / kMedianOfTwo);
  }

  // The centroid of a circle's image is not the image of its centre: subtracts the difference from the measured
  // centres.
  void correct_circles(const std::vector<size_t>& used) {
    if (diameter_m_ <= 0) return;
    for (const size_t v : used) {
      const Pose pose = to_pose(poses_[v]);
      for (size_t j = 0; j < points_.size(); ++j) offsets_[v][j] = -circle_bias(pose, points_[j]);
    }
  }

  ViewResult result(size_t v, bool used) const {
    ViewResult result;
    result.name = views_[v].name;
    result.used = used;
    result.camera_from_board = to_pose(poses_[v]);
    const Pinhole camera = camera_lens(), projector = projector_lens();
    const Pose projector_from_board = to_pose(relative_) * result.camera_from_board;
    double camera_squares = 0, projector_squares = 0;
    int lit = 0, seen = 0;
    for (size_t j = 0; j < points_.size(); ++j) {
      result.camera_px.push_back(camera_corner(v, j));
      result.camera_residual_px.push_back(result.camera_px[j] - camera.project(result.camera_from_board * points_[j]));
      if (is_seen(v, j)) {
        camera_squares += result.camera_residual_px[j].squaredNorm();
        ++seen;
      }
      const bool known = views_[v].homographies[j].has_value();
      result.projector_px.push_back(known ? projector_corner(v, j) : kNone);
      result.projector_residual_px.push_back(
          known ? Eigen::Vector2d(result.projector_px[j] - projector.project(projector_from_board * points_[j]))
                : kNone);
      if (!known) continue;
      projector_squares += result.projector_residual_px[j].squaredNorm();
      ++lit;
    }
    result.camera_rms_px = std::sqrt(camera_squares / std::max(1, seen));
    result.projector_rms_px = std::sqrt(projector_squares / std::max(1, lit));
    return result;
  }

  Pinhole camera_lens() const { return to_pinhole(camera_, rig_.camera.width, rig_.camera.height); }
  Pinhole projector_lens() const { return to_pinhole(projector_, rig_.projector.width, rig_.projector.height); }
  Pose relative() const { return to_pose(relative_); }
  // Lenses and relative pose in the order of the covariance.
  Eigen::VectorXd parameters() const {
    Eigen::VectorXd all(2 * kLens + 6);
    all << Eigen::Map<const Eigen::Matrix<double, kLens, 1>>(camera_.data()),
        Eigen::Map<const Eigen::Matrix<double, kLens, 1>>(projector_.data()),
        Eigen::Map<const Vector6d>(relative_.data());
    return all;
  }

  // Triangulates a board from its corners and projector columns and compares it with its plan.
  HeldOutBoard measure(size_t v) const;

  Pose board_pose(size_t v) const { return to_pose(poses_[v]); }

 private:
  bool is_seen(size_t v, size_t j) const { return !std::isnan(views_[v].corners_px[j].x); }
  Eigen::Vector2d camera_corner(size_t v, size_t j) const {
    const cv::Point2f& corner = views_[v].corners_px[j];
    return Eigen::Vector2d(corner.x, corner.y) + offsets_[v][j];
  }
  Eigen::Vector2d projector_corner(size_t v, size_t j) const {
    return (*views_[v].homographies[j])(camera_corner(v, j));
  }

  Eigen::Vector2d projector_sigma(const LocalHomography& local) const {
    return projector_factor_ * local.sigma_px.cwiseMax(kLeastProjectorSigmaPx);
  }

  Eigen::Vector2d circle_bias(const Pose& camera_from_board, const Eigen::Vector3d& centre) const {
    constexpr int kCorners = 64;
    const Pinhole camera = camera_lens();
    std::vector<Eigen::Vector2d> rim;
    for (int i = 0; i < kCorners; ++i) {
      const double angle = 2 * std::numbers::pi * i / kCorners;
      const Eigen::Vector3d point = centre + 0.5 * diameter_m_ * Eigen::Vector3d(std::cos(angle), std::sin(angle), 0);
      rim.push_back(camera.project(camera_from_board * point));
    }
    // Centroid of the polygon.
    const Eigen::Vector2d middle = camera.project(camera_from_board * centre);
    double area = 0;
    Eigen::Vector2d sum = Eigen::Vector2d::Zero();
    for (int i = 0; i < kCorners; ++i) {
      const Eigen::Vector2d a = rim[static_cast<size_t>(i)] - middle,
                            b = rim[static_cast<size_t>((i + 1) % kCorners)] - middle;
      const double cross = a.x() * b.y() - a.y() * b.x();
      area += cross;
      sum += cross * (a + b) / 3;
    }
    return sum / area;
  }

  const std::vector<BoardView>& views_;
  std::vector<Eigen::Vector3d> points_;
  double diameter_m_;
  RigModel rig_;
  RigCalibrationOptions options_;
  std::vector<std::vector<Eigen::Vector2d>> offsets_;
  double corner_sigma_px_ = kFirstCornerSigmaPx, projector_factor_ = 1;
  Lens camera_{}, projector_{};
  PoseVector relative_{};
  std::vector<PoseVector> poses_;
};

// Intersects the ray of a camera pixel with the surface of constant projector column.
Eigen::Vector3d triangulated(const Pinhole& camera, const Pinhole& projector, const Pose& projector_from_camera,
                             const Eigen::Vector2d& camera_px, const Eigen::Vector2d& projector_px) {
  const Eigen::Vector2d ray = camera.undistort(camera_px), lit = projector.undistort(projector_px);
  const Eigen::Vector3d d = projector_from_camera.rotation * Eigen::Vector3d(ray.x(), ray.y(), 1);
  const Eigen::Vector3d& t = projector_from_camera.translation;
  const double z = (lit.x() * t.z() - t.x()) / (d.x() - lit.x() * d.z());
  return z * Eigen::Vector3d(ray.x(), ray.y(), 1);
}

HeldOutBoard Bundle::measure(size_t v) const {
  const Pinhole camera = camera_lens(), projector = projector_lens();
  std::vector<Eigen::Vector3d> measured, planned;
  for (size_t j = 0; j < points_.size(); ++j) {
    if (!views_[v].homographies[j]) continue;
    measured.push_back(triangulated(camera, projector, relative(), camera_corner(v, j), projector_corner(v, j)));
    planned.push_back(points_[j]);
  }
  HeldOutBoard board;
  board.name = views_[v].name;
  const auto count = static_cast<double>(measured.size());
  Eigen::Vector3d center = Eigen::Vector3d::Zero(), planned_center = center;
  for (size_t i = 0; i < measured.size(); ++i) center += measured[i] / count, planned_center += planned[i] / count;
  Eigen::Matrix3d spread = Eigen::Matrix3d::Zero();
  double measured_squares = 0, planned_squares = 0;
  for (size_t i = 0; i < measured.size(); ++i) {
    spread += (measured[i] - center) * (measured[i] - center).transpose() / count;
    measured_squares += (measured[i] - center).squaredNorm();
    planned_squares += (planned[i] - planned_center).squaredNorm();
  }
  board.plane_rms_m = std::sqrt(std::max(0.0, symmetric_eigen(spread).values[0]));
  board.scale_error = std::sqrt(measured_squares / planned_squares) - 1;
  return board;
}

// Covariance of the parameters by leaving out one view at a time, from the changes of the parameters.
Eigen::MatrixXd jackknife_covariance(const std::vector<HeldOutBoard>& held_out) {
  const auto n = static_cast<double>(held_out.size());
  Eigen::VectorXd mean = Eigen::VectorXd::Zero(held_out[0].change.size());
  for (const HeldOutBoard& board : held_out) mean += board.change / n;
  Eigen::MatrixXd covariance = Eigen::MatrixXd::Zero(mean.size(), mean.size());
  for (const HeldOutBoard& board : held_out)
    covariance += (n - 1) / n * (board.change - mean) * (board.change - mean).transpose();
  return covariance;
}

// Upper 97.5 % quantile of chi-square per degree of freedom (Wilson and Hilferty 1931).
double upper_chi_square_per_dof(double dof) {
  constexpr double kNormal = 1.96;
  const double spread = 2 / (9 * dof);
  return std::pow(1 - spread + kNormal * std::sqrt(spread), 3);
}

// Widens the covariance of independent corners by the disagreement of the views: errors of a view's corners have common
// causes, such as a bent board, an imperfect lens model or blur, which do not average over its corners. All parameters
// share one factor, which is estimated well; a parameter that disagrees significantly more is widened on its own.
void widen_covariance(RigCalibration& calibration) {
  Eigen::MatrixXd& covariance = calibration.covariance;
  const Eigen::MatrixXd jackknife = jackknife_covariance(calibration.held_out);
  std::vector<Eigen::Index> estimated;
  for (Eigen::Index i = 0; i < covariance.rows(); ++i) {
    if (covariance(i, i) > 0) estimated.push_back(i);
  }
  std::vector<double> ratios;
  for (const Eigen::Index i : estimated) ratios.push_back(jackknife(i, i) / covariance(i, i));
  const double squared = median(ratios);
  calibration.covariance_factor = std::sqrt(std::max(1.0, squared));
  covariance *= std::max(1.0, squared);
  const double limit = upper_chi_square_per_dof(static_cast<double>(calibration.held_out.size()) - 1);
  for (const Eigen::Index i : estimated) {
    const double ratio = jackknife(i, i) / covariance(i, i);
    if (ratio <= limit) continue;
    covariance.row(i) *= std::sqrt(ratio);
    covariance.col(i) *= std::sqrt(ratio);
  }
}

// Share of the cells of an 8 x 8 grid over an image that contain one of the points.
double coverage_of(const std::vector<ViewResult>& views, std::vector<Eigen::Vector2d> ViewResult::*points,
                   const Pinhole& device) {
  constexpr int kCells = 8;
  std::array<bool, kCells * kCells> seen{};
  for (const ViewResult& view : views) {
    if (!view.used) continue;
    for (const Eigen::Vector2d& p : view.*points) {
      if (!device.contains(p)) continue;
      const int col = static_cast<int>((p.x() + 0.5) / device.width * kCells),
                row = static_cast<int>((p.y() + 0.5) / device.height * kCells);
      seen[static_cast<size_t>(row * kCells + col)] = true;
    }
  }
  return static_cast<double>(std::count(seen.begin(), seen.end(), true)) / (kCells * kCells);
}

std::string rounded(double value, int decimals) {
  char text[40];
  std::snprintf(text, sizeof text, "%.*f", decimals, value);
  return text;
}

void add_warnings(RigCalibration& calibration, double widest_tilt_deg) {
  std::vector<std::string>& warnings = calibration.warnings;
  const auto all = calibration.views.size();
  size_t used = 0, missing = 0, larger = 0;
  for (const ViewResult& view : calibration.views) {
    used += view.used;
    missing += view.reason == kNotFound;
    larger += view.continues;
  }
  if (missing > 0 && 4 * missing >= all)
    warnings.push_back("the board was not found in " + std::to_string(missing) + " of " + std::to_string(all) +
                       " views; check its number of columns and rows, and that it is completely visible");
  if (2 * larger >= used)
    warnings.push_back("the board's crossings continue beyond the described columns and rows in " +
                       std::to_string(larger) + " of " + std::to_string(used) +
                       " views; count its inner corners again");
  constexpr size_t kFewViews = 6;
  if (used < kFewViews)
    warnings.push_back("only " + std::to_string(used) +
                       " views are used; 10 to 15 are recommended, and the sigmas are themselves uncertain");
  constexpr double kLeastTilt = 25;
  if (widest_tilt_deg < kLeastTilt)
    warnings.push_back("the boards are tilted against each other by at most " + rounded(widest_tilt_deg, 0) +
                       " degrees; tilt them by 20 to 40 degrees in several directions");
  for (const bool camera : {true, false}) {
    const Pinhole& lens = camera ? calibration.rig.camera : calibration.rig.projector;
    const LensSigmas& sigma = camera ? calibration.camera_sigma : calibration.projector_sigma;
    const std::string device = camera ? "camera" : "projector";
    constexpr double kLeastCoverage = 0.35;
    const double coverage = camera ? calibration.camera_coverage : calibration.projector_coverage;
    if (coverage < kLeastCoverage)
      warnings.push_back("the corners cover " + rounded(100 * coverage, 0) + " % of the " + device +
                         "'s image; the lens is extrapolated elsewhere: show the board in all parts of the image");
    constexpr double kAspect = 0.05;
    if (std::abs(lens.fx / lens.fy - 1) > kAspect)
      warnings.push_back("the " + device + "'s fx and fy differ by " +
                         rounded(100 * std::abs(lens.fx / lens.fy - 1), 0) + " %; check " +
                         (camera ? "that its pixels are not square" : "projector width_px and height_px"));
    if (lens.cx < 0 || lens.cx > lens.width)
      warnings.push_back("the " + device + "'s principal point lies beside the image (cx = " + rounded(lens.cx, 0) +
                         " px); check the size of its image and the sign of the fringes");
    constexpr double kFocal = 0.003;
    const double relative = std::max(sigma.fx / lens.fx, sigma.fy / lens.fy);
    if (relative > kFocal)
      warnings.push_back("the " + device + "'s focal length is known to " + rounded(100 * relative, 1) +
                         " % only; add tilted views");
  }
}

std::string rejection_reason(const BoardView& view, size_t corners) {
  if (view.corners_px.size() != corners) return kNotFound;
  const auto lit =
      std::count_if(view.homographies.begin(), view.homographies.end(), [](const auto& h) { return h.has_value(); });
  const auto seen = std::count_if(view.corners_px.begin(), view.corners_px.end(),
                                  [](const cv::Point2f& c) { return !std::isnan(c.x); });
  const size_t wanted = std::max<size_t>(6, static_cast<size_t>(seen) / 2);
  if (static_cast<size_t>(lit) < wanted)
    return "only " + std::to_string(lit) + " of " + std::to_string(corners) + " corners have projector coordinates";
  return {};
}

std::string list_of(const std::vector<ViewResult>& views) {
  std::string text;
  for (const ViewResult& view : views) {
    if (!view.reason.empty()) text += (text.empty() ? " (" : "; ") + view.name + ": " + view.reason;
  }
  return text.empty() ? "" : text + ")";
}

// Returns the largest angle between two boards. Focal lengths follow from foreshortening, so parallel boards do not
// determine them; throws Error.
double check_tilts(const Bundle& bundle, const std::vector<size_t>& used) {
  double widest = 0;
  for (const size_t a : used) {
    for (const size_t b : used)
      widest = std::max(
          widest, std::acos(std::clamp(bundle.board_pose(a).rotation.col(2).dot(bundle.board_pose(b).rotation.col(2)),
                                       -1.0, 1.0)));
  }
  constexpr double kLeastDegrees = 8;
  const double degrees = widest * 180 / std::numbers::pi;
  if (degrees < kLeastDegrees)
    throw Error(
        "the boards of all views are parallel to within " + std::to_string(static_cast<int>(std::ceil(degrees))) +
        " degrees and do not determine the focal lengths; tilt the board by 20 to 40 degrees in several directions");
  return degrees;
}

LensSigmas lens_sigmas(const Eigen::MatrixXd& covariance, int first) {
  const Eigen::VectorXd s = covariance.diagonal().segment(first, kLens).cwiseMax(0).cwiseSqrt();
  return {s(0), s(1), s(2), s(3), {s(4), s(5), s(6), s(7), s(8)}};
}

void check_determined(const RigCalibration& calibration, double max_focal_sigma) {
  const auto check = [&](const std::string& device, const Pinhole& lens, const LensSigmas& sigma) {
    const double relative = std::max(sigma.fx / lens.fx, sigma.fy / lens.fy);
    if (relative <= max_focal_sigma) return;
    throw Error(
        "the views determine the " + device + "'s focal length only to " + rounded(std::ceil(100 * relative), 0) +
        " %; add views with the board tilted by 20 to 40 degrees in several directions and at several distances");
  };
  check("camera", calibration.rig.camera, calibration.camera_sigma);
  check("projector", calibration.rig.projector, calibration.projector_sigma);
}

}  // namespace

BoardView observe_board(const std::string& name, const cv::Mat1f& texture, const ProjectorCoordinates& coordinates,
                        const Board& board, const RigCalibrationOptions& options) {
  BoardView view{name, detect_board(texture, board), {}};
  if (view.corners_px.empty()) return view;
  view.continues = continues_beyond(texture, board, view.corners_px);
  const auto columns = static_cast<size_t>(board.columns);
  double spacing_px = 0;
  for (size_t j = 0; j < view.corners_px.size(); ++j) {
    const cv::Point2f& corner = view.corners_px[j];
    const size_t beside = j % columns + 1 < columns ? j + 1 : j - 1;
    const double distance = cv::norm(view.corners_px[beside] - corner);
    if (distance > 0) spacing_px = distance;  // of the last pair, where one of the two was not found
    if (std::isnan(corner.x) || spacing_px == 0) {
      view.homographies.emplace_back();
      continue;
    }
    const double radius = std::clamp(options.window * spacing_px, 3.0, options.max_window_px);
    view.homographies.push_back(local_homography(coordinates, {corner.x, corner.y}, radius));
  }
  return view;
}

RigCalibration calibrate_rig(const std::vector<BoardView>& views, const Board& board, const RigModel& rig,
                             const RigCalibrationOptions& options) {
  check_options(options, "calibration");
  RigCalibration calibration;
  std::vector<size_t> used;
  for (size_t v = 0; v < views.size(); ++v) {
    ViewResult& view = calibration.views.emplace_back();
    view.name = views[v].name;
    view.reason = rejection_reason(views[v], static_cast<size_t>(board.corners()));
    if (view.reason.empty()) used.push_back(v);
  }
  Bundle bundle(views, board, rig, options);
  bool started = false;
  double widest_tilt_deg = 0;
  while (true) {
    if (static_cast<int>(used.size()) < options.min_views)
      throw Error(std::to_string(used.size()) + " of " + std::to_string(views.size()) + " views are usable; at least " +
                  std::to_string(options.min_views) + " are required, 10 to 15 are recommended" +
                  list_of(calibration.views));
    if (!started) bundle.start(used);
    started = true;
    widest_tilt_deg = check_tilts(bundle, used);
    // The sigmas and the circles' perspective bias are estimated from a first solution.
    bundle.refine(used);
    bundle.correct_circles(used);
    bundle.rescale(used);
    calibration.covariance = bundle.refine(used);
    if (calibration.covariance.size() == 0)
      throw Error(
          "the views do not determine all lens parameters; add views with the board tilted by 20 to 40 degrees in "
          "several directions, or estimate fewer distortion terms");
    std::vector<double> sizes;
    for (const size_t v : used) {
      calibration.views[v] = bundle.result(v, true);
      sizes.push_back(std::max(calibration.views[v].camera_rms_px, calibration.views[v].projector_rms_px));
    }
    // Rejects the worst view if it is an outlier among the views or exceeds the limit, and estimates again.
    const size_t worst = static_cast<size_t>(std::max_element(sizes.begin(), sizes.end()) - sizes.begin());
    const double typical = median(sizes);
    const bool out_of_line = sizes[worst] > std::max(3 * typical, 0.25);
    if (!out_of_line && sizes[worst] <= options.max_reprojection_px) break;
    ViewResult& view = calibration.views[used[worst]];
    char reason[160];
    std::snprintf(reason, sizeof reason, "reprojection error %.2f px in the %s; median of the views %.2f px",
                  sizes[worst], view.camera_rms_px > view.projector_rms_px ? "camera" : "projector", typical);
    view.used = false;
    view.reason = reason;
    used.erase(used.begin() + static_cast<std::ptrdiff_t>(worst));
    started = false;
  }

  calibration.rig = rig;
  calibration.rig.calibrated = true;
  calibration.rig.camera = bundle.camera_lens();
  calibration.rig.projector = bundle.projector_lens();
  calibration.rig.projector_from_camera = bundle.relative();
  for (const size_t v : used) {
    calibration.views[v].continues = views[v].continues;
    Bundle others = bundle;
    std::vector<size_t> rest = used;
    std::erase(rest, v);
    others.refine(rest, false);
    calibration.held_out.push_back(others.measure(v));
    calibration.held_out.back().change = others.parameters() - bundle.parameters();
  }
  widen_covariance(calibration);
  calibration.camera_sigma = lens_sigmas(calibration.covariance, 0);
  calibration.projector_sigma = lens_sigmas(calibration.covariance, kLens);
  check_determined(calibration, options.max_focal_sigma);
  calibration.rotation_sigma_rad = calibration.covariance.diagonal().segment<3>(2 * kLens).cwiseSqrt();
  calibration.translation_sigma_m = calibration.covariance.diagonal().segment<3>(2 * kLens + 3).cwiseSqrt();
  double camera_squares = 0, projector_squares = 0;
  for (const size_t v : used) {
    camera_squares += std::pow(calibration.views[v].camera_rms_px, 2);
    projector_squares += std::pow(calibration.views[v].projector_rms_px, 2);
  }
  calibration.camera_rms_px = std::sqrt(camera_squares / static_cast<double>(used.size()));
  calibration.projector_rms_px = std::sqrt(projector_squares / static_cast<double>(used.size()));
  calibration.camera_coverage = coverage_of(calibration.views, &ViewResult::camera_px, calibration.rig.camera);
  calibration.projector_coverage = coverage_of(calibration.views, &ViewResult::projector_px, calibration.rig.projector);
  add_warnings(calibration, widest_tilt_deg);
  return calibration;
}

}  // namespace fringeslam
