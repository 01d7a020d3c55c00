// SPDX-License-Identifier: Apache-2.0
// One world of scenes/victims through the whole pipeline: which victims were found, and what else was taken for one.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "core/score/victim_score.h"

namespace fringeslam::bench {

struct Searched {
  VictimScore score;
  // Warm things that were looked at and those of them wrongly taken for a victim, by the material that shows most.
  std::map<std::string, int> things, wrong;
  std::vector<std::string> failures;  // in words
  int views = 0, tracked = 0;
  double valid = 1;                    // share of lit pixels with a depth, of the worst view
  std::vector<double> translations_m;  // errors of the motions from view to view
};

// `changes` to the scene: paths and YAML.
Searched search_for_victims(uint64_t seed, const std::vector<std::pair<std::string, std::string>>& changes = {});

// Settles the piles of these seeds, two at a time; they are in the cache then.
void settle_victims(uint64_t first_seed, int count);

}  // namespace fringeslam::bench
