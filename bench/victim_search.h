// SPDX-License-Identifier: Apache-2.0
// One scene of scenes/victims through the whole pipeline: victims found, and other objects mistaken for victims.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "core/score/victim_score.h"

namespace fringeslam::bench {

struct VictimSearchResult {
  VictimScore score;
  // Number of warm objects examined, and of those mistaken for a victim, by predominant material.
  std::map<std::string, int> things, wrong;
  std::vector<std::string> failures;  // human-readable
  int views = 0, tracked = 0;
  double valid = 1;                    // fraction of lit pixels with depth, in the worst view
  std::vector<double> translations_m;  // errors of the motions between consecutive views
};

// `changes` to the scene: paths and YAML values.
VictimSearchResult search_for_victims(uint64_t seed,
                                      const std::vector<std::pair<std::string, std::string>>& changes = {});

// Settles the piles of these seeds, two at a time, so that they are in the cache.
void prepare_victim_scenes(uint64_t first_seed, int count);

}  // namespace fringeslam::bench
