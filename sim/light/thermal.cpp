// SPDX-License-Identifier: Apache-2.0
#include "sim/light/thermal.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <vector>

#include "core/base/parallel.h"
#include "core/base/symmetric_filter.h"
#include "core/types/centikelvin.h"
#include "core/types/selected_instruction_set.h"
#include "sim/light/infrared.h"
#include "sim/random.h"

namespace fringeslam::sim {

namespace {

constexpr double kDustEmissivity = 0.95;

Eigen::Vector3d vector_of(const cv::Vec3f& v) { return Eigen::Vector3f(v[0], v[1], v[2]).cast<double>(); }

// Thermal radiance arriving along rays: emitted and reflected by surfaces, and from the air.
class HeatSource {
 public:
  HeatSource(const Scene& scene, const RayScene& world, const Surfaces& surfaces, const Effects& effects)
      : scene_(scene),
        world_(world),
        surfaces_(surfaces),
        surrounding_(black_body_radiance(scene.surroundings_c)),
        extinction_per_m_(effects.air ? scene.air.infrared_share * scene.air.extinction_per_m : 0) {}

  // Adds the radiance along each active ray; directions have unit z in the camera frame.
  void add(const RayPacket& rays, double footprint_m, double* radiance) const {
    HitPacket hits;
    world_.trace(rays, hits);
    SurfacePacket surface;
    surfaces_.at(hits, footprint_m, surface);
    for (int i = 0; i < kPacket; ++i) {
      if (!has(rays.active, i)) continue;
      if (!has(hits.hit, i)) {
        radiance[i] += surrounding_;
        continue;
      }
      const double arriving = std::exp(-extinction_per_m_ * hits.distance[i] * rays.direction.at(i).norm());
      const double leaving = of_surface(hits.object[i], static_cast<double>(surface.dust_cover[i]));
      radiance[i] += surrounding_ + arriving * (leaving - surrounding_);
    }
  }

 private:
  double of_surface(int object, double dust_cover) const {
    const double temperature_c = surfaces_.temperature_c(object);
    const double bare = emitted(surfaces_.material(object).emissivity, temperature_c);
    if (dust_cover == 0) return bare;
    const double dust_c = scene_.surroundings_c + scene_.dust.warmed_share * (temperature_c - scene_.surroundings_c);
    return bare + dust_cover * (emitted(kDustEmissivity, dust_c) - bare);
  }
  double emitted(double emissivity, double temperature_c) const {
    return surrounding_ + emissivity * (black_body_radiance(temperature_c) - surrounding_);
  }

  const Scene& scene_;
  const RayScene& world_;
  const Surfaces& surfaces_;
  double surrounding_, extinction_per_m_;
};

// Returns the rays of consecutive pixels of a row, starting at column `first`, one per lane.
RayPacket packet(const SampleRays& rays, int sample, int row, int first, int width, const Pose& world_from_thermal) {
  RayPacket result;
  for (int i = 0; i < kPacket; ++i) {
    const int col = std::min(first + i, width - 1);
    const auto pixel = static_cast<size_t>(row * width + col);
    const Eigen::Vector2d& slope =
        rays.samples[pixel * static_cast<size_t>(rays.per_pixel) + static_cast<size_t>(sample)];
    result.origin.set(i, world_from_thermal.translation);
    result.direction.set(i, world_from_thermal.rotation * Eigen::Vector3d(slope.homogeneous()));
    // No ray where the distortion polynomial has no inverse.
    if (first + i < width && slope.allFinite()) result.active |= LaneMask{1} << i;
  }
  return result;
}

// Converts the NETD, defined for a black body at 300 K, to a standard deviation of radiance.
double noise_radiance(double netd_k) {
  constexpr double kReference_c = 300 - kKelvinOfZeroCelsius, kHalf_k = 1;
  return netd_k * (black_body_radiance(kReference_c + kHalf_k) - black_body_radiance(kReference_c - kHalf_k)) /
         (2 * kHalf_k);
}

}  // namespace

SampleRays thermal_rays(const RigModel& rig, const Effects& effects, int per_pixel) {
  return sample_rays(rig.thermal->lens, per_pixel, 1, effects.lens_blur ? rig.thermal->blur_px : 0);
}

cv::Mat1f thermal_image(const Scene& scene, const SampleRays& rays, const RayScene& world, const Surfaces& surfaces,
                        const Effects& effects, const Pose& world_from_camera, int stack,
                        const ThermalImaging& imaging) {
  const ThermalCamera& thermal = *scene.rig.thermal;
  const Pinhole& lens = thermal.lens;
  const Pose world_from_thermal = world_from_camera * thermal.thermal_from_camera.inverse();
  const HeatSource source(scene, world, surfaces, effects);
  cv::Mat1d radiance(lens.height, lens.width);
  for_each_row(lens.height, [&](int row) {
    for (int first = 0; first < lens.width; first += kPacket) {
      double sums[kPacket] = {};
      for (int sample = 0; sample < rays.per_pixel; ++sample)
        source.add(packet(rays, sample, row, first, lens.width, world_from_thermal), 1 / lens.fx, sums);
      for (int i = 0; i < kPacket && first + i < lens.width; ++i) radiance(row, first + i) = sums[i] / rays.per_pixel;
    }
  });
  const double blur_px = effects.lens_blur ? remaining_blur_px(thermal.blur_px, rays.blur_px) : 0;
  if (blur_px > 0)
    radiance = filtered(radiance, point_spread_half(blur_px), FilterBorder::replicated, selected_instruction_set());

  cv::Mat1f temperature_c(radiance.size());
  const NormalField noise(scene.seed, Stream::thermal_noise, static_cast<uint32_t>(stack), 0);
  const double sigma = imaging.noise ? noise_radiance(thermal.netd_k) : 0;
  for_each_row(lens.height, [&](int row) {
    std::vector<float> normal(static_cast<size_t>(lens.width));
    noise.row(static_cast<uint32_t>(row), normal);
    for (int col = 0; col < lens.width; ++col) {
      const double noisy = radiance(row, col) + sigma * static_cast<double>(normal[static_cast<size_t>(col)]);
      const double seen_c = std::clamp(apparent_temperature_c(noisy), thermal.coldest_c, thermal.hottest_c);
      temperature_c(row, col) = imaging.quantise ? celsius(centikelvin(seen_c)) : static_cast<float>(seen_c);
    }
  });
  return temperature_c;
}

void mark_thermal_visibility(TruthFrame& truth, const Scene& scene, const RayScene& world,
                             const Pose& world_from_camera) {
  const ThermalCamera& thermal = *scene.rig.thermal;
  const Pose thermal_from_world = thermal.thermal_from_camera * world_from_camera.inverse();
  const Eigen::Vector3d eye = thermal_from_world.inverse().translation;
  const double largest_r2 = thermal.lens.largest_r2();
  for_each_row(truth.mask.rows, [&](int row) {
    for (int col = 0; col < truth.mask.cols; ++col) {
      const int mask = static_cast<int>(truth.mask(row, col));
      if (!(mask & kTruthSurface)) continue;
      Hit hit;
      hit.point = vector_of(truth.position_m(row, col));
      Eigen::Vector2d pixel;
      if (!thermal.lens.shows(thermal_from_world * hit.point, largest_r2, pixel)) continue;
      hit.normal = world_from_camera.rotation * vector_of(truth.normals(row, col));
      if (hit.normal.dot(eye - hit.point) <= 0 || world.occluded(hit, eye)) continue;
      truth.mask(row, col) = static_cast<float>(mask | kTruthThermal);
    }
  });
}

}  // namespace fringeslam::sim
