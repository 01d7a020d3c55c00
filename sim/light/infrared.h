// SPDX-License-Identifier: Apache-2.0
// Thermal radiation in the band of uncooled thermal cameras, 8 to 14 um (docs/method.md, section 10). The black-body
// radiance is Planck's law integrated over the band with the series of Chang and Rhee (1984) for the fraction of
// sigma T^4 / pi below a wavelength:
//
//   F(z) = 15 / pi^4 sum_n exp(-n z) / n (z^3 + 3 z^2 / n + 6 z / n^2 + 6 / n^3),  z = h c / (wavelength k T)
#pragma once

namespace fringeslam::sim {

// Returns the in-band radiance of a black body, W / (m^2 sr); temperatures are clamped to -250 to 2100 degrees C.
double black_body_radiance(double temperature_c);

// Returns the temperature, degrees C, of the black body with this in-band radiance; inverse of black_body_radiance().
double apparent_temperature_c(double radiance);

}  // namespace fringeslam::sim
