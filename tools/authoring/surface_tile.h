// SPDX-License-Identifier: Apache-2.0
// Pictures of materials for a scene's page, which maps them onto objects as the simulator maps textures: along the axis of
// the object's frame closest to the normal, or by the mesh's texture coordinates.
#pragma once

#include <array>
#include <optional>
#include <string>

#include "core/types/options.h"
#include "sim/light/texture_images.h"
#include "sim/scene/material.h"

namespace fringeslam::tools {

// The continuation of a tile beyond its square.
enum class TileEdge { repeat, mirror, clamp };

constexpr auto choices(TileEdge) {
  using enum TileEdge;
  return std::to_array<Choice<TileEdge>>({{repeat, "repeat"}, {mirror, "mirror"}, {clamp, "clamp"}});
}

struct SurfaceTile {
  std::string png;       // gray, linear
  double size_m = 0;     // edge length
  double scale = 1;      // albedo relative to the material's mean where the picture is white
  bool centered = true;  // about the origin of the object's frame; otherwise a corner is there
  TileEdge edge = TileEdge::mirror;
};

// Returns the picture of a material; empty for a plain one. A grain is a section of its pattern through the plane z = 0, drawn
// for one object. Throws Error if the material's texture is no image.
std::optional<SurfaceTile> surface_tile(const sim::Material& material, sim::TextureImages& textures);

}  // namespace fringeslam::tools
