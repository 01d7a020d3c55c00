// SPDX-License-Identifier: Apache-2.0
#include "tools/authoring/surface_tile.h"

#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>

#include "core/io/files.h"
#include "sim/scene/noise.h"

namespace fringeslam::tools {

namespace {

constexpr int kWidth = 256, kBoardWidth = 512;  // px

uchar level(double share) { return static_cast<uchar>(std::lround(255 * std::clamp(share, 0.0, 1.0))); }

bool is_board(sim::Grain grain) {
  return grain == sim::Grain::checkerboard || grain == sim::Grain::circles || grain == sim::Grain::asymmetric_circles;
}

SurfaceTile texture_tile(const sim::Material& material, sim::TextureImages& textures) {
  const size_t texture = textures.add(material.texture);
  const auto at = [](int i) { return (static_cast<float>(i) + 0.5f) / kWidth; };
  cv::Mat1b picture(kWidth, kWidth);
  for (int row = 0; row < kWidth; ++row) {
    for (int col = 0; col < kWidth; ++col)
      picture(row, col) = level(static_cast<double>(textures.luminance(texture, at(col), at(row), 1.0f / kWidth)));
  }
  return {png_bytes(picture), material.texture_m, 1, false, TileEdge::repeat};
}

// Albedo on a square about the origin of the plane z = 0, y upwards.
cv::Mat1b section(const sim::Material& material, int width, double size_m, double white) {
  cv::Mat1b picture(width, width);
  const auto position_m = [&](int i) { return static_cast<float>(((i + 0.5) / width - 0.5) * size_m); };
  for (int row = 0; row < width; ++row) {
    for (int first = 0; first < width; first += sim::kNoiseLanes) {
      sim::NoisePoints points{};
      for (int i = 0; i < sim::kNoiseLanes; ++i) {
        points.x[i] = position_m(first + i);
        points.y[i] = -position_m(row);
      }
      const sim::NoiseValues albedo = material.albedo_at(points, 0);
      for (int i = 0; i < sim::kNoiseLanes; ++i)
        picture(row, first + i) = level(static_cast<double>(albedo.value[i]) / white);
    }
  }
  return picture;
}

}  // namespace

std::optional<SurfaceTile> surface_tile(const sim::Material& material, sim::TextureImages& textures) {
  constexpr double kFeatures = 10;  // of the grain's largest, across a tile
  if (!material.texture.empty()) return texture_tile(material, textures);
  if (material.albedo <= 0) return std::nullopt;
  if (is_board(material.grain)) {
    const double size_m = (std::max(material.columns, material.rows) + 3) * material.spacing_m;
    const double white = std::max(material.albedo, material.print_albedo);
    return SurfaceTile{png_bytes(section(material, kBoardWidth, size_m, white)), size_m, white / material.albedo, true,
                       TileEdge::clamp};
  }
  if (material.grain == sim::Grain::plain || material.contrast <= 0) return std::nullopt;
  const double size_m = kFeatures * material.grain_m, white = material.albedo * (1 + std::min(material.contrast, 1.0));
  return SurfaceTile{png_bytes(section(material, kWidth, size_m, white)), size_m, white / material.albedo, true,
                     TileEdge::mirror};
}

}  // namespace fringeslam::tools
