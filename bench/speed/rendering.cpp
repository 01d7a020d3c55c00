// SPDX-License-Identifier: Apache-2.0
// Rendering beside bare Embree: the same rays, in the same packets and order, on the same threads, taking turns.
#include <embree3/rtcore.h>

#include <Eigen/Geometry>
#include <chrono>
#include <cstdio>
#include <fstream>
#include <limits>

#include "bench/row.h"
#include "bench/speed/turns.h"
#include "core/types/parallel.h"
#include "sim/virtual_rig.h"

namespace fringeslam::bench {

namespace {

// The default scene's table with 36 rocks on it, of 20 * 4^subdivisions triangles each: 184,000 for 4.
sim::Scene rubble(int subdivisions) {
  sim::Scene scene = sim::load_scene(std::string(FRINGESLAM_SCENES) + "/boxes_and_foam/scene.yaml");
  const sim::Material stone = scene.objects.back().material;
  scene.objects.resize(1);
  for (int i = 0; i < 36; ++i) {
    sim::Object rock;
    rock.mesh = sim::rock_mesh({0.07, 0.05 + 0.001 * i, 0.06}, subdivisions, 0.3, static_cast<uint32_t>(i));
    rock.world_from_object =
        pose_from({{60.0 * (i % 6) - 150, 60.0 * (i / 6) - 150, 20.0 + (i % 5)}, {20.0 * i, 7.0 * i, 31.0 * i}});
    rock.material = stone;
    rock.texture_seed = static_cast<uint32_t>(i);
    scene.objects.push_back(std::move(rock));
  }
  return scene;
}

// The rays of one view: to the surfaces, and from there to the projector.
class BareRays {
 public:
  BareRays(const sim::Scene& scene, const sim::Renderer& renderer)
      : scene_(renderer.world().embree_scene()), blocks_down_((scene.rig.camera.height + 3) / 4) {
    const Pose pose = scene.trajectory.front().world_from_robot * scene.rig.robot_from_camera;
    const Eigen::Vector3d light = pose * scene.rig.projector_from_camera.inverse().translation;
    const int width = scene.rig.camera.width, height = scene.rig.camera.height;
    const auto& rays = renderer.rays();
    for (int block_row = 0; block_row < blocks_down_; ++block_row) {
      starts_.push_back(primary_.size());
      for (int block_col = 0; block_col < (width + 3) / 4; ++block_col) {
        for (int sample = -1; sample < rays.per_pixel; ++sample) {
          sim::RayPacket packet;
          for (int i = 0; i < sim::kPacket; ++i) {
            const int row = std::min(block_row * 4 + i / 4, height - 1),
                      col = std::min(block_col * 4 + i % 4, width - 1);
            const auto pixel = static_cast<size_t>(row * width + col);
            const Eigen::Vector2d ray =
                sample < 0 ? rays.centres[pixel]
                           : rays.samples[pixel * static_cast<size_t>(rays.per_pixel) + static_cast<size_t>(sample)];
            packet.origin.set(i, pose.translation);
            packet.direction.set(i, pose.rotation * ray.homogeneous());
          }
          packet.active = 0xffff;
          add(renderer.world(), packet, light);
        }
      }
    }
    starts_.push_back(primary_.size());
  }

  size_t count() const { return primary_.size() * sim::kPacket + shadow_rays_; }

  void operator()() const {
    for_each_row(blocks_down_, [&](int row) {
      RTCIntersectContext context;
      rtcInitIntersectContext(&context);
      context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
      const auto index = static_cast<size_t>(row);
      for (size_t k = starts_[index]; k < starts_[index + 1]; ++k) {
        alignas(64) RTCRayHit16 hit;
        hit.ray = primary_[k];
        std::fill_n(hit.hit.geomID, sim::kPacket, RTC_INVALID_GEOMETRY_ID);
        rtcIntersect16(valid_.data(), scene_, &context, &hit);
        alignas(64) RTCRay16 shadow = shadow_[k];
        rtcOccluded16(shadow_valid_[k].data(), scene_, &context, &shadow);
      }
    });
  }

 private:
  using Valid = std::array<int, sim::kPacket>;

  static RTCRay16 bare(const sim::Points& origin, const sim::Points& direction, float far) {
    alignas(64) RTCRay16 ray{};
    for (int i = 0; i < sim::kPacket; ++i) {
      ray.org_x[i] = static_cast<float>(origin.x[i]), ray.dir_x[i] = static_cast<float>(direction.x[i]);
      ray.org_y[i] = static_cast<float>(origin.y[i]), ray.dir_y[i] = static_cast<float>(direction.y[i]);
      ray.org_z[i] = static_cast<float>(origin.z[i]), ray.dir_z[i] = static_cast<float>(direction.z[i]);
      ray.tfar[i] = far;
      ray.mask[i] = ~0u;
    }
    return ray;
  }

  void add(const sim::RayWorld& world, const sim::RayPacket& packet, const Eigen::Vector3d& light) {
    primary_.push_back(bare(packet.origin, packet.direction, std::numeric_limits<float>::infinity()));
    sim::HitPacket hits;
    world.trace(packet, hits);
    const sim::Points from = sim::RayWorld::lifted(hits);
    sim::Points to;
    Valid valid{};
    for (int i = 0; i < sim::kPacket; ++i) {
      to.set(i, light - from.at(i));
      const bool towards = sim::has(hits.hit, i) && hits.normal.at(i).dot(to.at(i)) > 0;
      valid[static_cast<size_t>(i)] = towards ? -1 : 0;
      shadow_rays_ += towards;
    }
    shadow_.push_back(bare(from, to, 1));
    shadow_valid_.push_back(valid);
  }

  RTCScene scene_;
  int blocks_down_;
  std::vector<RTCRay16> primary_, shadow_;
  struct alignas(64) AlignedValid : Valid {
    AlignedValid(const Valid& v) : Valid(v) {}
  };
  std::vector<AlignedValid> shadow_valid_;
  AlignedValid valid_{[] {
    Valid all;
    all.fill(-1);
    return all;
  }()};
  std::vector<size_t> starts_;
  size_t shadow_rays_ = 0;
};

// Everything from a pose to the grey values of `steps` images of one period.
class Stack {
 public:
  Stack(const sim::Scene& scene, int patterns) : scene_(scene) {
    sequence_ = phase_shift_sequence(scene.rig.projector.width, scene.rig.projector.height, {16.5},
                                     std::max(patterns, 3), Axis::columns, 8);
    sequence_.patterns.resize(static_cast<size_t>(patterns));
    scene_.trajectory.assign(1000, scene.trajectory.front());
    rig_ = std::make_unique<sim::VirtualRig>(scene_, sim::RenderOptions{}, [](const TruthFrame&) {});
  }
  void operator()() { rig_->capture(sequence_); }

 private:
  sim::Scene scene_;
  PatternSequence sequence_;
  std::unique_ptr<sim::VirtualRig> rig_;
};

std::vector<Row> render_rows(const Context& context) {
  const sim::Scene scene = rubble(4);
  const sim::Renderer renderer(scene, {}, 4);
  const BareRays bare(scene, renderer);
  Stack stack(scene, 3);
  const auto times = take_turns({[&] { bare(); }, [&] { stack(); }}, context.quick ? 5 : 25);
  const double rays = static_cast<double>(bare.count());
  std::fprintf(stderr,
               "  %.2f million rays; bare Embree %.1f ms, %.1f Mray/s; three images with truth %.1f ms, %.1f Mray/s\n",
               1e-6 * rays, 1e3 * median(times[0]), 1e-6 * rays / median(times[0]), 1e3 * median(times[1]),
               1e-6 * rays / median(times[1]));
  return {median_row("speed.render", ratios(times[0], times[1]), "of bare Embree", 0.6, Limit::least)};
}

std::vector<Row> pattern_rows(const Context& context) {
  const sim::Scene scene = rubble(4);
  Stack one(scene, 1), nine(scene, 9);
  const auto times = take_turns({[&] { one(); }, [&] { nine(); }}, context.quick ? 5 : 25);
  std::fprintf(stderr, "  one pattern %.1f ms, nine %.1f ms\n", 1e3 * median(times[0]), 1e3 * median(times[1]));
  return {median_row("speed.patterns", ratios(times[1], times[0]), "x", 1.5)};
}

}  // namespace

std::vector<Item> rendering_items() {
  return {{{"speed.render"}, "a stack of three images, as a share of bare Embree's rays", render_rows},
          {{"speed.patterns"}, "nine patterns against one", pattern_rows}};
}

}  // namespace fringeslam::bench
