// SPDX-License-Identifier: Apache-2.0
// Real images of a moving hand: the ripple that motion leaves in the phase.
#include <cstdio>

#include "bench/accuracy/moving_hand.h"
#include "bench/row.h"

namespace fringeslam::bench {

namespace {

void print(const char* method, const HandRipples::Method& ripples) {
  std::fprintf(stderr, "  %-9s 2 phi: %6.2f mrad (each tile: %6.2f)   4 phi: %6.2f mrad (each tile: %6.2f)\n", method,
               1e3 * ripples.second.mean_of_tiles_rad, 1e3 * ripples.second.each_tile_rad,
               1e3 * ripples.fourth.mean_of_tiles_rad, 1e3 * ripples.fourth.each_tile_rad);
}

std::vector<Row> hand_rows(const Context&) {
  const std::filesystem::path folder = moving_hand_folder(FRINGESLAM_SOURCE);
  const std::optional<HandRipples> found = measure_hand_ripples(folder);
  if (!found) {
    std::fprintf(stderr,
                 "  skipped: %s does not exist; set FRINGESLAM_CAPTURES to the folder that contains moving_hand/\n",
                 folder.c_str());
    return {};
  }
  print("plain", found->plain);
  print("binomial", found->binomial);
  print("rolling", found->rolling);
  const double ripple = found->rolling.second.mean_of_tiles_rad;
  return {bound_row("moving.hand.plain", ripple / found->plain.second.mean_of_tiles_rad, found->windows, "x", 1.0 / 3,
                    Limit::most),
          bound_row("moving.hand.binomial", ripple / found->binomial.second.mean_of_tiles_rad, found->windows, "x", 1,
                    Limit::most)};
}

}  // namespace

std::vector<Item> moving_hand_items() {
  return {{{"moving.hand.plain", "moving.hand.binomial"},
           "ripple of rolling windows of a real moving hand, relative to plain and to binomial decoding",
           hand_rows}};
}

}  // namespace fringeslam::bench
