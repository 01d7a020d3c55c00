// SPDX-License-Identifier: Apache-2.0
// Depth of metal, white card and black rubber in one view, from three exposures of each pattern. Each exposure by itself
// saturates on one material or loses another in noise.
#include <algorithm>
#include <cstdio>
#include <string>
#include <vector>

#include "bench/row.h"
#include "core/decode/decode.h"
#include "core/depth/depth.h"
#include "core/score/depth_honesty.h"
#include "sim/virtual_rig.h"

namespace fringeslam::bench {

namespace {

// The images of one exposure of a stack.
FringeStack at_exposure(const FringeStack& stack, double exposure) {
  FringeStack part = stack;
  part.patterns.patterns.clear();
  part.images.clear();
  part.exposure_s.clear();
  part.exposure_time_s.clear();
  for (size_t i = 0; i < stack.images.size(); ++i) {
    Pattern pattern = stack.patterns.patterns[i];
    if (pattern.exposure != exposure) continue;
    pattern.exposure = 1;
    part.patterns.patterns.push_back(pattern);
    part.images.push_back(stack.images[i]);
    part.exposure_s.push_back(stack.exposure_s[i]);
    part.exposure_time_s.push_back(stack.exposure_time_s[i]);
  }
  return part;
}

std::vector<Row> dynamic_range_rows(const Context& context) {
  const int seeds = context.quick ? 3 : 20;
  DepthHonesty all;
  std::vector<double> exposures;
  std::vector<DepthHonesty> single;
  for (int seed = 1; seed <= seeds; ++seed) {
    const sim::Scene scene = sim::load_scene(std::string(FRINGESLAM_SCENES) + "/metal_card_rubber/scene.yaml",
                                             {static_cast<uint64_t>(seed)});
    const auto view = sim::VirtualRig(scene, {}).simulate(scene.patterns);
    const Triangulation triangulation(scene.rig, pixel_rays(scene.rig.camera), 0.4, 2.5);
    const auto add = [&](const FringeStack& stack, DepthHonesty& depths) {
      Frame frame;
      triangulate(frame, decode(stack, scene.rig, {}), triangulation, {});
      depths.add(frame, view->truth);
    };
    add(view->stack, all);
    if (exposures.empty()) {
      for (const Pattern& pattern : scene.patterns.patterns)
        if (std::find(exposures.begin(), exposures.end(), pattern.exposure) == exposures.end())
          exposures.push_back(pattern.exposure);
      single.resize(exposures.size());
    }
    for (size_t i = 0; i < exposures.size(); ++i) add(at_exposure(view->stack, exposures[i]), single[i]);
  }
  for (size_t i = 0; i < exposures.size(); ++i)
    std::fprintf(stderr, "  exposure %g alone: honest depth on %.4f; beyond 4 sigmas %.1e\n", exposures[i],
                 single[i].honest_share(), single[i].dishonest_share());
  std::fprintf(stderr, "  all: honest depth on %.4f; beyond 4 sigmas %.1e\n", all.honest_share(),
               all.dishonest_share());
  return {bound_row("hdr.valid", all.honest_share(), seeds, "share", 0.99, Limit::least)};
}

}  // namespace

std::vector<Item> dynamic_range_items() {
  return {{{"hdr.valid"},
           "metal, white card and black rubber in one view by three exposures: pixels with depth within 4 sigmas",
           dynamic_range_rows}};
}

}  // namespace fringeslam::bench
