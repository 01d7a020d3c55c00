// SPDX-License-Identifier: Apache-2.0
// What the light meets where a ray ends: the material of the object there, with its texture, its small relief and the
// dust that lies on it.
#pragma once

#include <memory>

#include "sim/light/effects.h"
#include "sim/light/gloss.h"
#include "sim/light/ray_world.h"

namespace fringeslam::sim {

struct SurfacePacket {
  alignas(64) float albedo[kPacket];  // of the matt lobe
  float reflectance[kPacket];         // of the glossy lobe at normal incidence; 0: none
  float alpha[kPacket];               // its roughness, squared
  float emission_lux[kPacket];
  float dust_cover[kPacket];  // share that settled dust hides
  Points normal;              // for shading; unit, towards the viewer
  Lanes glossy = 0;
  Reflection reflection(int lane) const {
    return {static_cast<double>(albedo[lane]), static_cast<double>(reflectance[lane]),
            static_cast<double>(alpha[lane])};
  }
};

class Surfaces {
 public:
  // Throws Error when a texture cannot be read.
  Surfaces(const Scene& scene, const Effects& effects);
  ~Surfaces();
  Surfaces(Surfaces&&) noexcept;

  // At the lanes that hit; `footprint_m`: the width of what one sample stands for, across the ray at 1 m.
  void at(const HitPacket& hits, double footprint_m, SurfacePacket& result) const;

  const Material& material(int object) const;
  double temperature_c(int object) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace fringeslam::sim
