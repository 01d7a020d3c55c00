// SPDX-License-Identifier: Apache-2.0
// Temperatures as recorded by radiometric thermal cameras: hundredths of a kelvin in 16 bits.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace fringeslam {

constexpr double kKelvinOfZeroCelsius = 273.15;
constexpr double kColdestRecorded_c = -kKelvinOfZeroCelsius, kHottestRecorded_c = 655.35 - kKelvinOfZeroCelsius;

// Rounds to the nearest value and clamps to the 16-bit range.
inline uint16_t centikelvin(double temperature_c) {
  return static_cast<uint16_t>(std::clamp(std::round(100 * (temperature_c + kKelvinOfZeroCelsius)), 0.0, 65535.0));
}
inline float celsius(uint16_t centikelvin) {
  return static_cast<float>(0.01 * static_cast<double>(centikelvin) - kKelvinOfZeroCelsius);
}

}  // namespace fringeslam
