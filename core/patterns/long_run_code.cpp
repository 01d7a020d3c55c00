// SPDX-License-Identifier: Apache-2.0
#include "core/patterns/long_run_code.h"

#include <algorithm>
#include <array>
#include <limits>
#include <mutex>
#include <string>
#include <utility>

#include "core/types/error.h"

namespace fringeslam {

namespace {

// The bit that changes after each word of a cyclic code.
using Changes = std::vector<int>;

struct Runs {
  int shortest = 0, longest = 0;
  // Longer shortest runs first, then shorter longest ones.
  bool operator<(const Runs& other) const {
    return std::pair(shortest, -longest) < std::pair(other.shortest, -other.longest);
  }
};

Runs runs_of(const Changes& changes, int bits) {
  const int length = static_cast<int>(changes.size());
  std::vector<int> last(static_cast<size_t>(bits), -1);
  Runs runs{std::numeric_limits<int>::max(), 0};
  for (int i = 0; i < 2 * length; ++i) {
    int& before = last[static_cast<size_t>(changes[static_cast<size_t>(i % length)])];
    if (before >= 0) runs = {std::min(runs.shortest, i - before), std::max(runs.longest, i - before)};
    before = i;
  }
  return runs;
}

Changes reflected(int bits) {
  Changes changes;
  for (unsigned i = 1; i <= 1U << bits; ++i) {
    int lowest = 0;
    while (lowest < bits - 1 && !(i >> lowest & 1U)) ++lowest;
    changes.push_back(lowest);
  }
  return changes;
}

// Interleaves an m-bit code with a longer one: `shorter_share` of every 2^m changes belong to the shorter code, spread
// evenly. If the share is odd, the pair of both codes' words returns only after all combinations (Goddyn and Gvozdjak,
// theorem 1): the multiples of the pair of both shares reach 2^n pairs, and the changes in between add distinct
// remainders.
Changes interleaved(const Changes& shorter, int shorter_bits, const Changes& longer, size_t shorter_share) {
  const size_t block = shorter.size(), length = shorter.size() * longer.size();
  Changes changes;
  size_t of_shorter = 0, of_longer = 0;
  for (size_t k = 0; k < length; ++k) {
    const size_t at = k % block;
    if ((at + 1) * shorter_share / block > at * shorter_share / block)
      changes.push_back(shorter[of_shorter++ % shorter.size()]);
    else
      changes.push_back(shorter_bits + longer[of_longer++ % longer.size()]);
  }
  return changes;
}

// The best of all ways to interleave two shorter codes.
Changes long_run_changes(int bits) {
  if (bits < 5) return reflected(bits);
  if (bits == 5) {  // runs of at least four
    Changes changes = {0, 1, 2, 3, 0, 4, 2, 1, 0, 3, 2, 1, 0, 4, 2, 3};
    changes.insert(changes.end(), changes.begin(), changes.begin() + 16);
    return changes;
  }
  Changes best;
  Runs best_runs;
  for (int shorter_bits = 1; shorter_bits <= bits / 2; ++shorter_bits) {
    const Changes shorter = long_run_changes(shorter_bits), longer = long_run_changes(bits - shorter_bits);
    for (size_t share = 1; share < shorter.size(); share += 2) {
      Changes changes = interleaved(shorter, shorter_bits, longer, share);
      const Runs runs = runs_of(changes, bits);
      if (!(best_runs < runs)) continue;
      best_runs = runs;
      best = std::move(changes);
    }
  }
  return best;
}

}  // namespace

const std::vector<unsigned>& long_run_code(int bits) {
  static std::array<std::once_flag, kMostLongRunBits + 1> made;
  static std::array<std::vector<unsigned>, kMostLongRunBits + 1> codes;
  if (bits < 1 || bits > kMostLongRunBits)
    throw Error("a Gray code with long runs has 1 to " + std::to_string(kMostLongRunBits) + " bits, not " +
                std::to_string(bits));
  const auto index = static_cast<size_t>(bits);
  std::call_once(made[index], [&] {
    unsigned word = 0;
    for (const int bit : long_run_changes(bits)) {
      codes[index].push_back(word);
      word ^= 1U << (bits - 1 - bit);
    }
  });
  return codes[index];
}

}  // namespace fringeslam
