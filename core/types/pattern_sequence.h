// SPDX-License-Identifier: Apache-2.0
// Pattern sequence: the images that a projector shows. core/patterns/patterns.h defines what each coding means.
#pragma once

#include <vector>

#include "core/types/options.h"

namespace fringeslam {

enum class Axis { columns, rows };  // the coded projector coordinate
enum class Coding { fringe, gray, flat, extra, product };

constexpr auto choices(Axis) { return std::to_array<Choice<Axis>>({{Axis::columns, "columns"}, {Axis::rows, "rows"}}); }

constexpr auto choices(Coding) {
  using enum Coding;
  return std::to_array<Choice<Coding>>(
      {{fringe, "fringe"}, {gray, "gray"}, {flat, "flat"}, {extra, "extra"}, {product, "product"}});
}

struct Pattern {
  Axis axis = Axis::columns;
  double period_px = 0;  // fringe, extra, product: period; gray: code cell width
  double shift_rad = 0;  // fringe, extra, product: delta
  int bits = 8;          // grey-level bit depth of the projector; 0: continuous intensity, for numerical studies
  Coding coding = Coding::fringe;
  bool inverted = false;  // gray: 1 - bit
  double level = 0;       // flat: 0 black to 1 white
  bool dithered = false;  // intermediate levels by error diffusion (1 bit: only black and white)
  double carrier_px = 0;  // product: period of the second cosine; gray: cells of the bit combined by XOR, 0: none
  // gray: bits of a code with long runs (core/patterns/long_run_code.h), and which one this is, from 0. 0 bits: the
  // reflected code, whose bit the cell width identifies.
  int code_bits = 0, code_bit = 0;
  double carrier_shift_rad = 0;  // product: its delta
  double exposure = 1;           // exposure time of the image, relative to the rig's
  bool operator==(const Pattern&) const = default;
};

struct PatternSequence {
  int width = 0, height = 0;  // projector image, px
  std::vector<Pattern> patterns = {};
  // Projector input level for equally spaced light levels from 0 to 1, to linearise a projector with a nonlinear
  // response. Empty: identity.
  std::vector<double> inverse_response = {};
  bool operator==(const PatternSequence&) const = default;
};

}  // namespace fringeslam
