// SPDX-License-Identifier: Apache-2.0
// Depth of metal, white card and black rubber in one view, from three exposures of each pattern. Each exposure by itself
// saturates on one material or loses another in noise.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>
#include <vector>

#include "bench/row.h"
#include "core/decode/decode.h"
#include "core/depth/depth.h"
#include "sim/virtual_rig.h"

namespace fringeslam::bench {

namespace {

struct Depths {
  int lit = 0, compared = 0, dishonest = 0;

  void add(const Frame& frame, const TruthFrame& truth) {
    constexpr float kSigmas = 4;
    for (int row = 0; row < truth.depth_m.rows; ++row) {
      for (int col = 0; col < truth.depth_m.cols; ++col) {
        const int mask = static_cast<int>(truth.mask(row, col));
        if (!(mask & kTruthSurface) || !(mask & kTruthInBeam) || (mask & (kTruthInShadow | kTruthMixed))) continue;
        ++lit;
        const float error = frame.points_m(row, col)[2] - truth.depth_m(row, col);
        if (std::isnan(error)) continue;
        ++compared;
        dishonest += std::abs(error) > kSigmas * frame.sigma_m(row, col);
      }
    }
  }
  double honest_share() const { return static_cast<double>(compared - dishonest) / std::max(1, lit); }
  double dishonest_share() const { return static_cast<double>(dishonest) / std::max(1, compared); }
};

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
  Depths all;
  std::vector<double> exposures;
  std::vector<Depths> single;
  for (int seed = 1; seed <= seeds; ++seed) {
    const sim::Scene scene = sim::load_scene(std::string(FRINGESLAM_SCENES) + "/metal_card_rubber/scene.yaml",
                                             {static_cast<uint64_t>(seed)});
    const auto view = sim::VirtualRig(scene, {}).simulate(scene.patterns);
    const Triangulation triangulation(scene.rig, pixel_rays(scene.rig.camera), 0.4, 2.5);
    const auto add = [&](const FringeStack& stack, Depths& depths) {
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
