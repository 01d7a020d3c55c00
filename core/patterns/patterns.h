// SPDX-License-Identifier: Apache-2.0
// Pattern sequences and their coding. Each pattern carries its coding, period, phase shift, axis and bit depth; nothing
// is inferred from the file order. Projector coordinates u are integers at pixel centres, so x = u + 1/2 is the
// distance from the image edge.
//
//   fringe  1/2 + 1/2 cos(Phi + delta) with absolute phase Phi(u) = 2 pi x / p, so that Phi >= 0 on the image.
//           The paper's three steps [C eq. 1-3] are delta = (-alpha, 0, +alpha), alpha = 2 pi / 3.
//   gray    one bit of the reflected Gray code j ^ (j >> 1): the bit with code cells of c px is 1 where
//           floor((floor(x / c) + 1) / 2) is odd, so the cell width identifies the bit. Cells of p, 2p, 4p, ...
//           number the periods of a fringe pattern. An additional bit with cells of p/2 makes the code
//           complementary: the fringe order can then be decoded without relying on pixels at cell edges. A bit may be
//           shown as its exclusive or (XOR) with a finer one, the carrier, so that no stripe is wider than the carrier's
//           two cells: indirect light then hardly differs between the stripes [Gupta et al., CVPR 2011]. A code with long
//           runs instead numbers cells of one width by bits whose stripes are 5 to 20 cells wide.
//   flat    constant level: white, black, or one step of a grey ramp.
//   extra   a single image of a fringe with a period of its own, as micro phase shifting projects in addition to the
//           phase steps of one period. It has too few phase steps to determine a phase by itself.
//   product 1/2 + 1/2 cos(Phi + delta) cos(Phi_c + delta_c), Phi_c with the period of a carrier, as modulated phase
//           shifting projects.
//
// Fringes, Gray codes and products can be decoded; flat images serve as thresholds, extra ones with fringes.
//
// See docs/method.md, section 2.
#pragma once

#include <array>
#include <opencv2/core.hpp>
#include <vector>

#include "core/types/pattern_sequence.h"

namespace fringeslam {

// Images of a sequence with the same axis and period.
struct FringeGroup {
  Axis axis = Axis::columns;
  double period_px = 0;
  std::vector<int> images;         // indices into the sequence
  std::vector<double> shifts_rad;  // phase shift of each image
};

// One bit of a Gray code; an image index is -1 if the sequence has no such image.
struct GrayBit {
  double cell_px = 0;
  double carrier_px = 0;            // cells of the bit that it is combined with by XOR; 0: none
  int code_bits = 0, code_bit = 0;  // of a code with long runs; 0 bits: of a reflected code
  int image = -1, inverted_image = -1;
};

double absolute_phase(double coordinate_px, double period_px);
double projector_coordinate(double absolute_phase_rad, double period_px);

// Returns the index of the Gray code cell, of the given width, that contains a projector coordinate.
int gray_cell(double coordinate_px, double cell_px);

// Builds a sequence with N equally spaced shifts, centred on 0, for each period in turn.
PatternSequence phase_shift_sequence(int width, int height, const std::vector<double>& periods_px, int steps, Axis axis,
                                     int bits);

// Returns the bits, coarsest first, that distinguish all cells of `cell_px` over `length_px`. With a carrier, bits with
// cells wider than `carrier_px` are combined with it by XOR. Throws Error if the carrier is none of the bits.
std::vector<Pattern> gray_patterns(Axis axis, double cell_px, int length_px, int bits, double carrier_px = 0);

// Counts distinct shifts; shifts that differ by whole turns give the same pattern.
size_t distinct_shifts(const std::vector<double>& shifts_rad);

// Returns the fringe groups of one axis, coarsest period first; empty if the axis has no fringes. Throws Error if a
// group has fewer than three distinct shifts, which do not determine the phase.
std::vector<FringeGroup> fringe_groups(const PatternSequence& sequence, Axis axis);

// Returns the sequence reduced to the finest period of one axis: what must be projected if fringe orders are already
// known.
PatternSequence finest_patterns(const PatternSequence& sequence, Axis axis);

// True if an image has another exposure than the rig's.
bool has_exposures(const PatternSequence& sequence);

// True if the sequence has fringes, Gray bits or products along the axis: images that decoders use.
bool codes_axis(const PatternSequence& sequence, Axis axis);

// Throws Error if all images that code the axis are of coding `extra`, which needs fringes.
void require_decoder(const PatternSequence& sequence, Axis axis);

// Returns the bits of a code with long runs, first bit first, that numbers all cells of `cell_px` over `length_px`. Throws
// Error if it would need more than kMostLongRunBits.
std::vector<Pattern> long_run_patterns(Axis axis, double cell_px, int length_px, int bits);

// Returns the Gray codes of one axis: the plain code, those combined by XOR with each carrier (of which the bits no coarser
// than the carrier belong to the plain code, too) and those with long runs; complete ones first. Bits are in the order of
// the code, coarsest first.
std::vector<std::vector<GrayBit>> gray_codes(const PatternSequence& sequence, Axis axis);

// Returns the bits of the first Gray code of one axis; empty if there is none.
std::vector<GrayBit> gray_bits(const PatternSequence& sequence, Axis axis);

// Returns the intensity in [0, 1] at a projector coordinate along the pattern's axis, before quantisation.
double ideal_intensity(const Pattern& pattern, double coordinate_px);

// Returns the input levels in [0, 1] of the projector pixels, after the sequence's inverse response and quantisation to
// the pattern's bits. A dimension along which the pattern is constant has size 1.
cv::Mat1f pattern_levels(const Pattern& pattern, const PatternSequence& sequence);

// Renders the pattern as an image of the projector's size, 8 bits, or 16 bits for patterns with more than 8.
cv::Mat pattern_image(const Pattern& pattern, const PatternSequence& sequence);

// Interpolates linearly in a table with equally spaced entries over [0, 1]; an empty table is the identity.
double interpolate_table(const std::vector<double>& table, double position);

// Inverts such a table, which must be increasing, into a table with `entries` entries. Values outside its range are
// clipped to 0 or 1.
std::vector<double> invert_table(const std::vector<double>& table, int entries);

}  // namespace fringeslam
