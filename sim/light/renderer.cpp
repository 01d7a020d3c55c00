// SPDX-License-Identifier: Apache-2.0
#include "sim/light/renderer.h"

#include <algorithm>
#include <atomic>
#include <limits>
#include <optional>

#include "core/base/constants.h"
#include "core/base/last_result.h"
#include "core/types/selected_instruction_set.h"
#include "sim/light/block_renderer.h"

namespace fringeslam::sim {

namespace {

// BlockRenderer::render is not FRINGESLAM_INLINE: the functions for AVX inline all that it calls.
void render_portable(BlockRenderer& block, int row, int col, std::vector<cv::Mat1f>& images, TruthFrame* truth) {
  block.render(row, col, images, truth);
}
[[gnu::flatten]] FRINGESLAM_AVX2 void render_avx2(BlockRenderer& block, int row, int col,
                                                  std::vector<cv::Mat1f>& images, TruthFrame* truth) {
  block.render(row, col, images, truth);
}
[[gnu::flatten]] FRINGESLAM_AVX512 void render_avx512(BlockRenderer& block, int row, int col,
                                                      std::vector<cv::Mat1f>& images, TruthFrame* truth) {
  block.render(row, col, images, truth);
}

std::shared_ptr<const Panes> panes_of(const Scene& scene, const Effects& effects) {
  auto panes = std::make_shared<const Panes>(scene);
  return effects.panes && !panes->empty() ? panes : nullptr;
}

struct RaysKey {
  Pinhole camera;
  int per_pixel;
  double extent, blur_px, vignetting;
  bool operator==(const RaysKey&) const = default;
};

std::shared_ptr<const SampleRays> rays_of(const RigModel& rig, const Effects& effects, int per_pixel, double extent) {
  const double blur_px = effects.lens_blur ? rig.camera_lens.blur_px : 0;
  const double vignetting = effects.vignetting ? rig.camera_lens.vignetting : 0;
  // The trials of studies and datasets usually have the same camera.
  static LastResult<RaysKey, std::shared_ptr<const SampleRays>> last;
  return last.get({rig.camera, per_pixel, extent, blur_px, vignetting}, [&] {
    return std::make_shared<const SampleRays>(sample_rays(rig.camera, per_pixel, extent, blur_px, vignetting));
  });
}

}  // namespace

Renderer::Renderer(const Scene& scene, const Effects& effects, int samples_per_pixel)
    : scene_(scene),
      effects_(effects),
      world_(std::make_shared<const RayScene>(scene)),
      surfaces_(std::make_shared<const Surfaces>(scene, effects)),
      panes_(panes_of(scene, effects)),
      rays_(rays_of(scene.rig, effects, samples_per_pixel, 1)) {}

Renderer::Renderer(const Renderer& other, const Scene& scene, const Effects& effects, int samples_per_pixel,
                   double extent)
    : scene_(scene),
      effects_(effects),
      world_(other.world_),
      surfaces_(other.surfaces_),
      panes_(other.panes_),
      rays_(rays_of(scene.rig, effects, samples_per_pixel, extent)) {}

namespace {

// Adds smoothed light to the images, and its mean over the patterns to each of `sums`.
void add(IndirectLightBuffer& indirect, std::vector<cv::Mat1f>& images, std::vector<cv::Mat1f> sums) {
  const int steady = indirect.channels - 1;
  for_each_row(indirect.size.height, [&](int row) {
    for (int col = 0; col < indirect.size.width; ++col) {
      const float* lux = indirect.at(row, col);
      const float albedo = indirect.albedo[indirect.index(row, col)];
      for (int k = 0; k < steady; ++k) images[static_cast<size_t>(k)](row, col) += albedo * (lux[k] + lux[steady]);
      for (cv::Mat1f& sum : sums) {
        for (int k = 0; k < steady; ++k) sum(row, col) += albedo * lux[k] / static_cast<float>(steady);
      }
    }
  });
}

}  // namespace

std::vector<cv::Mat1f> Renderer::render(const ProjectedPatterns& patterns, const std::vector<Pose>& world_from_camera,
                                        int stack, TruthFrame* truth, const Stop& stop) const {
  const RigModel& rig = scene_.rig;
  const cv::Size size(rig.camera.width, rig.camera.height);
  std::vector<Station> stations;
  for (const Pose& pose : world_from_camera) stations.push_back({pose, Beam(rig, effects_, pose)});
  std::vector<cv::Mat1f> images(static_cast<size_t>(patterns.count()));
  for (cv::Mat1f& image : images) image.create(size);
  if (truth) {
    for (cv::Mat1f* image : {&truth->depth_m, &truth->projector_column, &truth->projector_row, &truth->temperature_c})
      *image = cv::Mat1f(size, kNaN);
    for (cv::Mat1f* image : {&truth->object_id, &truth->mask}) *image = cv::Mat1f(size, 0.0f);
    for (cv::Mat3f* image : {&truth->position_m, &truth->normals}) *image = cv::Mat3f(size, cv::Vec3f::all(kNaN));
  }
  const int across = (size.width + kBlock - 1) / kBlock, down = (size.height + kBlock - 1) / kBlock;
  std::optional<IndirectLightBuffer> indirect, veil;
  const bool bounces = effects_.interreflection && scene_.bounces > 0;
  const bool share = effects_.share_paths && patterns.count() > 0;
  if (share && bounces) indirect.emplace(size, patterns.count() + 1);
  if (share && effects_.air && scene_.air.extinction_per_m > 0) veil.emplace(size, patterns.count() + 1);
  std::optional<LightShares> shares;
  if (truth && patterns.count() > 0 && (bounces || surfaces_->translucent() || panes_))
    shares = LightShares{cv::Mat1f(size, 0.0f), cv::Mat1f(size, 0.0f)};
  static const auto render_block =
      Variants<render_portable, render_avx2, render_avx512>::of(selected_instruction_set());
  std::atomic<bool> stopped = false;
  for_each_row(down, [&](int block_row) {
    if (stop && (stopped || stop())) return void(stopped = true);
    BlockRenderer block(*this, patterns, stations, stack, indirect ? &*indirect : nullptr, veil ? &*veil : nullptr,
                        shares ? &*shares : nullptr);
    for (int block_col = 0; block_col < across; ++block_col) render_block(block, block_row, block_col, images, truth);
  });
  if (stopped) {
    if (truth) *truth = {};
    return {};
  }
  for (auto* light : {&indirect, &veil}) {
    if (!*light) continue;
    smooth(**light, 1 / rig.camera.fx, world_from_camera.front().translation);
    std::vector<cv::Mat1f> sums;
    if (shares) sums.push_back(shares->total);
    if (shares && light == &indirect) sums.push_back(shares->indirect);
    add(**light, images, sums);
  }
  if (shares) {
    truth->indirect_share.create(size);
    for (int row = 0; row < size.height; ++row) {
      for (int col = 0; col < size.width; ++col) {
        const float total = shares->total(row, col), share_of_it = shares->indirect(row, col) / total;
        truth->indirect_share(row, col) = total > 0 ? std::clamp(share_of_it, 0.0f, 1.0f) : kNaN;
      }
    }
  }
  return images;
}

}  // namespace fringeslam::sim
