// SPDX-License-Identifier: Apache-2.0
#include "sim/light/infrared.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "core/types/centikelvin.h"

namespace fringeslam::sim {

namespace {

constexpr double kShortest_m = 8e-6, kLongest_m = 14e-6;
constexpr double kColdest_c = -250, kHottest_c = 2100, kStep_k = 0.5;  // table range and step

// Fraction of the total black-body radiance below a wavelength.
double share_below(double wavelength_m, double temperature_k) {
  constexpr double kSecondRadiationConstant_m_k = 0.01438776877;
  constexpr double kNegligible = 1e-15;
  const double z = kSecondRadiationConstant_m_k / (wavelength_m * temperature_k);
  double sum = 0;
  for (int n = 1; std::exp(-n * z) > kNegligible; ++n)
    sum += std::exp(-n * z) / n * (z * z * z + 3 * z * z / n + 6 * z / (n * n) + 6.0 / (n * n * n));
  return 15 / std::pow(std::numbers::pi, 4) * sum;
}

double integrated_radiance(double temperature_c) {
  constexpr double kStefanBoltzmann = 5.670374419e-8;  // W / (m^2 K^4)
  const double kelvin = temperature_c + kKelvinOfZeroCelsius;
  return kStefanBoltzmann * std::pow(kelvin, 4) / std::numbers::pi *
         (share_below(kLongest_m, kelvin) - share_below(kShortest_m, kelvin));
}

// Radiances at equal temperature steps; linear interpolation between them errs by less than a millikelvin.
const std::vector<double>& table() {
  static const std::vector<double> radiances = [] {
    std::vector<double> all;
    const int steps = static_cast<int>((kHottest_c - kColdest_c) / kStep_k);
    for (int i = 0; i <= steps; ++i) all.push_back(integrated_radiance(kColdest_c + i * kStep_k));
    return all;
  }();
  return radiances;
}

}  // namespace

double black_body_radiance(double temperature_c) {
  const std::vector<double>& radiances = table();
  const double at = (std::clamp(temperature_c, kColdest_c, kHottest_c) - kColdest_c) / kStep_k;
  const size_t i = std::min(static_cast<size_t>(at), radiances.size() - 2);
  return radiances[i] + (at - static_cast<double>(i)) * (radiances[i + 1] - radiances[i]);
}

double apparent_temperature_c(double radiance) {
  const std::vector<double>& radiances = table();
  const auto above = std::upper_bound(radiances.begin() + 1, radiances.end() - 1, radiance);
  const auto i = static_cast<size_t>(above - radiances.begin()) - 1;
  const double share = (radiance - radiances[i]) / (radiances[i + 1] - radiances[i]);
  return kColdest_c + kStep_k * (static_cast<double>(i) + std::clamp(share, 0.0, 1.0));
}

}  // namespace fringeslam::sim
