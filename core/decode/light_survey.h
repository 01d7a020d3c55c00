// SPDX-License-Identifier: Apache-2.0
// How bright the pixels of a view are under the fringes, and which exposures decode them (docs/method.md, section 3.4).
//
// With I' the mean above the black level and I'' the modulation, both at the rig's exposure, an exposure e (relative to the
// rig's) gives grey values up to offset + e (I' + I'') with the phase sigma
//
//   sigma_phi(e) = sqrt(2 v(offset + e I') / N) / (e I''),   v the camera's noise model, N the phase steps.
//
// A pixel can be decoded at the exposures between the least that makes sigma_phi small enough for the coding and the
// greatest that does not saturate it. Exposures of a pixel therefore form an interval, and the fewest exposures that serve
// all pixels are a minimum set of points that meets all intervals.
#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "core/decode/decode.h"
#include "core/types/fringe_stack.h"

namespace fringeslam {

// Standard deviations that 99 % of normal values do not exceed: the certainty of the predictions.
constexpr double kCertainSigmas = 2.326;

enum class LightState : uint8_t {
  unlit,      // no modulation above the noise: no surface, shadow, or outside the beam
  lit,        // measured
  estimated,  // saturated; the unsaturated samples determine the brightness
  hidden      // saturated; the brightness is unknown
};

// Brightness of each pixel at the rig's exposure; all images are H x W.
struct PixelLight {
  cv::Mat1f mean_dn;  // I' above the black level
  cv::Mat1f
      modulation_dn;  // I'' of the finest period without the part that noise adds; faint pixels: that of their block
  cv::Mat1f peak_dn;  // I' + I'' of the strongest period
  cv::Mat1b state;    // LightState
  double shortest = 1, longest = 1;  // exposures of the images
  // Measured over predicted standard deviation of the grey values; NaN: the patterns do not show it.
  double noise_ratio = 0;

  LightState at(int row, int col) const { return static_cast<LightState>(state(row, col)); }
};

// Measures the light of a stack along the axis. Without fringes, a white and a black image serve. Throws Error if the
// stack has neither.
PixelLight survey_light(const FringeStack& stack, const SensorModel& sensor, const DecodeOptions& options, Axis axis);

// Replaces what saturation hides in `light`, and what the longer exposures of `look` show better. Both are of the same
// view.
void add_look(PixelLight& light, const PixelLight& look);

// Agreement of the periods of a view with its finest period, on smooth surfaces. Indirect light shifts the phases of long
// periods more than those of short ones, and neighbouring pixels alike; noise does not.
struct PeriodAgreement {
  int64_t tested = 0;     // pixels of blocks with enough measured pixels; 0: the patterns or the view allow no test
  int64_t biased = 0;     // pixels of blocks whose median residual exceeds 4 sigmas of a pixel
  double bias_rad = 0;    // of the period's phase in these blocks: the median
  double ripple_rad = 0;  // amplitude of the residual's N-th harmonic: a nonlinear projector
  double sigma_rad = 0;   // median sigma of the residuals
  // (I' - I'') / I'' of the finest period, the median; NaN without fringes. It is all light that is no fringe, such as ambient and indirect light.
  // The indirect light of any period has at most this share of the direct light's modulation.
  double unmodulated = 0;
};

// Compares the phase of each period with that of the coordinate in `decoded`, which must be decoded without a limit on the
// residuals between periods.
PeriodAgreement compare_periods(const FringeStack& stack, const SensorModel& sensor, const DecodeOptions& options,
                                Axis axis, const DecodedStack& decoded, const PixelLight& light);

// Exposures that can be chosen: 2^(i / 4).
class ExposureGrid {
 public:
  static constexpr int kSteps = 81;
  static double exposure(int step);
  // The step next to an exposure.
  static int nearest(double exposure);
};

// Least signal of a pixel that a coding can decode.
struct SignalDemand {
  int steps = 3;
  double max_phase_sigma_rad = 0.35;
};

// Which exposures decode a pixel, with 99 % certainty in view of the noise.
class SignalLimits {
 public:
  SignalLimits(const SensorModel& sensor, const DecodeOptions& options, const SignalDemand& demand, double noise_ratio);
  bool saturates(double peak_dn, double exposure) const;
  bool too_dark(double mean_dn, double modulation_dn, double exposure) const;

 private:
  SensorModel sensor_;
  DecodeOptions options_;
  SignalDemand demand_;
  double noise_ratio_;
};

// Numbers of pixels by the first and the last step of the exposure grid that decode them.
class ExposureIntervals {
 public:
  // Adds the lit pixels of a view.
  void add(const PixelLight& light, const SensorModel& sensor, const DecodeOptions& options,
           const SignalDemand& demand);

  // Pixels that some exposure decodes, that none does, and whose brightness is unknown.
  int64_t decodable() const { return decodable_; }
  int64_t hopeless() const { return hopeless_; }
  int64_t hidden() const { return hidden_; }

  // Number of pixels that at least one of the exposures (steps of the grid, increasing) decodes.
  int64_t covered(const std::vector<int>& steps) const;

  // Number of pixels that both exposures decode.
  int64_t common(int step, int other) const;

  // The `count` exposures between the limits that decode most pixels, increasing; of equal ones, those in the middle of the
  // possible range. Empty if the limits include fewer steps.
  std::vector<int> best(int count, int first, int last) const;

  // Ratio of the last to the first exposure that decode a pixel: the median.
  double median_range() const;

 private:
  int64_t newly_covered(int before, int step) const;

  int64_t at(int first, int last) const { return counts_[static_cast<size_t>(first * ExposureGrid::kSteps + last)]; }
  std::vector<int64_t> counts_ = std::vector<int64_t>(static_cast<size_t>(ExposureGrid::kSteps) * ExposureGrid::kSteps);
  int64_t decodable_ = 0, hopeless_ = 0, hidden_ = 0;
};

}  // namespace fringeslam
