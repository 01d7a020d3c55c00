// SPDX-License-Identifier: Apache-2.0
#include "bench/studies/statistics.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <numeric>

#include "core/base/constants.h"
#include "core/score/score.h"
#include "sim/random.h"

namespace fringeslam::studies {

namespace {

constexpr int kResamplings = 500;

double mean_of(const std::vector<double>& values) {
  return std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
}

double variance_of(const std::vector<double>& values) {
  const double mean = mean_of(values);
  double sum = 0;
  for (const double value : values) sum += (value - mean) * (value - mean);
  return sum / static_cast<double>(values.size());
}

// Values of `estimate` over rows drawn with replacement.
std::vector<double> resampled(size_t rows, uint64_t seed,
                              const std::function<double(const std::vector<size_t>&)>& estimate) {
  std::vector<double> values;
  for (uint32_t r = 0; r < kResamplings; ++r) {
    sim::Philox random(seed, sim::Stream::draws, r);
    std::vector<size_t> drawn(rows);
    for (size_t& row : drawn)
      row = std::min(rows - 1, static_cast<size_t>(random.uniform() * static_cast<double>(rows)));
    if (const double value = estimate(drawn); std::isfinite(value)) values.push_back(value);
  }
  return values;
}

Interval central_95(const std::vector<double>& values) {
  return {quantile_of(values, 0.025), quantile_of(values, 0.975)};
}

Interval bootstrap(size_t rows, uint64_t seed, const std::function<double(const std::vector<size_t>&)>& estimate) {
  return central_95(resampled(rows, seed, estimate));
}

std::vector<double> picked(const std::vector<double>& values, const std::vector<size_t>& rows) {
  std::vector<double> result;
  for (const size_t row : rows) result.push_back(values[row]);
  return result;
}

std::vector<size_t> all(size_t rows) {
  std::vector<size_t> every(rows);
  std::iota(every.begin(), every.end(), size_t{0});
  return every;
}

}  // namespace

Interval wilson(int successes, int trials) {
  if (trials == 0) return {0, 1};
  constexpr double z = 1.959963984540054;
  const double n = trials, p = successes / n;
  const double centre = (p + z * z / (2 * n)) / (1 + z * z / n);
  const double half = z / (1 + z * z / n) * std::sqrt(p * (1 - p) / n + z * z / (4 * n * n));
  return {successes == 0 ? 0 : centre - half, successes == trials ? 1 : centre + half};
}

SobolIndex sobol(const std::vector<double>& a, const std::vector<double>& b, const std::vector<double>& a_with_b,
                 uint64_t seed) {
  const auto variance = [&](const std::vector<size_t>& rows) {
    std::vector<double> both = picked(a, rows);
    const std::vector<double> more = picked(b, rows);
    both.insert(both.end(), more.begin(), more.end());
    return variance_of(both);
  };
  const auto first = [&](const std::vector<size_t>& rows) {
    double sum = 0;
    for (const size_t r : rows) sum += b[r] * (a_with_b[r] - a[r]);
    return sum / static_cast<double>(rows.size()) / variance(rows);
  };
  const auto total = [&](const std::vector<size_t>& rows) {
    double sum = 0;
    for (const size_t r : rows) sum += (a[r] - a_with_b[r]) * (a[r] - a_with_b[r]);
    return sum / (2 * static_cast<double>(rows.size())) / variance(rows);
  };
  if (a.empty() || variance(all(a.size())) == 0) return {kNaN, kNaN, {kNaN, kNaN}, {kNaN, kNaN}};
  return {first(all(a.size())), total(all(a.size())), bootstrap(a.size(), seed, first),
          bootstrap(a.size(), seed, total)};
}

SobolIndex first_order(const std::vector<double>& parameter, const std::vector<double>& output, int bins,
                       uint64_t seed) {
  const auto index = [&](const std::vector<size_t>& rows) -> double {
    std::vector<size_t> order = rows;
    std::sort(order.begin(), order.end(), [&](size_t i, size_t j) { return parameter[i] < parameter[j]; });
    const double variance = variance_of(picked(output, rows)), mean = mean_of(picked(output, rows));
    if (variance == 0) return kNaN;
    double between = 0, chance = 0;
    const size_t count = order.size(), classes = static_cast<size_t>(bins);
    for (size_t bin = 0; bin < classes; ++bin) {
      std::vector<double> inside;
      for (size_t i = bin * count / classes; i < (bin + 1) * count / classes; ++i) inside.push_back(output[order[i]]);
      if (inside.size() < 2) return kNaN;
      const double off = mean_of(inside) - mean, n = static_cast<double>(inside.size());
      between += n * off * off;
      chance += variance_of(inside) * n / (n - 1) * (1 - n / static_cast<double>(count));
    }
    return (between - chance) / static_cast<double>(count) / variance;
  };
  if (parameter.size() < 2 * static_cast<size_t>(bins)) return {kNaN, kNaN, {kNaN, kNaN}, {kNaN, kNaN}};
  // `chance` removes the noise of the bins once, but resampled rows have it twice: that of the rows and that of the drawing.
  const double estimate = index(all(parameter.size()));
  const std::vector<double> values = resampled(parameter.size(), seed, index);
  if (values.empty()) return {estimate, kNaN, {kNaN, kNaN}, {kNaN, kNaN}};
  const double bias = mean_of(values) - estimate;
  const Interval interval = central_95(values);
  return {estimate, kNaN, {interval.low - bias, interval.high - bias}, {kNaN, kNaN}};
}

}  // namespace fringeslam::studies
