// SPDX-License-Identifier: Apache-2.0
// Configuration of OpenCV.
#pragma once

#include <opencv2/core/utility.hpp>

namespace fringeslam {

// Makes OpenCV run the code of its baseline instruction set everywhere in this process. Its AVX2 code fuses products and
// sums, so that results would depend on the processor. To be called once at the start of a program.
inline void use_portable_opencv() { cv::setUseOptimized(false); }

}  // namespace fringeslam
