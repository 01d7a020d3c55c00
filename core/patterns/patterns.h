// SPDX-License-Identifier: Apache-2.0
// What to project and how each image is coded. Nothing is ever inferred from file order: coding, period,
// phase shift, axis and bit depth travel with every pattern. Projector coordinates u are integer at pixel
// centres, so x = u + 1/2 is the distance from the image's edge.
//
//   fringe  1/2 + 1/2 cos(Phi + delta), absolute phase Phi(u) = 2 pi x / p        (so Phi >= 0 on the image)
//           The paper's three steps [C eq. 1-3] are delta = (-alpha, 0, +alpha), alpha = 2 pi / 3.
//   gray    one bit of the reflected Gray code j ^ (j >> 1): the bit whose code cells are c px wide is 1
//           where floor((floor(x / c) + 1) / 2) is odd. So its cell width alone tells which bit it is: cells
//           of p, 2p, 4p ... number the periods of a fringe, and one more bit of cells p/2 is the
//           complementary code, whose cells the fringe's order can be read from without its own edges.
//   flat    one level everywhere: white, black, or a step of a grey ramp.
#pragma once

#include <opencv2/core.hpp>
#include <vector>

namespace fringeslam {

enum class Axis { columns, rows };  // the projector coordinate that is coded
enum class Coding { fringe, gray, flat };

struct Pattern {
  Axis axis = Axis::columns;
  double period_px = 0;  // fringe: period; gray: width of a code cell
  double shift_rad = 0;  // fringe: delta
  int bits = 8;          // grey levels of the projector; 0 = a continuous intensity, for numerical studies
  Coding coding = Coding::fringe;
  bool inverted = false;  // gray: 1 - the bit
  double level = 0;       // flat: 0 black, 1 white
  bool dithered = false;  // levels between two grey levels by error diffusion (1 bit: black and white alone)
  bool operator==(const Pattern&) const = default;
};

struct PatternSequence {
  int width = 0, height = 0;  // projector image, px
  std::vector<Pattern> patterns = {};
  // Input level for each of equally spaced levels of light from 0 to 1, so that a projector whose output is no
  // linear function of its input shows what the patterns mean. Empty: the levels as they are.
  std::vector<double> inverse_response = {};
  bool operator==(const PatternSequence&) const = default;
};

// The images of one sequence that share axis and period.
struct FringeGroup {
  Axis axis = Axis::columns;
  double period_px = 0;
  std::vector<int> images;         // indices into the sequence
  std::vector<double> shifts_rad;  // of those images
};

// One bit of a Gray code; -1 where the sequence has no such image.
struct GrayBit {
  double cell_px = 0;
  int image = -1, inverted_image = -1;
};

double absolute_phase(double coordinate_px, double period_px);
double projector_coordinate(double absolute_phase_rad, double period_px);

// Number of the Gray code's cell of the given width that holds a projector coordinate.
int gray_cell(double coordinate_px, double cell_px);

// N equally spaced shifts, centred on 0, for each period in turn.
PatternSequence phase_shift_sequence(int width, int height, const std::vector<double>& periods_px, int steps, Axis axis,
                                     int bits);

// The bits, coarsest first, that tell apart all cells of `cell_px` over `length_px`.
std::vector<Pattern> gray_patterns(Axis axis, double cell_px, int length_px, int bits);

// Groups of one axis, coarsest period first; empty when the axis has no fringes. Throws Error when a group has
// fewer than three distinct shifts, from which no phase can be had.
std::vector<FringeGroup> fringe_groups(const PatternSequence& sequence, Axis axis);

// The images of the finest fringes alone: what is left to project where fringe orders are known already.
PatternSequence finest_patterns(const PatternSequence& sequence, Axis axis);

// Gray bits of one axis, coarsest first.
std::vector<GrayBit> gray_bits(const PatternSequence& sequence, Axis axis);

// Intensity in [0, 1] at a projector coordinate along the pattern's axis, before quantisation.
double ideal_intensity(const Pattern& pattern, double coordinate_px);

// Input levels in [0, 1] of the projector's pixels, by the sequence's inverse response and the pattern's bits. A
// dimension along which the pattern does not change has size 1, else it is the projector's.
cv::Mat1f pattern_levels(const Pattern& pattern, const PatternSequence& sequence);

// The pattern as the projector's image, 8 bits, or 16 for patterns of more than 8.
cv::Mat pattern_image(const Pattern& pattern, const PatternSequence& sequence);

// Value of a table of equally spaced entries over [0, 1], linear in between; an empty table is the identity.
double table_value(const std::vector<double>& table, double position);

// The inverse of such a table, with as many entries; it must grow. What light cannot be reached is clipped.
std::vector<double> inverse_table(const std::vector<double>& table, int entries);

}  // namespace fringeslam
