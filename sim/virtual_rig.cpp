// SPDX-License-Identifier: Apache-2.0
#include "sim/virtual_rig.h"

#include <cmath>

#include "core/rig/dataset.h"
#include "core/rig/files.h"

namespace fringeslam::sim {

void RenderOptions::check() const {
  check_options(*this, "render");
  const int side = static_cast<int>(std::lround(std::sqrt(samples_per_pixel)));
  if (side * side != samples_per_pixel)
    throw Error("render.samples_per_pixel is " + std::to_string(samples_per_pixel) + "; it must be a square number");
}

VirtualRig::VirtualRig(const Scene& scene, const RenderOptions& options, TruthSink truth)
    : scene_(scene),
      options_((options.check(), options)),
      truth_(std::move(truth)),
      world_(scene),
      rays_(sample_rays(scene.rig.camera, options.samples_per_pixel)) {}

std::optional<FringeStack> VirtualRig::capture(const PatternSequence& sequence) {
  if (next_ >= scene_.trajectory.size()) return std::nullopt;
  const TimedPose& pose = scene_.trajectory[next_];
  const RigModel& rig = scene_.rig;
  TracedView view = trace_view(world_, rig, rays_, pose.world_from_robot * rig.robot_from_camera);

  FringeStack stack;
  stack.index = static_cast<int>(next_);
  stack.timestamp_s = pose.timestamp_s;
  for (size_t i = 0; i < sequence.patterns.size(); ++i) {
    const cv::Mat1f electrons =
        shade(view, options_.samples_per_pixel, sequence.patterns[i], sequence, rig, scene_.ambient_electrons);
    stack.images.push_back(expose(electrons, rig.sensor,
                                  {options_.noise, options_.quantise, scene_.seed, stack.index, static_cast<int>(i)}));
    stack.exposure_s.push_back(1.0 / 360);  // one pattern of the papers' projector (METHOD S1)
  }
  if (truth_) {
    view.truth.index = stack.index;
    view.truth.timestamp_s = pose.timestamp_s;
    view.truth.world_from_robot = pose.world_from_robot;
    truth_(view.truth);
  }
  ++next_;
  return stack;
}

void write_truth(const TruthFrame& truth, const std::filesystem::path& folder) {
  std::vector<cv::Mat> normal(3);
  cv::split(truth.normals, normal);
  write_exr(folder / (stack_name(truth.index) + ".exr"), {{"depth_m", truth.depth_m},
                                                          {"normal.x", normal[0]},
                                                          {"normal.y", normal[1]},
                                                          {"normal.z", normal[2]},
                                                          {"object_id", truth.object_id},
                                                          {"projector_column", truth.projector_column},
                                                          {"mask", truth.mask}});
}

}  // namespace fringeslam::sim
