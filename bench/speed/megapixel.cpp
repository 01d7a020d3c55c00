// SPDX-License-Identifier: Apache-2.0
// Cameras of one to five megapixels: the cost per pixel of each stage, relative to that of the papers' camera.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <limits>
#include <map>
#include <string>

#include "bench/row.h"
#include "bench/speed/interleaving.h"
#include "core/base/stage_clock.h"
#include "core/decode/decode.h"
#include "core/mapper/pipeline.h"
#include "core/patterns/patterns.h"
#include "sim/virtual_rig.h"

namespace fringeslam::bench {

namespace {

// The scene `loop` seen by a camera with the same field of view and this many pixels.
sim::Scene loop_with_pixels(double pixels) {
  sim::Scene scene = sim::load_scene(std::string(FRINGESLAM_SCENES) + "/loop/scene.yaml");
  Pinhole& camera = scene.rig.camera;
  const double scale = std::sqrt(pixels / (camera.width * camera.height));
  const int width = static_cast<int>(std::lround(scale * camera.width)),
            height = static_cast<int>(std::lround(scale * camera.height));
  camera.fx *= scale;
  camera.fy *= scale;
  camera.cx = scale * (camera.cx + 0.5) - 0.5;
  camera.cy = scale * (camera.cy + 0.5) - 0.5;
  camera.width = width;
  camera.height = height;
  return scene;
}

// Seconds per view of each stage, the least of `runs` runs.
std::map<std::string, double> stage_seconds(const sim::Scene& scene, const std::vector<FringeStack>& stacks, int runs) {
  std::map<std::string, double> least;
  for (int run = 0; run < runs; ++run) {
    StageClock clock;
    Pipeline pipeline(scene.rig, scene.patterns, {}, scene.trajectory[0].world_from_robot);
    {
      const StageClock::Use use(clock);
      for (const FringeStack& stack : stacks) pipeline.process(stack);
      clock.leave();
    }
    std::map<std::string, double> seconds = clock.seconds();
    seconds["surface"] = seconds_of([&] { pipeline.surface(); });
    for (const auto& [stage, value] : seconds) {
      double& best = least.emplace(stage, std::numeric_limits<double>::infinity()).first->second;
      best = std::min(best, value / static_cast<double>(stacks.size()));
    }
  }
  return least;
}

// Stages that take less than this share of a view are not compared.
constexpr double kNegligible = 0.02;

std::vector<Row> pixel_rows(const Context& context) {
  constexpr std::array kMegapixels = {0.266, 1.3, 5.0};
  const int views = context.quick ? 3 : 6, runs = context.quick ? 1 : 3;
  std::map<std::string, std::array<double, kMegapixels.size()>> ns_per_pixel;
  for (size_t i = 0; i < kMegapixels.size(); ++i) {
    const sim::Scene scene = loop_with_pixels(1e6 * kMegapixels[i]);
    sim::VirtualRig rig(scene, {});
    std::vector<FringeStack> stacks;
    for (int view = 0; view < views; ++view) stacks.push_back(*rig.capture(scene.patterns));
    const double pixels = static_cast<double>(scene.rig.camera.width) * scene.rig.camera.height;
    for (const auto& [stage, seconds] : stage_seconds(scene, stacks, runs))
      ns_per_pixel[stage][i] = 1e9 * seconds / pixels;
  }
  double view_ns = 0;
  for (const auto& [stage, ns] : ns_per_pixel) view_ns += ns[0];
  std::fprintf(stderr, "  ns per pixel at 0.27, 1.3 and 5 megapixels\n");
  std::vector<Row> rows;
  for (const auto& [stage, ns] : ns_per_pixel) {
    std::fprintf(stderr, "  %-10s %7.1f %7.1f %7.1f\n", stage.c_str(), ns[0], ns[1], ns[2]);
    if (ns[0] < kNegligible * view_ns) continue;
    rows.push_back(
        bound_row("speed.megapixel." + stage, std::max(ns[1], ns[2]) / ns[0], views * runs, "x", 1.3, Limit::most));
  }
  return rows;
}

std::vector<Row> decode_rows(const Context& context) {
  const sim::Scene scene = loop_with_pixels(1.3e6);
  const PatternSequence sequence = phase_shift_sequence(scene.rig.projector.width, scene.rig.projector.height,
                                                        {1040, 131, 16.5}, 4, Axis::columns, 8);
  const FringeStack stack = *sim::VirtualRig(scene, {}).capture(sequence);
  DecodedStack decoded;
  const auto times =
      interleaved_times({[&] { decode_into(decoded, stack, scene.rig, {}, {}); }}, context.quick ? 10 : 50);
  const Row row = median_row("speed.decode.large", in_ms(times[0]), "ms", 40);
  std::fprintf(stderr, "  %.0f Mpixel/s of one phase map from twelve images\n",
               1e-3 * static_cast<double>(stack.images.front().total()) / row.value);
  return {row};
}

}  // namespace

std::vector<Item> megapixel_items() {
  return {{{"speed.decode.large"}, "twelve images of 1.3 megapixels to absolute phase with sigma", decode_rows},
          {{"speed.megapixel"}, "cost per pixel with 1.3 and 5 megapixels, relative to 0.27", pixel_rows}};
}

}  // namespace fringeslam::bench
