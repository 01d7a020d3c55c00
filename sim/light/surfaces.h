// SPDX-License-Identifier: Apache-2.0
// Surface properties at ray hits: the object's material with texture, small-scale relief and settled dust
// (docs/method.md, section 12.1).
#pragma once

#include <memory>

#include "sim/light/effects.h"
#include "sim/light/gloss.h"
#include "sim/light/ray_scene.h"

namespace fringeslam::sim {

struct SurfacePacket {
  alignas(64) float albedo[kPacket];  // of the diffuse lobe
  float reflectance[kPacket];         // of the glossy lobe at normal incidence; 0: no glossy lobe
  float alpha[kPacket];               // squared roughness of the glossy lobe
  float emission_lux[kPacket];
  float dust_cover[kPacket];  // fraction covered by settled dust
  Points normal;              // shading normal; unit, towards the viewer
  LaneMask glossy = 0;
  // Lanes whose diffuse light, or the part of it that settled dust does not cover, passes below the surface; the members
  // below are defined for these lanes.
  LaneMask translucent = 0;
  float inner_albedo[kPacket];      // part of `albedo`: light from below the surface
  float profile_length_m[kPacket];  // sim/light/subsurface.h, eq. 1
  float far_shift_m[kPacket];       // eq. 2: c l / n
  Reflection reflection(int lane) const {
    return {static_cast<double>(albedo[lane]), static_cast<double>(reflectance[lane]),
            static_cast<double>(alpha[lane])};
  }
};

class Surfaces {
 public:
  // Loads the textures; throws Error if one cannot be read.
  Surfaces(const Scene& scene, const Effects& effects);
  ~Surfaces();
  Surfaces(Surfaces&&) noexcept;

  // Evaluates the surface at the lanes that hit; `footprint_m`: width of a sample's footprint at 1 m, m.
  void at(const HitPacket& hits, double footprint_m, SurfacePacket& result) const;

  const Material& material(int object) const;
  // True if any object is translucent.
  bool translucent() const;
  // Returns the surface temperature of an object, degrees C.
  double temperature_c(int object) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace fringeslam::sim
