// SPDX-License-Identifier: Apache-2.0
// Result of decoding a fringe stack: the projector coordinate seen by each camera pixel.
#pragma once

#include <array>
#include <opencv2/core.hpp>
#include <optional>
#include <vector>

#include "core/types/options.h"

namespace fringeslam {

// Methods of absolute phase unwrapping (core/decode/decode.h); automatic: the first one that the patterns support.
enum class Unwrapping {
  automatic,
  multifrequency,
  heterodyne,
  gray,
  micro,
  modulated,
  ensemble,
  geometric,
  predicted,
  spatial
};

constexpr auto choices(Unwrapping) {
  using enum Unwrapping;
  return std::to_array<Choice<Unwrapping>>({{automatic, "auto"},
                                            {multifrequency, "multifrequency"},
                                            {heterodyne, "heterodyne"},
                                            {gray, "gray"},
                                            {micro, "micro"},
                                            {modulated, "modulated"},
                                            {ensemble, "ensemble"},
                                            {geometric, "geometric"},
                                            {predicted, "predicted"},
                                            {spatial, "spatial"}});
}

// A connected region of spatially unwrapped phase.
struct PhaseComponent {
  int pixels = 0;
  int votes = 0;         // pixels whose order is known independently
  double agreement = 0;  // fraction of the votes for the selected order
  bool absolute = false;
};

// All images are H x W. Invalid pixels are NaN (fringe_order: -1): wrapped_phase and sigma_px where there are no
// fringes; coordinate_px and confidence also where the fringe order is unknown.
struct DecodedStack {
  int index = 0;
  double timestamp_s = 0;
  // Method used; empty before decoding.
  std::optional<Unwrapping> unwrapping;
  bool filled_by_prediction = false;  // orders that the method left open come from a prediction

  cv::Mat1f mean;           // I', DN; valid everywhere
  cv::Mat1f modulation;     // I'' of the finest period, DN; valid everywhere
  cv::Mat1f wrapped_phase;  // finest period, rad, (-pi, pi]
  cv::Mat1i fringe_order;   // K of the finest period
  cv::Mat1f coordinate_px;  // projector column (or row), integer at pixel centres
  cv::Mat1f sigma_px;       // its standard deviation, px
  cv::Mat1f confidence;     // probability that the fringe order is correct
  double full_scale_dn = 255;
  double finest_period_px = 0;   // 0: no fringes; the coordinate is that of a Gray code cell
  double omitted_period_px = 0;  // finest of the periods whose phase the motion left undetermined; 0: none

  // Set by spatial unwrapping only; otherwise empty.
  cv::Mat1i component;       // index into components; -1: none
  cv::Mat1f relative_phase;  // rad; known up to a multiple of 2 pi in components that are not absolute
  std::vector<PhaseComponent> components;
};

}  // namespace fringeslam
