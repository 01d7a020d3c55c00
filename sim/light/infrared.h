// SPDX-License-Identifier: Apache-2.0
// Heat radiation in the band of uncooled thermal cameras, 8 to 14 um. A black body's radiance in it is Planck's law
// integrated, by the series of Chang and Rhee (1984) for the share of sigma T^4 / pi below a wavelength:
//
//   F(z) = 15 / pi^4 sum_n exp(-n z) / n (z^3 + 3 z^2 / n + 6 z / n^2 + 6 / n^3),  z = h c / (wavelength k T)
#pragma once

namespace fringeslam::sim {

// Of a black body, W / (m^2 sr); temperatures from -250 to 2100 degrees C, the ends beyond.
double infrared_radiance(double temperature_c);

// The temperature of the black body that has this radiance: the inverse of infrared_radiance().
double apparent_temperature_c(double radiance);

}  // namespace fringeslam::sim
