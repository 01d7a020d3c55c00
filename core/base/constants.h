// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <limits>
#include <numbers>

namespace fringeslam {

inline constexpr double kPi = std::numbers::pi;
inline constexpr double kTwoPi = 2 * std::numbers::pi;
inline constexpr float kTwoPiFloat = 2 * std::numbers::pi_v<float>;
// Marks pixels without a value in float images; converts to double's NaN.
inline constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();

}  // namespace fringeslam
