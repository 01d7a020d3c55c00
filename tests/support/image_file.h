// SPDX-License-Identifier: Apache-2.0
// Image files that the program itself does not write.
#pragma once

#include <OpenImageIO/imageio.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <opencv2/core.hpp>

namespace fringeslam::test {

// Writes an image in the format given by the extension. Channels are in the file's order; colors are not multiplied by
// alpha.
inline void write_image(const std::filesystem::path& file, const cv::Mat& image) {
  const OIIO::TypeDesc type = image.depth() == CV_8U    ? OIIO::TypeDesc::UINT8
                              : image.depth() == CV_16U ? OIIO::TypeDesc::UINT16
                                                        : OIIO::TypeDesc::FLOAT;
  OIIO::ImageSpec spec(image.cols, image.rows, image.channels(), type);
  spec.attribute("oiio:UnassociatedAlpha", 1);
  auto out = OIIO::ImageOutput::create(file.string());
  ASSERT_TRUE(out && out->open(file.string(), spec) && out->write_image(type, image.data) && out->close()) << file;
}

}  // namespace fringeslam::test
