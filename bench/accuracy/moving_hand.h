// SPDX-License-Identifier: Apache-2.0
// The ripple that motion leaves in the phase of a real moving hand, for three ways to decode its images.
#pragma once

#include <filesystem>
#include <optional>

namespace fringeslam::bench {

// Ripple of one harmonic of the phase, rms over windows, rad. The shape of the surface leaks into the amplitude of a tile
// with any sign; motion gives all tiles of a hand the same sign, so its ripple remains in their mean.
struct Ripple {
  double mean_of_tiles_rad = 0, each_tile_rad = 0;
};

struct HandRipples {
  int windows = 0, tiles = 0;
  // Of 2 phi: motion. Of 4 phi: the third harmonic of the fringes.
  struct Method {
    Ripple second, fourth;
  } plain, binomial, rolling;
};

// Measures the ripples of all third windows of the capture moving_hand: 60 images 00.png to 59.png, 640 x 480, of a hand
// in motion, image k with the shift k pi/2 (Zhang, Zhu and Liu, ECCV 2024). Plain: four images. Binomial: binomial
// self-compensation of order 4, eight images. Rolling: decode_rolling_window(). Nullopt if the folder does not exist.
std::optional<HandRipples> measure_hand_ripples(const std::filesystem::path& folder);

// Returns the folder moving_hand in $FRINGESLAM_CAPTURES, or else in ../shared/captures beside `source_folder`.
std::filesystem::path moving_hand_folder(const std::filesystem::path& source_folder);

}  // namespace fringeslam::bench
