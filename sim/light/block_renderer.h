// SPDX-License-Identifier: Apache-2.0
// Renders one block of pixels. Included only by renderer.cpp, so that all of it is compiled for each instruction set.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>

#include "core/base/constants.h"
#include "core/base/instruction_set.h"
#include "core/base/parallel.h"
#include "core/types/camera_pupil.h"
#include "sim/light/air.h"
#include "sim/light/beam.h"
#include "sim/light/indirect.h"
#include "sim/light/panes.h"
#include "sim/light/photometry.h"
#include "sim/light/renderer.h"
#include "sim/light/subsurface.h"
#include "sim/random.h"

namespace fringeslam::sim {

inline constexpr int kBlock = 4;  // px; a packet covers a block of 4 x 4 pixels
static_assert(kBlock * kBlock == kPacket);

// Low-discrepancy sequence in the unit square (R2: additive recurrence with the plastic number).
inline Eigen::Vector2d r2_point(int index, double shift_x, double shift_y) {
  const double x = shift_x + index * 0.7548776662466927, y = shift_y + index * 0.5698402909980532;
  return {x - std::floor(x), y - std::floor(y)};
}

// Returns the binary digits of a number mirrored at the binary point, in [0, 1) (van der Corput).
inline double mirrored_digits(uint32_t number) {
  double result = 0;
  for (double place = 0.5; number != 0; number >>= 1, place *= 0.5) result += place * (number & 1);
  return result;
}

// Returns the lanes for which a branch-free condition holds; both loops vectorise.
template <class Condition>
FRINGESLAM_INLINE LaneMask lanes_where(const Condition& condition) {
  alignas(64) uint32_t flags[kPacket];
#pragma GCC ivdep
  for (int i = 0; i < kPacket; ++i) flags[i] = condition(i) ? 1u : 0u;
  uint32_t sum = 0;
  for (int i = 0; i < kPacket; ++i) sum += flags[i] << i;
  return sum;
}

// Weight per lane: 1 if the lane is set, else 0.
struct alignas(64) LaneWeights {
  float value[kPacket];
  explicit LaneWeights(LaneMask lanes) {
    for (int i = 0; i < kPacket; ++i) value[i] = static_cast<float>(lanes >> i & 1);
  }
};

// Camera pose with the corresponding projector beam.
struct Station {
  Pose world_from_camera;
  Beam beam;
};

// Means over the patterns of the projector's light in each pixel: all of it, and what other surfaces sent or came from
// below the surface.
struct LightShares {
  cv::Mat1f total, indirect;
};

// Renders one block of pixels under all patterns.
class BlockRenderer {
 public:
  BlockRenderer(const Renderer& renderer, const ProjectedPatterns& patterns, const std::vector<Station>& stations,
                int stack, IndirectLightBuffer* indirect, IndirectLightBuffer* veil, LightShares* shares)
      : r_(renderer),
        patterns_(patterns),
        stations_(stations),
        stack_(stack),
        indirect_(indirect),
        veil_(veil),
        shares_(shares),
        width_(renderer.scene_.rig.camera.width),
        height_(renderer.scene_.rig.camera.height),
        footprint_(renderer.rays_->extent / renderer.scene_.rig.camera.fx),
        ambient_lux_(renderer.scene_.ambient_lux),
        // Ground truth alone needs no light paths.
        bounces_(renderer.effects_.interreflection && patterns.count() > 0 ? renderer.scene_.bounces : 0),
        haze_(renderer.effects_.air && patterns.count() > 0 ? renderer.scene_.air : Air{}),
        pupil_m_(renderer.effects_.depth_of_field ? camera_pupil_m(renderer.scene_.rig) : 0),
        sums_(static_cast<size_t>(kPacket * patterns.stride())),
        soft_sums_(indirect ? sums_.size() : 0),
        veil_sums_(veil ? sums_.size() : 0) {}

  void render(int block_row, int block_col, std::vector<cv::Mat1f>& images, TruthFrame* truth) {
    place(block_row, block_col);
    std::fill(sums_.begin(), sums_.end(), 0.0f);
    std::fill(std::begin(steady_), std::end(steady_), 0.0f);
    if (indirect_) {
      std::fill(soft_sums_.begin(), soft_sums_.end(), 0.0f);
      std::fill(std::begin(soft_steady_), std::end(soft_steady_), 0.0f);
      std::fill(std::begin(guided_), std::end(guided_), 0);
    }
    std::fill(veil_sums_.begin(), veil_sums_.end(), 0.0f);
    std::fill(std::begin(indirect_light_), std::end(indirect_light_), 0.0f);
    if (truth) trace_centres(*truth);
    const int samples = r_.rays_->per_pixel;
    for (int sample = 0; sample < samples; ++sample) take(sample, truth != nullptr);
    if (truth) {
      for (int i = 0; i < kPacket; ++i) {
        if (has(mixed_, i)) truth->mask(row_[i], col_[i]) += static_cast<float>(kTruthMixed);
      }
    }
    const float share = 1.0f / static_cast<float>(samples);
    for (int k = 0; k < patterns_.count(); ++k) {
      cv::Mat1f& image = images[static_cast<size_t>(k)];
      const float* sums = sums_.data() + patterns_.slot(k);
      for (int i = 0; i < kPacket; ++i) {
        if (has(inside_, i)) image(row_[i], col_[i]) = share * (sums[i * patterns_.stride()] + steady_[i]);
      }
    }
    if (shares_) {
      const float mean = share / static_cast<float>(patterns_.count());
      for (int i = 0; i < kPacket; ++i) {
        if (!has(inside_, i)) continue;
        shares_->total(row_[i], col_[i]) = mean * pattern_light(i);
        shares_->indirect(row_[i], col_[i]) = mean * indirect_light_[i];
      }
    }
    float shares[kPacket];
    if (indirect_) {
      // The weights are means over all samples, so the irradiance is that of the samples that receive light.
      for (int i = 0; i < kPacket; ++i) shares[i] = 1.0f / static_cast<float>(std::max(1, guided_[i]));
      hand_over(*indirect_, soft_sums_, soft_steady_, shares);
    }
    if (veil_) {
      constexpr float kNone[kPacket] = {};
      std::fill_n(shares, kPacket, share);
      hand_over(*veil_, veil_sums_, kNone, shares);
    }
  }

 private:
  // Hits of the rays through the pixel centres, with which the samples are compared.
  struct Centres {
    HitPacket hits;
    LaneMask shadow = 0, in_beam = 0;
  };

  void place(int block_row, int block_col) {
    inside_ = 0;
    mixed_ = 0;
    for (int i = 0; i < kPacket; ++i) {
      row_[i] = block_row * kBlock + i / kBlock;
      col_[i] = block_col * kBlock + i % kBlock;
      inside_ |= static_cast<LaneMask>(row_[i] < height_ && col_[i] < width_) << i;
      // Lanes outside the image duplicate a border pixel; their results are discarded.
      row_[i] = std::min(row_[i], height_ - 1);
      col_[i] = std::min(col_[i], width_ - 1);
      pixel_[i] = static_cast<uint32_t>(row_[i] * width_ + col_[i]);
    }
  }

  // Returns the light of a lane so far, summed over the patterns.
  float pattern_light(int lane) const {
    float sum = 0;
    for (int k = 0; k < patterns_.count(); ++k)
      sum += sums_[static_cast<size_t>(lane * patterns_.stride() + patterns_.slot(k))];
    return sum;
  }

  // Stores the block's indirect light for smoothing after all blocks are done.
  void hand_over(IndirectLightBuffer& indirect, const std::vector<float>& sums, const float* steady,
                 const float* share) {
    for (int i = 0; i < kPacket; ++i) {
      if (!has(inside_, i)) continue;
      float* light = indirect.at(row_[i], col_[i]);
      for (int k = 0; k < patterns_.count(); ++k)
        light[k] = share[i] * sums[static_cast<size_t>(i * patterns_.stride() + patterns_.slot(k))];
      light[patterns_.count()] = share[i] * steady[i];
    }
  }

  // Records the guides for smoothing: mean weight of indirect light, and normal and position of the surface; normal and
  // position are those of the last sample.
  void record_guides(IndirectLightBuffer& indirect, const HitPacket& hits, LaneMask lanes, const float* weight) const {
    for (int i = 0; i < kPacket; ++i) {
      if (!has(inside_, i)) continue;
      const size_t pixel = pixel_[i];
      indirect.albedo[pixel] += weight[i] / static_cast<float>(r_.rays_->per_pixel);
      if (!has(lanes, i)) continue;
      indirect.normal[pixel] = hits.normal.at(i).cast<float>();
      indirect.position[pixel] = hits.point.at(i).cast<float>();
    }
  }

  // Transforms directions (x, y, 1) and pupil origins (x, y, 0) from the camera frame to world rays.
  static void aim(const Pose& pose, const Eigen::Vector2d (&slope)[kPacket], const Eigen::Vector2d (&start)[kPacket],
                  RayPacket& rays) {
    const Eigen::Matrix3d& r = pose.rotation;
    const Eigen::Vector3d& t = pose.translation;
    for (int i = 0; i < kPacket; ++i) {
      const double x = slope[i].x(), y = slope[i].y(), a = start[i].x(), b = start[i].y();
      rays.direction.x[i] = r(0, 0) * x + r(0, 1) * y + r(0, 2);
      rays.direction.y[i] = r(1, 0) * x + r(1, 1) * y + r(1, 2);
      rays.direction.z[i] = r(2, 0) * x + r(2, 1) * y + r(2, 2);
      rays.origin.x[i] = r(0, 0) * a + r(0, 1) * b + t.x();
      rays.origin.y[i] = r(1, 0) * a + r(1, 1) * b + t.y();
      rays.origin.z[i] = r(2, 0) * a + r(2, 1) * b + t.z();
    }
  }

  // Returns the lanes whose surface faces the projector.
  static LaneMask facing(const HitPacket& hits, const BeamPacket& beam) {
    return hits.hit & lanes_where([&](int i) {
             return hits.normal.x[i] * beam.to_light.x[i] + hits.normal.y[i] * beam.to_light.y[i] +
                        hits.normal.z[i] * beam.to_light.z[i] >
                    0;
           });
  }

  // Returns the lanes inside the image that have a ray. Where the lens's distortion polynomial has no inverse, there is none;
  // its slope becomes zero, because Embree and sums over all lanes require finite numbers.
  LaneMask with_rays(Eigen::Vector2d (&slope)[kPacket]) const {
    LaneMask lanes = inside_;
    for (int i = 0; i < kPacket; ++i) {
      if (slope[i].allFinite()) continue;
      slope[i].setZero();
      lanes &= ~(LaneMask{1} << i);
    }
    return lanes;
  }

  // Traces the rays through the pixel centres and fills in the ground truth.
  void trace_centres(TruthFrame& truth) {
    const Station& station = stations_.front();
    Eigen::Vector2d slope[kPacket], start[kPacket];
    for (int i = 0; i < kPacket; ++i) slope[i] = r_.rays_->centres[pixel_[i]], start[i].setZero();
    RayPacket rays;
    rays.active = with_rays(slope);
    aim(station.world_from_camera, slope, start, rays);
    HitPacket& hits = centre_.hits;
    r_.world_->trace(rays, hits);
    BeamPacket beam;
    station.beam.light(hits.point, hits.hit, beam);
    const LaneMask towards = facing(hits, beam);
    const LaneMask dark = r_.world_->occluded(RayScene::lifted(hits), towards, station.beam.position());
    centre_.shadow = hits.hit & ~(towards & ~dark);  // surfaces that face away from the light count as shadowed
    centre_.in_beam = beam.inside;
    const Eigen::Matrix3d camera_from_world = station.world_from_camera.rotation.transpose();
    for (int i = 0; i < kPacket; ++i) {
      if (!has(hits.hit, i)) continue;
      const int row = row_[i], col = col_[i];
      const Eigen::Vector3f normal = (camera_from_world * hits.normal.at(i)).cast<float>();
      const Eigen::Vector3f point = hits.point.at(i).cast<float>();
      truth.depth_m(row, col) = static_cast<float>(hits.distance[i]);  // rays have d_z = 1
      truth.position_m(row, col) = {point.x(), point.y(), point.z()};
      truth.normals(row, col) = {normal.x(), normal.y(), normal.z()};
      truth.object_id(row, col) = static_cast<float>(hits.object[i] + 1);
      truth.temperature_c(row, col) = static_cast<float>(r_.surfaces_->temperature_c(hits.object[i]));
      if (has(beam.inside, i)) {
        truth.projector_column(row, col) = static_cast<float>(beam.column[i]);
        truth.projector_row(row, col) = static_cast<float>(beam.row[i]);
      }
      truth.mask(row, col) = static_cast<float>(kTruthSurface + (has(beam.inside, i) ? kTruthInBeam : 0) +
                                                (has(centre_.shadow, i) ? kTruthInShadow : 0) +
                                                (r_.surfaces_->material(hits.object[i]).victim ? kTruthVictim : 0));
    }
  }

  // Returns the pixels whose sample and centre ray differ in object, normal (by 30 degrees), shadow or beam, or whose sample
  // lies off the centre's tangent plane: an edge between parallel faces of an object. The distance from that plane, unlike the
  // difference in depth, does not grow on a flat surface at grazing incidence.
  LaneMask differing(const HitPacket& hits, LaneMask shadow, LaneMask in_beam) const {
    constexpr double kCosine30 = 0.866, kOffPlane = 3;  // the latter in pixel footprints
    const HitPacket& centre = centre_.hits;
    const LaneMask border = (hits.hit ^ centre.hit) | (shadow ^ centre_.shadow) | (in_beam ^ centre_.in_beam);
    const LaneMask other = lanes_where([&](int i) {
      const double cosine = hits.normal.x[i] * centre.normal.x[i] + hits.normal.y[i] * centre.normal.y[i] +
                            hits.normal.z[i] * centre.normal.z[i];
      const double off_m = (hits.point.x[i] - centre.point.x[i]) * centre.normal.x[i] +
                           (hits.point.y[i] - centre.point.y[i]) * centre.normal.y[i] +
                           (hits.point.z[i] - centre.point.z[i]) * centre.normal.z[i];
      return static_cast<int>(hits.object[i] != centre.object[i]) | static_cast<int>(cosine < kCosine30) |
             static_cast<int>(std::abs(off_m) > kOffPlane * footprint_ * centre.distance[i]);
    });
    return (border | (other & hits.hit & centre.hit)) & inside_;
  }

  // Returns the pose during the exposure at which a sample is traced: the same in all pixels, so that textures are blurred alike
  // everywhere, and in an order in which the sample's place in the pixel depends on its time as little as possible.
  size_t station_of(int sample) const {
    const auto steps = static_cast<int>(stations_.size());
    const int samples = r_.rays_->per_pixel;
    if (samples == 4 && steps == 4) return std::array<size_t, 4>{0, 2, 1, 3}[static_cast<size_t>(sample)];
    if (samples == 4) return static_cast<size_t>(sample % steps);  // samples on opposite sides belong together
    // The time has two digits to the base of the grid's side. Each row of samples has all values of both digits, each column all
    // values of the first and, if the side is odd, of the second.
    const int side = static_cast<int>(std::lround(std::sqrt(samples))), row = sample / side, col = sample % side;
    const int time = (row + col) % side * side + (2 * row + col) % side;
    return static_cast<size_t>(time * steps / samples);
  }

  // Traces one sample of each pixel and adds its light.
  void take(int sample, bool compare) {
    const Station& station = stations_[station_of(sample)];
    const auto samples = static_cast<size_t>(r_.rays_->per_pixel);
    Eigen::Vector2d slope[kPacket], start[kPacket];
    alignas(64) float transmission[kPacket];
    for (int i = 0; i < kPacket; ++i) {
      const size_t number = pixel_[i] * samples + static_cast<size_t>(sample);
      slope[i] = r_.rays_->samples[number];
      start[i].setZero();
      transmission[i] = r_.rays_->transmission.empty() ? 1.0f : r_.rays_->transmission[number];
    }
    sighted_ = with_rays(slope);
    if (pupil_m_ > 0) apply_thin_lens(sample, slope, start);
    RayPacket rays;
    rays.active = sighted_;
    aim(station.world_from_camera, slope, start, rays);
    HitPacket hits;
    r_.world_->trace(rays, hits);
    SurfacePacket surface;
    r_.surfaces_->at(hits, footprint_, surface);

    Points to_viewer;
    alignas(64) float weight[kPacket], length[kPacket];
    for (int i = 0; i < kPacket; ++i) {
      const double dx = rays.direction.x[i], dy = rays.direction.y[i], dz = rays.direction.z[i];
      const double norm = std::sqrt(dx * dx + dy * dy + dz * dz);
      to_viewer.x[i] = -dx / norm;
      to_viewer.y[i] = -dy / norm;
      to_viewer.z[i] = -dz / norm;
      length[i] = static_cast<float>(hits.distance[i] * norm);
      weight[i] = transmission[i];
      if (haze_.extinction_per_m > 0) weight[i] *= std::exp(-static_cast<float>(haze_.extinction_per_m) * length[i]);
    }
    if (r_.panes_) weaken_by_panes(rays, hits, weight);
    BeamPacket beam;
    const LaneMask lit = surface.translucent == 0
                             ? add_direct(station, hits, surface, to_viewer, hits.hit, weight, true, beam)
                             : add_translucent(station, hits, surface, to_viewer, weight, beam);
    alignas(64) float direct_light[kPacket];
    if (shares_) {
      for (int i = 0; i < kPacket; ++i) direct_light[i] = pattern_light(i);
    }
    if (r_.panes_ && patterns_.count() > 0) {
      add_mirrored_beam(station, hits, surface, to_viewer, weight);
      add_mirrored_surfaces(station, rays, hits, transmission);
    }
    if (compare) mixed_ |= differing(hits, hits.hit & ~lit, beam.inside);
    if (bounces_ == 0) {
      const LaneWeights seen(hits.hit);
      for (int i = 0; i < kPacket; ++i) {
        const float back = surface.albedo[i] + surface.reflectance[i];
        steady_[i] += seen.value[i] * weight[i] * static_cast<float>(ambient_lux_) * back;
      }
    } else {
      if (indirect_) {
        alignas(64) float matt[kPacket];
        LaneMask receiving = 0;  // black surfaces send no paths, so their irradiance is unknown
        for (int i = 0; i < kPacket; ++i) {
          matt[i] = has(hits.hit, i) ? weight[i] * surface.albedo[i] : 0;
          const bool receives = has(hits.hit, i) && surface.albedo[i] > 0;
          receiving |= LaneMask{receives} << i;
          guided_[i] += receives;
        }
        record_guides(*indirect_, hits, receiving, matt);
      }
      follow_paths(station, sample, hits, surface, to_viewer, weight);
    }
    if (shares_) {
      for (int i = 0; i < kPacket; ++i) indirect_light_[i] += pattern_light(i) - direct_light[i];
    }
    if (haze_.extinction_per_m > 0) {
      if (veil_) {
        alignas(64) float whole[kPacket];
        std::fill_n(whole, kPacket, 1.0f);
        record_guides(*veil_, hits, hits.hit, whole);
      }
      scatter_in_air(station, sample, rays, hits, to_viewer, length);
    }
  }

  // Thin lens: the ray starts at a point of the pupil and passes through the in-focus point.
  void apply_thin_lens(int sample, Eigen::Vector2d (&slope)[kPacket], Eigen::Vector2d (&start)[kPacket]) const {
    const Eigen::Vector2d point = 0.5 * pupil_m_ * r_.rays_->pupil[static_cast<size_t>(sample)];
    for (int i = 0; i < kPacket; ++i) {
      start[i] = point;
      slope[i] -= point / r_.scene_.rig.camera_lens.focus_m;
    }
  }

  // Adds the projector light reflected and the light emitted by surface points towards a viewer. Returns the lanes
  // whose points see the projector; lanes outside the beam are tested only if `everywhere` is set.
  LaneMask add_direct(const Station& station, const HitPacket& hits, const SurfacePacket& surface,
                      const Points& to_viewer, LaneMask active, const float* weight, bool everywhere,
                      BeamPacket& beam) {
    station.beam.light(hits.point, active, beam);
    LaneMask lit = facing(hits, beam) & active;
    if (!everywhere) lit &= beam.inside;
    lit &= ~r_.world_->occluded(RayScene::lifted(hits), lit, station.beam.position());
    ProjectedPatterns::Points points;
    alignas(64) double cosine[kPacket];
#pragma GCC ivdep
    for (int i = 0; i < kPacket; ++i) {
      cosine[i] = surface.normal.x[i] * beam.to_light.x[i] + surface.normal.y[i] * beam.to_light.y[i] +
                  surface.normal.z[i] * beam.to_light.z[i];
      points.column[i] = static_cast<float>(beam.column[i]);
      points.row[i] = static_cast<float>(beam.row[i]);
      points.blur_px[i] = beam.blur_px[i];
      points.weight[i] = weight[i] * surface.albedo[i] * static_cast<float>(cosine[i]) * beam.lux[i];
    }
    const LaneMask bright = lit & beam.inside & lanes_where([&](int i) { return cosine[i] > 0; });
    const LaneWeights seen(active);
    for (int i = 0; i < kPacket; ++i) add_steady(i, seen.value[i] * weight[i] * surface.emission_lux[i]);
    if ((surface.glossy & bright) != 0) {
      for (int i = 0; i < kPacket; ++i) {
        if (!has(surface.glossy & bright, i)) continue;
        const Eigen::Vector3d normal = surface.normal.at(i), to_light = beam.to_light.at(i);
        const double back = reflected(surface.reflection(i), normal, to_light, to_viewer.at(i));
        points.weight[i] = weight[i] * static_cast<float>(back * normal.dot(to_light)) * beam.lux[i];
      }
    }
    if (haze_.extinction_per_m > 0) {
      for (int i = 0; i < kPacket; ++i)
        points.weight[i] *= static_cast<float>(std::exp(-haze_.extinction_per_m * beam.distance[i]));
    }
    if (r_.panes_) weaken_by_panes(hits.point, station.beam.position(), bright, points);
    patterns_.add(points, bright & ~soft_, sums_.data());
    if (soft_ != 0) patterns_.add(points, bright & soft_, soft_sums_.data());
    return lit;
  }

  void add_steady(int lane, float lux) { (has(soft_, lane) ? soft_steady_ : steady_)[lane] += lux; }

  // Same as add_direct() for points seen of which some are translucent: their diffuse light comes from below the surface.
  // Not inlined, so that the code of opaque surfaces stays small.
  [[gnu::noinline]] LaneMask add_translucent(const Station& station, const HitPacket& hits,
                                             const SurfacePacket& surface, const Points& to_viewer, const float* weight,
                                             BeamPacket& beam) {
    SurfacePacket skin = surface;
    for (int i = 0; i < kPacket; ++i) {
      if (has(surface.translucent, i)) skin.albedo[i] = std::max(0.0f, surface.albedo[i] - surface.inner_albedo[i]);
    }
    const LaneMask lit = add_direct(station, hits, skin, to_viewer, hits.hit, weight, true, beam);
    float before[kPacket];
    if (shares_) {
      for (int i = 0; i < kPacket; ++i) before[i] = pattern_light(i);
    }
    add_from_below(station, hits, surface, to_viewer, weight, beam);
    if (shares_) {
      for (int i = 0; i < kPacket; ++i) indirect_light_[i] += pattern_light(i) - before[i];
    }
    return lit;
  }

  // Adds the projector light that enters translucent surfaces near the points seen and leaves them there. Points of entry
  // are drawn in the tangent plane and projected onto the surface along its normal; light is lost where this misses the
  // object. They come in pairs on opposite sides, which cancel the noise of the phase. The pairs are a Hammersley set,
  // shifted at random. It is the same for all samples of a pixel: if a sample's share of the light varied with its place
  // in the pixel, the phase would.
  void add_from_below(const Station& station, const HitPacket& hits, const SurfacePacket& surface,
                      const Points& to_viewer, const float* weight, const BeamPacket& beam) {
    const int samples = r_.rays_->per_pixel;
    constexpr int kLeastPairs = 16;  // fewer points of entry would not represent the profile
    const int pairs =
        std::max(std::min(kLeastPairs, r_.effects_.subsurface_paths / 2), r_.effects_.subsurface_paths / (2 * samples));
    const Philox random(r_.scene_.seed, Stream::subsurface, static_cast<uint32_t>(stack_));
    for (int pair = 0; pair < pairs; ++pair) {
      const double turn = mirrored_digits(static_cast<uint32_t>(pair));
      Eigen::Vector3d centre[kPacket], aside[kPacket];
      for (int i = 0; i < kPacket; ++i) {
        if (!has(surface.translucent, i)) continue;
        const auto u = random.uniforms(pixel_[i]);
        const ProfileSample drawn =
            sample_profile(static_cast<double>(surface.profile_length_m[i]), (pair + u[0]) / pairs);
        const Eigen::Vector3d normal = hits.normal.at(i);
        const double phi = kPi * (turn + u[1]);  // half a turn holds all pairs
        aside[i] = drawn.radius_m * (frame_about(normal) * Eigen::Vector3d(std::cos(phi), std::sin(phi), 0));
        const Eigen::Vector3d apart = beam.to_light.at(i) - to_viewer.at(i);
        const double shift_m = drawn.far ? static_cast<double>(surface.far_shift_m[i]) : 0;
        centre[i] = hits.point.at(i) + shift_m * (apart - normal * normal.dot(apart));
      }
      for (const int side : {1, -1}) {
        RayPacket probe;
        probe.origin = hits.point;
        probe.active = surface.translucent;
        probe.coherent = false;
        alignas(64) double reach_m[kPacket];
        for (int i = 0; i < kPacket; ++i) {
          const Eigen::Vector3d normal = has(probe.active, i) ? hits.normal.at(i) : Eigen::Vector3d::UnitZ();
          probe.direction.set(i, -normal);
          if (!has(probe.active, i)) continue;
          const Eigen::Vector3d at = centre[i] + side * aside[i];
          reach_m[i] = (at - hits.point.at(i)).norm() + static_cast<double>(surface.profile_length_m[i]);
          probe.origin.set(i, at + reach_m[i] * normal);
        }
        HitPacket entry;
        r_.world_->trace(probe, entry);
        LaneMask met = probe.active & entry.hit;
        for (int i = 0; i < kPacket; ++i) {
          if (has(met, i) && (entry.object[i] != hits.object[i] || entry.distance[i] > 2 * reach_m[i]))
            met &= ~(LaneMask{1} << i);
        }
        add_entering(station, entry, met, surface, to_viewer, weight, 1.0f / static_cast<float>(2 * pairs));
      }
    }
  }

  // Adds the projector light that enters at `entry` and leaves at the points seen.
  void add_entering(const Station& station, const HitPacket& entry, LaneMask active, const SurfacePacket& surface,
                    const Points& to_viewer, const float* weight, float share) {
    BeamPacket beam;
    station.beam.light(entry.point, active, beam);
    LaneMask lit = facing(entry, beam) & active & beam.inside;
    lit &= ~r_.world_->occluded(RayScene::lifted(entry), lit, station.beam.position());
    ProjectedPatterns::Points points{};
    for (int i = 0; i < kPacket; ++i) {
      if (!has(lit, i)) continue;
      const double cosine = entry.normal.at(i).dot(beam.to_light.at(i));
      const auto coat = static_cast<double>(surface.reflectance[i]);
      const double through = passed(coat, cosine) * passed(coat, surface.normal.at(i).dot(to_viewer.at(i))) *
                             std::exp(-haze_.extinction_per_m * beam.distance[i]);
      points.column[i] = static_cast<float>(beam.column[i]);
      points.row[i] = static_cast<float>(beam.row[i]);
      points.blur_px[i] = beam.blur_px[i];
      points.weight[i] =
          share * weight[i] * surface.inner_albedo[i] * static_cast<float>(through * cosine) * beam.lux[i];
    }
    if (r_.panes_) weaken_by_panes(entry.point, station.beam.position(), lit, points);
    patterns_.add(points, lit, sums_.data());
  }

  // Multiplies the weights by what panes let pass between the rays' origins and their hits.
  [[gnu::noinline]] void weaken_by_panes(const RayPacket& rays, const HitPacket& hits, float* weight) const {
    for (int i = 0; i < kPacket; ++i) {
      if (has(hits.hit & rays.active, i))
        weight[i] *= static_cast<float>(r_.panes_->passed(rays.origin.at(i), hits.point.at(i)));
    }
  }

  [[gnu::noinline]] void weaken_by_panes(const Points& from, const Eigen::Vector3d& to, LaneMask active,
                                         ProjectedPatterns::Points& points) const {
    for (int i = 0; i < kPacket; ++i) {
      if (has(active, i)) points.weight[i] *= static_cast<float>(r_.panes_->passed(from.at(i), to));
    }
  }

  // Adds the projector light that panes mirror onto the points seen. It comes from the mirror image of the projector: the
  // point's mirror image receives the same light from the projector itself.
  [[gnu::noinline]] void add_mirrored_beam(const Station& station, const HitPacket& hits, const SurfacePacket& surface,
                                           const Points& to_viewer, const float* weight) {
    const Eigen::Vector3d& light = station.beam.position();
    for (int pane = 0; pane < r_.panes_->count(); ++pane) {
      const double light_height = r_.panes_->mirrored(light, pane).height;
      Points images = hits.point;
      LaneMask lit = 0;
      for (int i = 0; i < kPacket; ++i) {
        if (!has(hits.hit, i)) continue;
        const Panes::Mirrored image = r_.panes_->mirrored(hits.point.at(i), pane);
        images.set(i, image.point);
        if (image.height * light_height > 0) lit |= LaneMask{1} << i;
      }
      BeamPacket beam;
      station.beam.light(images, lit, beam);
      lit &= beam.inside;
      ProjectedPatterns::Points points{};
      for (int i = 0; i < kPacket; ++i) {
        if (!has(lit, i)) continue;
        points.weight[i] =
            mirrored_weight(hits, surface, to_viewer, i, pane, light, images.at(i)) * weight[i] * beam.lux[i];
        points.column[i] = static_cast<float>(beam.column[i]);
        points.row[i] = static_cast<float>(beam.row[i]);
        points.blur_px[i] = beam.blur_px[i];
        if (haze_.extinction_per_m > 0)
          points.weight[i] *= static_cast<float>(std::exp(-haze_.extinction_per_m * beam.distance[i]));
        if (!(points.weight[i] > 0)) lit &= ~(LaneMask{1} << i);
      }
      patterns_.add(points, lit, sums_.data());
    }
  }

  // Returns pi f_r cos(i) of a point for light that a pane mirrors, times the share that arrives; 0 if none does.
  float mirrored_weight(const HitPacket& hits, const SurfacePacket& surface, const Points& to_viewer, int lane,
                        int pane, const Eigen::Vector3d& light, const Eigen::Vector3d& image) const {
    const Panes& panes = *r_.panes_;
    const std::optional<Panes::Crossing> crossing = panes.crossing_between(light, image, pane);
    if (!crossing) return 0;
    const Eigen::Vector3d at = light + crossing->distance * (image - light), point = hits.point.at(lane);
    const Eigen::Vector3d to_light = (at - point).normalized(), normal = surface.normal.at(lane);
    const double cosine = normal.dot(to_light);
    if (cosine <= 0 || hits.normal.at(lane).dot(to_light) <= 0) return 0;
    Hit mirror, seen;
    mirror.point = at;
    mirror.normal = panes.normal(pane) * ((light - at).dot(panes.normal(pane)) > 0 ? 1 : -1);
    seen.point = point;
    seen.normal = hits.normal.at(lane);
    if (r_.world_->occluded(mirror, light) || r_.world_->occluded(seen, at)) return 0;
    const double arrives = crossing->reflected * panes.passed(light, at, pane) * panes.passed(at, point, pane);
    const double back = has(surface.glossy, lane)
                            ? reflected(surface.reflection(lane), normal, to_light, to_viewer.at(lane))
                            : static_cast<double>(surface.albedo[lane]);
    return static_cast<float>(arrives * back * cosine);
  }

  // Adds what panes mirror into the camera: surfaces in the light of the projector and of the surroundings.
  [[gnu::noinline]] void add_mirrored_surfaces(const Station& station, const RayPacket& rays, const HitPacket& hits,
                                               const float* transmission) {
    std::vector<Panes::Crossing> crossings[kPacket];
    size_t most = 0;
    for (int i = 0; i < kPacket; ++i) {
      if (!has(sighted_, i)) continue;
      const double end = has(hits.hit, i) ? hits.distance[i] : std::numeric_limits<double>::infinity();
      crossings[i] = r_.panes_->crossings(rays.origin.at(i), rays.direction.at(i), end);
      most = std::max(most, crossings[i].size());
    }
    alignas(64) float through[kPacket];
    std::copy_n(transmission, kPacket, through);
    for (size_t k = 0; k < most; ++k) {
      RayPacket mirrored;
      mirrored.coherent = false;
      Points to_viewer;
      alignas(64) float weight[kPacket] = {};
      for (int i = 0; i < kPacket; ++i) {
        mirrored.direction.set(i, Eigen::Vector3d::UnitZ());
        to_viewer.set(i, Eigen::Vector3d::UnitZ());
        if (crossings[i].size() <= k) continue;
        const Panes::Crossing& crossing = crossings[i][k];
        const Eigen::Vector3d direction = rays.direction.at(i), normal = r_.panes_->normal(crossing.triangle);
        const Eigen::Vector3d onwards = (direction - 2 * normal * normal.dot(direction)).normalized();
        mirrored.active |= LaneMask{1} << i;
        mirrored.origin.set(i, rays.origin.at(i) + crossing.distance * direction);
        mirrored.direction.set(i, onwards);
        to_viewer.set(i, -onwards);
        const double way_m = crossing.distance * direction.norm();
        weight[i] = through[i] * static_cast<float>(crossing.reflected * std::exp(-haze_.extinction_per_m * way_m));
        through[i] *= static_cast<float>(1 - crossing.reflected);
      }
      HitPacket seen;
      r_.world_->trace(mirrored, seen);
      SurfacePacket surface;
      r_.surfaces_->at(seen, footprint_, surface);
      for (int i = 0; i < kPacket; ++i) {
        if (!has(mirrored.active, i)) continue;
        const auto ambient = static_cast<float>(ambient_lux_);
        if (!has(seen.hit, i)) {
          steady_[i] += weight[i] * ambient;
          continue;
        }
        const int triangle = crossings[i][k].triangle;
        weight[i] *= static_cast<float>(r_.panes_->passed(mirrored.origin.at(i), seen.point.at(i), triangle) *
                                        std::exp(-haze_.extinction_per_m * seen.distance[i]));
        steady_[i] += weight[i] * ambient * (surface.albedo[i] + surface.reflectance[i]);
      }
      BeamPacket beam;
      add_direct(station, seen, surface, to_viewer, mirrored.active & seen.hit, weight, false, beam);
      add_mirrored_beam(station, seen, surface, to_viewer, weight);
    }
  }

  // Adds indirect light by path tracing: from other surfaces, and ambient light from paths that leave the scene. Paths
  // have the scene's number of bounces; at the last point, ambient light is assumed unshadowed.
  void follow_paths(const Station& station, int sample, const HitPacket& first, const SurfacePacket& first_surface,
                    const Points& first_viewer, const float* first_weight) {
    const int samples = r_.rays_->per_pixel;
    const int paths = (r_.effects_.bounce_paths + samples - 1) / samples;
    for (int path = 0; path < paths; ++path) {
      HitPacket hits = first;
      SurfacePacket surface = first_surface;
      Points to_viewer = first_viewer;
      LaneMask active = first.hit;
      alignas(64) float weight[kPacket];
      for (int i = 0; i < kPacket; ++i) weight[i] = first_weight[i] / static_cast<float>(paths);
      soft_ = 0;
      const int number = sample * paths + path;
      for (int bounce = 1; bounce <= bounces_ && active != 0; ++bounce) {
        // First bounce: stratified over a pixel's paths (low-discrepancy); later bounces: independent random numbers.
        const Philox random(r_.scene_.seed, Stream::paths, static_cast<uint32_t>(stack_),
                            bounce == 1 ? 0u : static_cast<uint32_t>(number * 64 + bounce));
        RayPacket rays;
        rays.origin = RayScene::lifted(hits);
        rays.coherent = false;
        for (int i = 0; i < kPacket; ++i) {
          rays.direction.set(i, Eigen::Vector3d::UnitZ());
          if (!has(active, i)) continue;
          auto u = random.uniforms(pixel_[i]);
          if (bounce == 1) {
            const Eigen::Vector2d even = r2_point(number, u[0], u[1]);
            const double choice = u[2] + number * 0.6180339887498949;
            u = {even.x(), even.y(), choice - std::floor(choice), 0};
          }
          const BrdfSample next =
              scatter(surface.reflection(i), surface.normal.at(i), to_viewer.at(i), u[2], u[0], u[1]);
          weight[i] *= static_cast<float>(next.weight);
          if (bounce == 1 && indirect_ && !next.glossy && surface.albedo[i] > 0) {
            // Keep irradiance: the diffuse albedo is applied after smoothing.
            weight[i] = static_cast<float>(next.weight) / (static_cast<float>(paths) * surface.albedo[i]);
            soft_ |= LaneMask{1} << i;
          }
          // With a shading normal, the sampled ray may point into the surface.
          if (next.weight <= 0 || next.direction.dot(hits.normal.at(i)) <= 0) {
            active &= ~(LaneMask{1} << i);
            continue;
          }
          rays.direction.set(i, next.direction);
        }
        rays.active = active;
        r_.world_->trace(rays, hits);
        for (int i = 0; i < kPacket; ++i) {
          if (has(active & ~hits.hit, i)) add_steady(i, weight[i] * static_cast<float>(ambient_lux_));
        }
        active &= hits.hit;
        for (int i = 0; i < kPacket; ++i) {
          to_viewer.x[i] = -rays.direction.x[i];
          to_viewer.y[i] = -rays.direction.y[i];
          to_viewer.z[i] = -rays.direction.z[i];
          if (haze_.extinction_per_m > 0 && has(active, i))
            weight[i] *= static_cast<float>(std::exp(-haze_.extinction_per_m * hits.distance[i]));
        }
        if (r_.panes_) weaken_by_panes(rays, hits, weight);
        r_.surfaces_->at(hits, footprint_, surface);
        BeamPacket beam;
        add_direct(station, hits, surface, to_viewer, active, weight, false, beam);
        if (bounce < bounces_) continue;
        for (int i = 0; i < kPacket; ++i) {
          if (has(active, i))
            add_steady(i, weight[i] * static_cast<float>(ambient_lux_) * (surface.albedo[i] + surface.reflectance[i]));
        }
      }
    }
    soft_ = 0;
  }

  // Adds light scattered by the air: beam light from one equiangularly sampled point per camera ray, and the veil of
  // scattered ambient light.
  void scatter_in_air(const Station& station, int sample, const RayPacket& rays, const HitPacket& hits,
                      const Points& to_viewer, const float* length) {
    const Philox random(r_.scene_.seed, Stream::air, static_cast<uint32_t>(stack_));
    Points points;
    alignas(64) double along[kPacket], density[kPacket];
    for (int i = 0; i < kPacket; ++i) {
      const double shift = random.uniforms(pixel_[i])[0] + sample * 0.6180339887498949;
      const double end = has(hits.hit, i) ? static_cast<double>(length[i]) : kSkyDistance;
      const AirSample drawn =
          equiangular(rays.origin.at(i), -to_viewer.at(i), end, station.beam.position(), shift - std::floor(shift));
      along[i] = drawn.distance_m;
      density[i] = drawn.density_per_m;
      points.set(i, rays.origin.at(i) - drawn.distance_m * to_viewer.at(i));
      const double veil = haze_.albedo * (1 - std::exp(-haze_.extinction_per_m * end));
      if (has(sighted_, i)) steady_[i] += static_cast<float>(veil * ambient_lux_);
    }
    BeamPacket beam;
    station.beam.light(points, sighted_, beam);
    const LaneMask lit = beam.inside & ~r_.world_->occluded(points, beam.inside, station.beam.position());
    ProjectedPatterns::Points lit_points{};
    for (int i = 0; i < kPacket; ++i) {
      if (!has(lit, i)) continue;
      // Scattering angle between the direction from the projector and the direction to the camera.
      const double cosine = -beam.to_light.at(i).dot(to_viewer.at(i));
      const double scattered = std::numbers::pi * haze_.albedo * haze_.extinction_per_m *
                               henyey_greenstein(haze_.anisotropy, cosine) *
                               std::exp(-haze_.extinction_per_m * (along[i] + beam.distance[i])) / density[i];
      lit_points.column[i] = static_cast<float>(beam.column[i]);
      lit_points.row[i] = static_cast<float>(beam.row[i]);
      lit_points.blur_px[i] = beam.blur_px[i];
      lit_points.weight[i] = static_cast<float>(scattered) * beam.lux[i];
      if (r_.panes_)
        lit_points.weight[i] *= static_cast<float>(r_.panes_->passed(rays.origin.at(i), points.at(i)) *
                                                   r_.panes_->passed(points.at(i), station.beam.position()));
    }
    patterns_.add(lit_points, lit, veil_ ? veil_sums_.data() : sums_.data());
  }

  const Renderer& r_;
  const ProjectedPatterns& patterns_;
  const std::vector<Station>& stations_;
  int stack_;
  IndirectLightBuffer *indirect_, *veil_;  // indirect and air-scattered light to be smoothed; null: no smoothing
  LightShares* shares_;                    // null: not required
  int width_, height_;
  double footprint_, ambient_lux_;
  int bounces_;
  Air haze_;
  double pupil_m_;

  int row_[kPacket], col_[kPacket];
  uint32_t pixel_[kPacket];
  LaneMask inside_ = 0, mixed_ = 0;
  LaneMask sighted_ = 0;  // lanes inside the image whose current sample has a ray
  Centres centre_;
  std::vector<float> sums_;            // by lane, then pattern
  alignas(64) float steady_[kPacket];  // pattern-independent light
  // Same for indirect light that will be smoothed, as irradiance; and the lanes whose current path carries such light.
  std::vector<float> soft_sums_;
  alignas(64) float soft_steady_[kPacket];
  int guided_[kPacket];  // samples whose indirect light is known
  LaneMask soft_ = 0;
  std::vector<float> veil_sums_;
  alignas(64) float indirect_light_[kPacket];  // in `sums_`, summed over the patterns; kept if shares are required
};

}  // namespace fringeslam::sim
