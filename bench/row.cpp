// SPDX-License-Identifier: Apache-2.0
#include "bench/row.h"

#include <random>

#include "core/score/score.h"

namespace fringeslam::bench {

Row median_row(const std::string& id, const std::vector<double>& values, const std::string& unit, double limit,
               Limit direction) {
  std::mt19937_64 random(1);
  std::vector<double> medians;
  std::vector<double> sample(values.size());
  for (int resampling = 0; resampling < 2000; ++resampling) {
    for (double& value : sample) value = values[random() % values.size()];
    medians.push_back(median_of(sample));
  }
  Row row;
  row.id = id;
  row.value = median_of(values);
  row.unit = unit;
  row.n = static_cast<int>(values.size());
  row.interval_low = quantile_of(medians, 0.025);
  row.interval_high = quantile_of(medians, 0.975);
  row.limit = limit;
  row.direction = direction;
  row.pass = direction == Limit::most ? row.value <= limit : row.value >= limit;
  return row;
}

Row bound_row(const std::string& id, double value, int n, const std::string& unit, double limit, Limit direction) {
  Row row = median_row(id, {value}, unit, limit, direction);
  row.n = n;
  return row;
}

}  // namespace fringeslam::bench
