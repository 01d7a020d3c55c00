// SPDX-License-Identifier: Apache-2.0
// Interleaved timing of several workloads, so that other load on the machine affects all of them alike.
#pragma once

#include <algorithm>
#include <chrono>
#include <functional>
#include <vector>

namespace fringeslam::bench {

inline double seconds_of(const std::function<void()>& work) {
  const auto start = std::chrono::steady_clock::now();
  work();
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

// Returns the seconds of each workload in each turn, after a warm-up turn.
inline std::vector<std::vector<double>> interleaved_times(const std::vector<std::function<void()>>& works, int turns) {
  std::vector<std::vector<double>> times(works.size());
  for (int turn = -1; turn < turns; ++turn) {
    for (size_t i = 0; i < works.size(); ++i) {
      const double seconds = seconds_of(works[i]);
      if (turn >= 0) times[i].push_back(seconds);
    }
  }
  return times;
}

inline double median(std::vector<double> values) {
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2), values.end());
  return values[values.size() / 2];
}

inline std::vector<double> in_ms(std::vector<double> seconds) {
  for (double& s : seconds) s *= 1e3;
  return seconds;
}

// Ratios, turn by turn.
inline std::vector<double> ratios(const std::vector<double>& slow, const std::vector<double>& fast) {
  std::vector<double> result;
  for (size_t i = 0; i < slow.size(); ++i) result.push_back(slow[i] / fast[i]);
  return result;
}

}  // namespace fringeslam::bench
