// SPDX-License-Identifier: Apache-2.0
#include "sim/light/ray_tracing_baseline.h"

#include <embree3/rtcore.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <limits>

#include "core/base/parallel.h"

namespace fringeslam::sim {

struct RayTracingBaseline::Impl {
  Impl(const Scene& scene, const Renderer& renderer)
      : scene_(renderer.world().embree_scene()), blocks_down_((scene.rig.camera.height + 3) / 4) {
    const Pose pose = scene.trajectory.front().world_from_robot * scene.rig.robot_from_camera;
    const Eigen::Vector3d light = pose * scene.rig.projector_from_camera.inverse().translation;
    const int width = scene.rig.camera.width, height = scene.rig.camera.height;
    const auto& rays = renderer.rays();
    for (int block_row = 0; block_row < blocks_down_; ++block_row) {
      starts_.push_back(primary_.size());
      for (int block_col = 0; block_col < (width + 3) / 4; ++block_col) {
        for (int sample = -1; sample < rays.per_pixel; ++sample) {
          RayPacket packet;
          for (int i = 0; i < kPacket; ++i) {
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

  void trace() const {
    for_each_row(blocks_down_, [&](int row) {
      RTCIntersectContext context;
      rtcInitIntersectContext(&context);
      context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
      const auto index = static_cast<size_t>(row);
      for (size_t k = starts_[index]; k < starts_[index + 1]; ++k) {
        alignas(64) RTCRayHit16 hit;
        hit.ray = primary_[k];
        std::fill_n(hit.hit.geomID, kPacket, RTC_INVALID_GEOMETRY_ID);
        rtcIntersect16(valid_.data(), scene_, &context, &hit);
        alignas(64) RTCRay16 shadow = shadow_[k];
        rtcOccluded16(shadow_valid_[k].data(), scene_, &context, &shadow);
      }
    });
  }

  using Valid = std::array<int, kPacket>;

  static RTCRay16 bare(const Points& origin, const Points& direction, float far) {
    alignas(64) RTCRay16 ray{};
    for (int i = 0; i < kPacket; ++i) {
      ray.org_x[i] = static_cast<float>(origin.x[i]), ray.dir_x[i] = static_cast<float>(direction.x[i]);
      ray.org_y[i] = static_cast<float>(origin.y[i]), ray.dir_y[i] = static_cast<float>(direction.y[i]);
      ray.org_z[i] = static_cast<float>(origin.z[i]), ray.dir_z[i] = static_cast<float>(direction.z[i]);
      ray.tfar[i] = far;
      ray.mask[i] = ~0u;
    }
    return ray;
  }

  void add(const RayScene& world, const RayPacket& packet, const Eigen::Vector3d& light) {
    primary_.push_back(bare(packet.origin, packet.direction, std::numeric_limits<float>::infinity()));
    HitPacket hits;
    world.trace(packet, hits);
    const Points from = RayScene::lifted(hits);
    Points to;
    Valid valid{};
    for (int i = 0; i < kPacket; ++i) {
      to.set(i, light - from.at(i));
      const bool towards = has(hits.hit, i) && hits.normal.at(i).dot(to.at(i)) > 0;
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

RayTracingBaseline::RayTracingBaseline(const Scene& scene, const Renderer& renderer)
    : impl_(std::make_unique<Impl>(scene, renderer)) {}
RayTracingBaseline::~RayTracingBaseline() = default;

size_t RayTracingBaseline::count() const { return impl_->primary_.size() * kPacket + impl_->shadow_rays_; }

void RayTracingBaseline::operator()() const { impl_->trace(); }

}  // namespace fringeslam::sim
