// SPDX-License-Identifier: Apache-2.0
#include "core/types/options.h"

#include <algorithm>
#include <charconv>
#include <numeric>

namespace fringeslam {

namespace {

size_t edit_distance(const std::string& a, const std::string& b) {
  std::vector<size_t> row(b.size() + 1);
  std::iota(row.begin(), row.end(), size_t{0});
  for (size_t i = 1; i <= a.size(); ++i) {
    size_t diagonal = row[0];
    row[0] = i;
    for (size_t j = 1; j <= b.size(); ++j) {
      const size_t above = row[j];
      row[j] = std::min({row[j] + 1, row[j - 1] + 1, diagonal + (a[i - 1] == b[j - 1] ? 0 : 1)});
      diagonal = above;
    }
  }
  return row.back();
}

}  // namespace

std::string to_text(double value) {
  char buffer[64];
  const auto end = std::to_chars(buffer, buffer + sizeof buffer, value).ptr;
  return {buffer, end};
}

std::string range_error(const std::string& name, double value, const Range& range) {
  return name + " is " + to_text(value) + "; it must lie in [" + to_text(range.low) + ", " + to_text(range.high) + "]";
}

std::string nearest_name(const std::string& unknown, const std::vector<std::string>& known) {
  std::string best;
  constexpr size_t kLongest = 100;  // longest name considered; the cost grows with the product of both lengths
  if (unknown.size() > kLongest) return best;
  size_t best_distance = std::max<size_t>(3, unknown.size() / 2) + 1;
  for (const std::string& name : known) {
    if (name.size() > kLongest) continue;
    const size_t distance = edit_distance(unknown, name);
    if (distance < best_distance) {
      best_distance = distance;
      best = name;
    }
  }
  return best;
}

}  // namespace fringeslam
