// SPDX-License-Identifier: Apache-2.0
// Formats that need OpenImageIO, in a program that links nothing else of this project, like a consumer: what the other
// libraries load before this one affects how it starts.
#include <gtest/gtest.h>

#include "core/io/files.h"
#include "core/io/jpeg_file.h"
#include "tests/support/temp_folder.h"

namespace fringeslam {
namespace {

TEST(ImageFormats, AreReadWithoutTheOtherLibraries) {
  const test::TempFolder temp;
  write_png(temp / "grey.png", cv::Mat1b(20, 30, uchar{90}));
  test::write_bytes(temp / "grey.jpg", jpeg_bytes(cv::Mat1b(20, 30, uchar{90}), 100));
  for (const char* name : {"grey.png", "grey.jpg", "grey.png"}) {
    const cv::Mat image = read_grey(temp / name);
    ASSERT_EQ(image.size(), cv::Size(30, 20)) << name;
    EXPECT_LE(cv::norm(image, cv::Mat1b(20, 30, uchar{90}), cv::NORM_INF), 1) << name;
  }
}

// EXR files store channels alphabetically; a worker without OpenImageIO passes them on.
TEST(ImageFormats, ColorsAreRedGreenBlue) {
  const test::TempFolder temp;
  write_exr(temp / "color.exr",
            {{"B", cv::Mat1f(3, 4, 3.f)}, {"G", cv::Mat1f(3, 4, 2.f)}, {"R", cv::Mat1f(3, 4, 1.f)}});
  for (int i = 0; i < 3; ++i) {
    const cv::Mat image = read_pixels(temp / "color.exr");
    ASSERT_EQ(image.type(), CV_32FC3);
    EXPECT_EQ(image.at<cv::Vec3f>(2, 1), cv::Vec3f(1, 2, 3));
    EXPECT_EQ(read_exr(temp / "color.exr").size(), 3u);
  }
}

}  // namespace
}  // namespace fringeslam
