// SPDX-License-Identifier: Apache-2.0
#include "tools/live/preview.h"

#include <gmock/gmock.h>

#include "core/patterns/design.h"
#include "tests/support/fringes.h"
#include "tests/support/matchers.h"
#include "tests/support/scene.h"
#include "tests/tools/fake_rig.h"

namespace fringeslam {
namespace {

using support::error_of;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using tools::Preview;
using tools::preview_of;
using tools::PreviewFigures;

PatternSequence sequence_of(const RigModel& rig, Axis axis = Axis::columns) {
  return phase_shift_sequence(rig.projector.width, rig.projector.height, {1040, 131, 16.5}, 3, axis, 8);
}

// Renders fringe images of the plane z = z_m.
FringeStack plane_seen(const RigModel& rig, double z_m, const PatternSequence& sequence,
                       const support::FringeLight& light) {
  cv::Mat1d coordinate_px(rig.camera.height, rig.camera.width);
  for (int row = 0; row < coordinate_px.rows; ++row) {
    for (int col = 0; col < coordinate_px.cols; ++col) {
      const Eigen::Vector2d ray = rig.camera.undistort(Eigen::Vector2d(col, row));
      const Eigen::Vector3d point(z_m * ray.x(), z_m * ray.y(), z_m);
      const Eigen::Vector2d pixel = rig.projector.project(rig.projector_from_camera * point);
      coordinate_px(row, col) = sequence.patterns.front().axis == Axis::columns ? pixel.x() : pixel.y();
    }
  }
  return support::fringe_stack(coordinate_px, sequence, light, CV_8UC1);
}

// The plane fills a camera of 133 x 125 px.
class PlaneAtOneMetre : public testing::Test {
 protected:
  FringeStack seen(const PatternSequence& sequence, const support::FringeLight& light) const {
    return plane_seen(rig_, 1.0, sequence, light);
  }

  const RigModel rig_ = support::small_rig(false);
  const PatternSequence sequence_ = sequence_of(rig_);
};

TEST_F(PlaneAtOneMetre, FiguresAreThoseOfTheLight) {
  const Preview preview = preview_of(seen(sequence_, {.mean_dn = 120, .modulation_dn = 90}), sequence_, rig_);
  const PreviewFigures& figures = preview.figures;
  EXPECT_GT(figures.valid, 0.95);
  EXPECT_EQ(figures.saturated, 0);
  EXPECT_NEAR(figures.mean_modulation_dn, 90, 0.5);
  // The largest cosine of three samples 120 deg apart is at least cos 60 deg = 0.5; more periods only raise it.
  EXPECT_GT(figures.brightness, (120 + 90 * 0.5) / 255);
  EXPECT_LT(figures.brightness, (120 + 90.5) / 255);
  EXPECT_TRUE(figures.depth_possible);
  EXPECT_THAT(warnings(figures), IsEmpty());
  for (const cv::Mat& picture :
       {cv::Mat(preview.texture), cv::Mat(preview.modulation), cv::Mat(preview.saturation), cv::Mat(preview.depth)})
    EXPECT_EQ(picture.size(), cv::Size(rig_.camera.width, rig_.camera.height));
  EXPECT_NEAR(preview.texture(62, 66), 255 * 120 / (0.6 * 255), 2);
  EXPECT_NEAR(preview.modulation(62, 66), 255 * 90 / 127.5, 2);
}

TEST_F(PlaneAtOneMetre, SaturatedPixelsAreRedAndCounted) {
  FringeStack stack = seen(sequence_, {.mean_dn = 120, .modulation_dn = 90});
  const cv::Rect bright(10, 20, 30, 40);
  stack.images[4](bright).setTo(255);  // one clipped sample is enough
  const Preview preview = preview_of(stack, sequence_, rig_);
  EXPECT_DOUBLE_EQ(preview.figures.saturated, 30.0 * 40 / (133 * 125));
  int red = 0;
  for (int row = 0; row < 125; ++row) {
    for (int col = 0; col < 133; ++col) {
      const cv::Vec3b colour = preview.saturation(row, col);
      const bool is_red = colour == cv::Vec3b(0, 0, 255);
      EXPECT_EQ(is_red, bright.contains({col, row})) << col << ", " << row;
      EXPECT_TRUE(is_red || (colour[0] == colour[1] && colour[1] == colour[2]));
      EXPECT_TRUE(!is_red || preview.depth(row, col) == 0);
      red += is_red;
    }
  }
  EXPECT_EQ(red, 1200);
  EXPECT_THAT(warnings(preview.figures), ElementsAre(HasSubstr("Reduce exposure")));
}

TEST_F(PlaneAtOneMetre, PixelsWithoutDepthAreZeroAndNotCounted) {
  FringeStack stack = seen(sequence_, {.mean_dn = 120, .modulation_dn = 90});
  const double all = preview_of(stack, sequence_, rig_).figures.valid;
  const cv::Rect shadow(40, 30, 50, 60);
  for (cv::Mat& image : stack.images) image(shadow).setTo(60);
  const Preview preview = preview_of(stack, sequence_, rig_);
  for (int row = 30; row < 90; ++row) {
    for (int col = 40; col < 90; ++col) EXPECT_EQ(preview.depth(row, col), 0);
  }
  EXPECT_NEAR(all - preview.figures.valid, 50.0 * 60 / (133 * 125), 0.005);
}

// docs/method.md, section 4.2: 255 (far - z) / (far - near).
TEST_F(PlaneAtOneMetre, DepthIsBrightWhereItIsNear) {
  for (const double share : {0.15, 0.5, 0.85}) {
    const double z_m = rig_.near_m + share * (rig_.far_m - rig_.near_m);
    const Preview preview = preview_of(plane_seen(rig_, z_m, sequence_, {}), sequence_, rig_);
    EXPECT_NEAR(preview.depth(62, 66), 255 * (1 - share), 1) << z_m;
  }
}

// The pipeline's own images of the same stack.
TEST_F(PlaneAtOneMetre, AViewOfThePipelineLooksTheSame) {
  const FringeStack stack = seen(sequence_, {.mean_dn = 120, .modulation_dn = 90});
  const Preview expected = preview_of(stack, sequence_, rig_);
  cv::Mat1b texture(expected.depth.size(), 120);
  cv::Mat1f modulation(expected.depth.size(), 90.0f);
  const Preview preview = preview_of(stack, rig_, texture, modulation, expected.depth);
  EXPECT_EQ(preview.figures.valid, expected.figures.valid);
  EXPECT_EQ(preview.figures.saturated, expected.figures.saturated);
  EXPECT_EQ(preview.figures.brightness, expected.figures.brightness);
  EXPECT_NEAR(preview.figures.mean_modulation_dn, expected.figures.mean_modulation_dn, 0.5);
  EXPECT_NEAR(preview.texture(62, 66), expected.texture(62, 66), 2);
  EXPECT_NEAR(preview.modulation(62, 66), expected.modulation(62, 66), 2);
}

TEST_F(PlaneAtOneMetre, DarknessIsSaid) {
  const Preview preview = preview_of(seen(sequence_, {.mean_dn = 4, .modulation_dn = 1}), sequence_, rig_);
  EXPECT_LT(preview.figures.valid, 0.1);
  EXPECT_THAT(warnings(preview.figures), ElementsAre(HasSubstr("Too dark")));
}

TEST_F(PlaneAtOneMetre, LightWithoutDepthIsSaid) {
  const Preview preview = preview_of(seen(sequence_, {.mean_dn = 120, .modulation_dn = 1}), sequence_, rig_);
  EXPECT_THAT(warnings(preview.figures), ElementsAre(HasSubstr("Hardly any depth")));
}

TEST_F(PlaneAtOneMetre, RowsGiveDepthToo) {
  RigModel above = rig_;  // the projector above the camera: depth comes from rows
  above.projector_from_camera.translation = {0, 0.05, 0};
  above.projector_from_camera.rotation.setIdentity();
  const PatternSequence rows = sequence_of(above, Axis::rows);
  const Preview preview = preview_of(plane_seen(above, 1.0, rows, {}), rows, above);
  EXPECT_TRUE(preview.figures.depth_possible);
  EXPECT_GT(preview.figures.valid, 0.8);
}

// Patterns for measuring a projector's response or focus have no fringe orders and so no depth.
TEST_F(PlaneAtOneMetre, PatternsWithoutOrdersStillShowTheirLight) {
  const PatternSequence fine = phase_shift_sequence(1024, 768, {16}, 4, Axis::columns, 8);
  const Preview fringes = preview_of(seen(fine, {.mean_dn = 120, .modulation_dn = 90}), fine, rig_);
  EXPECT_FALSE(fringes.figures.depth_possible);
  EXPECT_EQ(fringes.figures.valid, 0);
  EXPECT_NEAR(fringes.figures.mean_modulation_dn, 90, 0.5);
  EXPECT_THAT(warnings(fringes.figures), IsEmpty());

  const PatternSequence ramp = design_sequence({.width = 1024, .height = 768, .columns = false, .ramp_levels = 5});
  std::vector<cv::Mat> flats;
  for (const int level : {10, 60, 110, 160, 210}) flats.push_back(cv::Mat1b(125, 133, static_cast<uchar>(level)));
  ASSERT_EQ(ramp.patterns.size(), flats.size());
  const Preview preview = preview_of(support::stack_of(ramp, flats), ramp, rig_);
  EXPECT_FALSE(preview.figures.depth_possible);
  EXPECT_DOUBLE_EQ(preview.figures.mean_modulation_dn, 100);
  EXPECT_NEAR(preview.figures.brightness, 210 / 255.0, 1e-9);
}

TEST_F(PlaneAtOneMetre, AStackOfAnotherSequenceIsRefused) {
  FringeStack stack = seen(sequence_, {});
  stack.images.pop_back();
  EXPECT_THAT(error_of([&] { preview_of(stack, sequence_, rig_); }), HasSubstr("8 images, the sequence 9"));
}

}  // namespace
}  // namespace fringeslam
