// SPDX-License-Identifier: Apache-2.0
// Random sample consensus over triples (M. Fischler and R. Bolles, CACM 24, 1981).
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <random>

namespace fringeslam {

struct RansacOptions {
  size_t exhaustive_up_to = 0;     // up to that many items, all triples are tried
  int max_triples = 0;             // random triples otherwise
  double miss_probability = 1e-6;  // of never having drawn a triple of inliers; ends the search early
  uint64_t seed = 1;
};

// Number of random triples of which at least one contains only inliers, except with probability `miss`.
inline double triples_needed(double inlier_share, double miss) {
  const double right = std::min(0.999999, inlier_share * inlier_share * inlier_share);
  return right > 0 ? std::ceil(std::log(miss) / std::log1p(-right)) : std::numeric_limits<double>::infinity();
}

// Tries triples of `items` items and returns the best hypothesis; empty if no triple gives one.
//   fit(i, j, k)      returns an optional hypothesis, which has `inliers()`: the number of items that support it
//   better(a, b)      true if hypothesis a replaces the best one so far, b
template <class Fit, class Better>
auto best_of_triples(size_t items, const RansacOptions& options, const Fit& fit, const Better& better)
    -> decltype(fit(size_t{}, size_t{}, size_t{})) {
  decltype(fit(size_t{}, size_t{}, size_t{})) best;
  const auto try_triple = [&](size_t i, size_t j, size_t k) {
    auto hypothesis = fit(i, j, k);
    if (!hypothesis || (best && !better(*hypothesis, *best))) return false;
    best = std::move(hypothesis);
    return true;
  };
  if (items <= options.exhaustive_up_to) {
    for (size_t i = 0; i < items; ++i) {
      for (size_t j = i + 1; j < items; ++j) {
        for (size_t k = j + 1; k < items; ++k) try_triple(i, j, k);
      }
    }
    return best;
  }
  // std::uniform_int_distribution differs between standard libraries; the generator does not.
  std::mt19937_64 random(options.seed);
  double needed = options.max_triples;
  for (int trial = 0; trial < needed; ++trial) {
    const size_t i = random() % items, j = random() % items, k = random() % items;
    if (i == j || j == k || i == k || !try_triple(i, j, k)) continue;
    const double share = static_cast<double>(best->inliers()) / static_cast<double>(items);
    needed = std::min(needed, triples_needed(share, options.miss_probability));
  }
  return best;
}

}  // namespace fringeslam
