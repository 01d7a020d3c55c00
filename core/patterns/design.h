// SPDX-License-Identifier: Apache-2.0
// Generates pattern sequences from design parameters and packs images for the projector.
#pragma once

#include <array>
#include <string>

#include "core/patterns/patterns.h"
#include "core/types/options.h"

namespace fringeslam {

enum class GrayCode {
  none,
  plain,         // one bit per binary digit of the finest fringe period's index
  complementary  // and a bit with cells of half a period, so that no cell edge is ambiguous
};

constexpr auto choices(GrayCode) {
  using enum GrayCode;
  return std::to_array<Choice<GrayCode>>({{none, "none"}, {plain, "plain"}, {complementary, "complementary"}});
}

struct SequenceDesign {
  int width = 0, height = 0;  // projector resolution, px
  bool columns = true, rows = false;
  std::vector<double> periods_px = {};
  int steps = 3;
  GrayCode gray = GrayCode::none;
  bool gray_inverted = false;  // also project each bit inverted
  bool white_black = false;    // a white and a black image
  int ramp_levels = 0;         // equally spaced flat levels from black to white
  int bits = 8;
  bool dithered = false;
  double gray_cell_px = 0;  // cells of a Gray code by itself, with or without fringes; 0: as `gray` states
  std::vector<double> extra_periods_px = {};    // one image each, with a shift of 0
  std::vector<double> product_periods_px = {};  // `steps` shifts times `steps` shifts of the carrier, each
  double carrier_px = 0;                        // period of the products' second cosine
  // Micro phase shifting: `steps` shifts of this period and single images of others near it, in all `micro_images` per
  // axis (0: four more than the steps). 0 px: none.
  double micro_period_px = 0;
  int micro_images = 0;
  // Modulated phase shifting: `steps` shifts of this period and, with it as carrier, products with as many longer periods as
  // number its fringes. 0 px: none.
  double modulated_period_px = 0;
  // Exposure times of each pattern, relative to the rig's: one image each, one after the other. Empty: one of 1.
  std::vector<double> exposures = {};
  // One Gray code for each stripe width: that of the bit that coarser ones are combined with by XOR, twice its cells; 0: the
  // plain code. Empty: the plain code, unless long runs replace it.
  std::vector<double> gray_xor_px = {};
  bool gray_long_runs = false;  // a code whose bits have stripes of several cells, none much wider than the others
};

// Builds the sequence: fringes period by period, then the Gray code, coarsest bit first, then images of extra periods,
// then products period by period, in which the carrier's shifts vary fastest; columns before rows; flat images last.
// The images of micro and of modulated phase shifting precede all others. Throws Error if the sequence is empty, if a Gray
// code of fringe periods is requested without fringes, if no bit of the code has stripes of a gray_xor_px, if products lack a
// carrier, if too few images are left for micro phase shifting, or if two exposures are equal.
PatternSequence design_sequence(const SequenceDesign& design);

// Repeats each pattern at each exposure, relative to the rig's. Throws Error if one is not positive or occurs twice.
std::vector<Pattern> at_exposures(const std::vector<Pattern>& patterns, const std::vector<double>& exposures);

// Returns the same patterns at the rig's exposure, one image each.
PatternSequence at_one_exposure(const PatternSequence& sequence);

// Returns the patterns of a rig for which none are given: three steps of three periods along the columns, each an eighth of
// the previous one, of which the coarsest is a little wider than the projector.
PatternSequence default_sequence(int width, int height);

// Packs three grey images into one colour image (OpenCV's BGR) for a projector in black-and-white mode, which shows the
// colour channels one after the other as grey images [C III.A]. `order`, such as "RGB", gives the channel of each
// image.
cv::Mat3b packed_image(const std::vector<cv::Mat1b>& images, const std::string& order);

}  // namespace fringeslam
