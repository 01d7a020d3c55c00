// SPDX-License-Identifier: Apache-2.0
// Counter-based random numbers (Philox 4x32-10, Random123): each number is a pure function of its address
// (seed, stack, image, pixel), independent of the drawing order and of the thread.
#pragma once

#include <Random123/philox.h>

#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <span>
#include <utility>

namespace fringeslam::sim {

// Purpose of a random stream; separates the streams that share a seed.
enum class Stream : uint32_t {
  sensor_noise = 1,
  placement = 2,
  shape = 3,
  views = 4,
  paths = 5,
  fixed_pattern = 6,
  air = 7,
  draws = 8,
  settling = 9,
  thermal_noise = 10,
  vibration = 11,
  building = 12,
  subsurface = 13,
  water = 14
};

class Philox {
 public:
  Philox(uint64_t seed, Stream stream, uint32_t a, uint32_t b = 0)
      : key_{{static_cast<uint32_t>(seed), static_cast<uint32_t>(seed >> 32)}},
        counter_{{0, static_cast<uint32_t>(stream), a, b}} {}

  // Returns two independent standard normal numbers for an address (Box-Muller).
  std::pair<double, double> normal_pair(uint32_t address) const {
    const auto block = at(address);
    const double radius = std::sqrt(-2 * std::log(open_unit(block[0], block[1])));
    const double angle = 2 * std::numbers::pi * open_unit(block[2], block[3]);
    return {radius * std::cos(angle), radius * std::sin(angle)};
  }

  // Returns four uniform numbers in (0, 1) for an address.
  std::array<double, 4> uniforms(uint32_t address) const {
    const auto block = at(address);
    std::array<double, 4> result;
    for (size_t i = 0; i < 4; ++i) result[i] = (static_cast<double>(block[i]) + 0.5) * 0x1p-32;
    return result;
  }

  // Returns the next uniform number in (0, 1), or in (low, high), of this object's sequence.
  double uniform() {
    const auto block = at(next_++);
    return open_unit(block[0], block[1]);
  }
  double uniform(double low, double high) { return low + (high - low) * uniform(); }

  // Derives a seed for another generator from a uniform number, or from the next number of this sequence.
  static uint32_t seed_from(double uniform) { return static_cast<uint32_t>(uniform * 4294967295.0); }
  uint32_t seed() { return seed_from(uniform()); }

 private:
  r123::Philox4x32::ctr_type at(uint32_t address) const {
    r123::Philox4x32::ctr_type counter = counter_;
    counter[0] = address;
    return r123::Philox4x32()(counter, key_);
  }
  // 53-bit number at the centre of its cell: never 0, so its logarithm is finite.
  static double open_unit(uint32_t high, uint32_t low) {
    const uint64_t bits = (static_cast<uint64_t>(high) << 21) ^ (low >> 11);
    return (static_cast<double>(bits) + 0.5) * 0x1p-53;
  }

  r123::Philox4x32::key_type key_;
  r123::Philox4x32::ctr_type counter_;
  uint32_t next_ = 0;
};

// Standard normal numbers for the pixels of one image, in single precision and row by row; each is a function of the
// key, row and column.
class NormalField {
 public:
  NormalField(uint64_t seed, Stream stream, uint32_t a, uint32_t b);
  void row(uint32_t row, std::span<float> values) const;

 private:
  uint32_t key_[2];
  uint32_t counter_[3];
};

}  // namespace fringeslam::sim
