// SPDX-License-Identifier: Apache-2.0
// What to project and how each image is coded. Nothing is ever inferred from file order: period,
// phase shift, axis and bit depth travel with every pattern.
//
// A sinusoidal pattern of period p and shift delta shows, at projector coordinate u (integer at pixel
// centres), the intensity 1/2 + 1/2 cos(Phi(u) + delta) with the absolute phase
//
//   Phi(u) = 2 pi (u + 1/2) / p                                            (so Phi >= 0 on the image)
//
// The paper's three steps [C eq. 1-3] are delta = (-alpha, 0, +alpha), alpha = 2 pi / 3.
#pragma once

#include <opencv2/core.hpp>
#include <vector>

namespace fringeslam {

enum class Axis { columns, rows };  // the projector coordinate that the fringes code

struct Pattern {
  Axis axis = Axis::columns;
  double period_px = 0;
  double shift_rad = 0;
  int bits = 8;  // grey levels of the projector; 0 = a continuous intensity, for numerical studies
  bool operator==(const Pattern&) const = default;
};

struct PatternSequence {
  int width = 0, height = 0;  // projector image, px
  std::vector<Pattern> patterns;
  bool operator==(const PatternSequence&) const = default;
};

// The images of one sequence that share axis and period.
struct FringeGroup {
  Axis axis = Axis::columns;
  double period_px = 0;
  std::vector<int> images;         // indices into the sequence
  std::vector<double> shifts_rad;  // of those images
};

double absolute_phase(double coordinate_px, double period_px);
double projector_coordinate(double absolute_phase_rad, double period_px);

// N equally spaced shifts, centred on 0, for each period in turn.
PatternSequence phase_shift_sequence(int width, int height, const std::vector<double>& periods_px, int steps, Axis axis,
                                     int bits);

// Groups of one axis, coarsest period first. Throws Error when a group has fewer than three distinct
// shifts, from which no phase can be had.
std::vector<FringeGroup> fringe_groups(const PatternSequence& sequence, Axis axis);

// Intensity in [0, 1] at a projector coordinate, before quantisation.
double ideal_intensity(const Pattern& pattern, double coordinate_px);

// Intensity of every projector pixel along the coded axis, quantised to the pattern's bits.
std::vector<float> intensity_profile(const Pattern& pattern, int length_px);

// The pattern as an 8-bit image for the projector.
cv::Mat1b pattern_image(const Pattern& pattern, int width, int height);

}  // namespace fringeslam
