// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <opencv2/core.hpp>

namespace fringeslam {

// Writes an image as a NumPy array file (format 1.0) of dtype '<f4', '|u1' or '<i4' and shape (H, W), in C order.
void write_npy(const std::filesystem::path& file, const cv::Mat& image);

}  // namespace fringeslam
