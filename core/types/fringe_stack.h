// SPDX-License-Identifier: Apache-2.0
// Input of the pipeline: the camera images of one pattern sequence, in sequence order, and the thermal image taken with
// it. Contains no ground truth.
#pragma once

#include <cstddef>
#include <opencv2/core.hpp>
#include <vector>

#include "core/types/pattern_sequence.h"
#include "core/types/rig_model.h"

namespace fringeslam {

struct FringeStack {
  int index = 0;                        // position in the recording, from 0
  double timestamp_s = 0;               // time of the view's pose and depth; see reference_time_s()
  PatternSequence patterns;             // one pattern per image
  std::vector<cv::Mat> images;          // each H x W, CV_8UC1, CV_16UC1 or CV_32FC1 (unquantised), grey values in DN
  std::vector<double> exposure_s;       // duration, one per image
  std::vector<double> exposure_time_s;  // middle of each exposure, on the clock of timestamp_s
  cv::Mat1f thermal_c;  // apparent temperature in the thermal camera's pixel grid; empty: no thermal camera
};

// Returns the middles of the exposures of `images` images taken at the camera rate, centred on timestamp_s: the timing
// of recordings that do not list exposure times.
std::vector<double> exposure_times_s(double timestamp_s, size_t images, const Timing& timing);

// Returns the reference time of a view: the middle of the exposures of its finest fringes along the columns, or else
// along the rows, or else of all exposures. Depth is least sensitive to motion there.
double reference_time_s(const PatternSequence& patterns, const std::vector<double>& exposure_time_s);

// Returns the middles of the exposures of a stack taken at the camera rate, with reference time `timestamp_s`.
std::vector<double> exposure_times_s(double timestamp_s, const PatternSequence& patterns, const Timing& timing);

// Returns the median interval between the images of a stack; that of the camera rate if it agrees within 2 %, or if the stack has
// one image.
double image_interval_s(const FringeStack& stack, const Timing& timing);

// Throws Error unless images, patterns, exposures and exposure times agree in number and all images are grey and have
// the same size and type.
void check_stack(const FringeStack& stack);

}  // namespace fringeslam
