// SPDX-License-Identifier: Apache-2.0
// Surface materials. A matt surface is Lambertian with a solid texture, i.e. an albedo defined at every point of the
// object frame; coats and metals add a glossy lobe (sim/light/gloss.h).
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
  std::string name = {};  // key in the scene file
  Grain grain = Grain::plain;
  double albedo = 0.5;    // mean
  double contrast = 0.3;  // peak deviation from the mean, as a fraction of the mean
  double grain_m = 0.01;  // size of the largest features; for bricks, the brick length
  // Calibration boards, printed on the plane z = 0 around its centre: numbers of inner corners or circles, their
  // spacing (within a row for asymmetric grids), the circle diameter, and the albedo of the print.
  int columns = 0, rows = 0;
  double spacing_m = 0.01, diameter_m = 0.005, print_albedo = 0.1;

  // Image texture instead of a grain: its luminance times `albedo`, projected onto the object along the axes of its
  // frame in tiles of `texture_m`.
  std::string texture = {};
  double texture_m = 0.1;

  // Glossy lobe (GGX): reflectance at normal incidence and roughness. A dielectric coat lies over the matt surface;
  // a metal uses its albedo as reflectance and has no diffuse component.
  double reflectance = 0;
  double roughness = 0.4;
  bool metal = false;

  // Thin pane of clear glass, which reflects and lets pass the light of both faces (sim/light/panes.h); `reflectance` is
  // that of a face.
  bool pane = false;

  // Transport mean free path of light below the surface, m; 0: opaque. A coat's reflectance gives the refractive index.
  double mean_free_path_m = 0;

  // Fine relief of this height and lateral size that perturbs the shading normal, not the geometry.
  double bump_m = 0, bump_size_m = 0.005;

  double emission_lux = 0;                   // luminous exitance
  std::optional<double> temperature_c = {};  // none: ambient temperature + warmer_k
  double warmer_k = 0;
  double emissivity = 0.95;  // in the long-wave infrared; the rest is reflected
  bool victim = false;       // true if objects of this material count as victims to be detected
  bool dust = true;          // true if the scene's dust settles on it

  // Evaluates the grain's albedo at points in the object frame (m).
  NoiseValues albedo_at(const NoisePoints& points_m, uint32_t seed) const;
};

}  // namespace fringeslam::sim
