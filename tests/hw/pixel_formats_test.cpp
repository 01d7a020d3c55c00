// SPDX-License-Identifier: Apache-2.0
#include "hw/pixel_formats.h"

#include <gmock/gmock.h>

#include <cstdint>

#include "tests/support/matchers.h"

namespace fringeslam {
namespace {

using support::error_of;

std::vector<int> values(const cv::Mat& image) {
  cv::Mat1i all;
  image.convertTo(all, CV_32S);
  return {all.begin(), all.end()};
}

TEST(PixelFormats, BytesAndWords) {
  const uint8_t bytes[] = {0x00, 0x01, 0x34, 0x12};
  const cv::Mat mono8 = unpacked(pixel_format("Mono8"), {2, 2}, bytes, 4);
  EXPECT_EQ(mono8.type(), CV_8UC1);
  EXPECT_EQ(values(mono8), (std::vector<int>{0x00, 0x01, 0x34, 0x12}));
  const cv::Mat mono12 = unpacked(pixel_format("Mono12"), {2, 1}, bytes, 4);
  EXPECT_EQ(mono12.type(), CV_16UC1);
  EXPECT_EQ(values(mono12), (std::vector<int>{0x100, 0x1234}));
}

TEST(PixelFormats, BitStreams) {
  // PFNC 2.1: 0xABC and 0xDEF are stored as BC, FA, DE.
  const uint8_t twelve[] = {0xBC, 0xFA, 0xDE};
  EXPECT_EQ(values(unpacked(pixel_format("Mono12p"), {2, 1}, twelve, 3)), (std::vector<int>{0xABC, 0xDEF}));
  // Four pixels of ten bits: 1, 2, 3 and 1023.
  const uint8_t ten[] = {0x01, 0x08, 0x30, 0xC0, 0xFF};
  EXPECT_EQ(values(unpacked(pixel_format("Mono10p"), {4, 1}, ten, 5)), (std::vector<int>{1, 2, 3, 1023}));
}

TEST(PixelFormats, PairsInThreeBytes) {
  // GigE Vision: 0xABC and 0xDEF are stored as AB, FC, DE.
  const uint8_t twelve[] = {0xAB, 0xFC, 0xDE};
  EXPECT_EQ(values(unpacked(pixel_format("Mono12Packed"), {2, 1}, twelve, 3)), (std::vector<int>{0xABC, 0xDEF}));
  const uint8_t ten[] = {0xFF, 0x13, 0x80};  // 1023 and 513
  EXPECT_EQ(values(unpacked(pixel_format("Mono10Packed"), {2, 1}, ten, 3)), (std::vector<int>{1023, 513}));
}

TEST(PixelFormats, EveryFormatHasTheBytesThatItsCodeSays) {
  // PFNC: the second byte of the code is the number of bits per pixel.
  for (const PixelFormat& format : pixel_formats())
    EXPECT_EQ(image_bytes(format, {8, 4}), 32 * (format.code >> 16 & 0xff) / 8) << format.name;
}

// A camera that announces gigabytes must not make the program allocate them.
TEST(PixelFormats, PayloadsFitTheImages) {
  constexpr uint64_t kMore = 1 << 20;
  const cv::Size size(64, 48);
  for (const PixelFormat& format : pixel_formats()) {
    const uint64_t image = image_bytes(format, size);
    for (const uint64_t fine : {image, image + 16, image + kMore}) EXPECT_NO_THROW(check_payload(format, size, fine));
    for (const uint64_t odd : {uint64_t{0}, image - 1, image + kMore + 1, uint64_t{0xffffffff}})
      EXPECT_THAT(
          error_of([&] { check_payload(format, size, odd); }),
          testing::HasSubstr("announces " + std::to_string(odd) + " bytes for each image, but one of 64x48 px"));
  }
}

TEST(PixelFormats, BadInput) {
  EXPECT_THAT(error_of([] { (void)pixel_format("Mono9"); }), testing::HasSubstr("did you mean 'Mono8'"));
  EXPECT_THAT(error_of([] {
                (void)unpacked(pixel_format("Mono8"), {4, 4}, "", 15);
              }),
              testing::HasSubstr("has 16 bytes, not 15"));
}

}  // namespace
}  // namespace fringeslam
