// SPDX-License-Identifier: Apache-2.0
#include "sim/light/surfaces.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <bit>
#include <cmath>
#include <numbers>
#include <optional>

#include "sim/light/subsurface.h"
#include "sim/light/texture_images.h"
#include "sim/random.h"

namespace fringeslam::sim {

namespace {

struct Covering {
  Material material;
  Pose object_from_world;
  uint32_t seed = 0;
  const Mesh* mesh = nullptr;
  std::optional<size_t> texture;  // of TextureImages
};

float smoothstep(float low, float high, float x) {
  const float t = std::clamp((x - low) / (high - low), 0.0f, 1.0f);
  return t * t * (3 - 2 * t);
}

NoisePoints transformed(const Pose& pose, const Points& points, double scale, double offset) {
  const Eigen::Matrix3d r = scale * pose.rotation;
  const Eigen::Vector3d t = scale * pose.translation + Eigen::Vector3d::Constant(offset);
  NoisePoints result;
  for (int i = 0; i < kPacket; ++i) {
    const double x = points.x[i], y = points.y[i], z = points.z[i];
    result.x[i] = static_cast<float>(r(0, 0) * x + r(0, 1) * y + r(0, 2) * z + t.x());
    result.y[i] = static_cast<float>(r(1, 0) * x + r(1, 1) * y + r(1, 2) * z + t.y());
    result.z[i] = static_cast<float>(r(2, 0) * x + r(2, 1) * y + r(2, 2) * z + t.z());
  }
  return result;
}

}  // namespace

struct Surfaces::Impl {
  std::vector<Covering> coverings;
  Effects effects;
  Dust dust;
  Water water;
  uint32_t water_seed = 0;
  float wet_above = 0;  // patch noise of wet points
  double surroundings_c = 20;
  TextureImages textures;

  // Texture coordinates of a hit, and the length of one metre of surface in texture coordinates.
  struct TexturePoint {
    float s = 0, t = 0, per_m = 0;
  };

  static TexturePoint by_mesh(const Mesh& mesh, const HitPacket& hits, int lane) {
    const Eigen::Vector3i& t = mesh.triangles[static_cast<size_t>(hits.triangle[lane])];
    const auto coordinate = [&](int i) { return mesh.texture_coordinates[static_cast<size_t>(t[i])]; };
    const auto vertex = [&](int i) { return mesh.vertices[static_cast<size_t>(t[i])]; };
    const Eigen::Vector2f a = coordinate(1) - coordinate(0), b = coordinate(2) - coordinate(0);
    const Eigen::Vector2f at = coordinate(0) + hits.u[lane] * a + hits.v[lane] * b;
    const double area = (vertex(1) - vertex(0)).cross(vertex(2) - vertex(0)).norm();
    const double share = std::abs(static_cast<double>(a.x() * b.y() - a.y() * b.x()));
    return {at.x(), 1 - at.y(), static_cast<float>(std::sqrt(share / area))};
  }

  // Box mapping: projects the texture along the object axis closest to the surface normal.
  static TexturePoint by_side(const Covering& covering, const HitPacket& hits, int lane) {
    const Eigen::Vector3d point = covering.object_from_world * hits.point.at(lane);
    const Eigen::Vector3d normal = covering.object_from_world.rotation * hits.normal.at(lane);
    int axis = 0;
    normal.cwiseAbs().maxCoeff(&axis);
    const Eigen::Vector3d tiles = point / covering.material.texture_m;
    return {static_cast<float>(tiles[(axis + 1) % 3]), static_cast<float>(1 - tiles[(axis + 2) % 3]),
            static_cast<float>(1 / covering.material.texture_m)};
  }

  float texel(const Covering& covering, const HitPacket& hits, int lane, double footprint_m) const {
    const TexturePoint at = covering.mesh->texture_coordinates.empty() ? by_side(covering, hits, lane)
                                                                       : by_mesh(*covering.mesh, hits, lane);
    const float width = static_cast<float>(footprint_m) * at.per_m;
    return textures.luminance(*covering.texture, at.s, at.t, width);
  }

  // Evaluates the lanes of one object.
  void cover(const Covering& covering, LaneMask lanes, const HitPacket& hits, double footprint_m,
             SurfacePacket& result) const {
    const Material& m = covering.material;
    NoiseValues albedo;
    if (covering.texture) {
      for (int i = 0; i < kPacket; ++i) {
        if (!has(lanes, i)) continue;
        const float value = texel(covering, hits, i, hits.distance[i] * footprint_m);
        albedo.value[i] = std::clamp(static_cast<float>(m.albedo) * value, 0.0f, 1.0f);
      }
    } else {
      albedo = m.albedo_at(transformed(covering.object_from_world, hits.point, 1, 0), covering.seed);
    }
    const bool wets = effects.water && water.cover > 0;
    const bool glossy = effects.gloss && (m.metal || m.reflectance > 0 || wets);
    for (int i = 0; i < kPacket; ++i) {
      if (!has(lanes, i)) continue;
      result.albedo[i] = glossy && m.metal ? 0 : albedo.value[i];
      result.reflectance[i] = !glossy ? 0 : m.metal ? albedo.value[i] : static_cast<float>(m.reflectance);
      result.alpha[i] = static_cast<float>(m.roughness * m.roughness);
      result.emission_lux[i] = static_cast<float>(m.emission_lux);
      result.dust_cover[i] = 0;
    }
    if (effects.relief && m.bump_m > 0) roughen(covering, lanes, hits, result);
    if (wets) wet(m, lanes, hits, albedo, result);
    if (effects.dust && dust.cover > 0 && m.dust) settle(lanes, hits, covering.seed, result);
    if (effects.subsurface && m.mean_free_path_m > 0) lead_below(m, lanes, albedo, result);
    if (glossy) {
      for (int i = 0; i < kPacket; ++i)
        result.glossy |= static_cast<LaneMask>(has(lanes, i) && result.reflectance[i] > 0) << i;
    }
  }

  NoiseValues water_noise(const NoisePoints& at) const { return fractal_noise(at, 3, water_seed); }

  // The quantile of the patch noise that leaves the wet share above it.
  float least_wet_noise() const {
    constexpr int kPackets = 512;
    std::vector<float> values;
    for (int k = 0; k < kPackets; ++k) {
      NoisePoints at;
      for (int i = 0; i < kPacket; ++i) {
        const auto n = static_cast<float>(k * kPacket + i);
        at.x[i] = 0.754877f * n, at.y[i] = 0.569840f * n, at.z[i] = 0.437016f * n;
      }
      const NoiseValues noise = water_noise(at);
      values.insert(values.end(), noise.value, noise.value + kPacket);
    }
    const double rank =
        std::min((1 - water.cover) * static_cast<double>(values.size()), static_cast<double>(values.size() - 1));
    const auto at = values.begin() + static_cast<std::ptrdiff_t>(rank);
    std::nth_element(values.begin(), at, values.end());
    return water.cover == 1 ? -2 : *at;
  }

  // Covers patches with a film of water, which smooths the relief, and with puddles where the surface is level.
  void wet(const Material& m, LaneMask lanes, const HitPacket& hits, NoiseValues& albedo, SurfacePacket& result) const {
    // Turned, because the noise has a greater variance on planes of its lattice than between them.
    const Pose turned{Eigen::AngleAxisd(0.9, Eigen::Vector3d(1, 2, 3).normalized()).toRotationMatrix(),
                      Eigen::Vector3d::Zero()};
    const NoiseValues patches = water_noise(transformed(turned, hits.point, 1 / water.patch_m, 900));
    const double level = std::cos(water.puddle_slope_deg * std::numbers::pi / 180);
    constexpr double kPuddleRoughness = 0.05, kFilmRelief = 0.5;
    for (int i = 0; i < kPacket; ++i) {
      if (!has(lanes, i) || patches.value[i] < wet_above) continue;
      const Eigen::Vector3d n = hits.normal.at(i);
      const bool puddle = n.dot(water.up) >= level;
      if (!m.metal) {
        albedo.value[i] = static_cast<float>(wet_albedo(static_cast<double>(albedo.value[i])));
        result.albedo[i] = albedo.value[i];
        if (effects.gloss) result.reflectance[i] = static_cast<float>(kWaterReflectance);
      }
      const double roughness = puddle ? kPuddleRoughness : water.roughness;
      if (!m.metal || puddle) result.alpha[i] = static_cast<float>(roughness * roughness);
      const Eigen::Vector3d rough = result.normal.at(i);
      result.normal.set(i, puddle ? n : (n + kFilmRelief * (rough - n)).normalized());
    }
  }

  // Assigns the diffuse light that settled dust does not cover to paths below the surface.
  void lead_below(const Material& m, LaneMask lanes, const NoiseValues& albedo, SurfacePacket& result) const {
    const double index = effects.gloss ? refractive_index(m.reflectance) : 1;
    for (int i = 0; i < kPacket; ++i) {
      if (!has(lanes, i)) continue;
      result.inner_albedo[i] = albedo.value[i] * (1 - result.dust_cover[i]);
      const auto a = static_cast<double>(albedo.value[i]);
      result.profile_length_m[i] = static_cast<float>(profile_length_m(a, m.mean_free_path_m));
      result.far_shift_m[i] = static_cast<float>(far_shift_m(a, m.mean_free_path_m) / index);
    }
    result.translucent |= lanes;
  }

  // Bump mapping: shading normal n - grad h of the height field h = bump * noise, with the gradient taken along the
  // surface.
  void roughen(const Covering& covering, LaneMask lanes, const HitPacket& hits, SurfacePacket& result) const {
    const Material& m = covering.material;
    const NoisePoints p = transformed(covering.object_from_world, hits.point, 1 / m.bump_size_m, 500);
    constexpr float kStep = 0.02f;
    constexpr int kOctaves = 3;
    NoisePoints px = p, py = p, pz = p;
    for (int i = 0; i < kPacket; ++i) px.x[i] += kStep, py.y[i] += kStep, pz.z[i] += kStep;
    const uint32_t seed = covering.seed + 977;
    const NoiseValues h = fractal_noise(p, kOctaves, seed), hx = fractal_noise(px, kOctaves, seed),
                      hy = fractal_noise(py, kOctaves, seed), hz = fractal_noise(pz, kOctaves, seed);
    const double slope = m.bump_m / (m.bump_size_m * static_cast<double>(kStep));
    const Eigen::Matrix3d world_from_object = covering.object_from_world.rotation.transpose();
    for (int i = 0; i < kPacket; ++i) {
      if (!has(lanes, i)) continue;
      const Eigen::Vector3d gradient =
          slope * (world_from_object *
                   Eigen::Vector3f(hx.value[i] - h.value[i], hy.value[i] - h.value[i], hz.value[i] - h.value[i])
                       .cast<double>());
      const Eigen::Vector3d n = hits.normal.at(i);
      result.normal.set(i, (n - (gradient - n * n.dot(gradient))).normalized());
    }
  }

  // Covers upward-facing surfaces with patchy dust.
  void settle(LaneMask lanes, const HitPacket& hits, uint32_t seed, SurfacePacket& result) const {
    NoisePoints p;
    constexpr double kPatch = 0.004;  // m
    for (int i = 0; i < kPacket; ++i) {
      p.x[i] = static_cast<float>(hits.point.x[i] / kPatch) + 300;
      p.y[i] = static_cast<float>(hits.point.y[i] / kPatch) + 300;
      p.z[i] = static_cast<float>(hits.point.z[i] / kPatch) + 300;
    }
    const NoiseValues patches = fractal_noise(p, 3, seed + 31);
    const auto least = static_cast<float>(std::cos(dust.max_slope_deg * std::numbers::pi / 180));
    for (int i = 0; i < kPacket; ++i) {
      if (!has(lanes, i)) continue;
      const auto upward = static_cast<float>(hits.normal.at(i).dot(dust.up));
      const float thickness = static_cast<float>(dust.cover) * smoothstep(least, 1, upward);
      // The noise has zero mean, so that its mean is the thickness.
      const float covered = thickness + patches.value[i] * std::min(thickness / 3, 1 - thickness);
      result.albedo[i] += covered * (static_cast<float>(dust.albedo) - result.albedo[i]);
      result.reflectance[i] *= 1 - covered;
      result.dust_cover[i] = covered;
    }
  }
};

Surfaces::Surfaces(const Scene& scene, const Effects& effects) : impl_(std::make_unique<Impl>()) {
  impl_->effects = effects;
  impl_->dust = scene.dust;
  impl_->water = scene.water;
  impl_->water_seed = Philox(scene.seed, Stream::water, 0).seed();
  if (scene.water.cover > 0) impl_->wet_above = impl_->least_wet_noise();
  impl_->surroundings_c = scene.surroundings_c;
  for (const Object& object : scene.objects) {
    Covering covering{object.material, object.world_from_object.inverse(), object.texture_seed, object.mesh.get(), {}};
    if (!object.material.texture.empty()) covering.texture = impl_->textures.add(object.material.texture);
    impl_->coverings.push_back(std::move(covering));
  }
}

Surfaces::~Surfaces() = default;
Surfaces::Surfaces(Surfaces&&) noexcept = default;

void Surfaces::at(const HitPacket& hits, double footprint_m, SurfacePacket& result) const {
  result.normal = hits.normal;
  result.glossy = 0;
  result.translucent = 0;
  if (hits.hit != kAllLanes) {  // lanes without a hit contribute no light
    std::fill_n(result.albedo, kPacket, 0.0f);
    std::fill_n(result.reflectance, kPacket, 0.0f);
    std::fill_n(result.emission_lux, kPacket, 0.0f);
    std::fill_n(result.dust_cover, kPacket, 0.0f);
  }
  LaneMask left = hits.hit;
  while (left != 0) {
    const int object = hits.object[std::countr_zero(left)];
    LaneMask same = 0;
    for (int i = 0; i < kPacket; ++i) same |= static_cast<LaneMask>(has(left, i) && hits.object[i] == object) << i;
    impl_->cover(impl_->coverings[static_cast<size_t>(object)], same, hits, footprint_m, result);
    left &= ~same;
  }
}

const Material& Surfaces::material(int object) const { return impl_->coverings[static_cast<size_t>(object)].material; }

bool Surfaces::translucent() const {
  return impl_->effects.subsurface && std::any_of(impl_->coverings.begin(), impl_->coverings.end(),
                                                  [](const Covering& c) { return c.material.mean_free_path_m > 0; });
}

double Surfaces::temperature_c(int object) const {
  const Material& m = material(object);
  return m.temperature_c.value_or(impl_->surroundings_c + m.warmer_k);
}

}  // namespace fringeslam::sim
