// SPDX-License-Identifier: Apache-2.0
// Encoded images have the same pixels when our own decoders and those of OpenImageIO read them.
#include <gmock/gmock.h>

#include <limits>

#include "core/io/exr_encoder.h"
#include "core/io/image_decoder.h"
#include "core/io/image_library.h"
#include "core/io/jpeg_file.h"
#include "core/io/png_file.h"
#include "core/types/error.h"
#include "tests/support/random.h"
#include "tests/support/same_pixels.h"
#include "tests/support/temp_folder.h"

namespace fringeslam {
namespace {

using test::message_of;
using test::same_pixels;
using testing::HasSubstr;

cv::Mat allocated(const ImageHeader& header) { return {header.size, header.type}; }

TEST(PngEncoding, IsReadByBothLibraries) {
  cv::RNG random(3);
  for (const int depth : {CV_8U, CV_16U}) {
    for (int channels = 1; channels <= 4; ++channels) {
      for (const PngEncoding& encoding :
           {PngEncoding{}, PngEncoding{9}, PngEncoding{1, PngFilter::up}, PngEncoding{3, PngFilter::none}}) {
        cv::Mat image(23, 41, CV_MAKETYPE(depth, channels));
        random.fill(image, cv::RNG::UNIFORM, 0, depth == CV_8U ? 256 : 65536);
        image.rowRange(4, 9).setTo(cv::Scalar::all(7));
        const std::string bytes = encode_png(image, encoding);
        EXPECT_TRUE(same_pixels(decode_here(bytes, {"png"}, "png", allocated), image)) << depth << " " << channels;
        cv::Mat exact, read = image_library().decode(bytes, {"png", true}, "png", allocated);
        image.convertTo(exact, CV_32F, 1 / (depth == CV_8U ? 255.0 : 65535.0));
        EXPECT_LT(cv::norm(read, exact, cv::NORM_INF), 1e-6) << depth << " " << channels;
      }
    }
  }
}

// The pixels of a file by libdeflate are a single chunk, which may be larger than others may be.
TEST(PngEncoding, NoiseOfAnySizeIsRead) {
  cv::Mat1w noise(3000, 3000);
  cv::RNG random(4);
  random.fill(noise, cv::RNG::UNIFORM, 0, 65536);
  const std::string bytes = encode_png(noise, {1, PngFilter::up});
  EXPECT_GT(bytes.size(), 17u << 20);
  EXPECT_TRUE(same_pixels(decode_here(bytes, {"png"}, "png", allocated), noise));
}

TEST(PngEncoding, RefusesOtherPixels) {
  EXPECT_THAT(message_of([] { encode_png(cv::Mat(2, 2, CV_32FC1), {}); }), HasSubstr("one to four of 8 or 16 bits"));
  EXPECT_THAT(message_of([] { encode_png(cv::Mat(2, 2, CV_8UC(5)), {}); }), HasSubstr("5 channels"));
  EXPECT_THAT(message_of([] { encode_png(cv::Mat(), {}); }), HasSubstr("PNG image: cannot be encoded"));
}

// In memory, because OpenImageIO does not notice when a disk is full.
TEST(GifEncoding, IsCompleteAndReadByOpenImageIo) {
  const cv::Vec3b first(20, 100, 60), second(200, 100, 60);
  const std::vector<cv::Mat3b> frames = {cv::Mat3b(11, 17, first), cv::Mat3b(11, 17, second)};
  const std::string bytes = image_library().gif_bytes(frames, 6, "gif");
  EXPECT_THAT(bytes, testing::StartsWith("GIF89a"));
  EXPECT_EQ(bytes.back(), ';');
  EXPECT_GT(bytes.size(), image_library().gif_bytes({frames[0]}, 6, "gif").size());
  const cv::Mat read = image_library().decode(bytes, {"gif"}, "gif", allocated);
  ASSERT_EQ(read.size(), cv::Size(17, 11));
  const cv::Scalar color = cv::mean(read);  // red, green, blue
  for (int i = 0; i < 3; ++i) EXPECT_NEAR(color[i], first[2 - i], 8) << i;
}

TEST(JpegEncoding, IsReadByOpenImageIo) {
  cv::Mat1b image(37, 50);
  for (int row = 0; row < image.rows; ++row) {
    for (int col = 0; col < image.cols; ++col) image(row, col) = static_cast<uchar>(3 * row + 2 * col);
  }
  const auto error = [&](int quality) {
    const cv::Mat read = image_library().decode(jpeg_bytes(image, quality), {"jpeg"}, "jpeg", allocated);
    return cv::norm(read, image, cv::NORM_INF);
  };
  EXPECT_LE(error(100), 2);
  EXPECT_LE(error(80), 12);
  EXPECT_LT(jpeg_bytes(image, 20).size(), jpeg_bytes(image, 90).size());
  EXPECT_THAT(message_of([] { jpeg_bytes(cv::Mat1b(1, 70000), 90); }), HasSubstr("JPEG image: cannot be encoded: "));
  EXPECT_THAT(message_of([] { jpeg_bytes(cv::Mat1b(), 90); }), HasSubstr("JPEG image: cannot be encoded: "));
}

// Even and odd widths, rows that compress and rows that do not.
TEST(ExrEncoding, ImagesOfAllWidthsAreReadByBothLibraries) {
  support::Random random(11);
  for (int width = 1; width < 420; width += width < 40 ? 1 : 13) {
    cv::Mat1f image(6, width);
    for (int row = 0; row < image.rows; ++row) {
      for (int col = 0; col < width;) {
        const int run = static_cast<int>(random.uniform(1, row < 3 ? 6 : 300));
        const bool noisy = row % 2 == 0 && run % 2 == 0;
        const auto value = static_cast<float>(random.normal());
        for (int i = 0; i < run && col < width; ++i, ++col)
          image(row, col) = noisy ? static_cast<float>(random.normal()) : run % 5 == 0 ? 0.0f : value;
      }
    }
    for (const ExrCompression compression : {ExrCompression::none, ExrCompression::zip}) {
      const std::string bytes = exr_bytes({{"Y", image}}, compression);
      EXPECT_TRUE(same_pixels(image_library().decode(bytes, {"openexr"}, "exr", allocated), image)) << width;
      EXPECT_TRUE(same_pixels(decode_here(bytes, {"openexr"}, "exr", allocated), image)) << width;
    }
  }
}

TEST(ExrEncoding, CompressesConstantAreas) {
  const cv::Mat1f empty(100, 200, std::numeric_limits<float>::quiet_NaN());
  const size_t stored = exr_bytes({{"Y", empty}}, ExrCompression::none).size();
  EXPECT_GT(stored, 4 * empty.total());
  EXPECT_LT(exr_bytes({{"Y", empty}}, ExrCompression::zip).size(), stored / 15);
}

TEST(ExrEncoding, KeepsLongNamesAndPartsOfLargerImages) {
  cv::Mat1f large(40, 50);
  cv::randu(large, 0, 1);
  const cv::Mat part = large(cv::Rect(7, 5, 20, 30));
  const std::string name = "a_name_of_more_than_thirty_one_letters";
  ImageHeader header;
  const std::string bytes = exr_bytes({{name, part}, {"Z", cv::Mat1f(part.size(), 2.f)}});
  const cv::Mat read = decode_here(bytes, {"openexr", true}, "exr", [&](const ImageHeader& given) {
    header = given;
    return allocated(given);
  });
  ASSERT_THAT(header.channels, testing::ElementsAre("Z", name));
  cv::Mat second;
  cv::extractChannel(read, second, 1);
  EXPECT_TRUE(same_pixels(second, part.clone()));
}

TEST(ExrEncoding, RefusesWhatIsNoImage) {
  const cv::Mat1f image(2, 3, 1.f);
  EXPECT_THAT(message_of([&] { exr_bytes({{"A", image}, {"B", cv::Mat1f(3, 2, 1.f)}}); }), HasSubstr("channel B"));
  EXPECT_THAT(message_of([&] { exr_bytes({{"A", cv::Mat1b(2, 3)}}); }), HasSubstr("channel A"));
  EXPECT_THAT(message_of([&] { exr_bytes({{"A", image}, {"A", image}}); }), HasSubstr("EXR image: cannot be encoded"));
  EXPECT_THAT(message_of([&] { exr_bytes({}); }), HasSubstr("EXR image: has no channel"));
}

}  // namespace
}  // namespace fringeslam
