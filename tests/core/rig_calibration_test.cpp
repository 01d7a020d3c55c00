// SPDX-License-Identifier: Apache-2.0
#include "core/calibrate/rig_calibration.h"

#include <gmock/gmock.h>

#include <cmath>
#include <numbers>
#include <opencv2/aruco/charuco.hpp>
#include <opencv2/imgproc.hpp>

#include "core/calibrate/initial_rig.h"
#include "tests/support/matchers.h"
#include "tests/support/random.h"

namespace fringeslam {
namespace {

using support::error_of;
using support::PoseNear;
using support::Random;
using testing::HasSubstr;

RigModel true_rig() {
  RigModel rig;
  rig.camera = {1280, 1024, 1750, 1748, 645, 530, {-0.11, 0.08, 0.0004, -0.0003, 0}};
  // Projectors project upwards: their principal point lies near the lower edge of the image or beyond it.
  rig.projector = {1024, 768, 1900, 1905, 505, 1.1 * 768, {0.03, -0.02, 0.0002, 0.0003, 0}};
  rig.projector_from_camera = pose_from({{-180, 130, 25}, {-7, 11, 1}});
  return rig;
}

Board board() { return {BoardKind::checkerboard, 9, 7, 0.02, 0}; }

std::vector<Pose> board_poses(int count, double tilt_deg, Random& random) {
  std::vector<Pose> poses;
  for (int i = 0; i < count; ++i) {
    const double azimuth = 2.4 * i, tilt = tilt_deg * random.uniform(0.5, 1);
    poses.push_back(pose_from({{random.uniform(-90, 90), random.uniform(-60, 60), 800 + 500.0 * (i % 7) / 6},
                               {tilt * std::cos(azimuth), tilt * std::sin(azimuth), random.uniform(-20, 20)}}));
  }
  return poses;
}

// Projector coordinates of the pixels around the corners of a board at a pose, as a decoder would return them.
ProjectorCoordinates coordinates_of(const RigModel& rig, const Pose& camera_from_board) {
  const cv::Size size(rig.camera.width, rig.camera.height);
  ProjectorCoordinates result;
  for (cv::Mat1f* image : {&result.column_px, &result.row_px}) *image = cv::Mat1f(size, std::nanf(""));
  for (cv::Mat1f* image : {&result.column_sigma_px, &result.row_sigma_px}) *image = cv::Mat1f(size, 0.03f);
  const Eigen::Vector3d normal = camera_from_board.rotation.col(2);
  const double offset = normal.dot(camera_from_board.translation);
  for (const Eigen::Vector3d& corner : board().points_m()) {
    const Eigen::Vector2d centre = rig.camera.project(camera_from_board * corner);
    for (int y = static_cast<int>(centre.y()) - 8; y <= centre.y() + 8; ++y) {
      for (int x = static_cast<int>(centre.x()) - 8; x <= centre.x() + 8; ++x) {
        if (x < 0 || y < 0 || x >= size.width || y >= size.height) continue;
        const Eigen::Vector2d xy = rig.camera.undistort({x, y});
        const Eigen::Vector3d ray(xy.x(), xy.y(), 1);
        const Eigen::Vector2d p = rig.projector.project(rig.projector_from_camera * (ray * (offset / normal.dot(ray))));
        result.column_px(y, x) = static_cast<float>(p.x());
        result.row_px(y, x) = static_cast<float>(p.y());
      }
    }
  }
  return result;
}

BoardView view_of(const RigModel& rig, const Pose& camera_from_board, const std::string& name, double noise_px,
                  Random& random) {
  BoardView view{name, {}, {}};
  const ProjectorCoordinates coordinates = coordinates_of(rig, camera_from_board);
  for (const Eigen::Vector3d& corner : board().points_m()) {
    const Eigen::Vector2d p = rig.camera.project(camera_from_board * corner) + noise_px * random.normals<2>();
    view.corners_px.emplace_back(static_cast<float>(p.x()), static_cast<float>(p.y()));
    view.homographies.push_back(local_homography(coordinates, p, 6));
  }
  return view;
}

std::vector<BoardView> views_of(const RigModel& rig, const std::vector<Pose>& poses, double noise_px, Random& random) {
  std::vector<BoardView> views;
  for (size_t i = 0; i < poses.size(); ++i)
    views.push_back(view_of(rig, poses[i], "view " + std::to_string(i), noise_px, random));
  return views;
}

TEST(LocalHomography, CarriesCornersOverThroughDistortedLenses) {
  const RigModel rig = true_rig();
  const Pose pose = pose_from({{20, -10, 900}, {20, -25, 8}});
  const ProjectorCoordinates coordinates = coordinates_of(rig, pose);
  for (const Eigen::Vector3d& corner : board().points_m()) {
    const Eigen::Vector2d pixel = rig.camera.project(pose * corner);
    const auto local = local_homography(coordinates, pixel, 7);
    ASSERT_TRUE(local);
    EXPECT_LT(((*local)(pixel)-rig.projector.project(rig.projector_from_camera * (pose * corner))).norm(), 1e-3);
    const double h = 1e-4;
    for (int axis = 0; axis < 2; ++axis) {
      const Eigen::Vector2d step = h * Eigen::Vector2d::Unit(axis);
      const Eigen::Vector2d slope = ((*local)(pixel + step) - (*local)(pixel - step)) / (2 * h);
      EXPECT_LT((local->jacobian(pixel).col(axis) - slope).norm(), 1e-5);
    }
  }
}

TEST(LocalHomography, WithstandsOutliersAndRefusesOneSidedWindows) {
  const RigModel rig = true_rig();
  const Pose pose = pose_from({{0, 0, 900}, {10, -15, 0}});
  const Eigen::Vector3d corner = board().points_m()[31];
  const Eigen::Vector2d pixel = rig.camera.project(pose * corner);
  const Eigen::Vector2d truth = rig.projector.project(rig.projector_from_camera * (pose * corner));
  ProjectorCoordinates coordinates = coordinates_of(rig, pose);
  for (int i = 0; i < static_cast<int>(coordinates.column_px.total()); i += 4)
    coordinates.column_px(i / 1280, i % 1280) += 16;
  const auto local = local_homography(coordinates, pixel, 7);
  ASSERT_TRUE(local);
  EXPECT_LT(((*local)(pixel)-truth).norm(), 0.01);
  // No coordinates to the right of the corner.
  coordinates.column_px.colRange(static_cast<int>(pixel.x()), 1280).setTo(std::nanf(""));
  EXPECT_FALSE(local_homography(coordinates, pixel, 7));
}

TEST(InitialProjector, IsExactWhereverThePrincipalPointLies) {
  const RigModel rig = true_rig();
  Pinhole plain = rig.projector;
  plain.distortion = {};
  std::vector<Eigen::Vector3d> points;
  std::vector<Eigen::Vector2d> pixels;
  Random random(2);
  for (const Pose& pose : board_poses(4, 30, random)) {
    for (const Eigen::Vector3d& corner : board().points_m()) {
      points.push_back(pose * corner);
      pixels.push_back(plain.project(rig.projector_from_camera * points.back()));
    }
  }
  Pose relative;
  const Pinhole found = initial_projector(points, pixels, {1024, 768}, relative);
  EXPECT_NEAR(found.fx, 1900, 1e-4);
  EXPECT_NEAR(found.fy, 1905, 1e-4);
  EXPECT_NEAR(found.cy, 1.1 * 768, 1e-4);
  EXPECT_THAT(relative, PoseNear(rig.projector_from_camera, 1e-7, 1e-7));
  for (Eigen::Vector2d& pixel : pixels) pixel.x() = 1023 - pixel.x();
  EXPECT_THAT(error_of([&] { initial_projector(points, pixels, {1024, 768}, relative); }), HasSubstr("mirrored"));
  points.resize(63);
  pixels.resize(63);
  EXPECT_THAT(error_of([&] {
                initial_projector(points, pixels, {1024, 768}, relative);
              }),
              HasSubstr("lie in one plane"));
}

TEST(CalibrateRig, ExactCornersGiveTheRig) {
  const RigModel rig = true_rig();
  Random random(3);
  RigModel unknown = rig;  // the given lenses and relative pose must be ignored
  unknown.camera.fx = unknown.camera.fy = unknown.projector.fx = unknown.projector.fy = 1000;
  unknown.camera.distortion = unknown.projector.distortion = {};
  unknown.projector_from_camera = {};
  unknown.calibrated = false;
  const RigCalibration result =
      calibrate_rig(views_of(rig, board_poses(12, 35, random), 0, random), board(), unknown, {});
  EXPECT_TRUE(result.rig.calibrated);
  EXPECT_NEAR(result.rig.camera.fx, rig.camera.fx, 0.02);
  EXPECT_NEAR(result.rig.camera.distortion.k1, rig.camera.distortion.k1, 2e-4);
  EXPECT_NEAR(result.rig.projector.fy, rig.projector.fy, 0.05);
  EXPECT_NEAR(result.rig.projector.cy, rig.projector.cy, 0.1);
  EXPECT_THAT(result.rig.projector_from_camera, PoseNear(rig.projector_from_camera, 2e-5, 5e-5));
  EXPECT_LT(result.camera_rms_px, 1e-3);
  EXPECT_LT(result.projector_rms_px, 3e-3);
}

TEST(CalibrateRig, ErrorsStayWithinTheCovariance) {
  const RigModel rig = true_rig();
  Random random(4);
  constexpr int kTrials = 12;
  double focal = 0, baseline = 0;
  for (int trial = 0; trial < kTrials; ++trial) {
    const RigCalibration result =
        calibrate_rig(views_of(rig, board_poses(10, 35, random), 0.05, random), board(), rig, {});
    EXPECT_NEAR(result.camera_rms_px, 0.05 * std::sqrt(2.0), 0.01);
    focal += std::pow((result.rig.camera.fx - rig.camera.fx) / result.camera_sigma.fx, 2) / kTrials;
    const Eigen::Vector3d off = result.rig.projector_from_camera.translation - rig.projector_from_camera.translation;
    baseline += off.cwiseQuotient(result.translation_sigma_m).squaredNorm() / (3 * kTrials);
  }
  // Mean of 12 chi-squares with one degree of freedom: expectation 1, standard deviation 0.41.
  EXPECT_GT(focal, 0.15);
  EXPECT_LT(focal, 2.5);
  EXPECT_GT(baseline, 0.15);
  EXPECT_LT(baseline, 2.5);
}

// Views of a projector that drifts by 0.5 px from one to the next.
std::vector<BoardView> drifting_views(const RigModel& rig, Random& random) {
  std::vector<BoardView> views;
  for (const Pose& pose : board_poses(10, 35, random)) {
    RigModel drifted = rig;
    drifted.projector.cx += 0.5 * random.normal();
    drifted.projector.cy += 0.5 * random.normal();
    views.push_back(view_of(drifted, pose, "view", 0.02, random));
  }
  return views;
}

// Errors that all corners of a view share, here by a drift, do not average over the corners. The sigmas must show it.
TEST(CalibrateRig, CommonErrorsOfAViewWidenTheCovariance) {
  const RigModel rig = true_rig();
  Random random(6);
  constexpr int kTrials = 10;
  RigCalibrationOptions any;
  any.max_focal_sigma = 1;
  double narrow = 0, wide = 0, factor = 0;
  for (int trial = 0; trial < kTrials; ++trial) {
    const RigCalibration result = calibrate_rig(drifting_views(rig, random), board(), rig, any);
    const Pinhole &found = result.rig.projector, &truth = rig.projector;
    const double error = std::pow((found.fx - truth.fx) / result.projector_sigma.fx, 2) +
                         std::pow((found.cx - truth.cx) / result.projector_sigma.cx, 2) +
                         std::pow((found.cy - truth.cy) / result.projector_sigma.cy, 2);
    wide += error / (3 * kTrials);
    narrow += error * std::pow(result.covariance_factor, 2) / (3 * kTrials);
    factor += result.covariance_factor / kTrials;
  }
  EXPECT_GT(factor, 1.5);
  EXPECT_GT(narrow, 3);
  EXPECT_LT(wide, 2.5);
}

// The sigma that decides is the reported one, which contains the disagreement of the views.
TEST(CalibrateRig, TheReportedSigmaOfTheFocalLengthIsLimited) {
  const RigModel rig = true_rig();
  Random random(6);
  const std::vector<BoardView> views = drifting_views(rig, random);
  RigCalibrationOptions options;
  options.max_focal_sigma = 1;
  const RigCalibration result = calibrate_rig(views, board(), rig, options);
  ASSERT_GT(result.covariance_factor, 1.1);
  const Pinhole &camera = result.rig.camera, &projector = result.rig.projector;
  options.max_focal_sigma =
      std::max({result.camera_sigma.fx / camera.fx, result.camera_sigma.fy / camera.fy,
                result.projector_sigma.fx / projector.fx, result.projector_sigma.fy / projector.fy});
  EXPECT_EQ(error_of([&] { calibrate_rig(views, board(), rig, options); }), "no Error was thrown");
  options.max_focal_sigma *= 0.99;
  EXPECT_THAT(error_of([&] { calibrate_rig(views, board(), rig, options); }), HasSubstr("focal length only to "));
}

TEST(CalibrateRig, WeakSetsAreFlagged) {
  const RigModel rig = true_rig();
  Random random(7);
  const auto warnings = [&](const std::vector<BoardView>& views) {
    std::string all;
    for (const std::string& warning : calibrate_rig(views, board(), rig, {}).warnings) all += warning + "\n";
    return all;
  };
  EXPECT_THAT(warnings(views_of(rig, board_poses(4, 35, random), 0.02, random)), HasSubstr("only 4 views are used"));
  EXPECT_THAT(warnings(views_of(rig, board_poses(10, 12, random), 0.02, random)),
              HasSubstr("tilted against each other"));
  auto views = views_of(rig, board_poses(10, 35, random), 0.02, random);
  EXPECT_THAT(warnings(views), testing::Not(HasSubstr("not found")));
  for (size_t v = 0; v < 3; ++v) views[v].corners_px.clear();
  EXPECT_THAT(warnings(views), HasSubstr("the board was not found in 3 of 10 views"));
  for (BoardView& view : views) view.continues = true;
  EXPECT_THAT(warnings(views), HasSubstr("count its inner corners again"));
  RigModel narrow = rig;
  narrow.projector.width /= 2;
  narrow.projector.fx /= 2, narrow.projector.cx /= 2;
  EXPECT_THAT(warnings(views_of(narrow, board_poses(10, 35, random), 0.02, random)),
              HasSubstr("the projector's fx and fy differ by 50 %"));
}

TEST(CalibrateRig, PartlyVisibleBoardsCount) {
  const RigModel rig = true_rig();
  Random random(9);
  auto views = views_of(rig, board_poses(12, 35, random), 0.02, random);
  for (size_t v = 0; v < views.size(); v += 2) {
    for (size_t j = 0; j < views[v].corners_px.size(); ++j) {
      if (random.uniform(0, 1) < 0.6) continue;
      views[v].corners_px[j] = {std::nanf(""), std::nanf("")};
      views[v].homographies[j].reset();
    }
  }
  const RigCalibration result = calibrate_rig(views, board(), rig, {});
  for (const ViewResult& view : result.views) EXPECT_TRUE(view.used) << view.reason;
  EXPECT_NEAR(result.camera_rms_px, 0.02 * std::sqrt(2.0), 0.005);
  EXPECT_LT(std::abs(result.rig.camera.fx - rig.camera.fx), 5 * result.camera_sigma.fx);
  EXPECT_LT(std::abs(result.rig.projector.cy - rig.projector.cy), 5 * result.projector_sigma.cy);
}

TEST(DetectBoard, PartlyHiddenCharucoBoards) {
  Board charuco{BoardKind::charuco, 6, 4, 0.03, 0};
  charuco.marker_m = 0.022;
  constexpr int kSquare = 60, kMargin = 40;
  cv::Mat drawn;
  cv::aruco::CharucoBoard::create(7, 5, 0.03f, 0.022f, cv::aruco::getPredefinedDictionary(cv::aruco::DICT_4X4_50))
      ->draw({7 * kSquare + 2 * kMargin, 5 * kSquare + 2 * kMargin}, drawn, kMargin);
  cv::Mat1f image;
  drawn.convertTo(image, CV_32F);
  cv::GaussianBlur(image, image, {0, 0}, 0.8);
  const auto all = detect_board(image, charuco);
  ASSERT_EQ(all.size(), 24U);
  EXPECT_TRUE(is_complete(all));
  // Any order of the corners is right if neighbours in it are neighbours on the board.
  for (size_t row = 0; row < 4; ++row) {
    for (size_t col = 0; col + 1 < 6; ++col)
      EXPECT_NEAR(cv::norm(all[6 * row + col + 1] - all[6 * row + col]), kSquare, 0.2);
  }
  image.colRange(kMargin + 4 * kSquare, image.cols).setTo(255.0f);
  const auto part = detect_board(image, charuco);
  ASSERT_EQ(part.size(), 24U);
  int found = 0;
  for (size_t j = 0; j < part.size(); ++j) {
    if (std::isnan(part[j].x)) continue;
    ++found;
    EXPECT_LT(cv::norm(part[j] - all[j]), 0.2);
  }
  EXPECT_GE(found, 12);
  EXPECT_LT(found, 24);
  EXPECT_TRUE(detect_board(cv::Mat1f(200, 200, 128.0f), charuco).empty());
}

TEST(CalibrateRig, HeldOutBoardsAreFlatAndTrueToScale) {
  const RigModel rig = true_rig();
  Random random(8);
  const RigCalibration result =
      calibrate_rig(views_of(rig, board_poses(10, 35, random), 0.02, random), board(), rig, {});
  ASSERT_EQ(result.held_out.size(), 10U);
  for (const HeldOutBoard& measured : result.held_out) {
    EXPECT_LT(measured.plane_rms_m, 1e-4);
    EXPECT_LT(std::abs(measured.scale_error), 1e-3);
  }
}

TEST(ContinuesBeyond, FindsLargerBoards) {
  const auto image_of = [](int columns, int rows) {
    cv::Mat1f image(60 + 20 * (rows + 1), 60 + 20 * (columns + 1), 200.0f);
    for (int row = 0; row <= rows; ++row) {
      for (int col = 0; col <= columns; ++col) {
        if ((row + col) % 2 == 0) image(cv::Rect(30 + 20 * col, 30 + 20 * row, 20, 20)) = 40.0f;
      }
    }
    cv::GaussianBlur(image, image, {0, 0}, 1);
    return image;
  };
  const Board described{BoardKind::checkerboard, 6, 5, 0.02, 0};
  std::vector<cv::Point2f> corners;
  for (int row = 0; row < 5; ++row) {
    for (int col = 0; col < 6; ++col)
      corners.emplace_back(49.5f + 20.0f * static_cast<float>(col), 49.5f + 20.0f * static_cast<float>(row));
  }
  EXPECT_FALSE(continues_beyond(image_of(6, 5), described, corners));
  EXPECT_TRUE(continues_beyond(image_of(7, 5), described, corners));
  EXPECT_TRUE(continues_beyond(image_of(6, 7), described, corners));
}

TEST(CalibrateRig, BadViewsAreLeftOutWithTheReason) {
  const RigModel rig = true_rig();
  Random random(5);
  auto views = views_of(rig, board_poses(12, 35, random), 0.02, random);
  for (cv::Point2f& corner : views[4].corners_px)
    corner += cv::Point2f(static_cast<float>(2 * random.normal()), static_cast<float>(2 * random.normal()));
  views[7].corners_px.clear();
  for (size_t j = 0; j < 50; ++j) views[9].homographies[j].reset();
  const RigCalibration result = calibrate_rig(views, board(), rig, {});
  EXPECT_THAT(result.views[4].reason, HasSubstr("reprojection error"));
  EXPECT_EQ(result.views[7].reason, "the board was not found");
  EXPECT_EQ(result.views[9].reason, "only 13 of 63 corners have projector coordinates");
  for (const size_t v : {0U, 1U, 11U}) EXPECT_TRUE(result.views[v].used && result.views[v].reason.empty());
  EXPECT_NEAR(result.rig.camera.fx, rig.camera.fx, 5 * result.camera_sigma.fx);
}

TEST(CalibrateRig, ViewsThatDetermineTooLittleAreRefused) {
  const RigModel rig = true_rig();
  Random random(6);
  const auto error = [&](const std::vector<Pose>& poses) {
    return error_of([&] { calibrate_rig(views_of(rig, poses, 0.05, random), board(), rig, {}); });
  };
  EXPECT_THAT(error(board_poses(2, 35, random)), HasSubstr("2 of 2 views are usable; at least 3 are required"));
  std::vector<Pose> parallel;
  for (int i = 0; i < 8; ++i)
    parallel.push_back(pose_from({{20.0 * i - 70, 10, 900}, {0.3 * (i % 3), 0.2 * (i % 2), 5.0 * i}}));
  EXPECT_THAT(error(parallel), HasSubstr("tilt"));
  std::vector<BoardView> empty(5);
  for (BoardView& view : empty) view.name = "view";
  EXPECT_THAT(error_of([&] { calibrate_rig(empty, board(), rig, {}); }), HasSubstr("the board was not found"));
}

// --- boards in images ---

// Renders a board in perspective with 8 x 8 samples per pixel: albedo 0.8 and 0.1, illumination decreasing to one side.
cv::Mat1f draw(const Board& what, const Pinhole& camera, const Pose& camera_from_board, double noise, Random& random) {
  cv::Mat1f image(camera.height, camera.width);
  const Pose board_from_camera = camera_from_board.inverse();
  const auto points = what.points_m();
  const auto albedo = [&](double x, double y) {
    if (what.kind == BoardKind::checkerboard) {
      const int col = static_cast<int>(std::floor(x / what.spacing_m + 0.5 * (what.columns + 1)));
      const int row = static_cast<int>(std::floor(y / what.spacing_m + 0.5 * (what.rows + 1)));
      return col >= 0 && col <= what.columns && row >= 0 && row <= what.rows && (col + row) % 2 == 0 ? 0.1 : 0.8;
    }
    for (const Eigen::Vector3d& p : points) {
      if (std::hypot(x - p.x(), y - p.y()) < 0.5 * what.diameter_m) return 0.1;
    }
    return 0.8;
  };
  constexpr int kSide = 8;
  for (int v = 0; v < camera.height; ++v) {
    for (int u = 0; u < camera.width; ++u) {
      double sum = 0;
      for (int s = 0; s < kSide * kSide; ++s) {
        const Eigen::Vector2d xy(((u + (s % kSide + 0.5) / kSide - 0.5) - camera.cx) / camera.fx,
                                 ((v + (s / kSide + 0.5) / kSide - 0.5) - camera.cy) / camera.fy);
        const Eigen::Vector3d direction = board_from_camera.rotation * Eigen::Vector3d(xy.x(), xy.y(), 1);
        const Eigen::Vector3d p =
            board_from_camera.translation - direction * (board_from_camera.translation.z() / direction.z());
        sum += albedo(p.x(), p.y()) / (kSide * kSide);
      }
      image(v, u) = static_cast<float>(200 * sum * (0.6 + 0.4 * u / camera.width) + noise * random.normal());
    }
  }
  return image;
}

class BoardDetection : public testing::TestWithParam<Board> {};
INSTANTIATE_TEST_SUITE_P(Kinds, BoardDetection,
                         testing::Values(Board{BoardKind::checkerboard, 7, 5, 0.02, 0},
                                         Board{BoardKind::circles, 6, 5, 0.022, 0.01},
                                         Board{BoardKind::asymmetric_circles, 4, 7, 0.03, 0.01}));

TEST_P(BoardDetection, FindsCornersToAFewHundredthsOfAPixel) {
  const Pinhole camera{320, 256, 420, 420, 159.5, 127.5, {}};
  Random random(9);
  for (const Pose& pose : {pose_from({{5, 4, 400}, {12, -18, 9}}), pose_from({{-8, 2, 430}, {-22, 10, -15}})}) {
    const cv::Mat1f image = draw(GetParam(), camera, pose, 1, random);
    const auto corners = detect_board(image, GetParam());
    const auto points = GetParam().points_m();
    ASSERT_EQ(corners.size(), points.size());
    // The detection may start from either end of the board; the corners are then in reverse order.
    double straight = 0, turned = 0;
    for (size_t j = 0; j < points.size(); ++j) {
      const Eigen::Vector2d truth = camera.project(pose * points[j]);
      const auto off = [&](const cv::Point2f& c) { return (Eigen::Vector2d(c.x, c.y) - truth).squaredNorm(); };
      straight += off(corners[j]) / static_cast<double>(points.size());
      turned += off(corners[points.size() - 1 - j]) / static_cast<double>(points.size());
    }
    // Perspective shifts the centres of circles by 0.05 px here; the calibration corrects this.
    EXPECT_LT(std::sqrt(std::min(straight, turned)), GetParam().kind == BoardKind::checkerboard ? 0.04 : 0.09);
  }
  const cv::Mat1f nothing(256, 320, 90.0f);
  EXPECT_TRUE(detect_board(nothing, GetParam()).empty());
}

TEST(BoardPoints, AreCentredAndSpaced) {
  const auto grid = Board{BoardKind::circles, 4, 3, 0.01, 0.004}.points_m();
  ASSERT_EQ(grid.size(), 12U);
  EXPECT_LT((grid[1] - grid[0] - Eigen::Vector3d(0.01, 0, 0)).norm(), 1e-15);
  EXPECT_LT((grid[4] - grid[0] - Eigen::Vector3d(0, 0.01, 0)).norm(), 1e-15);
  const auto shifted = Board{BoardKind::asymmetric_circles, 4, 5, 0.02, 0.004}.points_m();
  EXPECT_LT((shifted[4] - shifted[0] - Eigen::Vector3d(0.01, 0.01, 0)).norm(), 1e-15);
  for (const auto& points : {grid, shifted}) {
    double right = -1, left = 1;
    for (const Eigen::Vector3d& p : points) right = std::max(right, p.x()), left = std::min(left, p.x());
    EXPECT_NEAR(right, -left, 1e-15);
  }
}

TEST(OrientLike, TurnsABoardThatWasFoundFromTheOtherEnd) {
  const std::vector<cv::Point2f> reference = {{0, 0}, {10, 0}, {0, 10}, {10, 10}};
  std::vector<cv::Point2f> turned = {{12, 11}, {2, 11}, {12, 1}, {2, 1}};
  align_corner_order(reference, turned);
  EXPECT_EQ(turned.front(), cv::Point2f(2, 1));
  align_corner_order(reference, turned);
  EXPECT_EQ(turned.front(), cv::Point2f(2, 1));
}

}  // namespace
}  // namespace fringeslam
