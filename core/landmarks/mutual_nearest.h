// SPDX-License-Identifier: Apache-2.0
// Brute-force search for mutual nearest neighbours between two sets of descriptors (docs/method.md, section 5.4).
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <type_traits>
#include <vector>

#include "core/base/parallel.h"

namespace fringeslam {

template <class Number>
struct NearestNeighbour {
  static constexpr Number kFar = std::numeric_limits<Number>::has_infinity ? std::numeric_limits<Number>::infinity()
                                                                           : std::numeric_limits<Number>::max();
  int index = -1;                           // -1 if there is none
  Number distance2 = kFar, second2 = kFar;  // squared distances to the nearest and the second nearest
};

// Returns for each of `queries` elements the nearest of `candidates` elements; among equal distances the lowest index
// wins. `distance2(query, candidate)` returns the squared distance.
template <class Distance2, class Number = std::invoke_result_t<Distance2, int, int>>
std::vector<NearestNeighbour<Number>> nearest_neighbours(int queries, int candidates, const Distance2& distance2) {
  std::vector<NearestNeighbour<Number>> result(static_cast<size_t>(queries));
  for_each_row(queries, [&](int q) {
    NearestNeighbour<Number>& best = result[static_cast<size_t>(q)];
    for (int c = 0; c < candidates; ++c) {
      const Number d2 = distance2(q, c);
      if (d2 < best.distance2) {
        best = {c, d2, best.distance2};
      } else if (d2 < best.second2) {
        best.second2 = d2;
      }
    }
  });
  return result;
}

struct MutualPair {
  int earlier = 0, current = 0;  // indices of the elements
  double distance = 0;
  double ratio = 0;  // of the distances of `current` to its nearest and second-nearest element
};

// Returns the pairs of elements that are each other's nearest neighbours and whose ratio is at most `max_ratio`, in the
// order of `current`. `distance2(earlier, current)` returns the squared distance; `least2` is the least squared distance
// of the second-nearest element in the ratio.
template <class Distance2, class Number = std::invoke_result_t<Distance2, int, int>>
std::vector<MutualPair> mutual_nearest(int earlier, int current, const Distance2& distance2, Number least2,
                                       double max_ratio) {
  const auto back = nearest_neighbours(current, earlier, [&](int c, int e) { return distance2(e, c); });
  const auto forth = nearest_neighbours(earlier, current, distance2);
  std::vector<MutualPair> pairs;
  for (int c = 0; c < current; ++c) {
    const NearestNeighbour<Number>& best = back[static_cast<size_t>(c)];
    if (best.index < 0 || forth[static_cast<size_t>(best.index)].index != c) continue;
    const auto nearest2 = static_cast<double>(best.distance2);
    const double ratio = std::sqrt(nearest2 / std::max(best.second2, least2));
    if (ratio <= max_ratio) pairs.push_back({best.index, c, std::sqrt(nearest2), ratio});
  }
  return pairs;
}

}  // namespace fringeslam
