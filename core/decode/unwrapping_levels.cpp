// SPDX-License-Identifier: Apache-2.0
#include "core/decode/unwrapping_levels.h"

#include "core/types/error.h"
#include "core/types/options.h"

namespace fringeslam {

namespace {

std::vector<UnwrappingLevel> single_periods(const std::vector<FringeGroup>& groups) {
  std::vector<UnwrappingLevel> unwrapping_levels;
  for (size_t g = 0; g < groups.size(); ++g) {
    UnwrappingLevel rung{groups[g].period_px, std::vector<int>(groups.size(), 0)};
    rung.multiples[g] = 1;
    unwrapping_levels.push_back(rung);
  }
  return unwrapping_levels;
}

// Difference of two phases, the finer minus the coarser: 1 / beat = 1 / fine - 1 / coarse.
UnwrappingLevel beat(const UnwrappingLevel& coarse, const UnwrappingLevel& fine) {
  UnwrappingLevel result{coarse.period_px * fine.period_px / (coarse.period_px - fine.period_px), fine.multiples};
  for (size_t g = 0; g < fine.multiples.size(); ++g) result.multiples[g] -= coarse.multiples[g];
  return result;
}

}  // namespace

std::vector<UnwrappingLevel> multifrequency_levels(const std::vector<FringeGroup>& groups, int length_px) {
  if (groups.front().period_px < length_px)
    throw Error("no fringe period covers the projector's " + std::to_string(length_px) + " px (the longest is " +
                to_text(groups.front().period_px) + " px); add one that does");
  return single_periods(groups);
}

std::vector<UnwrappingLevel> heterodyne_levels(const std::vector<FringeGroup>& groups, int length_px) {
  std::vector<std::vector<UnwrappingLevel>> levels = {single_periods(groups)};
  double longest = 0;
  while (levels.back().size() > 1) {
    const std::vector<UnwrappingLevel>& level = levels.back();
    std::vector<UnwrappingLevel> beats;
    // Beats may be in increasing or decreasing order; only neighbours are combined again.
    for (size_t i = 0; i + 1 < level.size(); ++i) {
      const bool ordered = level[i].period_px > level[i + 1].period_px;
      if (level[i].period_px == level[i + 1].period_px) continue;
      beats.push_back(ordered ? beat(level[i], level[i + 1]) : beat(level[i + 1], level[i]));
    }
    levels.push_back(beats);
    for (const UnwrappingLevel& top : beats) {
      longest = std::max(longest, top.period_px);
      if (top.period_px < length_px) continue;
      // Unwrapping sequence from coarse to fine: the finest phase of each level that is finer than the previous one,
      // ending with the finest period.
      std::vector<UnwrappingLevel> ladder = {top};
      for (size_t l = levels.size() - 1; l-- > 0;) {
        const auto finest = std::min_element(
            levels[l].begin(), levels[l].end(),
            [](const UnwrappingLevel& a, const UnwrappingLevel& b) { return a.period_px < b.period_px; });
        if (finest->period_px < ladder.back().period_px) ladder.push_back(*finest);
      }
      return ladder;
    }
  }
  throw Error("no beat of the fringe periods covers the projector's " + std::to_string(length_px) +
              " px (the longest is " + to_text(longest) + " px); choose periods closer together");
}

}  // namespace fringeslam
