// SPDX-License-Identifier: Apache-2.0
// Least-squares fits of a cosine, and of a monotone function of one, to the levels along an axis of a pattern image.
#pragma once

#include <vector>

namespace fringeslam {

// level(x) = mean + modulation cos(2 pi x / period + shift), with x = i + 1/2 for pixel i; modulation >= 0.
struct CosineFit {
  double period_px = 0, shift_rad = 0;
  double mean = 0, modulation = 0;
  double rms = 0, largest = 0;  // residuals
  double period_sigma_px = 0;   // standard deviation for independent residuals; 0: the period was given
};

// Fits all four parameters. Periods from 2 px to about four times the number of levels are found; there must be at least
// eight levels.
CosineFit fit_cosine(const std::vector<double>& levels);

// Fits the other parameters for a given period, or for a given period and shift.
CosineFit fit_cosine(const std::vector<double>& levels, double period_px);
CosineFit fit_cosine(const std::vector<double>& levels, double period_px, double shift_rad);

// level(x) = g(cos(2 pi x / period + shift)) with g monotonically increasing.
struct DistortedCosineFit {
  double period_px = 0, shift_rad = 0;
  double rms = 0;    // residuals
  double gamma = 0;  // g is this power, between the least and the greatest level; 0: g is no power
};

// `start`: the best cosine.
DistortedCosineFit fit_distorted_cosine(const std::vector<double>& levels, const CosineFit& start);

}  // namespace fringeslam
