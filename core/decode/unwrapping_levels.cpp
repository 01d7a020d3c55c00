// SPDX-License-Identifier: Apache-2.0
#include "core/decode/unwrapping_levels.h"

#include <algorithm>
#include <cmath>
#include <limits>

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

// The periods, the beats of any two, the beats of neighbours among the beats of neighbours and so on, the longest first.
std::vector<UnwrappingLevel> beats_of(const std::vector<UnwrappingLevel>& periods) {
  std::vector<UnwrappingLevel> all = periods;
  const auto add = [&](const UnwrappingLevel& a, const UnwrappingLevel& b) {
    if (a.period_px == b.period_px) return false;
    all.push_back(a.period_px > b.period_px ? beat(a, b) : beat(b, a));
    return true;
  };
  for (size_t i = 0; i < periods.size(); ++i) {
    for (size_t k = i + 2; k < periods.size(); ++k) add(periods[i], periods[k]);
  }
  for (std::vector<UnwrappingLevel> level = periods; level.size() > 1;) {
    std::vector<UnwrappingLevel> next;
    for (size_t i = 0; i + 1 < level.size(); ++i) {
      if (add(level[i], level[i + 1])) next.push_back(all.back());
    }
    level = std::move(next);
  }
  std::stable_sort(all.begin(), all.end(),
                   [](const UnwrappingLevel& a, const UnwrappingLevel& b) { return a.period_px > b.period_px; });
  return all;
}

}  // namespace

double step_noise(const UnwrappingLevel& coarse, const UnwrappingLevel& fine) {
  const double ratio = coarse.period_px / fine.period_px;
  double squares = 0;
  for (size_t g = 0; g < fine.multiples.size(); ++g) {
    const double weight = ratio * coarse.multiples[g] - fine.multiples[g];
    squares += weight * weight;
  }
  return std::sqrt(squares);
}

std::vector<UnwrappingLevel> multifrequency_levels(const std::vector<FringeGroup>& groups, int length_px) {
  if (groups.front().period_px < length_px)
    throw Error("no fringe period covers the projector's " + std::to_string(length_px) + " px (the longest is " +
                to_text(groups.front().period_px) + " px); add one that does");
  return single_periods(groups);
}

std::vector<UnwrappingLevel> heterodyne_levels(const std::vector<FringeGroup>& groups, int length_px) {
  const std::vector<UnwrappingLevel> periods = single_periods(groups), all = beats_of(periods);
  if (all.front().period_px < length_px)
    throw Error("no beat of the fringe periods covers the projector's " + std::to_string(length_px) +
                " px (the longest is " + to_text(all.front().period_px) + " px); choose periods closer together");
  // Best way to each entry: that whose noisiest step is least noisy, then the shortest.
  struct Way {
    double noise = std::numeric_limits<double>::infinity();
    int steps = 0;
    size_t from = 0;
    bool better_than(const Way& other) const {
      constexpr double kEqual = 1e-9;
      return noise < other.noise * (1 - kEqual) || (noise <= other.noise * (1 + kEqual) && steps < other.steps);
    }
  };
  std::vector<Way> ways(all.size());
  size_t finest = 0;
  for (size_t i = 0; i < all.size(); ++i) {
    if (all[i].period_px >= length_px) ways[i] = {0, 0, i};
    for (size_t k = 0; k < i; ++k) {
      if (all[k].period_px <= all[i].period_px) continue;
      const Way way{std::max(ways[k].noise, step_noise(all[k], all[i])), ways[k].steps + 1, k};
      if (way.better_than(ways[i])) ways[i] = way;
    }
    if (all[i].multiples == periods.back().multiples) finest = i;
  }
  std::vector<UnwrappingLevel> levels = {all[finest]};
  for (size_t i = finest; ways[i].from != i; i = ways[i].from) levels.push_back(all[ways[i].from]);
  std::reverse(levels.begin(), levels.end());
  return levels;
}

}  // namespace fringeslam
