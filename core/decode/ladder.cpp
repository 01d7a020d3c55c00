// SPDX-License-Identifier: Apache-2.0
#include "core/decode/ladder.h"

#include "core/types/error.h"
#include "core/types/options.h"

namespace fringeslam {

namespace {

std::vector<Rung> single_periods(const std::vector<FringeGroup>& groups) {
  std::vector<Rung> rungs;
  for (size_t g = 0; g < groups.size(); ++g) {
    Rung rung{groups[g].period_px, std::vector<int>(groups.size(), 0)};
    rung.multiples[g] = 1;
    rungs.push_back(rung);
  }
  return rungs;
}

// Difference of two phases, the finer minus the coarser: 1 / beat = 1 / fine - 1 / coarse.
Rung beat(const Rung& coarse, const Rung& fine) {
  Rung result{coarse.period_px * fine.period_px / (coarse.period_px - fine.period_px), fine.multiples};
  for (size_t g = 0; g < fine.multiples.size(); ++g) result.multiples[g] -= coarse.multiples[g];
  return result;
}

}  // namespace

std::vector<Rung> multifrequency_ladder(const std::vector<FringeGroup>& groups, int length_px) {
  if (groups.front().period_px < length_px)
    throw Error("no fringe period covers the projector's " + std::to_string(length_px) + " px (the longest is " +
                to_text(groups.front().period_px) + " px); add one that does");
  return single_periods(groups);
}

std::vector<Rung> heterodyne_ladder(const std::vector<FringeGroup>& groups, int length_px) {
  std::vector<std::vector<Rung>> levels = {single_periods(groups)};
  double longest = 0;
  while (levels.back().size() > 1) {
    const std::vector<Rung>& level = levels.back();
    std::vector<Rung> beats;
    // Beats may be in increasing or decreasing order; only neighbours are combined again.
    for (size_t i = 0; i + 1 < level.size(); ++i) {
      const bool ordered = level[i].period_px > level[i + 1].period_px;
      if (level[i].period_px == level[i + 1].period_px) continue;
      beats.push_back(ordered ? beat(level[i], level[i + 1]) : beat(level[i + 1], level[i]));
    }
    levels.push_back(beats);
    for (const Rung& top : beats) {
      longest = std::max(longest, top.period_px);
      if (top.period_px < length_px) continue;
      // Unwrapping sequence from coarse to fine: the finest phase of each level that is finer than the previous one,
      // ending with the finest period.
      std::vector<Rung> ladder = {top};
      for (size_t l = levels.size() - 1; l-- > 0;) {
        const auto finest = std::min_element(levels[l].begin(), levels[l].end(),
                                             [](const Rung& a, const Rung& b) { return a.period_px < b.period_px; });
        if (finest->period_px < ladder.back().period_px) ladder.push_back(*finest);
      }
      return ladder;
    }
  }
  throw Error("no beat of the fringe periods covers the projector's " + std::to_string(length_px) +
              " px (the longest is " + to_text(longest) + " px); choose periods closer together");
}

}  // namespace fringeslam
