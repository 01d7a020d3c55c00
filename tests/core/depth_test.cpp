// SPDX-License-Identifier: Apache-2.0
#include "core/depth/depth.h"

#include <gmock/gmock.h>

#include <limits>

#include "tests/support/matchers.h"
#include "tests/support/scene.h"

namespace fringeslam {
namespace {

using support::error_of;
using support::MatrixNear;
using support::nearest_of;
using support::plane;
using support::seen_columns;
using support::small_rig;
using support::Surface;

constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();

Eigen::Vector3d at(const cv::Mat3f& image, int row, int col) {
  const cv::Vec3f v = image(row, col);
  return {v[0], v[1], v[2]};
}

Frame reconstruct(const DecodedStack& decoded, const RigModel& rig, const DepthOptions& options = {}) {
  return reconstruct(decoded, rig, pixel_rays(rig.camera), options);
}

bool has_normal(const Frame& frame, int row, int col) { return !std::isnan(frame.normals(row, col)[2]); }

// True if the pixel is not on the image border.
bool inside(const Frame& frame, int row, int col) {
  return row > 0 && col > 0 && row + 1 < frame.height() && col + 1 < frame.width();
}

// With and without lens distortion.
class Triangulated : public testing::TestWithParam<bool> {
 protected:
  RigModel rig_ = small_rig(GetParam());
};
INSTANTIATE_TEST_SUITE_P(Distorted, Triangulated, testing::Bool());

TEST_P(Triangulated, TiltedPlanesAreExact) {
  for (const Eigen::Vector3d& direction :
       {Eigen::Vector3d(0, 0, -1), Eigen::Vector3d(0.5, -0.7, -1), Eigen::Vector3d(-1.2, 0.2, -1)}) {
    const Eigen::Vector3d normal = direction.normalized();
    const Surface surface = plane(normal, normal.z());  // through (0, 0, 1)
    const Frame frame = reconstruct(seen_columns(surface, rig_, {}, 0.02), rig_);
    const TruthFrame truth = truth_of(surface, rig_, {});
    for (int row = 0; row < frame.height(); ++row) {
      for (int col = 0; col < frame.width(); ++col) {
        ASSERT_TRUE(frame.valid(row, col)) << row << " " << col;
        const Eigen::Vector3d point = at(frame.points_m, row, col);
        EXPECT_NEAR(point.z(), truth.depth_m(row, col), 1e-6);
        EXPECT_THAT(rig_.camera.project(point), MatrixNear(Eigen::Vector2d(col, row), 1e-3));
        // Border pixels may lack a normal, because normals need neighbours on all sides.
        if (!inside(frame, row, col) && !has_normal(frame, row, col)) continue;
        EXPECT_THAT(at(frame.normals, row, col), MatrixNear(normal, 2e-4));
      }
    }
  }
}

TEST(Depth, SteepSurfacesAreLessSureThanTheirPhase) {
  // sigma^2 is the variance due to phase noise plus the square of 3 % of the depth change across the pixel.
  const RigModel rig = small_rig(false);
  const Eigen::Vector3d normal = Eigen::Vector3d(0.9, 0.1, -0.4).normalized();
  const DecodedStack decoded = seen_columns(plane(normal, normal.z()), rig, {}, 0.03);
  DepthOptions phase_alone;
  phase_alone.footprint_noise = 0;
  const Frame frame = reconstruct(decoded, rig);
  const Frame plain = reconstruct(decoded, rig, phase_alone);
  int compared = 0;
  for (int row = 1; row + 1 < frame.height(); row += 5) {
    for (int col = 1; col + 1 < frame.width(); col += 5) {
      const auto depth = [&](int r, int c) { return static_cast<double>(frame.points_m(r, c)[2]); };
      const double across = std::abs(depth(row, col + 1) - depth(row, col - 1)) / 2,
                   along = std::abs(depth(row + 1, col) - depth(row - 1, col)) / 2;
      if (std::isnan(across + along)) continue;
      const double expected = std::hypot(plain.sigma_m(row, col), 0.03 * std::hypot(across, along));
      EXPECT_NEAR(frame.sigma_m(row, col), expected, 0.02 * expected);
      EXPECT_GT(frame.sigma_m(row, col), 1.01 * plain.sigma_m(row, col));
      ++compared;
    }
  }
  EXPECT_GT(compared, 100);
}

TEST_P(Triangulated, SigmaIsTheSlopeOfDepthTimesThatOfTheColumn) {
  const Eigen::Vector3d normal = Eigen::Vector3d(0.5, -0.7, -1).normalized();
  const DecodedStack decoded = seen_columns(plane(normal, normal.z()), rig_, {}, 0.03);
  DepthOptions phase_alone;
  phase_alone.footprint_noise = 0;
  phase_alone.texture_correction = false;
  const Frame frame = reconstruct(decoded, rig_, phase_alone);
  const auto shifted = [&](float by_px) {
    DecodedStack moved = decoded;
    moved.coordinate_px = cv::Mat1f(cv::Mat(decoded.coordinate_px + by_px));
    return reconstruct(moved, rig_);
  };
  constexpr double kStepPx = 2;
  const Frame lower = shifted(-kStepPx), upper = shifted(kStepPx);
  for (int row = 0; row < frame.height(); row += 3) {
    for (int col = 0; col < frame.width(); col += 3) {
      const double step = std::abs(upper.points_m(row, col)[2] - lower.points_m(row, col)[2]);
      const double slope = step / (2 * kStepPx);  // m per px
      EXPECT_NEAR(frame.sigma_m(row, col), 0.03 * slope, 0.03 * slope * 1e-4);
    }
  }
}

TEST(Depth, StrongProjectorLensesAreIteratedToTheEnd) {
  RigModel rig = small_rig(true);
  rig.projector.distortion = {-0.2, 0.1, 0.004, -0.003, 0.05};
  const Eigen::Vector3d normal = Eigen::Vector3d(0.5, -0.7, -1).normalized();
  const Surface surface = plane(normal, normal.z());
  const Frame frame = reconstruct(seen_columns(surface, rig, {}, 0.02), rig);
  const TruthFrame truth = truth_of(surface, rig, {});
  // The norm passes over NaN.
  EXPECT_GT(cv::countNonZero(frame.sigma_m == frame.sigma_m), 0.99 * rig.camera.width * rig.camera.height);
  EXPECT_LT(cv::norm(frame.points_m.reshape(1, static_cast<int>(frame.points_m.total())).col(2),
                     truth.depth_m.reshape(1, static_cast<int>(truth.depth_m.total())), cv::NORM_INF),
            1e-6);
}

TEST(Depth, SigmaOfNoisyColumnsIsTheScatterOfTheDepths) {
  const RigModel rig = small_rig(true);
  support::Random random(1);
  const Surface surface = plane({0, 0, 1}, 1);
  const Frame frame = reconstruct(seen_columns(surface, rig, {}, 0.05, &random), rig);
  const TruthFrame truth = truth_of(surface, rig, {});
  double squares = 0, count = 0;
  for (int row = 0; row < frame.height(); ++row) {
    for (int col = 0; col < frame.width(); ++col) {
      if (!frame.valid(row, col)) continue;
      squares += std::pow((frame.points_m(row, col)[2] - truth.depth_m(row, col)) / frame.sigma_m(row, col), 2);
      ++count;
    }
  }
  EXPECT_GT(count, 0.999 * rig.camera.width * rig.camera.height);
  EXPECT_NEAR(std::sqrt(squares / count), 1, 0.03);
}

TEST(Depth, ImageIsTheFormula) {
  cv::Mat3f points(1, 8, cv::Vec3f(0, 0, 0));
  const float depths[] = {0.7F, 1.4F, 1.0F, 0.9F, 0.5F, 2.0F, kNaN, 1.399F};
  for (int i = 0; i < 8; ++i) points(0, i)[2] = depths[i];
  const cv::Mat1b image = depth_image(points, 0.7, 1.4);
  // 255 * 0.4 / 0.7 = 145.7, 255 * 0.5 / 0.7 = 182.1; 0 is reserved for "no data".
  EXPECT_THAT(std::vector<int>(image.begin(), image.end()), testing::ElementsAre(255, 1, 146, 182, 255, 1, 0, 1));
}

TEST(Depth, TextureIsTheMeanAsAShareOfFullScale) {
  const RigModel rig = small_rig(false);
  DecodedStack decoded = seen_columns(plane({0, 0, 1}, 1), rig, {}, 0.02);
  decoded.full_scale_dn = 4095;
  decoded.mean(5, 7) = 4095;
  decoded.mean(5, 8) = 0;
  decoded.mean(5, 9) = 1606;  // 100.007 of 255
  const cv::Mat1b texture = reconstruct(decoded, rig).texture;
  EXPECT_EQ(texture(5, 7), 255);
  EXPECT_EQ(texture(5, 8), 0);
  EXPECT_EQ(texture(5, 9), 100);
}

TEST(Depth, PixelsWithoutCoordinateOrOutOfLimitsAreNaN) {
  const RigModel rig = small_rig(false);
  DecodedStack decoded = seen_columns(plane({0, 0, 1}, 1), rig, {}, 0.02);
  decoded.coordinate_px(60, 70) = kNaN;
  decoded.sigma_px(20, 30) = 50;  // about 75 mm
  const Frame frame = reconstruct(decoded, rig);
  for (const auto& [row, col] : {std::pair{60, 70}, {20, 30}}) {
    EXPECT_FALSE(frame.valid(row, col));
    EXPECT_TRUE(std::isnan(frame.sigma_m(row, col)));
    EXPECT_FALSE(has_normal(frame, row, col));
    EXPECT_EQ(frame.depth_image(row, col), 0);
  }
  const auto valid_within = [&](double near_m, double far_m) {
    return reconstruct(decoded, rig, {.near_m = near_m, .far_m = far_m}).valid(40, 40);
  };
  EXPECT_TRUE(valid_within(0.99, 1.01));
  EXPECT_FALSE(valid_within(1.01, 2));
  EXPECT_FALSE(valid_within(0.5, 0.99));
}

// Steps of more than 11 mm between neighbours at 1 m are edges; the pixel spacing there is 2 mm.
DepthOptions edges_from_11_mm() {
  DepthOptions options;
  options.max_slope_deg = 80;
  return options;
}

// A board at 0.9 m left of column 60 in front of one at 1 m, with different tilts.
Surface step_edge(const RigModel& rig) {
  const double x_edge = rig.camera.undistort({59.5, 0}).x();
  const Surface front = plane(Eigen::Vector3d(0.3, 0.2, -1), -0.9), back = plane(Eigen::Vector3d(-0.4, 0.1, -1), -1.0);
  return [=](const Eigen::Vector3d& origin, const Eigen::Vector3d& direction) {
    return direction.x() / direction.z() < x_edge ? front(origin, direction) : back(origin, direction);
  };
}

TEST(Depth, NormalsDoNotReachAcrossAStep) {
  const RigModel rig = small_rig(false);
  const Surface surface = step_edge(rig);
  const Frame frame = reconstruct(seen_columns(surface, rig, {}, 0.02), rig, edges_from_11_mm());
  const TruthFrame truth = truth_of(surface, rig, {});
  int count = 0;
  for (int row = 0; row < frame.height(); ++row) {
    for (int col = 50; col < 70; ++col) {
      if (!has_normal(frame, row, col)) continue;
      ++count;
      EXPECT_THAT(at(frame.normals, row, col), MatrixNear(at(truth.normals, row, col), 2e-4)) << col;
    }
  }
  // Normals may be missing only in the two columns at the edge and at the image border.
  EXPECT_GE(count, 18 * (frame.height() - 2));
}

TEST(Depth, NormalsAreNotRoundedOverACrease) {
  const RigModel rig = small_rig(false);
  const Surface roof = nearest_of(
      {plane(Eigen::Vector3d(1, 0.1, -1).normalized(), -0.7), plane(Eigen::Vector3d(-1, 0.2, -1).normalized(), -0.7)});
  const Frame frame = reconstruct(seen_columns(roof, rig, {}, 0.02), rig);
  const TruthFrame truth = truth_of(roof, rig, {});
  int count = 0;
  for (int row = 0; row < frame.height(); ++row) {
    for (int col = 0; col < frame.width(); ++col) {
      if (!has_normal(frame, row, col)) continue;
      ++count;
      EXPECT_THAT(at(frame.normals, row, col), MatrixNear(at(truth.normals, row, col), 0.01)) << row << " " << col;
    }
  }
  EXPECT_GT(count, 0.9 * frame.height() * frame.width());
}

TEST(Depth, FlyingPixelsAreRemoved) {
  const RigModel rig = small_rig(false);
  DecodedStack decoded = seen_columns(step_edge(rig), rig, {}, 0.02);
  // One column of mixed pixels between the boards, and one isolated pixel off the back board.
  for (int row = 0; row < rig.camera.height; ++row)
    decoded.coordinate_px(row, 60) = 0.5F * (decoded.coordinate_px(row, 59) + decoded.coordinate_px(row, 61));
  decoded.coordinate_px(90, 100) -= 60;
  const Frame frame = reconstruct(decoded, rig, edges_from_11_mm());
  const auto removed = [&](int row, int col) {
    return !frame.valid(row, col) && std::isnan(frame.sigma_m(row, col)) && !has_normal(frame, row, col) &&
           frame.depth_image(row, col) == 0;
  };
  for (int row = 0; row < frame.height(); ++row) {
    EXPECT_TRUE(removed(row, 60)) << row;
    EXPECT_TRUE(frame.valid(row, 59) && frame.valid(row, 61)) << row;
  }
  EXPECT_TRUE(removed(90, 100));
  EXPECT_TRUE(frame.valid(90, 99) && frame.valid(90, 101) && frame.valid(89, 100) && frame.valid(91, 100));
}

TEST(Depth, ImagesOfAnotherCameraAreAnError) {
  const RigModel rig = small_rig(false);
  RigModel other = rig;
  other.camera.width = 100;
  const DecodedStack decoded = seen_columns(plane({0, 0, 1}, 1), rig, {}, 0.02);
  EXPECT_THAT(error_of([&] { reconstruct(decoded, other); }),
              testing::HasSubstr("images are 133x125 but the rig's camera has 100x125"));
}

TEST(Depth, DecodedImagesThatAreMissingOrOfAnotherSizeAreAnError) {
  const RigModel rig = small_rig(false);
  const DecodedStack whole = seen_columns(plane({0, 0, 1}, 1), rig, {}, 0.02);
  for (cv::Mat1f DecodedStack::*image : {&DecodedStack::sigma_px, &DecodedStack::mean}) {
    for (const cv::Size size : {cv::Size(), cv::Size(133, 10)}) {
      DecodedStack decoded = whole;
      decoded.*image = cv::Mat1f(size, 1.0F);
      EXPECT_THAT(error_of([&] { reconstruct(decoded, rig); }),
                  testing::HasSubstr("coordinate_px, sigma_px and mean (the texture) of the same size"));
    }
  }
}

}  // namespace
}  // namespace fringeslam
