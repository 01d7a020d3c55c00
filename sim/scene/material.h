// SPDX-License-Identifier: Apache-2.0
// What surfaces are made of. A matt surface is Lambertian with a solid texture, that is an albedo at every point of
// the object's own frame; a coat or a metal adds a glossy lobe (sim/light/gloss.h).
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "sim/scene/noise.h"

namespace fringeslam::sim {

enum class Grain {
  plain,
  cardboard,
  foam,
  wood,
  stone,
  concrete,
  paper,
  brick,
  metal,
  checkerboard,
  circles,
  asymmetric_circles
};

struct Material {
  std::string name = {};  // in its scene file
  Grain grain = Grain::plain;
  double albedo = 0.5;    // mean
  double contrast = 0.3;  // peak deviation from the mean, as a fraction of it
  double grain_m = 0.01;  // size of the largest features; of a brick its length
  // Calibration boards, printed on the plane z = 0 about its middle: inner corners or circles, their spacing (of an
  // asymmetric grid within a row), the circles' diameter, and the albedo of the print.
  int columns = 0, rows = 0;
  double spacing_m = 0.01, diameter_m = 0.005, print_albedo = 0.1;

  // An image instead of a grain: its luminance times `albedo`, laid onto the object from the six sides of its frame,
  // tiles of `texture_m`.
  std::string texture = {};
  double texture_m = 0.1;

  // Glossy lobe (GGX): reflectance at normal incidence and roughness. A dielectric coat lies over the matt surface;
  // a metal reflects by its albedo and has nothing matt.
  double reflectance = 0;
  double roughness = 0.4;
  bool metal = false;

  // Small relief that turns the shading normal, of this height and lateral size.
  double bump_m = 0, bump_size_m = 0.005;

  double emission_lux = 0;                   // luminous exitance
  std::optional<double> temperature_c = {};  // none: that of the surroundings, and this much more
  double warmer_k = 0;
  double emissivity = 0.95;  // in the long-wave infrared; the rest is reflected
  bool victim = false;       // whether what is made of it is to be found
  bool dust = true;          // whether the scene's dust settles on it

  // Albedo of the grain at points of the object's frame (m).
  NoiseValues albedo_at(const NoisePoints& points_m, uint32_t seed) const;
};

}  // namespace fringeslam::sim
