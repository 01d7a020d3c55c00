// SPDX-License-Identifier: Apache-2.0
#include "sim/preview/overview.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "core/base/parallel.h"
#include "sim/light/beam.h"
#include "sim/light/photometry.h"
#include "sim/light/surfaces.h"

namespace fringeslam::sim {

namespace {

constexpr int kBlock = 4;    // px; a packet covers a block of 4 x 4 pixels
constexpr int kPerSide = 2;  // samples per pixel along each axis
constexpr int kSkyRays = 4;  // per sample
constexpr double kAmbient = 0.08, kSky = 0.4, kLamp = 0.6, kProjector = 0.48;
constexpr double kGamma = 2.2;
const Eigen::Array3f kWarm(0.25f, 0.62f, 1.0f);  // BGR
const Eigen::Array3f kNeutral(0.95f, 0.99f, 1.0f);

Effects shown_effects() {
  Effects effects = Effects::none();
  effects.relief = effects.dust = effects.water = true;
  return effects;
}

// Cosine-distributed sky directions on a Fibonacci spiral, divided among the samples of a pixel.
std::vector<Eigen::Vector3d> sky_directions(const Eigen::Vector3d& up) {
  constexpr int kCount = kSkyRays * kPerSide * kPerSide;
  const Eigen::Vector3d side = up.unitOrthogonal(), front = up.cross(side);
  std::vector<Eigen::Vector3d> directions(kCount);
  for (int i = 0; i < kCount; ++i) {
    const double radius = std::sqrt((i + 0.5) / kCount), angle = 2.399963229728653 * i;
    const Eigen::Vector3d direction =
        std::sqrt(1 - radius * radius) * up + radius * (std::cos(angle) * side + std::sin(angle) * front);
    directions[static_cast<size_t>(i % (kPerSide * kPerSide) * kSkyRays + i / (kPerSide * kPerSide))] = direction;
  }
  return directions;
}

// Lighting of surface points, as the colour that a white surface would have.
class Light {
 public:
  Light(const Scene& scene, const RayScene& world, const Viewpoint& viewpoint)
      : world_(world),
        up_(viewpoint.up),
        sky_(sky_directions(viewpoint.up)),
        beam_(scene.rig, Effects::none(), world_from_camera(scene, 0)) {
    const Eigen::Matrix3d& axes = viewpoint.world_from_camera.rotation;
    to_lamp_ = (-0.75 * axes.col(0) - 0.35 * axes.col(2) + 1.1 * up_).normalized();
    reach_m_ = 0.35 * viewpoint.interest_m;
    // In a cutaway scene, the removed roof must not shadow the interior.
    lamp_reach_m_ = viewpoint.window ? reach_m_ : std::numeric_limits<double>::infinity();
    reference_lux_ = projector_lux_at_1m(scene.rig);
  }

  void on(const HitPacket& hits, const SurfacePacket& surface, int sample, Eigen::Array3f* light) const {
    const Points lifted = RayScene::lifted(hits);
    float sky[kPacket] = {};
    for (int k = 0; k < kSkyRays; ++k) {
      const Eigen::Vector3d& direction = sky_[static_cast<size_t>(sample * kSkyRays + k)];
      const auto open = openness(lifted, hits, direction, reach_m_);
      for (int i = 0; i < kPacket; ++i) {
        // Wrapped cosine, so that vertical walls receive half of the sky light.
        const double cosine = 0.5 + 0.5 * surface.normal.at(i).dot(direction);
        sky[i] += static_cast<float>(cosine) * open[static_cast<size_t>(i)] / kSkyRays;
      }
    }
    const auto lamp = openness(lifted, hits, to_lamp_, lamp_reach_m_);
    const auto projector = projected(hits, surface, lifted);
    for (int i = 0; i < kPacket; ++i) {
      const auto to_lamp = static_cast<float>(std::max(0.0, surface.normal.at(i).dot(to_lamp_)));
      const float plain = static_cast<float>(kAmbient) + static_cast<float>(kSky) * sky[i] +
                          static_cast<float>(kLamp) * to_lamp * lamp[static_cast<size_t>(i)];
      light[i] = plain * kNeutral + static_cast<float>(kProjector) * projector[static_cast<size_t>(i)] * kWarm;
    }
  }

  // Returns the brightness of an emitting surface.
  float glow(float emission_lux) const { return std::min(1.0f, emission_lux / static_cast<float>(reference_lux_) * 3); }

 private:
  using Values = std::array<float, kPacket>;

  // Returns 1 where nothing is hit within `reach_m`; otherwise less, in proportion to the hit distance.
  Values openness(const Points& lifted, const HitPacket& hits, const Eigen::Vector3d& direction, double reach_m) const {
    RayPacket rays;
    rays.origin = lifted;
    for (int i = 0; i < kPacket; ++i) {
      rays.direction.set(i, direction);
      if (has(hits.hit, i) && hits.normal.at(i).dot(direction) > 0) rays.active |= 1u << i;
    }
    Values open{};
    if (rays.active == 0) return open;
    HitPacket met;
    world_.trace(rays, met);
    for (int i = 0; i < kPacket; ++i) {
      if (!has(rays.active, i)) continue;
      const bool free = !has(met.hit, i) || met.distance[i] >= reach_m;
      open[static_cast<size_t>(i)] = free                  ? 1.0f
                                     : std::isinf(reach_m) ? 0.0f
                                                           : static_cast<float>(met.distance[i] / reach_m);
    }
    return open;
  }

  // Returns the cosines of incidence of the first view's projector light; 0 for unlit points.
  Values projected(const HitPacket& hits, const SurfacePacket& surface, const Points& lifted) const {
    BeamPacket lit;
    lit.inside = 0;
    beam_.light(hits.point, hits.hit, lit);
    Values result{};
    const LaneMask inside = lit.inside & hits.hit;
    if (inside == 0) return result;
    // The projector may light the side of the surface that faces away from the viewer.
    LaneMask turned_to = 0;
    for (int i = 0; i < kPacket; ++i) {
      if (has(inside, i) && hits.normal.at(i).dot(lit.to_light.at(i)) > 0) turned_to |= 1u << i;
    }
    if (turned_to == 0) return result;
    const LaneMask shadow = world_.occluded(lifted, turned_to, beam_.position());
    for (int i = 0; i < kPacket; ++i) {
      if (has(turned_to & ~shadow, i))
        result[static_cast<size_t>(i)] =
            static_cast<float>(std::max(0.0, surface.normal.at(i).dot(lit.to_light.at(i))));
    }
    return result;
  }

  const RayScene& world_;
  Eigen::Vector3d up_, to_lamp_;
  std::vector<Eigen::Vector3d> sky_;
  Beam beam_;
  double reach_m_ = 1, lamp_reach_m_ = 1, reference_lux_ = 1;
};

class OverviewRenderer {
 public:
  OverviewRenderer(const Scene& scene, const RayScene& world, const Viewpoint& viewpoint)
      : viewpoint_(viewpoint),
        opened_(scene, world, viewpoint.window),
        surfaces_(scene, shown_effects()),
        light_(scene, world, viewpoint) {}

  void block(int block_row, int block_col, Overview& overview) const {
    constexpr int kSamples = kPerSide * kPerSide;
    Eigen::Array3f sum[kPacket];
    for (Eigen::Array3f& colour : sum) colour.setZero();
    for (int sample = 0; sample < kSamples; ++sample) {
      const double dx = (sample % kPerSide + 0.5) / kPerSide - 0.5, dy = (sample / kPerSide + 0.5) / kPerSide - 0.5;
      HitPacket hits;
      opened_.trace(rays_of(block_row, block_col, dx, dy), hits);
      add_colours(hits, sample, sum);
    }
    HitPacket centres;
    opened_.trace(rays_of(block_row, block_col, 0, 0), centres);
    for (int i = 0; i < kPacket; ++i) {
      const int row = block_row * kBlock + i / kBlock, col = block_col * kBlock + i % kBlock;
      if (row >= overview.picture.rows || col >= overview.picture.cols) continue;
      if (has(centres.hit, i)) overview.distance_m(row, col) = static_cast<float>(centres.distance[i]);
      for (int k = 0; k < 3; ++k) overview.picture(row, col)[k] = cv::saturate_cast<uchar>(sum[i][k] / kSamples);
    }
  }

 private:
  RayPacket rays_of(int block_row, int block_col, double dx, double dy) const {
    const Pinhole& camera = viewpoint_.camera;
    RayPacket rays;
    rays.active = kAllLanes;
    for (int i = 0; i < kPacket; ++i) {
      const double u = block_col * kBlock + i % kBlock + dx, v = block_row * kBlock + i / kBlock + dy;
      rays.origin.set(i, viewpoint_.world_from_camera.translation);
      rays.direction.set(i,
                         viewpoint_.world_from_camera.rotation *
                             Eigen::Vector3d((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, 1).normalized());
    }
    return rays;
  }

  // Adds gamma-encoded colours, 0 to 255; averaging encoded values keeps high-contrast edges smooth.
  void add_colours(const HitPacket& hits, int sample, Eigen::Array3f* sum) const {
    const Eigen::Array3f paper(kPaper[0], kPaper[1], kPaper[2]);
    SurfacePacket surface;
    Eigen::Array3f light[kPacket];
    if (hits.hit != 0) {
      surfaces_.at(hits, 1 / (kPerSide * viewpoint_.camera.fx), surface);
      light_.on(hits, surface, sample, light);
    }
    for (int i = 0; i < kPacket; ++i) {
      if (!has(hits.hit, i)) {
        sum[i] += paper;
        continue;
      }
      const Eigen::Array3f colour = surface.albedo[i] * light[i] + light_.glow(surface.emission_lux[i]);
      sum[i] += 255 * colour.min(1.0f).pow(static_cast<float>(1 / kGamma));
    }
  }

  const Viewpoint& viewpoint_;
  CutawayScene opened_;
  Surfaces surfaces_;
  Light light_;
};

}  // namespace

Overview render_overview(const Scene& scene, const RayScene& world, const Viewpoint& viewpoint) {
  const OverviewRenderer renderer(scene, world, viewpoint);
  const cv::Size size(viewpoint.camera.width, viewpoint.camera.height);
  Overview overview{cv::Mat3b(size, kPaper), cv::Mat1f(size, std::numeric_limits<float>::infinity())};
  for_each_row((size.height + kBlock - 1) / kBlock, [&](int block_row) {
    for (int block_col = 0; block_col * kBlock < size.width; ++block_col)
      renderer.block(block_row, block_col, overview);
  });
  return overview;
}

}  // namespace fringeslam::sim
