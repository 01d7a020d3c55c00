// SPDX-License-Identifier: Apache-2.0
// The fast EXR decoder gives the same pixels as OpenImageIO's, and damaged files are refused.
#include "core/io/exr_file.h"

#include <gmock/gmock.h>

#include <cstring>
#include <limits>

#include "core/io/files.h"
#include "core/types/error.h"
#include "tests/support/random.h"

namespace fringeslam {
namespace {

struct Decoded {
  ImageHeader header;
  cv::Mat image;
};

AllocateImage into(Decoded& decoded) {
  return [&decoded](const ImageHeader& header) {
    decoded.header = header;
    return cv::Mat(header.size, header.type);
  };
}

// Smooth values, steps, zeros, NaN and noise.
cv::Mat1f content(support::Random& random, cv::Size size, int kind) {
  cv::Mat1f image(size);
  for (int row = 0; row < size.height; ++row) {
    for (int col = 0; col < size.width; ++col) {
      const double value = kind == 0   ? 1 + 1e-3 * row + 2e-3 * col
                           : kind == 1 ? (row + col) % 7
                           : kind == 2 ? random.normal()
                                       : 0;
      image(row, col) = (row + 2 * col) % 11 == 5 ? std::numeric_limits<float>::quiet_NaN() : static_cast<float>(value);
    }
  }
  return image;
}

std::vector<ExrChannel> channels_of(cv::Size size, size_t count) {
  constexpr const char* kNames[] = {"depth_m", "order.columns.16.5", "normal.x", "mask", "normal.y", "projector_row"};
  support::Random random(7);
  std::vector<ExrChannel> channels;
  for (size_t i = 0; i < count; ++i) channels.push_back({kNames[i], content(random, size, static_cast<int>(i) % 4)});
  return channels;
}

class ExrFiles : public testing::TestWithParam<ExrCompression> {};

TEST_P(ExrFiles, HaveTheSamePixelsAsOpenImageIoReads) {
  for (const cv::Size size : {cv::Size(1, 1), cv::Size(3, 5), cv::Size(17, 2), cv::Size(129, 33)}) {
    for (const size_t count : {1, 2, 6}) {
      const std::string bytes = exr_bytes(channels_of(size, count), GetParam());
      Decoded fast, other;
      const std::optional<cv::Mat> image = decode_exr(bytes, "file", into(fast));
      ASSERT_TRUE(image);
      other.image = decode_here(bytes, {"openexr", false}, "file", into(other));
      EXPECT_EQ(fast.header.channels, other.header.channels);
      ASSERT_EQ(image->size(), other.image.size());
      ASSERT_EQ(image->type(), other.image.type());
      EXPECT_EQ(std::memcmp(image->data, other.image.data, image->total() * image->elemSize()), 0)
          << size << " " << count;
    }
  }
}

TEST_P(ExrFiles, ThatAreDamagedGiveAnErrorOrOtherPixels) {
  const std::string bytes = exr_bytes(channels_of({40, 30}, 4), GetParam());
  support::Random random(3);
  int refused = 0;
  const auto try_to_read = [&](const std::string& damaged) {
    Decoded decoded;
    try {
      const bool read = decode_exr(damaged, "file", [&](const ImageHeader& header) {
                          if (header.size.area() > 1 << 20) throw Error("file: too large");
                          return into(decoded)(header);
                        }).has_value();
      return read;
    } catch (const Error& e) {
      EXPECT_THAT(e.what(), testing::StartsWith("file: "));
      return false;
    }
  };
  for (int i = 0; i < 500; ++i) {
    std::string damaged = bytes;
    const auto at = static_cast<size_t>(random.uniform(0, static_cast<double>(bytes.size())));
    damaged[at] = static_cast<char>(damaged[at] ^ (1 << i % 8));
    refused += !try_to_read(damaged);
  }
  EXPECT_GT(refused, GetParam() == ExrCompression::none ? 5 : 20);  // other pixels cannot be noticed if not compressed
  for (int i = 0; i < 50; ++i)
    EXPECT_FALSE(
        try_to_read(bytes.substr(0, static_cast<size_t>(random.uniform(0, 0.99) * static_cast<double>(bytes.size())))));
}

INSTANTIATE_TEST_SUITE_P(All, ExrFiles,
                         testing::Values(ExrCompression::none, ExrCompression::zip));

}  // namespace
}  // namespace fringeslam
